"""Values inside gaps from those along their border: mean value interpolation, cell by cell.

Strategy. From a cell inside a gap cones go out in all directions; each ends where cells with a value fill its width. The mean of
these values, each with the inverse of its distance as weight, takes every plane for what it is and joins the border without a step.
A cone and not a ray: far away neighbouring rays are many cells apart, and a small patch of ground in a large gap, met by one ray
from here and by none from the next cell, would throw spokes over it. What fills a part of the width counts for that part, and the
rest of the cone goes on. Nothing beyond `reach` counts, so that a tile with that halo gives the answer of the whole. Over a gap on
a hilltop that mean is too low, in a valley too high: how much the ground beyond the border bends is told by its slope there,
followed back to the cell. No hollow is deeper than the lowest place of its border: water would stand in it, and lie flat.

Source: Dyken and Floater (2009), Transfinite mean value interpolation, Computer Aided Geometric Design 26.
"""

from typing import NamedTuple

import numpy as np

from orthomill.kernels.kernel_compilation import njit

DIRECTIONS = 32
HALF, QUARTER = DIRECTIONS // 2, DIRECTIONS // 4
"""directions of a half and of a quarter circle"""
SHORTEST_SLOPE, LONGEST_SLOPE = 6, 24
"""cells along a cone over which the slope beyond the border is taken: as many as the gap is wide, within these"""
_WIDTH = np.pi / DIRECTIONS
"""half of the width of a cone, in units of the distance"""
_WIDEST = LONGEST_SLOPE // 2
"""cells, half of the greatest width: with the slope beyond it, nothing counts that is twice the longest one beyond the reach"""
_FULL = 0.95
"""share of its width at which a cone ends"""
_BETWEEN, _BESIDE = 0.4, 1.0
"""unevenness of the directions up to which a cell lies between known ones, and from which on beside them"""
_SQUARE, _TOGETHER = 32, 1024
"""side of a square of cells, and cells, that are filled together"""
_UNITS = 2.0**24
"""of whole numbers to the metre: their sums are exact, so that a tile gives the bits of the whole"""


class GapFill(NamedTuple):
    """Of every cell (rows, cols): `values` (rows, cols, bands) float32, heights and, if there are more, their standard errors and
    anything else, NaN where no ray found one; `distance` float32, the
    harmonic mean of the distances in cells, 0 at known cells; `open_side` uint8, the widest angle without a known cell, in
    directions; `beside` float32: 0 between known cells, 1 beside them, as if they filled a half plane, and all that lies between;
    `bend` float32: by how much the slopes beyond the border, followed to the cell, lie above the first of the values."""

    values: np.ndarray
    distance: np.ndarray
    open_side: np.ndarray
    beside: np.ndarray
    bend: np.ndarray

    @property
    def enclosed(self) -> np.ndarray:
        """(rows, cols) bool: whether known cells lie on every side, so that nothing is extrapolated."""
        return self.open_side < HALF


@njit(inline="always")
def _open_side(found):
    """The longest run of directions (K,) bool, around the circle, in which nothing was `found`."""
    count, longest, run = found.shape[0], 0, 0
    for k in range(2 * count):
        run = 0 if found[k % count] else run + 1
        longest = max(longest, run)
    return min(longest, count)


@njit(inline="always")
def _box(shape, top, bottom, left, right):
    """The corners, in sums of `shape`, of the cells from (top, left) to (bottom, right) that lie inside."""
    return max(top, 0), min(bottom + 1, shape[0] - 1), max(left, 0), min(right + 1, shape[1] - 1)


@njit(inline="always")
def _counted(counts, box):
    """How many known cells lie in a box; counts (rows + 1, cols + 1) of all cells above and to the left."""
    top, bottom, left, right = box
    return np.int64(counts[bottom, right] - counts[top, right] - counts[bottom, left] + counts[top, left])


@njit(inline="always")
def _total(sums, box, k):
    """The sum of the k-th numbers of the known cells in a box; `sums` (rows + 1, cols + 1, K)."""
    top, bottom, left, right = box
    return sums[bottom, right, k] - sums[top, right, k] - sums[bottom, left, k] + sums[top, left, k]


@njit(inline="always")
def _nothing_to_one_side(counts, r, c, reach):
    """Whether no known cell lies where a quarter of all cones goes to, so that they find none: `counts` (rows + 1, cols + 1)."""
    far, wide = int(reach) + 1, _WIDEST + 1
    for south in (False, True):
        for east in (False, True):
            top, bottom = r - (wide if south else far), r + (far if south else wide)
            left, right = c - (wide if east else far), c + (far if east else wide)
            if _counted(counts, _box(counts.shape, top, bottom, left, right)) == 0:
                return True
    return False


@njit(inline="always")
def _along(sums, box, number, r, c, dy, dx):
    """How far the middle of the `number` known cells of a box lies from the cell (r, c) along (dy, dx), in cells."""
    return ((_total(sums, box, 0) - number * r) * dy + (_total(sums, box, 1) - number * c) * dx) / number


@njit()
def _fill(counts, sums, free, places, holes, reach, across, down, filled, distance, open_side, beside, bend):
    """Fills `filled` (N, bands) m, `distance` in cells, `open_side` in directions, `beside` and `bend` m (N,) of the cells
    `places` (N, 2).

    counts (rows + 1, cols + 1) int32 and sums (rows + 1, cols + 1, 2 + bands) int64 as of `_summed`; `free` (rows, cols) the cells
    to the nearest known one along rows, columns and diagonals; cones go along (across, down) (K,), up to `reach` cells; `holes`
    (N,) bool are left as they are where a quarter of the directions is open.

    One direction after the other for many neighbouring cells: their cones end at the same few cells, which stay in the cache."""
    rows, cols = free.shape
    bands, count, farthest = sums.shape[2] - 2, across.shape[0], int(reach) + 2
    found, total, sides = np.zeros((_TOGETHER, count), np.bool_), np.zeros((_TOGETHER, bands)), np.zeros((_TOGETHER, 4))
    weights, followed, lowest = np.zeros(_TOGETHER), np.zeros(_TOGETHER), np.zeros(_TOGETHER)
    east, south = np.zeros(_TOGETHER), np.zeros(_TOGETHER)
    missed, looks = np.zeros(_TOGETHER, np.int64), np.zeros(_TOGETHER, np.bool_)
    below, right, halves = np.zeros(farthest, np.int64), np.zeros(farthest, np.int64), np.zeros(farthest, np.int64)
    for start in range(0, places.shape[0], _TOGETHER):
        size = min(_TOGETHER, places.shape[0] - start)
        for m in range(size):
            n = start + m
            weights[m], followed[m], lowest[m], missed[m], east[m], south[m] = 0.0, 0.0, np.inf, 0, 0.0, 0.0
            total[m, :] = 0.0
            sides[m, :] = 0.0
            looks[m] = not (holes[n] and _nothing_to_one_side(counts, places[n, 0], places[n, 1], reach))
        for k in range(count):
            # Along the longer axis a step is one cell, so that a cone misses none on its way; across it lies its width.
            longer = max(abs(across[k]), abs(down[k]))
            dx, dy = across[k] / longer, down[k] / longer
            level = abs(dx) >= abs(dy)
            widening = _WIDTH / longer**2
            last = int(reach * longer)
            for i in range(1, last + 1):
                below[i], right[i] = int(np.rint(i * dy)), int(np.rint(i * dx))
                halves[i] = min(int(i * widening + 0.5), _WIDEST)
            for m in range(size):
                if not looks[m]:
                    continue
                n = start + m
                r, c = places[n]
                rest, i = 1.0, 1
                while i <= last and rest > 1.0 - _FULL:
                    y, x, half = r + below[i], c + right[i], halves[i]
                    if not (0 <= y < rows and 0 <= x < cols):
                        break
                    # No known cell is nearer than `free`, in any direction.
                    if free[y, x] > half:
                        i += 1 + int((free[y, x] - 1 - half) / (1.0 + widening))
                        continue
                    v, u = (half, 0) if level else (0, half)
                    part = _box(counts.shape, y - v, y + v, x - u, x + u)
                    number = _counted(counts, part)
                    i += 1
                    if number == 0:
                        continue
                    width = 2.0 * half + 1.0
                    seen = number / width
                    left = min(1.0 - seen, rest * (1.0 - seen / width))
                    if left >= rest:
                        continue
                    share, rest = rest - left, left
                    away = max(_along(sums, part, number, r, c, down[k], across[k]), 1.0)
                    weight = share / away
                    weights[m] += weight
                    height = _total(sums, part, 2) / number
                    lowest[m] = min(lowest[m], height)
                    total[m, 0] += weight * height
                    for b in range(1, bands):
                        value = weight * (_total(sums, part, 2 + b) / number)
                        total[m, b] += value
                        if b == 1:
                            sides[m, 4 * k // count] += value
                    base = min(max(i - 1, SHORTEST_SLOPE), LONGEST_SLOPE)
                    j = i - 1 + base + base // 2
                    v, u = r + int(np.rint(j * dy)), c + int(np.rint(j * dx))
                    if 0 <= v < rows and 0 <= u < cols:
                        wide = max(half, base // 4)
                        beyond = _box(counts.shape, v - wide, v + wide, u - wide, u + wide)
                        number = _counted(counts, beyond)
                        if number > 0:
                            step = _along(sums, beyond, number, r, c, down[k], across[k]) - away
                            if 2.0 * step > base:
                                followed[m] += weight * (height - _total(sums, beyond, 2) / number) * away / step
                found[m, k] = rest < 0.5
                east[m], south[m] = east[m] + (1.0 - rest) * across[k], south[m] + (1.0 - rest) * down[k]
                missed[m] = 0 if found[m, k] else missed[m] + 1
                if holes[n] and missed[m] >= QUARTER:
                    weights[m], looks[m] = 0.0, False
        for m in range(size):
            if weights[m] > 0.0:
                n = start + m
                for b in range(bands):
                    filled[n, b] = total[m, b] / weights[m] / _UNITS
                if bands > 1:
                    # Neighbours share their errors, the sides of a gap do not.
                    filled[n, 1] = np.sqrt((sides[m] * sides[m]).sum()) / weights[m] / _UNITS
                distance[n] = count / weights[m]
                open_side[n] = _open_side(found[m])
                uneven = np.sqrt(east[m] * east[m] + south[m] * south[m]) * np.pi / count
                beside[n] = min(max((uneven - _BETWEEN) / (_BESIDE - _BETWEEN), 0.0), 1.0)
                bend[n] = followed[m] / weights[m] / _UNITS
                bend[n] += (1.0 - beside[n]) * max(lowest[m] / _UNITS - filled[n, 0] - bend[n], 0.0)


@njit()
def _sum(values, known, counts, sums):
    """Sums of all cells above and to the left of every corner, into arrays that are zero: the count of the `known` cells (rows,
    cols) bool into `counts` (rows + 1, cols + 1) int32; their rows, columns and values (rows, cols, bands) m, in whole units, into
    `sums` (rows + 1, cols + 1, 2 + bands) int64."""
    rows, cols, bands = values.shape
    row = np.zeros(2 + bands, np.int64)
    for r in range(rows):
        row[:] = 0
        number = 0
        for c in range(cols):
            if known[r, c]:
                number += 1
                row[0] += r
                row[1] += c
                for b in range(bands):
                    row[2 + b] += np.int64(np.rint(np.float64(values[r, c, b]) * _UNITS))
            counts[r + 1, c + 1] = counts[r, c + 1] + number
            for k in range(2 + bands):
                sums[r + 1, c + 1, k] = sums[r, c + 1, k] + row[k]


def _summed(values: np.ndarray, known: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The counts (rows + 1, cols + 1) int32 and sums (rows + 1, cols + 1, 2 + bands) int64 of `_sum`."""
    rows, cols, bands = values.shape
    counts, sums = np.zeros((rows + 1, cols + 1), np.int32), np.zeros((rows + 1, cols + 1, 2 + bands), np.int64)
    _sum(values, known, counts, sums)
    return counts, sums


def fill_gaps(values: np.ndarray, known: np.ndarray, wanted: np.ndarray, reach: int, holes: np.ndarray | None = None) -> GapFill:
    """The `known` (rows, cols) bool of the values (rows, cols, bands) continued into the `wanted` cells (rows, cols) bool, from at
    most `reach` cells away, into `holes` (rows, cols) bool only from all sides; cells that are neither known nor wanted are NaN."""
    angle = 2.0 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS
    filled = np.where(known[..., None], values, np.float32(np.nan)).astype(np.float32, copy=False)
    distance = np.where(known, np.float32(0.0), np.float32(np.inf))
    open_side = np.where(known, np.uint8(0), np.uint8(DIRECTIONS))
    beside, bend = np.zeros(known.shape, np.float32), np.zeros(known.shape, np.float32)
    at = _in_squares(np.nonzero(wanted & ~known))
    if len(at[0]):
        own = filled[at], distance[at], open_side[at], beside[at], bend[at]
        inside = np.zeros(len(at[0]), bool) if holes is None else holes[at]
        rays = np.cos(angle), np.sin(angle)
        near = _within_reach(at, reach, known.shape)
        free, places = _free(known[near], reach), np.column_stack([at[0] - near[0].start, at[1] - near[1].start])
        _fill(*_summed(filled[near], known[near]), free, places, inside, float(reach), *rays, *own)
        filled[at], distance[at], open_side[at], beside[at], bend[at] = own
    return GapFill(filled, distance, open_side, beside, bend)


def _in_squares(at: tuple[np.ndarray, ...]) -> tuple[np.ndarray, ...]:
    """Rows and columns (N,) of cells, one square of cells after the other; every cell is filled for itself, whatever the order."""
    row, col = at
    order = np.lexsort((col // _SQUARE, row // _SQUARE))
    return row[order], col[order]


def _within_reach(at: tuple[np.ndarray, ...], reach: int, shape: tuple[int, ...]) -> tuple[slice, slice]:
    """The rows and columns that count for the cells `at`."""
    halo = reach + 2 * LONGEST_SLOPE
    rows, cols = (
        slice(max(int(places.min()) - halo, 0), min(int(places.max()) + halo + 1, side))
        for places, side in zip(at, shape, strict=True)
    )
    return rows, cols


def _free(known: np.ndarray, reach: int) -> np.ndarray:
    """(rows, cols) float32: cells to the nearest `known` one (rows, cols) bool along rows, columns and diagonals."""
    import cv2

    if not known.any():
        return np.full(known.shape, reach + 1.0, np.float32)
    return np.asarray(cv2.distanceTransform((~known).astype(np.uint8), cv2.DIST_C, 3), np.float32)
