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
def _between(sums, top, bottom, left, right, part):
    """Writes the sums (K,) of the cells from (top, left) to (bottom, right) into `part`; `sums` (rows + 1, cols + 1, K). Of no
    known cell only the count, the first of them."""
    top, bottom = max(top, 0), min(bottom + 1, sums.shape[0] - 1)
    left, right = max(left, 0), min(right + 1, sums.shape[1] - 1)
    part[0] = sums[bottom, right, 0] - sums[top, right, 0] - sums[bottom, left, 0] + sums[top, left, 0]
    if part[0] == 0:
        return
    for k in range(1, part.shape[0]):
        part[k] = sums[bottom, right, k] - sums[top, right, k] - sums[bottom, left, k] + sums[top, left, k]


@njit(inline="always")
def _nothing_to_one_side(sums, r, c, reach):
    """Whether no known cell lies where a quarter of all cones goes to, so that they find none: `sums` (rows + 1, cols + 1, K)."""
    far, wide, rows, cols = int(reach) + 1, _WIDEST + 1, sums.shape[0] - 1, sums.shape[1] - 1
    for south in (False, True):
        for east in (False, True):
            top, bottom = max(r - (wide if south else far), 0), min(r + (far if south else wide) + 1, rows)
            left, right = max(c - (wide if east else far), 0), min(c + (far if east else wide) + 1, cols)
            if sums[bottom, right, 0] - sums[top, right, 0] - sums[bottom, left, 0] + sums[top, left, 0] == 0:
                return True
    return False


@njit(inline="always")
def _along(part, r, c, dy, dx):
    """How far the middle of the known cells of `part` lies from the cell (r, c) along (dy, dx), in cells."""
    return ((part[1] - part[0] * r) * dy + (part[2] - part[0] * c) * dx) / part[0]


@njit()
def _fill(sums, free, places, holes, reach, across, down, filled, distance, open_side, beside, bend):
    """Fills `filled` (N, bands) m, `distance` in cells, `open_side` in directions, `beside` and `bend` m (N,) of the cells
    `places` (N, 2).

    sums (rows + 1, cols + 1, 3 + bands) int64 as of `_summed`; `free` (rows, cols) the cells to the nearest known one along rows,
    columns and diagonals; cones go along (across, down) (K,), up to `reach` cells; `holes` (N,) bool are left as they are where a
    quarter of the directions is open."""
    rows, cols = free.shape
    bands, count = sums.shape[2] - 3, across.shape[0]
    found, total, sides = np.zeros(count, np.bool_), np.zeros(bands), np.zeros(4)
    part, beyond = np.zeros(3 + bands, np.int64), np.zeros(3 + bands, np.int64)
    for n in range(places.shape[0]):
        r, c = places[n]
        if holes[n] and _nothing_to_one_side(sums, r, c, reach):
            continue
        weights, followed, lowest, missed = 0.0, 0.0, np.inf, 0
        east, south = 0.0, 0.0
        total[:] = 0.0
        sides[:] = 0.0
        for k in range(count):
            # Along the longer axis a step is one cell, so that a cone misses none on its way; across it lies its width.
            longer = max(abs(across[k]), abs(down[k]))
            dx, dy = across[k] / longer, down[k] / longer
            level = abs(dx) >= abs(dy)
            widening = _WIDTH / longer**2
            last = int(reach * longer)
            rest, i = 1.0, 1
            while i <= last and rest > 1.0 - _FULL:
                y, x = r + int(np.rint(i * dy)), c + int(np.rint(i * dx))
                if not (0 <= y < rows and 0 <= x < cols):
                    break
                half = min(int(i * widening + 0.5), _WIDEST)
                # No known cell is nearer than `free`, in any direction.
                if free[y, x] > half:
                    i += 1 + int((free[y, x] - 1 - half) / (1.0 + widening))
                    continue
                v, u = (half, 0) if level else (0, half)
                _between(sums, y - v, y + v, x - u, x + u, part)
                i += 1
                if part[0] == 0:
                    continue
                width = 2.0 * half + 1.0
                seen = part[0] / width
                left = min(1.0 - seen, rest * (1.0 - seen / width))
                if left >= rest:
                    continue
                share, rest = rest - left, left
                away = max(_along(part, r, c, down[k], across[k]), 1.0)
                weight = share / away
                weights += weight
                height = part[3] / part[0]
                lowest = min(lowest, height)
                for b in range(bands):
                    total[b] += weight * (part[3 + b] / part[0])
                if bands > 1:
                    sides[4 * k // count] += weight * (part[4] / part[0])
                base = min(max(i - 1, SHORTEST_SLOPE), LONGEST_SLOPE)
                j = i - 1 + base + base // 2
                v, u = r + int(np.rint(j * dy)), c + int(np.rint(j * dx))
                if 0 <= v < rows and 0 <= u < cols:
                    wide = max(half, base // 4)
                    _between(sums, v - wide, v + wide, u - wide, u + wide, beyond)
                    if beyond[0] > 0:
                        step = _along(beyond, r, c, down[k], across[k]) - away
                        if 2.0 * step > base:
                            followed += weight * (height - beyond[3] / beyond[0]) * away / step
            found[k] = rest < 0.5
            east, south = east + (1.0 - rest) * across[k], south + (1.0 - rest) * down[k]
            missed = 0 if found[k] else missed + 1
            if holes[n] and missed >= QUARTER:
                weights = 0.0
                break
        if weights > 0.0:
            for b in range(bands):
                filled[n, b] = total[b] / weights / _UNITS
            if bands > 1:
                # Neighbours share their errors, the sides of a gap do not.
                filled[n, 1] = np.sqrt((sides * sides).sum()) / weights / _UNITS
            distance[n] = count / weights
            open_side[n] = _open_side(found)
            uneven = np.sqrt(east * east + south * south) * np.pi / count
            beside[n] = min(max((uneven - _BETWEEN) / (_BESIDE - _BETWEEN), 0.0), 1.0)
            bend[n] = followed / weights / _UNITS
            bend[n] += (1.0 - beside[n]) * max(lowest / _UNITS - filled[n, 0] - bend[n], 0.0)


@njit()
def _sum(values, known, sums):
    """Sums of all cells above and to the left of every corner, into `sums` (rows + 1, cols + 1, 3 + bands) int64 that is zero: the
    count of the `known` cells (rows, cols) bool, their rows, columns and values (rows, cols, bands) m, in whole units."""
    rows, cols, bands = values.shape
    row = np.zeros(3 + bands, np.int64)
    for r in range(rows):
        row[:] = 0
        for c in range(cols):
            if known[r, c]:
                row[0] += 1
                row[1] += r
                row[2] += c
                for b in range(bands):
                    row[3 + b] += np.int64(np.rint(np.float64(values[r, c, b]) * _UNITS))
            for k in range(3 + bands):
                sums[r + 1, c + 1, k] = sums[r, c + 1, k] + row[k]


def _summed(values: np.ndarray, known: np.ndarray) -> np.ndarray:
    """The sums (rows + 1, cols + 1, 3 + bands) int64 of `_sum`."""
    rows, cols, bands = values.shape
    sums = np.zeros((rows + 1, cols + 1, 3 + bands), np.int64)
    _sum(values, known, sums)
    return sums


def fill_gaps(values: np.ndarray, known: np.ndarray, wanted: np.ndarray, reach: int, holes: np.ndarray | None = None) -> GapFill:
    """The `known` (rows, cols) bool of the values (rows, cols, bands) continued into the `wanted` cells (rows, cols) bool, from at
    most `reach` cells away, into `holes` (rows, cols) bool only from all sides; cells that are neither known nor wanted are NaN."""
    angle = 2.0 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS
    filled = np.where(known[..., None], values, np.float32(np.nan)).astype(np.float32, copy=False)
    distance = np.where(known, np.float32(0.0), np.float32(np.inf))
    open_side = np.where(known, np.uint8(0), np.uint8(DIRECTIONS))
    beside, bend = np.zeros(known.shape, np.float32), np.zeros(known.shape, np.float32)
    at = np.nonzero(wanted & ~known)
    if len(at[0]):
        own = filled[at], distance[at], open_side[at], beside[at], bend[at]
        inside = np.zeros(len(at[0]), bool) if holes is None else holes[at]
        rays = np.cos(angle), np.sin(angle)
        near = _within_reach(at, reach, known.shape)
        free, places = _free(known[near], reach), np.column_stack([at[0] - near[0].start, at[1] - near[1].start])
        _fill(_summed(filled[near], known[near]), free, places, inside, float(reach), *rays, *own)
        filled[at], distance[at], open_side[at], beside[at], bend[at] = own
    return GapFill(filled, distance, open_side, beside, bend)


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
