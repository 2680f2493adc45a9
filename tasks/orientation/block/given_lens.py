"""Distortion that was given, kept its values, and does not fit: that of another lens, focus, zoom or model.

A given lens is tested as a given camera constant is: with its radial coefficients free one step shows where the block wants them.
Nothing else shows it. A wrong distortion of some pixels bends the ground by decimetres while the photographs, which share it, agree
with each other nearly as well as before.
"""

from dataclasses import replace

import numpy as np

from orthomill.schemas.camera import INTERIOR
from orthomill.schemas.errors import GeometryError
from orthomill.schemas.findings.camera_findings import LensContradicted
from orthomill.tasks.adjustment.testing.adjustment_result import Adjustment
from orthomill.tasks.geometry.distortion import BROWN, DIVISION, LENS, LensNumbers, lens_partials, undistort_point
from orthomill.tasks.orientation.block.camera_constant import step_in

RADIAL = np.array([INTERIOR.index("k1"), INTERIOR.index("k2")])
"""The first two coefficients: with more of them free the border would follow the noise."""
CONTRADICTED = 25.0
"""Squared length of the step in its standard errors: five of them, as for camera constants. Lenses depart from every model."""
NOTICEABLE = 0.5
"""px by which the step moves the border of the frame at least: less is what lenses change from day to day"""
OUTER = 95.0
"""Percentile of the radii of the measurements that counts as the border: beyond it nothing was measured."""


def contradicted_lenses(result: Adjustment, names: tuple[str, ...]) -> tuple[LensContradicted, ...]:
    """The cameras, called `names`, whose given radial distortion was held and contradicts the measurements."""
    network, present = result.network, np.unique(result.network.camera_of[result.rays.photo[result.used]])
    held = np.zeros_like(network.interior.free)
    held[np.ix_(present, RADIAL)] = ~network.interior.free[np.ix_(present, RADIAL)]
    lens = network.interior.lens
    if lens is not None:
        held[lens == DIVISION, RADIAL[1]] = False
    if not held.any():
        return ()
    freed = replace(network, interior=replace(network.interior, free=network.interior.free | held))
    try:
        step, cofactor = step_in(freed, result)
    except GeometryError:
        return ()
    return tuple(
        found
        for k in np.flatnonzero(held.any(axis=1))
        if (
            found := _contradicted(
                result, int(k), names[k], freed.interior_columns[k], step, cofactor.joint(freed.interior_columns[k])
            )
        )
    )


def _contradicted(
    result: Adjustment, camera: int, name: str, columns: np.ndarray, step: np.ndarray, covariance: np.ndarray
) -> LensContradicted | None:
    """The finding of one camera; `columns` (k,) of its interior parameters among the unknowns, `covariance` (k, k) of these."""
    radial = np.array([i for i in RADIAL if columns[i] >= 0])
    own, change = covariance[np.ix_(radial, radial)], np.where(columns >= 0, step[columns], 0.0)
    ratio = float(change[radial] @ np.linalg.pinv(own, hermitian=True) @ change[radial])
    moved = _moved_border(result, camera, change)
    if not ratio > CONTRADICTED or moved < max(NOTICEABLE, result.sigma0_px):
        return None
    given = result.state.interior[camera]
    return LensContradicted(
        camera=name,
        given=tuple(float(given[i]) for i in radial),
        fits=tuple(float(given[i] + change[i]) for i in radial),
        border_px=moved,
        ratio=float(np.sqrt(ratio)),
    )


def _moved_border(result: Adjustment, camera: int, change: np.ndarray) -> float:
    """px by which a change of the interior orientation moves what lies at the border of the frame, less what a scale explains."""
    state, rays = result.state, result.rays
    own = result.used & (result.network.camera_of[rays.photo] == camera)
    lens = _lens_of(result, camera)
    c = float(state.interior[camera, 0])
    border = float(np.percentile(np.linalg.norm(rays.xy[own] - state.interior[camera, 1:3], axis=1), OUTER)) / c
    radii = np.linspace(0.1, 1.0, 10) * border
    moved = np.array([_moved_at(radius, c, lens, change) for radius in radii])
    # A scale of all radii is a camera constant, which has a test of its own.
    scale = float(moved @ radii / (radii @ radii))
    return float(np.abs(moved - scale * radii).max())


def _moved_at(radius: float, c: float, lens: LensNumbers, change: np.ndarray) -> float:
    partials = np.zeros((2, len(LENS)))
    ideal, _ = undistort_point(radius, 0.0, lens)
    lens_partials(ideal, 0.0, lens, partials)
    return float(change[0] * radius + c * (partials[0] @ change[3:]))


def _lens_of(result: Adjustment, camera: int) -> LensNumbers:
    codes = result.network.interior.lens
    return LensNumbers._make((*map(float, result.state.interior[camera, 3:]), BROWN if codes is None else float(codes[camera])))
