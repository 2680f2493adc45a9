"""From the nodes of one pair to heights of map cells.

Strategy: four neighbouring nodes span two triangles. Where the parallax is continuous, a triangle gives every cell centre inside it
a height by linear interpolation. At a parallax discontinuity (roof edge, wall) there is no triangle: each node gives its own height
to the cells within half a node distance, but only to cells that no triangle covers. Where a cell gets several heights the highest
wins, because a surface model holds what is visible from above. All coordinates refer to the whole grid, so tiles agree with it.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from orthomill.kernels.kernel_compilation import njit
from orthomill.schemas.raster import MapGrid, Window
from orthomill.tasks.densification.ground_intersection import NodesOnGround
from orthomill.tasks.densification.settings.surface_settings import Gridding

_ALL_TRIANGLES = 6
"""triangles that meet in a node inside the grid"""
_ON_EDGE = 1e-9
"""share of a triangle within which a cell centre counts as lying on its edge: without it rounding leaves seams of empty cells"""


@dataclass(frozen=True)
class HeightCells:
    """Heights (rows, cols) float64 and their standard errors float32, m; NaN where there is none."""

    height: np.ndarray
    sigma: np.ndarray


class _NodeArrays(NamedTuple):
    """(rows, cols): place in cells of the whole grid, height and standard error m, parallax px."""

    col: np.ndarray
    row: np.ndarray
    z: np.ndarray
    sigma: np.ndarray
    parallax: np.ndarray


class _Corner(NamedTuple):
    """A node as the corner of a triangle."""

    col: float
    row: float
    z: float
    sigma: float


class _GriddingLimits(NamedTuple):
    """Greatest parallax difference (px) within a triangle, reach of a single node (cells), heights that are allowed (m)."""

    max_jump: np.float32
    reach: float
    low: float
    high: float


class _CellArrays(NamedTuple):
    """The window to fill: its first row and column in the whole grid, heights (float64) and standard errors (float32), m."""

    first_row: int
    first_col: int
    height: np.ndarray
    sigma: np.ndarray


@njit(inline="always")
def _corner(nodes, i, j):
    """The node (i, j) as a corner of triangles."""
    return _Corner(nodes.col[i, j], nodes.row[i, j], nodes.z[i, j], nodes.sigma[i, j])


@njit(inline="always")
def _keep_highest(cells, r, c, z, sigma):
    """Keep `z` (m) with its `sigma` in the cell (r, c) of the grid, unless a higher one is there."""
    if not cells.height[r - cells.first_row, c - cells.first_col] >= z:
        cells.height[r - cells.first_row, c - cells.first_col] = z
        cells.sigma[r - cells.first_row, c - cells.first_col] = sigma


@njit(inline="always")
def _triangle(p, q, s, cells):
    """Linear interpolation by barycentric coordinates at the cell centres inside the triangle p, q, s."""
    area = (q.col - p.col) * (s.row - p.row) - (s.col - p.col) * (q.row - p.row)
    # Nodes that lie behind one another in plan (a wall seen obliquely) span no area; NaN nodes fail this test as well.
    if not abs(area) > 1e-9:
        return
    last_row, last_col = cells.first_row + cells.height.shape[0] - 1, cells.first_col + cells.height.shape[1] - 1
    top = max(int(np.ceil(min(p.row, q.row, s.row))), cells.first_row)
    bottom = min(int(np.floor(max(p.row, q.row, s.row))), last_row)
    left = max(int(np.ceil(min(p.col, q.col, s.col))), cells.first_col)
    right = min(int(np.floor(max(p.col, q.col, s.col))), last_col)
    for r in range(top, bottom + 1):
        for c in range(left, right + 1):
            u = ((c - p.col) * (s.row - p.row) - (s.col - p.col) * (r - p.row)) / area
            v = ((q.col - p.col) * (r - p.row) - (c - p.col) * (q.row - p.row)) / area
            if u >= -_ON_EDGE and v >= -_ON_EDGE and u + v <= 1.0 + _ON_EDGE:
                z = p.z + u * (q.z - p.z) + v * (s.z - p.z)
                _keep_highest(cells, r, c, z, p.sigma + u * (q.sigma - p.sigma) + v * (s.sigma - p.sigma))


@njit()
def _triangulate(nodes, limits, cells, joined):
    """Fills the cells inside triangles; `joined` (rows, cols) counts the triangles that meet in every node."""
    for i in range(joined.shape[0] - 1):
        for j in range(joined.shape[1] - 1):
            # Parallaxes decide, not heights: a jump of 1.5 px is the same evidence at any scale and base. NaN fails both tests.
            upper, lower = nodes.parallax[i, j + 1], nodes.parallax[i + 1, j]
            if not abs(upper - lower) <= limits.max_jump:
                continue
            for half in range(2):
                k, m = (i, j) if half == 0 else (i + 1, j + 1)
                value = nodes.parallax[k, m]
                if not (abs(value - upper) <= limits.max_jump and abs(value - lower) <= limits.max_jump):
                    continue
                if not (limits.low <= nodes.z[k, m] <= limits.high):
                    continue
                joined[k, m] += 1
                joined[i, j + 1] += 1
                joined[i + 1, j] += 1
                _triangle(_corner(nodes, k, m), _corner(nodes, i, j + 1), _corner(nodes, i + 1, j), cells)


@njit()
def _cover(nodes, limits, joined, rows, alone):
    """Gives the height of every node at a discontinuity, of those in the range `rows`, to the cells around it."""
    last_row, last_col = alone.first_row + alone.height.shape[0] - 1, alone.first_col + alone.height.shape[1] - 1
    for i in range(rows[0], rows[1]):
        for j in range(joined.shape[1]):
            if joined[i, j] >= _ALL_TRIANGLES or not (limits.low <= nodes.z[i, j] <= limits.high):
                continue
            top, bottom = int(np.ceil(nodes.row[i, j] - limits.reach)), int(np.floor(nodes.row[i, j] + limits.reach))
            left, right = int(np.ceil(nodes.col[i, j] - limits.reach)), int(np.floor(nodes.col[i, j] + limits.reach))
            for r in range(max(top, alone.first_row), min(bottom, last_row) + 1):
                for c in range(max(left, alone.first_col), min(right, last_col) + 1):
                    _keep_highest(alone, r, c, nodes.z[i, j], nodes.sigma[i, j])


@njit()
def _add(nodes, limits, rows, cells, alone):
    """Adds the nodes of the range `rows`; those in the rows beside it, where there are some, complete their triangles."""
    joined = np.zeros(nodes.parallax.shape, np.uint8)
    _triangulate(nodes, limits, cells, joined)
    _cover(nodes, limits, joined, rows, alone)


@njit()
def _complete(cells, alone):
    """Fill cells that no triangle covers with those of single nodes, `alone`."""
    for r in range(cells.height.shape[0]):
        for c in range(cells.height.shape[1]):
            if np.isnan(cells.height[r, c]):
                cells.height[r, c], cells.sigma[r, c] = alone.height[r, c], alone.sigma[r, c]


@dataclass(frozen=True)
class TargetCells:
    """The cells to be filled: `window` of `grid`, heights within (low, high) m."""

    grid: MapGrid
    window: Window
    heights: tuple[float, float]


def grid_nodes(nodes: NodesOnGround, node_distance: float, target: TargetCells, settings: Gridding) -> HeightCells:
    """Heights of the target's cells from the nodes of one pair; node_distance: of nodes on the ground, m."""
    window, cell = target.window, target.grid.cell
    cells, alone = _empty_cells(window), _empty_cells(window)
    # At least half a cell: nodes finer than the cells would otherwise miss every cell centre at a discontinuity.
    reach = max(settings.node_reach * node_distance / cell, 0.5)
    arrays = _NodeArrays(*target.grid.pixel(nodes.x, nodes.y), nodes.z, nodes.sigma, nodes.parallax)
    limits = _GriddingLimits(np.float32(settings.max_jump), reach, *target.heights)
    _add(arrays, limits, (0, len(nodes.z)), cells, alone)
    _complete(cells, alone)
    return HeightCells(cells.height, cells.sigma)


def _empty_cells(window: Window) -> _CellArrays:
    return _CellArrays(window.row, window.col, np.full(window.shape, np.nan), np.full(window.shape, np.nan, np.float32))


class ValueRows(NamedTuple):
    """Rows of values (rows, cols) that lie at col, row (px) of an image, with the rows above and below them, where there are some,
    which belong to other strips; `own`: the first row of the strip itself, and the one behind its last."""

    col: np.ndarray
    row: np.ndarray
    value: np.ndarray
    own: tuple[int, int]


def rasterised(strips: Iterable[ValueRows], shape: tuple[int, int], max_jump: float, reach: float) -> np.ndarray:
    """The greatest of the values that fall on every pixel of an image of `shape`, float32, NaN where there is none.

    Neighbours whose values differ by more than `max_jump` are not connected; each covers the pixels within `reach` px of it. How
    the values are cut in strips makes no difference.
    """
    # Kept apart until the end: a value at a break must not overwrite what triangles say beside it.
    cells, alone = (_empty_cells(Window(0, 0, *shape)) for _ in range(2))
    limits = _GriddingLimits(np.float32(max_jump), reach, -np.inf, np.inf)
    for strip in strips:
        nodes = _NodeArrays(
            strip.col, strip.row, strip.value, np.zeros(strip.value.shape, np.float32), strip.value.astype(np.float32)
        )
        _add(nodes, limits, strip.own, cells, alone)
    _complete(cells, alone)
    return cells.height.astype(np.float32)
