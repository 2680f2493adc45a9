"""The two surfaces at a wall: planes through the smooth heights above and below the step, continued to the cells between them.

Matching windows that contain both surfaces blur the edge of a roof over several cells, and no height between its interior and the
free ground is trustworthy. But beside that strip both surfaces are smooth, so each is continued into it; which of them is there is
a question of its own (`likeness`).

Strategy: heights that touch no wall are taken, measured or not, from a window of cells; their largest gap, when it is a wall,
divides them. A plane with weights that fall with the distance goes through either part. Where a part is no plane (a wood,
rubble) there are no two surfaces.
"""

from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np

from orthomill.kernels.kernel_compilation import njit
from orthomill.tasks.visibility.height_model import WALL

REACH = 7
"""cells around a cell whose heights determine its two surfaces: three times as far as matching windows blur an edge, so that smooth
cells beside it, whose colours are examples of a surface, see the other one as well"""
FEWEST = 6
"""cells that a surface needs"""
_FLAT = 0.5  # of a wall: the greatest standard deviation of heights from their plane
_NEAR = 2.0  # cells^2 added to the squared distance in weights: the nearest cells share the noise
_INTERVALS = 256  # of half a wall; more relief in so small a window is rare and takes a sort
_RIDGE = 0.5  # cells^2: cells in one row give no slope across it


@dataclass(frozen=True)
class WallSurfaces:
    """Two surfaces at the cells (rows, cols) near walls.

    `upper`, `lower` (rows, cols, 3) float32: height m, slopes to the right and downwards, m per cell; NaN where no wall is near.
    `smooth` bool: cells that touch no wall; `certain`: those of them that are measured with all their neighbours.
    """

    upper: np.ndarray
    lower: np.ndarray
    smooth: np.ndarray
    certain: np.ndarray

    @property
    def doubtful(self) -> np.ndarray:
        """bool (rows, cols): cells between two surfaces that do not certainly belong to one of them"""
        return np.isfinite(self.upper[..., 0]) & ~self.certain


class _Around(NamedTuple):
    """The smooth heights around a cell, m, their places to the right of it and below, cells, and their weights."""

    heights: np.ndarray
    right: np.ndarray
    down: np.ndarray
    weights: np.ndarray


@njit()
def _plane(around, count, middle, above, plane):
    """Fills `plane` (3) with the plane at the window's centre through the heights on one side of `middle`; returns their weighted
    mean square distance from it."""
    heights, right, down, weights = around
    total, mean = 0.0, 0.0
    for k in range(count):
        if (heights[k] > middle) == above:
            total += weights[k]
            mean += weights[k] * heights[k]
    mean /= total
    # Normal equations of three unknowns, written out: a library call for every cell would cost as much as all the rest.
    x, y, xx, xy, yy, xz, yz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(count):
        weight = weights[k] if (heights[k] > middle) == above else 0.0
        across, along, height = weight * right[k], weight * down[k], heights[k] - mean
        x += across
        y += along
        xx += across * right[k]
        xy += across * down[k]
        yy += along * down[k]
        xz += across * height
        yz += along * height
    x, y, xz, yz = x / total, y / total, xz / total, yz / total
    # About the mean place the height is the mean, and two unknowns are left.
    a, b, c = xx / total + _RIDGE - x * x, xy / total - x * y, yy / total + _RIDGE - y * y
    determinant = a * c - b * b
    slope_x, slope_y = (xz * c - yz * b) / determinant, (yz * a - xz * b) / determinant
    plane[0], plane[1], plane[2] = mean - slope_x * x - slope_y * y, slope_x, slope_y
    square = 0.0
    for k in range(count):
        weight = weights[k] if (heights[k] > middle) == above else 0.0
        off = heights[k] - plane[0] - plane[1] * right[k] - plane[2] * down[k]
        square += weight * off * off
    return square / total


class _Storeys(NamedTuple):
    """Heights by intervals of half a wall: their number in each, the lowest and the highest of them."""

    number: np.ndarray
    low: np.ndarray
    high: np.ndarray


@njit()
def _gap_between(heights, count, wall, storeys):
    """The largest gap of a wall or more between heights that leaves FEWEST of them on either side, and its middle; 0 for none.

    Heights on either side of such a gap never share an interval of half a wall, so nothing has to be sorted.
    """
    bottom, top = heights[:count].min(), heights[:count].max()
    width = 0.5 * wall
    intervals = int((top - bottom) / width) + 1
    if top - bottom < wall or intervals > storeys.number.size:
        return _widest_gap(np.sort(heights[:count]), count, wall) if top - bottom >= wall else (0.0, 0.0)
    storeys.number[:intervals] = 0
    for k in range(count):
        n = min(int((heights[k] - bottom) / width), intervals - 1)
        if storeys.number[n] == 0:
            storeys.low[n] = storeys.high[n] = heights[k]
        storeys.number[n] += 1
        storeys.low[n], storeys.high[n] = min(storeys.low[n], heights[k]), max(storeys.high[n], heights[k])
    gap, middle, below, last = 0.0, 0.0, storeys.number[0], storeys.high[0]
    for n in range(1, intervals):
        if storeys.number[n] == 0:
            continue
        here = storeys.low[n] - last
        if here >= wall and here > gap and FEWEST <= below <= count - FEWEST:
            gap, middle = here, 0.5 * (storeys.low[n] + last)
        below, last = below + storeys.number[n], storeys.high[n]
    return gap, middle


@njit()
def _widest_gap(ordered, count, wall):
    """As `_gap_between` for sorted heights, however far apart."""
    gap, middle = 0.0, 0.0
    for k in range(FEWEST - 1, count - FEWEST):
        here = ordered[k + 1] - ordered[k]
        if here >= wall and here > gap:
            gap, middle = here, 0.5 * (ordered[k] + ordered[k + 1])
    return gap, middle


@njit()
def _divide(heights, smooth, near, wall, upper, lower):
    """Fills `upper` and `lower` at the cells `near` a wall."""
    rows, cols = heights.shape
    most = (2 * REACH + 1) ** 2
    around = _Around(np.empty(most), np.empty(most), np.empty(most), np.empty(most))
    storeys = _Storeys(np.zeros(_INTERVALS, np.int64), np.empty(_INTERVALS), np.empty(_INTERVALS))
    limit = (_FLAT * wall) ** 2
    shares = np.empty((2 * REACH + 1, 2 * REACH + 1))
    for i in range(-REACH, REACH + 1):
        for j in range(-REACH, REACH + 1):
            shares[i + REACH, j + REACH] = 1.0 / (_NEAR + i**2 + j**2)
    for r in range(rows):
        for c in range(cols):
            if not near[r, c]:
                continue
            count = 0
            for i in range(max(r - REACH, 0), min(r + REACH + 1, rows)):
                for j in range(max(c - REACH, 0), min(c + REACH + 1, cols)):
                    if smooth[i, j]:
                        around.heights[count], around.right[count], around.down[count] = heights[i, j], j - c, i - r
                        around.weights[count] = shares[i - r + REACH, j - c + REACH]
                        count += 1
            gap, middle = _gap_between(around.heights, count, wall, storeys)
            if gap == 0.0:
                continue
            above = _plane(around, count, middle, True, upper[r, c])
            below = _plane(around, count, middle, False, lower[r, c])
            if above > limit or below > limit:
                upper[r, c], lower[r, c] = np.nan, np.nan


def wall_surfaces(heights: np.ndarray, measured: np.ndarray, cell: float) -> WallSurfaces:
    """The two surfaces at walls of heights (rows, cols) m, `measured` bool; `cell` m. Cells nearer than REACH to an edge of the
    arrays that is not one of the model may differ from those of the whole model."""
    wall = WALL * cell
    smooth = np.isfinite(heights) & (_range(heights, np.isfinite(heights), 3) < wall)
    upper, lower = (np.full((*heights.shape, 3), np.nan, np.float32) for _ in range(2))
    near = _range(heights, smooth, 2 * REACH + 1) > wall
    if near.any():
        _divide(heights.astype(np.float64), smooth, near, wall, upper, lower)
    # Beyond the edge of the model nothing is measured.
    around = cv2.erode(measured.astype(np.uint8), np.ones((3, 3), np.uint8), borderType=cv2.BORDER_CONSTANT, borderValue=0)
    return WallSurfaces(upper, lower, smooth, smooth & (around > 0))


def _range(heights: np.ndarray, known: np.ndarray, side: int) -> np.ndarray:
    """float32 (rows, cols) m: highest minus lowest of the known heights in a window of `side` cells; -inf where there is none."""
    window = np.ones((side, side), np.uint8)
    top = cv2.dilate(np.where(known, heights, -np.inf).astype(np.float32), window, borderType=cv2.BORDER_REPLICATE)
    bottom = cv2.erode(np.where(known, heights, np.inf).astype(np.float32), window, borderType=cv2.BORDER_REPLICATE)
    return np.asarray(top - bottom)


def at_pixels(planes: np.ndarray, divisor: int) -> np.ndarray:
    """float32 (rows divisor, cols divisor) m: heights of planes (rows, cols, 3) at the pixels into which the cells are divided."""
    height, right, down = (np.repeat(np.repeat(planes[..., k], divisor, 0), divisor, 1) for k in range(3))
    inside = ((np.arange(divisor) + 0.5) / divisor - 0.5).astype(np.float32)
    dx, dy = (np.tile(inside, count) for count in (planes.shape[1], planes.shape[0]))
    return np.asarray(height + right * dx[None, :] + down * dy[:, None])
