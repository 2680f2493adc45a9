"""Paths of semi-global matching over packed candidates: every cell has its own range, and the sums of eight paths are added up.

Source: Hirschmueller 2008, eq. 13.
"""

import numpy as np

from orthomill.kernels.kernel_compilation import njit

UNIT = 16
"""The number of candidates of a cell is a multiple of this: so many are processed by one vector instruction."""
# A wall is above any sum of path costs and far enough below 2^15 that penalties cannot overflow it.
_WALL = np.int16(10000)


@njit(inline="always")
def _step(before, after, cost, total, lowest, small, large):
    """One step of one path over n candidates; `before` (n + 2,) includes a neighbour on both sides. Returns the lowest of `after`.

    All in 16 bits, of which LLVM processes 16 at a time; the sums stay far below 32000.
    """
    # Leaving the best candidate of the step before costs the large penalty, wherever the path goes.
    jump, least = np.int16(lowest + large), np.int16(32000)
    for k in range(cost.size):
        best = min(min(before[k + 1], np.int16(before[k] + small)), min(np.int16(before[k + 2] + small), jump))
        # Hirschmueller 2008, eq. 13: the lowest cost of the step before is subtracted, which bounds the sums.
        value = np.int16(np.int16(cost[k]) + np.int16(best - lowest))
        after[k] = value
        total[k] = np.int16(total[k] + value)
        least = min(least, value)
    return least


@njit()
def sweep(cost, total, low, offset, candidates, small, large, backwards):
    """Add four paths: along the row and the three from the row above; run backwards, these are the other four. `large`
    (rows, cols): the penalty of a jump into each pixel.

    Two rows of paths are kept, with a wall wherever a pixel has no candidate, so that neighbours may differ in their ranges.
    """
    rows, cols = low.shape
    paths = np.full((2, cols + 2, 4, candidates + 2), _WALL, np.int16)
    lowest, ranges = np.zeros((2, cols + 2, 4), np.int16), np.zeros((2, cols + 2, 2), np.int64)
    for r in range(rows):
        now, above = r % 2, (r + 1) % 2
        for c in range(1, cols + 1):
            y, x = (rows - 1 - r, cols - c) if backwards else (r, c - 1)
            begin, end = offset[y * cols + x], offset[y * cols + x + 1]
            first, last = np.int64(low[y, x]), low[y, x] + end - begin
            old_first, old_last = ranges[now, c, 0], ranges[now, c, 1]
            # The row is reused: candidates of its former pixel that this one lacks must become walls again.
            if old_first != first or old_last != last:
                for path in range(4):
                    paths[now, c, path, old_first + 1 : old_last + 1] = _WALL
                ranges[now, c, 0], ranges[now, c, 1] = first, last
            lowest[now, c, :] = 0
            if begin == end:
                continue
            here, sums = cost[begin:end], total[begin:end]
            for path in range(4):
                row, col = (now, c - 1) if path == 0 else (above, c + path - 2)
                before, after = paths[row, col, path, first : last + 2], paths[now, c, path, first + 1 : last + 1]
                lowest[now, c, path] = _step(before, after, here, sums, lowest[row, col, path], small, large[y, x])
