"""Which points of a surface a photograph sees: the ray from the point to the projection centre must stay above the height model.

Strategy: march along the ray, one cell at a time along the axis in which it advances faster, and compare its height with the
surface (interpolated linearly between the two adjacent cells). For every block of the model the greatest height around it is known,
so a ray above it skips the block; above the greatest height of the model it is free. Only the surface along the ray matters, so a
tile with a large enough halo gives exactly the answer of the whole model.

Holes are bridged for this test (and for draping) from the nearest heights in eight directions: an unmeasured spot on a roof still
hides the ground behind it. Holes wider than the bridge hide nothing.

Source: visibility by the surface nearest to the projection centre, Petsa et al. 2007 (sources/blending.md, M5); the exact
ray replaces the triangle look-up. Widening of occlusions: M10, on the ground instead of in the image.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import cv2
import numpy as np

from orthomill.kernels.kernel_compilation import njit
from orthomill.schemas.raster import MapGrid, Window
from orthomill.tasks.geometry.view import View

BLOCK, FINE_BLOCK = 16, 4
"""Side of the blocks whose greatest height lets a ray skip them, cells: large ones, and small ones for the first steps."""
WALL = 2.0
"""A step between neighbouring cells of more than this many cells is a wall, not a slope."""
# Factor on the tolerance: beyond this slope the noise of the model no longer grows with it, for its cells smooth it.
MOST_SLOPE = 2.0


@dataclass(frozen=True)
class HeightModel:
    """A window of a height model: `heights` (rows, cols) m with NaN for holes, at `window` of `grid`."""

    heights: np.ndarray
    grid: MapGrid
    window: Window

    @cached_property
    def terrain(self) -> "Terrain":
        """The model for the kernels, the same for all views."""
        heights = np.ascontiguousarray(self.heights, np.float32)
        ceilings = _ceiling(heights, BLOCK), _ceiling(heights, FINE_BLOCK)
        top = float(ceilings[0].max(initial=-np.inf))
        return Terrain(heights, *ceilings, top, self.window.row, self.window.col, WALL * self.grid.cell)


class Terrain(NamedTuple):
    """The height model for the kernels: `ceiling` and `fine_ceiling` as from `_ceiling`, `top` the greatest height, `row`, `col` of
    the first cell in the whole model, `wall` in m."""

    heights: np.ndarray
    ceiling: np.ndarray
    fine_ceiling: np.ndarray
    top: float
    row: int
    col: int
    wall: float


class CentrePlace(NamedTuple):
    """The projection centre in columns and rows of the whole model, and m."""

    col: float
    row: float
    z: float


@njit()
def _sweep(heights, gap, downwards, total, weights):
    """Adds, for every hole, the nearest heights of four of its eight directions: those behind a sweep over rows and columns.

    The sweep carries the distance and the height of the last valid cell along each direction instead of searching for it, so its
    time does not depend on `gap`. A sweep in the opposite direction adds the other four.
    """
    rows, cols = heights.shape
    steps = np.full((2, 3, cols + 2), gap + 1)
    value = np.zeros((2, 3, cols + 2), heights.dtype)
    for i in range(rows):
        r = i if downwards else rows - 1 - i
        now, before = i % 2, 1 - i % 2
        aside, height_aside = gap + 1, heights[r, 0]
        for j in range(cols):
            c = j if downwards else cols - 1 - j
            if not np.isnan(heights[r, c]):
                steps[now, :, c + 1] = 0
                value[now, :, c + 1] = heights[r, c]
                aside, height_aside = 0, heights[r, c]
                continue
            aside = min(aside + 1, gap + 1)
            if not downwards and aside <= gap:
                total[r, c] += 1.0 / aside * height_aside
                weights[r, c] += 1.0 / aside
            for k in range(3):
                near = min(steps[before, k, c + k] + 1, gap + 1)
                steps[now, k, c + 1] = near
                value[now, k, c + 1] = value[before, k, c + k]
                if near <= gap:
                    weight = 1.0 / (near * (1.0 if k == 1 else np.sqrt(2.0)))
                    total[r, c] += weight * value[now, k, c + 1]
                    weights[r, c] += weight
            if downwards and aside <= gap:
                total[r, c] += 1.0 / aside * height_aside
                weights[r, c] += 1.0 / aside


def bridge_holes(heights: np.ndarray, gap: int) -> np.ndarray:
    """Heights (rows, cols) with holes filled from the nearest heights in eight directions at most `gap` cells away, weighted by
    inverse distance.

    Where there is none within `gap`, NaN remains. The result at a cell depends on the cells within `gap` only. float32.
    """
    heights = np.ascontiguousarray(heights, np.float32)
    holes = np.isnan(heights)
    if not holes.any():
        return heights
    # float64, so that a constant height is reproduced exactly and no ripple appears on a bridged plane.
    total, weights = np.zeros(heights.shape), np.zeros(heights.shape)
    for downwards in (True, False):
        _sweep(heights, gap, downwards, total, weights)
    with np.errstate(invalid="ignore"):
        return np.where(holes, total / weights, heights).astype(np.float32)


@njit()
def _block_maxima(heights, side, out):
    """Raises `out`, -inf at first, to the greatest heights of blocks of `side` x `side` cells."""
    rows, cols = heights.shape
    # First over the rows of the blocks, many columns at a time.
    tops = np.empty(cols, np.float32)
    for first in range(0, rows, side):
        tops[:] = -np.inf
        for r in range(first, min(first + side, rows)):
            for c in range(cols):
                # A comparison with NaN is false: a hole has no height.
                tops[c] = heights[r, c] if heights[r, c] > tops[c] else tops[c]
        for c in range(cols):
            out[first // side, c // side] = max(out[first // side, c // side], tops[c])


def _ceiling(heights: np.ndarray, side: int) -> np.ndarray:
    """Per block of `side` x `side` cells, the greatest height in it and in the blocks around it; -inf where there is none."""
    blocks = np.full((-(-heights.shape[0] // side), -(-heights.shape[1] // side)), -np.inf, np.float32)
    _block_maxima(heights, side, blocks)
    return cv2.dilate(blocks, np.ones((3, 3), np.uint8), borderType=cv2.BORDER_REPLICATE)


@njit(inline="always")
def _surface_between(a, b, share, wall):
    """Height between two cells: linear, but the nearer one's on either side of a wall; the other one's next to a hole."""
    if np.isnan(a):
        return b
    if np.isnan(b):
        return a
    if abs(b - a) > wall:
        return a if share < 0.5 else b
    return a + share * (b - a)


@njit(inline="always")
def _surface_at(terrain, y, x, by_row):
    """Height at a point of the march, where the coordinate along the march is an integer; NaN outside."""
    heights, wall = terrain.heights, terrain.wall
    height, width = heights.shape
    if by_row:
        r, low = int(np.floor(y + 0.5)) - terrain.row, int(np.floor(x))
        c = low - terrain.col
        if r < 0 or r >= height or c + 1 < 0 or c >= width:
            return np.nan
        return _surface_between(heights[r, max(c, 0)], heights[r, min(c + 1, width - 1)], x - low, wall)
    c, low = int(np.floor(x + 0.5)) - terrain.col, int(np.floor(y))
    r = low - terrain.row
    if c < 0 or c >= width or r + 1 < 0 or r >= height:
        return np.nan
    return _surface_between(heights[max(r, 0), c], heights[min(r + 1, height - 1), c], y - low, wall)


@njit()
def _is_free(terrain, row, col, z, start, centre):
    """Whether the surface leaves the ray free that rises from the target (row, col, z) m at the height `start` to the centre."""
    height, width = terrain.heights.shape
    dr, dc = centre.row - row, centre.col - col
    steps = max(abs(dr), abs(dc))
    if steps < 1.0:
        return True
    sr, sc, sz = dr / steps, dc / steps, (centre.z - z) / steps
    by_row = abs(dr) >= abs(dc)
    place, ahead = (row, sr) if by_row else (col, sc)
    # The first step ends on a row (or column) of cell centres: from then on only the other coordinate is interpolated.
    step = np.floor(place) + 1.0 - place if ahead > 0 else place - np.ceil(place) + 1.0
    while step < steps:
        ray = start + sz * step
        if ray - 0.5 * sz > terrain.top:
            return True
        y, x = row + sr * step, col + sc * step
        near_r, near_c = int(np.floor(y + 0.5)) - terrain.row, int(np.floor(x + 0.5)) - terrain.col
        if near_r < 0 or near_c < 0 or near_r >= height or near_c >= width:
            return True
        # The ceiling covers the neighbouring blocks too, so nothing within the next block can reach the ray.
        if ray - 0.5 * sz > terrain.ceiling[near_r // BLOCK, near_c // BLOCK]:
            step += BLOCK - 1
            continue
        if ray - 0.5 * sz > terrain.fine_ceiling[near_r // FINE_BLOCK, near_c // FINE_BLOCK]:
            step += FINE_BLOCK - 1
            continue
        surface = _surface_at(terrain, y, x, by_row)
        if surface > ray:
            return False
        # A wall is between two cells: the ray reaches it half a step before the centre of the higher cell, or starts beyond it.
        if step >= 0.5 and surface > ray - 0.5 * sz:
            before = _surface_at(terrain, y - sr, x - sc, by_row)
            if surface - before > terrain.wall:
                return False
        step += 1.0
    return True


@njit()
def march_row(terrain, centre, row, cols, z, slope, tolerance, asked, answer, out):
    """Changes `out` (C,) from `asked` to `answer` at those targets of a row that the centre sees; row and cols (C,) in cells of the
    whole model, z (C,) m, slope (C,) and tolerance as in `visible_targets`."""
    # Positions are counted in the whole model, so that rounding is the same whatever the window.
    for j in range(cols.size):
        if out[j] != asked or np.isnan(z[j]) or centre.z <= z[j]:
            continue
        # Noise of the model displaces a slope horizontally as well, so a steep target gets a larger tolerance.
        start = z[j] + tolerance * (1.0 + min(slope[j], MOST_SLOPE))
        if _is_free(terrain, row, cols[j], z[j], start, centre):
            out[j] = answer


@njit()
def _march(terrain, centre, rows, cols, z, slope, tolerance, out):
    """Sets `out` to 1 at the targets that the centre sees."""
    for i in range(rows.size):
        march_row(terrain, centre, rows[i], cols, z[i], slope[i], tolerance, np.uint8(0), np.uint8(1), out[i])


def centre_of(model: HeightModel, view: View) -> CentrePlace:
    """The projection centre of a view for the kernels."""
    col, row = model.grid.pixel(view.centre[0], view.centre[1])
    return CentrePlace(float(col), float(row), float(view.centre[2]))


@dataclass(frozen=True)
class Targets:
    """Points on the surface in a grid: `rows` (R,) and `cols` (C,) in cells of the whole height model (float; integers are cell
    centres).

    `z` (R, C) m, NaN for none; `slope` (R, C), m per m.
    """

    rows: np.ndarray
    cols: np.ndarray
    z: np.ndarray
    slope: np.ndarray


def visible_targets(model: HeightModel, view: View, targets: Targets, tolerance: float) -> np.ndarray:
    """uint8 (R, C): 1 where the surface leaves the ray from the target to the view free.

    A target without height is not seen, and a model without heights hides nothing. `tolerance` (m) is how deep a ray may dip below
    the surface on level ground; it grows with the slope at the target. Whether the target lies inside the photograph is not tested
    here.
    """
    out = np.zeros(targets.z.shape, np.uint8)
    rows, cols = np.asarray(targets.rows, np.float64), np.asarray(targets.cols, np.float64)
    z, slope = (np.ascontiguousarray(values, np.float32) for values in (targets.z, targets.slope))
    _march(model.terrain, centre_of(model, view), rows, cols, z, slope, tolerance, out)
    return out


@njit()
def _by_distance(hidden, table, out):
    """Sets `out` to what `table` has for the squared distance (px^2) from the nearest hidden pixel; its last value serves for all
    farther ones."""
    rows, cols = hidden.shape
    far = np.int32(table.size - 1)
    reach = int(np.sqrt(far))
    # First along the rows, then the least sum of squares over the rows around: exact, and in time with the narrow width only.
    aside, without = np.empty((rows, cols), np.int32), np.empty(rows, np.bool_)
    for r in range(rows):
        without[r] = not hidden[r].any()
        if without[r]:
            continue
        near = reach + 1
        for c in range(cols):
            near = 0 if hidden[r, c] else near + 1
            aside[r, c] = min(near, reach + 1)
        near = reach + 1
        for c in range(cols - 1, -1, -1):
            near = 0 if hidden[r, c] else near + 1
            least = min(aside[r, c], near)
            aside[r, c] = least * least
    nearest = np.empty(cols, np.int32)
    for r in range(rows):
        nearest[:] = far
        for other in range(max(r - reach, 0), min(r + reach + 1, rows)):
            if without[other]:
                continue
            square = np.int32((other - r) ** 2)
            for c in range(cols):
                nearest[c] = min(nearest[c], aside[other, c] + square)
        for c in range(cols):
            out[r, c] = table[nearest[c]]


def widening_factor(hidden: np.ndarray, margin: float, ramp: float) -> np.ndarray:
    """float32 weight factor (rows, cols) that falls towards hidden pixels.

    0 within `margin` px of a hidden one, 1 from `margin` + `ramp` px on. Single hidden pixels (specks of a noisy model) are
    ignored: the hidden area is opened by a 2 x 2 window first (Petsa et al. 2007, M10 step 3).
    """
    square = np.ones((2, 2), np.uint8)
    # An even window has no middle: opposite anchors keep the opened area where it was.
    opened = cv2.dilate(cv2.erode(hidden.astype(np.uint8), square, anchor=(0, 0)), square, anchor=(1, 1))
    out = np.ones(hidden.shape, np.float32)
    if opened.any():
        distance = np.sqrt(np.arange((int(np.ceil(margin + ramp)) + 1) ** 2 + 1, dtype=np.float32))
        _by_distance(opened, np.clip((distance - margin) / max(ramp, 1e-6), 0.0, 1.0).astype(np.float32), out)
    return out
