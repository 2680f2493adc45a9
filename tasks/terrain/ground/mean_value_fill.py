"""Values inside gaps from those along their border: mean value interpolation, cell by cell.

Strategy. From a cell inside a gap rays go out in all directions; each ends at the first cell with a value. The mean of these
values, each with the inverse of its distance as weight, takes every plane for what it is and joins the border without a step.
Nothing beyond `reach` counts, so that a tile with that halo gives the answer of the whole.

Source: Dyken and Floater (2009), Transfinite mean value interpolation, Computer Aided Geometric Design 26.
"""

from typing import NamedTuple

import numpy as np

from orthomill.kernels.kernel_compilation import njit

DIRECTIONS = 32
HALF, QUARTER = DIRECTIONS // 2, DIRECTIONS // 4
"""directions of a half and of a quarter circle"""


class GapFill(NamedTuple):
    """Of every cell (rows, cols): `values` (rows, cols, bands) float32, NaN where no ray found one; `distance` float32, the
    harmonic mean of the distances in cells, 0 at known cells; `open_side` uint8, the widest angle without a known cell, in
    directions."""

    values: np.ndarray
    distance: np.ndarray
    open_side: np.ndarray

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
def _fill(known, wanted, reach, across, down, values, distance, open_side):
    """Fills `values` (rows, cols, bands) m, `distance` in cells and `open_side` in directions at the `wanted` cells (bool) from
    the `known` ones (bool); rays go along (across, down) (K,), in cells, up to `reach`."""
    rows, cols, bands = values.shape
    count = across.shape[0]
    found, total = np.zeros(count, np.bool_), np.zeros(bands)
    for r in range(rows):
        for c in range(cols):
            if not wanted[r, c] or known[r, c]:
                continue
            weights = 0.0
            total[:] = 0.0
            for k in range(count):
                # Along the longer axis a step is one cell, so that a ray misses none on its way.
                longer = max(abs(across[k]), abs(down[k]))
                dx, dy = across[k] / longer, down[k] / longer
                length = np.sqrt(dx * dx + dy * dy)
                found[k] = False
                for i in range(1, int(reach / length) + 1):
                    y, x = r + int(np.rint(i * dy)), c + int(np.rint(i * dx))
                    if not (0 <= y < rows and 0 <= x < cols):
                        break
                    if known[y, x]:
                        weight = 1.0 / (i * length)
                        for b in range(bands):
                            total[b] += weight * values[y, x, b]
                        weights += weight
                        found[k] = True
                        break
            if weights > 0.0:
                for b in range(bands):
                    values[r, c, b] = total[b] / weights
                distance[r, c] = count / weights
                open_side[r, c] = _open_side(found)


def fill_gaps(values: np.ndarray, known: np.ndarray, wanted: np.ndarray, reach: int) -> GapFill:
    """The `known` (rows, cols) bool of the values (rows, cols, bands) continued into the `wanted` cells (rows, cols) bool, from at
    most `reach` cells away; cells that are neither known nor wanted are NaN."""
    angle = 2.0 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS
    filled = np.where(known[..., None], values, np.nan).astype(np.float32)
    distance = np.where(known, 0.0, np.inf).astype(np.float32)
    open_side = np.where(known, 0, DIRECTIONS).astype(np.uint8)
    _fill(known, wanted, float(reach), np.cos(angle), np.sin(angle), filled, distance, open_side)
    return GapFill(filled, distance, open_side)
