"""Values inside gaps from those along their border: mean value interpolation, cell by cell.

Strategy. From a cell inside a gap rays go out in all directions; each ends at the first cell with a value. The mean of these
values, each with the inverse of its distance as weight, takes every plane for what it is and joins the border without a step.
Nothing beyond `reach` counts, so that a tile with that halo gives the answer of the whole. Over a gap on a hilltop that mean is
too low, in a valley too high: how much the ground beyond the border bends is told by its slope there, followed back to the cell.
No hollow is deeper than the lowest place of its border: water would stand in it, and lie flat.

Source: Dyken and Floater (2009), Transfinite mean value interpolation, Computer Aided Geometric Design 26.
"""

from typing import NamedTuple

import numpy as np

from orthomill.kernels.kernel_compilation import njit

DIRECTIONS = 32
HALF, QUARTER = DIRECTIONS // 2, DIRECTIONS // 4
"""directions of a half and of a quarter circle"""
SHORTEST_SLOPE, LONGEST_SLOPE = 6, 24
"""cells along a ray over which the slope beyond the border is taken: as many as the gap is wide, within these"""


class GapFill(NamedTuple):
    """Of every cell (rows, cols): `values` (rows, cols, bands) float32, heights and, if there are more, their standard errors and
    anything else, NaN where no ray found one; `distance` float32, the
    harmonic mean of the distances in cells, 0 at known cells; `open_side` uint8, the widest angle without a known cell, in
    directions; `bend` float32: by how much the slopes beyond the border, followed to the cell, lie above the first of the
    values."""

    values: np.ndarray
    distance: np.ndarray
    open_side: np.ndarray
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


@njit()
def _fill(values, free, places, holes, reach, across, down, filled, distance, open_side, bend):
    """Fills `filled` (N, bands) m, `distance` in cells, `open_side` in directions and `bend` m (N,) of the cells `places` (N, 2)
    from `values` (rows, cols, bands), known where `free` (rows, cols), the cells to the nearest known one along rows, columns and
    diagonals, is 0; rays go along (across, down) (K,), in cells, up to `reach`; `holes` (N,) bool are left as they are where a
    quarter of the directions is open."""
    rows, cols, bands = values.shape
    count = across.shape[0]
    found, total, sides = np.zeros(count, np.bool_), np.zeros(bands), np.zeros(4)
    for n in range(places.shape[0]):
        r, c = places[n]
        weights, followed, lowest, missed = 0.0, 0.0, np.inf, 0
        total[:] = 0.0
        sides[:] = 0.0
        for k in range(count):
            # Along the longer axis a step is one cell, so that a ray misses none on its way.
            longer = max(abs(across[k]), abs(down[k]))
            dx, dy = across[k] / longer, down[k] / longer
            length = np.sqrt(dx * dx + dy * dy)
            last = int(reach / length)
            found[k] = False
            # No known cell is nearer than `free`, in any direction.
            i = max(1, int(free[r, c]))
            while i <= last:
                y, x = r + int(np.rint(i * dy)), c + int(np.rint(i * dx))
                if not (0 <= y < rows and 0 <= x < cols):
                    break
                if free[y, x] > 0.0:
                    i += int(free[y, x])
                    continue
                weight = 1.0 / (i * length)
                for b in range(bands):
                    total[b] += weight * values[y, x, b]
                weights += weight
                lowest = min(lowest, values[y, x, 0])
                if bands > 1:
                    sides[4 * k // count] += weight * values[y, x, 1]
                found[k] = True
                base = min(max(i, SHORTEST_SLOPE), LONGEST_SLOPE)
                for j in range(i + base, i + 2 * base):
                    v, u = r + int(np.rint(j * dy)), c + int(np.rint(j * dx))
                    if not (0 <= v < rows and 0 <= u < cols):
                        break
                    if free[v, u] == 0.0:
                        followed += weight * (values[y, x, 0] - values[v, u, 0]) * i / (j - i)
                        break
                break
            missed = 0 if found[k] else missed + 1
            if holes[n] and missed >= QUARTER:
                weights = 0.0
                break
        if weights > 0.0:
            for b in range(bands):
                filled[n, b] = total[b] / weights
            if bands > 1:
                # Neighbours share their errors, the sides of a gap do not.
                filled[n, 1] = np.sqrt((sides * sides).sum()) / weights
            distance[n] = count / weights
            open_side[n] = _open_side(found)
            bend[n] = followed / weights
            if open_side[n] < HALF:
                bend[n] = max(bend[n], lowest - filled[n, 0])


def fill_gaps(values: np.ndarray, known: np.ndarray, wanted: np.ndarray, reach: int, holes: np.ndarray | None = None) -> GapFill:
    """The `known` (rows, cols) bool of the values (rows, cols, bands) continued into the `wanted` cells (rows, cols) bool, from at
    most `reach` cells away, into `holes` (rows, cols) bool only from all sides; cells that are neither known nor wanted are NaN."""
    import cv2

    angle = 2.0 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS
    filled = np.where(known[..., None], values, np.nan).astype(np.float32)
    distance = np.where(known, 0.0, np.inf).astype(np.float32)
    open_side = np.where(known, 0, DIRECTIONS).astype(np.uint8)
    bend = np.zeros(known.shape, np.float32)
    at = np.nonzero(wanted & ~known)
    free = cv2.distanceTransform((~known).astype(np.uint8), cv2.DIST_C, 3) if known.any() else np.full(known.shape, reach + 1.0)
    own = filled[at], distance[at], open_side[at], bend[at]
    inside = np.zeros(len(at[0]), bool) if holes is None else holes[at]
    _fill(filled, np.asarray(free, np.float32), np.column_stack(at), inside, float(reach), np.cos(angle), np.sin(angle), *own)
    filled[at], distance[at], open_side[at], bend[at] = own
    return GapFill(filled, distance, open_side, bend)
