"""Which candidates every cell of a volume has: all, or those near the heights that a coarser volume found around it.

Strategy: a cell's range spans the coarser heights of its neighbourhood with a margin, so that beside a wall both surfaces are
candidates and everything between. Counts are multiples of what one vector instruction processes; a cell's own cap and the budget of
the tile bound the memory, whatever the relief: ranges are then cut around the cell's own coarser height.
"""

from dataclasses import dataclass

import numpy as np

from orthomill.kernels.kernel_compilation import njit
from orthomill.tasks.matching.volume.paths import UNIT


@dataclass(frozen=True, eq=False)
class CellRanges:
    """Packed candidates: cell i (row by row) has the planes `low[i]`, `low[i]` + 1, ... and its costs begin at `offset[i]`.

    low (rows, cols) int32; offset (rows * cols + 1,) int64.
    """

    low: np.ndarray
    offset: np.ndarray

    @property
    def count(self) -> np.ndarray:
        """Candidates of every cell (rows, cols)."""
        return np.diff(self.offset).reshape(self.low.shape)

    def trimmed(self) -> tuple["CellRanges", slice]:
        """The same candidates, counted from the first plane that occurs, and the planes that occur. Raises ValueError
        without any."""
        count = self.count
        some = count > 0
        first, last = int(self.low[some].min()), int((self.low + count)[some].max())
        return CellRanges(np.where(some, self.low - first, 0).astype(np.int32), self.offset), slice(first, last)

    def only(self, cells: np.ndarray) -> "CellRanges":
        """The candidates of the `cells` (rows, cols) bool; the others have none."""
        return packed(self.low, np.where(cells, self.count, 0))


@dataclass(frozen=True)
class Ranges:
    """Rules for narrowed ranges; in planes, `reach` in coarser cells."""

    margin: int
    reach: int
    most: int
    """of one cell, a multiple of UNIT"""
    mean: int
    """of all cells of a tile, a multiple of UNIT"""


def packed(low: np.ndarray, count: np.ndarray) -> CellRanges:
    """The candidates of given first planes and counts (rows, cols)."""
    return CellRanges(low.astype(np.int32), np.concatenate([[0], np.cumsum(count.ravel(), dtype=np.int64)]))


def all_planes(shown: np.ndarray, planes: int) -> CellRanges:
    """Every plane for the cells `shown` (rows, cols) bool, none elsewhere; `planes` a multiple of UNIT."""
    return packed(np.zeros(shown.shape, np.int32), np.where(shown, planes, 0))


def narrowed(coarser: np.ndarray, cells: tuple[np.ndarray, np.ndarray], planes: int, rules: Ranges) -> CellRanges:
    """Candidates near the heights of a coarser volume.

    coarser (Rc, Cc): its heights in planes of this volume (float, NaN for none). cells: row (R,) and column (C,) in it of this
    volume's cells. Cells with no coarser height within reach have no candidates.
    """
    lowest, highest, own = _extremes(coarser.astype(np.float32), rules.reach)
    at = np.ix_(*cells)
    low, high, middle = lowest[at], highest[at], own[at]
    some = np.isfinite(low)
    low, high, middle = (np.where(some, values, 0.0) for values in (low, high, middle))
    first, last = np.floor(low).astype(np.int64) - rules.margin, np.ceil(high).astype(np.int64) + rules.margin
    wanted = np.where(some, -(-(last - first + 1) // UNIT) * UNIT, 0)
    count = np.minimum(wanted, _cap(wanted, rules))
    # A cut range lies about the cell's own height; a padded one about its middle.
    centre = np.where(count < wanted, middle, (first + last + 1) / 2)
    start = np.floor(centre - count / 2 + 0.5).astype(np.int64)
    start = np.where(count < wanted, np.clip(start, first, np.maximum(last + 1 - count, first)), start)
    return packed(np.clip(start, 0, np.maximum(planes - count, 0)), np.minimum(count, planes))


def bounded(candidates: CellRanges, first: np.ndarray, last: np.ndarray) -> CellRanges:
    """The same candidates without those below plane `first` and above plane `last` (rows, cols) of their cells.

    A cell whose candidates all lie beyond them keeps what it has: what bounds it is wrong there.
    """
    low, count = candidates.low.astype(np.int64), candidates.count
    lower, upper = np.maximum(low, first), np.minimum(low + count - 1, last)
    some = upper >= lower
    wanted = np.minimum(-(-(upper - lower + 1) // UNIT) * UNIT, count)
    start = np.clip((lower + upper + 1 - wanted) // 2, low, low + count - wanted)
    return packed(np.where(some, start, low), np.where(some, wanted, count))


def _cap(wanted: np.ndarray, rules: Ranges) -> int:
    """The greatest count of a cell with which the tile keeps to its budget."""
    budget = rules.mean * wanted.size
    for cap in range(rules.most, UNIT, -UNIT):
        if np.minimum(wanted, cap).sum() <= budget:
            return cap
    return UNIT


@njit()
def _extremes(heights, reach):
    """Lowest, highest and median-like own height of every cell's neighbourhood (rows, cols); NaN without any height in it."""
    rows, cols = heights.shape
    low, high, own = np.full((3, rows, cols), np.float32(np.nan))
    for r in range(rows):
        for c in range(cols):
            nearest = 1 << 30
            for y in range(max(r - reach, 0), min(r + reach + 1, rows)):
                for x in range(max(c - reach, 0), min(c + reach + 1, cols)):
                    h = heights[y, x]
                    if h != h:
                        continue
                    distance = (y - r) * (y - r) + (x - c) * (x - c)
                    # Comparisons with NaN are false: the first height found is taken.
                    if not low[r, c] <= h:
                        low[r, c] = h
                    if not high[r, c] >= h:
                        high[r, c] = h
                    if distance < nearest:
                        nearest, own[r, c] = distance, h
    return low, high, own
