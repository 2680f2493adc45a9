"""The two surfaces at a wall: planes through the smooth heights above and below the step, continued to the cells between them.

Matching windows that contain both surfaces blur the edge of a roof over several cells, and no height between its interior and the
free ground is trustworthy. But beside that strip both surfaces are smooth, so each is continued into it; which of them is there is
a question of its own (`likeness`).

Strategy: heights that touch no wall are taken, measured or not, from a window of cells and sorted; their largest gap, when it is a
wall, divides them. A plane with weights that fall with the distance goes through either part. Where a part is no plane (a wood,
rubble) there are no two surfaces.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numba import njit

from orthomill.tasks.visibility.height_model import WALL

REACH = 5
"""cells around a cell whose heights determine its two surfaces: twice as far as matching windows blur an edge"""
FEWEST = 6
"""cells that a surface needs"""
_FLAT = 0.5  # of a wall: the greatest standard deviation of heights from their plane
_NEAR = 2.0  # cells^2 added to the squared distance in weights: the nearest cells share the noise
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


@njit(cache=True)
def _plane(heights, right, down, count, middle, above, plane):
    """Fills `plane` (3) with the plane at the window's centre through the heights on one side of `middle`; returns their weighted
    mean square distance from it."""
    total, mean = 0.0, 0.0
    for k in range(count):
        if (heights[k] > middle) == above:
            weight = 1.0 / (_NEAR + right[k] ** 2 + down[k] ** 2)
            total += weight
            mean += weight * heights[k]
    mean /= total
    # Normal equations of three unknowns, written out: a library call for every cell would cost as much as all the rest.
    x, y, xx, xy, yy, xz, yz = 0.0, 0.0, _RIDGE, 0.0, _RIDGE, 0.0, 0.0
    for k in range(count):
        if (heights[k] > middle) == above:
            weight = 1.0 / (_NEAR + right[k] ** 2 + down[k] ** 2) / total
            x += weight * right[k]
            y += weight * down[k]
            xx += weight * right[k] * right[k]
            xy += weight * right[k] * down[k]
            yy += weight * down[k] * down[k]
            xz += weight * right[k] * (heights[k] - mean)
            yz += weight * down[k] * (heights[k] - mean)
    # About the mean place the height is the mean, and two unknowns are left.
    a, b, c = xx - x * x, xy - x * y, yy - y * y
    determinant = a * c - b * b
    slope_x, slope_y = (xz * c - yz * b) / determinant, (yz * a - xz * b) / determinant
    plane[0], plane[1], plane[2] = mean - slope_x * x - slope_y * y, slope_x, slope_y
    square = 0.0
    for k in range(count):
        if (heights[k] > middle) == above:
            off = heights[k] - plane[0] - plane[1] * right[k] - plane[2] * down[k]
            square += off * off / (_NEAR + right[k] ** 2 + down[k] ** 2) / total
    return square


@njit(cache=True)
def _divide(heights, smooth, near, wall, upper, lower):
    """Fills `upper` and `lower` at the cells `near` a wall."""
    rows, cols = heights.shape
    most = (2 * REACH + 1) ** 2
    values, right, down = np.empty(most), np.empty(most), np.empty(most)
    for r in range(rows):
        for c in range(cols):
            if not near[r, c]:
                continue
            count = 0
            for i in range(max(r - REACH, 0), min(r + REACH + 1, rows)):
                for j in range(max(c - REACH, 0), min(c + REACH + 1, cols)):
                    if smooth[i, j]:
                        values[count], right[count], down[count] = heights[i, j], j - c, i - r
                        count += 1
            ordered = np.sort(values[:count])
            gap, middle = 0.0, 0.0
            for k in range(FEWEST - 1, count - FEWEST):
                if ordered[k + 1] - ordered[k] > gap:
                    gap, middle = ordered[k + 1] - ordered[k], 0.5 * (ordered[k] + ordered[k + 1])
            if gap < wall:
                continue
            limit = (_FLAT * wall) ** 2
            above = _plane(values, right, down, count, middle, True, upper[r, c])
            below = _plane(values, right, down, count, middle, False, lower[r, c])
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
