"""The height of a surface at a surveyed point, and whether it can be tested there.

The height is the one that a user reads off the file: bilinear between the four cells around. It is tested on ground that is one
plane for some cells around, for beside an edge the height compares two places. What is not tested is counted and told, never
passed over: a surface that is rough at every point has no good class.

Source: ASPRS Positional Accuracy Standards, edition 2, 7.10: check points on flat or uniformly sloping open ground, at least as far
from abrupt changes of height as the data resolve, slopes of 10 % or less.
"""

from dataclasses import dataclass

import numpy as np

from orthomill.schemas.accuracy.point_tests import TESTED, UNEVEN, WITHOUT_HEIGHT, HeightTest, PlaceTest
from orthomill.schemas.observations import NO_HEIGHT
from orthomill.schemas.raster import MapGrid, Window
from orthomill.schemas.surface import MEASURED

REACH = 3
"""cells around the point that must be one plane"""
STEP_SIGMAS, STEP_CELLS = 4.0, 0.5
"""how far a cell may leave this plane: so many stated standard errors, or so many cells of width where that is more"""
_ROUNDS = 5


@dataclass(frozen=True)
class CellsAround:
    """Cells of a surface around a point: (rows, cols) heights and standard errors m, codes of Provenance or None where they are not
    known (a surface of another program), at `window` of `grid`."""

    grid: MapGrid
    window: Window
    height: np.ndarray
    sigma: np.ndarray
    code: np.ndarray | None = None
    datum: np.ndarray | None = None
    """the part of the standard errors that is the place of the block, m; None: not known"""


def cells_around(grid: MapGrid, x: float, y: float) -> Window:
    """The window (not clipped) that the test of a point at x, y (m) reads."""
    col, row = grid.pixel(x, y)
    # One more: the four cells between which the point lies need not be centred on its own.
    side = 2 * REACH + 3
    return Window(int(np.floor(row + 0.5)) - REACH - 1, int(np.floor(col + 0.5)) - REACH - 1, side, side)


def height_at(cells: CellsAround, x: float, y: float, steepest: float) -> HeightTest:
    """The surface at x, y (m); steepest: rise over run up to which heights are tested."""
    if cells.window.empty:
        return HeightTest(reason="outside of the surface")
    between, weight = _four(cells, x, y)
    if between is None:
        return HeightTest(reason="at the border of the surface")
    values = cells.height[between]
    if not np.isfinite(values).all():
        return HeightTest(reason="the surface has no height here", uneven=True)
    height, stated = float((weight * values).sum()), float((weight * cells.sigma[between]).sum())
    sigma, datum = (stated if np.isfinite(stated) else None), _shared(cells, between, weight)
    plane = _ground_plane(cells, x, y)
    if plane is None:
        return HeightTest(reason="beside a hole of the surface", height=height, sigma=sigma, datum=datum, uneven=True)
    slope, step = plane
    known = {"height": height, "sigma": sigma, "datum": datum, "slope": slope, "step": step}
    uneven = _uneven(cells, step)
    if uneven:
        return HeightTest(reason=uneven, uneven=True, **known)
    return HeightTest(reason=f"on a slope of {100 * slope:.0f} %" if slope > steepest else TESTED, **known)


def beside_survey(test: HeightTest | None, sigma_z: float) -> HeightTest | None:
    """The test of a height at a point surveyed with a standard error (m) in height; untested where that says it has none."""
    return test.model_copy(update={"reason": WITHOUT_HEIGHT}) if test and test.tested and sigma_z >= NO_HEIGHT else test


def on_even_ground(place: PlaceTest, height: HeightTest | None) -> PlaceTest:
    """The test of a place in an orthoimage, untested where the surface says that the ground around is uneven: patches are drawn on
    one plane, and what rises above it or is hidden behind it is another picture in each photograph and in the orthoimage."""
    return place.model_copy(update={"reason": UNEVEN}) if place.tested and height and height.uneven else place


def _shared(cells: CellsAround, between: tuple[slice, slice], weight: np.ndarray) -> float | None:
    if cells.datum is None:
        return None
    found = float((weight * cells.datum[between]).sum())
    return found if np.isfinite(found) else None


def _four(cells: CellsAround, x: float, y: float) -> tuple[tuple[slice, slice] | None, np.ndarray]:
    """The four cells between which a point lies, and their bilinear weights (2, 2)."""
    col, row = cells.grid.pixel(x, y)
    i, j = int(np.floor(row)) - cells.window.row, int(np.floor(col)) - cells.window.col
    f, g = row - np.floor(row), col - np.floor(col)
    weight = np.outer([1 - f, f], [1 - g, g])
    rows, cols = cells.height.shape
    if i < 0 or j < 0 or i + 2 > rows or j + 2 > cols:
        return None, weight
    return (slice(i, i + 2), slice(j, j + 2)), weight


def _ground_plane(cells: CellsAround, x: float, y: float) -> tuple[float, float] | None:
    """Slope of the plane through most cells within reach, and the largest distance of a cell from it, m; None beside holes."""
    east, north = cells.grid.centres(cells.window)
    dx, dy = np.meshgrid((east - x) / cells.grid.cell, (north - y) / cells.grid.cell)
    near = np.hypot(dx, dy) <= REACH
    known = near & np.isfinite(cells.height)
    if known.sum() < 0.75 * near.sum() or known.sum() < 9:
        return None
    design, z = np.column_stack([np.ones(known.sum()), dx[known], dy[known]]), cells.height[known].astype(np.float64)
    weight = np.ones(len(z))
    for _ in range(_ROUNDS):
        found = np.linalg.lstsq(design * weight[:, None], z * weight, rcond=None)[0]
        away = np.abs(z - design @ found)
        # Absolute values (L1): the plane of the larger part, so that a wall beside the point stands out instead of tilting it.
        weight = 1 / np.sqrt(np.maximum(away, 1e-4))
    return float(np.hypot(found[1], found[2])) / cells.grid.cell, float(away.max())


def _uneven(cells: CellsAround, step: float) -> str | None:
    """Why the ground around is not one measured plane; None where it is."""
    if cells.code is not None and not np.isin(cells.code, MEASURED).all():
        share = 1 - float(np.isin(cells.code, MEASURED).mean())
        if share > 0.1:
            return f"{100 * share:.0f} % of the heights around are estimated"
    spread = STEP_SIGMAS * float(np.nan_to_num(np.nanmedian(cells.sigma)) if np.isfinite(cells.sigma).any() else 0.0)
    if step > max(spread, STEP_CELLS * cells.grid.cell):
        return f"beside an edge: heights {step:.2g} m off the ground's plane within {REACH} cells"
    return None
