"""The cameras of a block as tables: what the adjustment changed, and how strongly its parameters are correlated."""

from collections.abc import Iterator

from orthomill.schemas.camera import INTERIOR
from orthomill.schemas.stage_report import Grid
from orthomill.tasks.orientation.examined.block_facts import Facts
from orthomill.tasks.orientation.examined.block_numbers import interior_correlations, interior_sigmas

K1 = INTERIOR.index("k1")


def camera_grids(facts: Facts) -> tuple[Grid, ...]:
    """The table of all cameras, and one of correlations for every camera that was adjusted."""
    return _cameras(facts), *_correlations(facts)


def _cameras(facts: Facts) -> Grid:
    rows: list[tuple[str | float | None, ...]] = []
    for name, camera in facts.shown_cameras.items():
        before, sigma = facts.given_camera(name), interior_sigmas(camera)
        rows += [
            (name, parameter, before.interior[i], camera.interior[i], sigma[i], camera.interior[i] - before.interior[i])
            for i, parameter in enumerate(INTERIOR)
            if parameter in camera.parameters
        ]
        # The unit of the calibration literature, in which k1 can be compared with published values.
        k1, sigma_k1 = (before.value("k1") / before.c**2, camera.value("k1") / camera.c**2), sigma[K1]
        rows.append((name, "k1 in px^-2", *k1, sigma_k1 / camera.c**2 if sigma_k1 else None, None))
    more = len(facts.block.cameras) - len(facts.shown_cameras)
    return Grid(
        title="Cameras",
        columns=("camera", "parameter", "before", "adjusted", "standard error", "change"),
        rows=tuple(rows),
        note="c, x0, y0 in pixels. No standard error: the parameter was fixed. A standard error without a change: the parameter "
        "was not adjusted, but its uncertainty was propagated to all results."
        + (f" {more} more cameras are in products/cameras.json." if more else ""),
    )


def _correlations(facts: Facts) -> Iterator[Grid]:
    for name, camera in facts.shown_cameras.items():
        free = [i for i, sigma in enumerate(interior_sigmas(camera)) if sigma]
        # One parameter has no correlation.
        if len(free) < 2:
            continue
        values = interior_correlations(camera, free)
        yield Grid(
            title=f"Correlations of the interior orientation, camera {name}",
            columns=("", *(INTERIOR[i] for i in free)),
            rows=tuple((INTERIOR[i], *(round(v, 2) for v in values[k])) for k, i in enumerate(free)),
            note="Near 1 or -1: only the two together are known.",
        )
