"""The shift of a surface from a file as it was given, with a standard error that holds what pairs add alike everywhere."""

import numpy as np

from orthomill.tasks.dsm_check.surfaces.surface_shift import SurfaceShift


def whole_shift(placed: SurfaceShift, raised: float, moved: bool) -> SurfaceShift:
    """The shift of a surface as it was given. placed: after it was brought to the tie points; raised: m, by how much it was raised
    for the check; moved: whether it was moved back in plan as well."""
    if not placed.in_plan:
        # The shape of a surface, a tilt or a dome, takes the sign of a shift in plan that is not there, and one in height with it.
        return placed.model_copy(update={"up": -raised, "up_sigma": placed.level_sigma or placed.up_sigma})
    return placed.model_copy(update={"up": (0.0 if moved else placed.up - placed.level) - raised})


def with_pairs_apart(found: SurfaceShift, medians: list[float]) -> SurfaceShift:
    """A shift whose standard error in height holds what the orientation of every pair adds alike all over the surface, and no
    scatter of blocks can show: that of the mean of the pairs' medians (m)."""
    known = np.array([median for median in medians if np.isfinite(median)])
    if len(known) < 2:
        return found
    return found.model_copy(update={"up_sigma": float(np.hypot(found.up_sigma, known.std(ddof=1) / np.sqrt(len(known))))})
