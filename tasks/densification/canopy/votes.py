"""One height of several depth maps: the one that most of them confirm, smoothed as far as a pixel of theirs sees.

Strategy: a map votes in every cell that its pixel covers, with the highest of its heights there. Heights that differ by no more
than leaves are deep speak of the same crown; the largest such group wins, the higher one of two that are equal, and its mean
counts. Every vote is for another leaf, so that a median over the pixel's surroundings follows.
"""

import numpy as np

from orthomill.kernels.kernel_compilation import njit

MOST = 16
"""depth maps that vote in a cell; the first that show it"""
_FEWEST = 3
"""maps that must agree: two may follow the same leaf that moved"""
_COMPANY = 0.3
"""share of the cells around that must have a height"""


@njit()
def cast(votes, count, places, reach, highest):
    """Add the heights of one map to `votes` (MOST, rows, cols) float32, whose first `count` (rows, cols) are taken.

    places (3, N): column and row in the window, and height m, of the pixels of the map, NaN without one; reach: cells on every side
    of a place that its pixel covers; highest (rows, cols) float32: scratch.
    """
    rows, cols = count.shape
    highest[:] = -np.inf
    for i in range(places.shape[1]):
        col, row, height = places[0, i], places[1, i], np.float32(places[2, i])
        # Comparisons with NaN are false.
        if not (col > -reach - 1 and row > -reach - 1 and col < cols + reach and row < rows + reach):
            continue
        for r in range(max(0, int(np.ceil(row - reach))), min(rows, int(np.floor(row + reach)) + 1)):
            for c in range(max(0, int(np.ceil(col - reach))), min(cols, int(np.floor(col + reach)) + 1)):
                highest[r, c] = max(highest[r, c], height)
    for r in range(rows):
        for c in range(cols):
            if highest[r, c] > -np.inf and count[r, c] < MOST:
                votes[count[r, c], r, c] = highest[r, c]
                count[r, c] += 1


@njit()
def elected(votes, count, apart):
    """Heights (rows, cols) float32 of the largest group of `votes` that differ by no more than `apart` (m); NaN where fewer agree
    than must."""
    rows, cols = count.shape
    out = np.full((rows, cols), np.float32(np.nan))
    for r in range(rows):
        for c in range(cols):
            most, best = 0, np.float32(-np.inf)
            for i in range(count[r, c]):
                seed, agree = votes[i, r, c], 0
                for j in range(count[r, c]):
                    agree += abs(votes[j, r, c] - seed) <= apart
                if agree > most or (agree == most and seed > best):
                    most, best = agree, seed
            if most < _FEWEST:
                continue
            total = 0.0
            for j in range(count[r, c]):
                if abs(votes[j, r, c] - best) <= apart:
                    total += votes[j, r, c]
            out[r, c] = total / most
    return out


@njit()
def smoothed(heights, reach):
    """Medians (rows, cols) float32 over (2 reach + 1)^2 cells; NaN where too few of them have a height."""
    rows, cols = heights.shape
    out = np.full((rows, cols), np.float32(np.nan))
    around = np.empty((2 * reach + 1) ** 2, np.float32)
    for r in range(rows):
        for c in range(cols):
            n = 0
            for y in range(max(0, r - reach), min(rows, r + reach + 1)):
                for x in range(max(0, c - reach), min(cols, c + reach + 1)):
                    if heights[y, x] == heights[y, x]:
                        around[n] = heights[y, x]
                        n += 1
            if n >= _COMPANY * around.size:
                out[r, c] = np.median(around[:n])
    return out
