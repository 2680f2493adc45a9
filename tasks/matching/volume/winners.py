"""From path sums to heights: the cheapest candidate of every cell, between planes, and what says how good it is.

Coherence: the share of the 9 x 9 cells around a cell whose heights go along with it. Where photographs see different leaves, or
nothing at all, the paths still prefer some height, but neighbours are not of one mind.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

COHERENCE_HALF = 4


class Winners(NamedTuple):
    """Per cell (rows, cols): `plane` float32, fractional number of the plane, NaN without candidates; `nearest` int32, its whole
    number, -1 without; `cost` uint8 at it; `margin` float32, path sums by which the best candidate farther than two planes is
    dearer, infinite without any."""

    plane: np.ndarray
    nearest: np.ndarray
    cost: np.ndarray
    margin: np.ndarray


@njit(cache=True)
def winners(total, cost, low, offset):
    """Winners of packed path sums int16 and costs uint8."""
    rows, cols = low.shape
    plane, nearest = np.full((rows, cols), np.float32(np.nan)), np.full((rows, cols), np.int32(-1))
    own, margin = np.zeros((rows, cols), np.uint8), np.full((rows, cols), np.float32(np.inf))
    for r in range(rows):
        for c in range(cols):
            begin, end = offset[r * cols + c], offset[r * cols + c + 1]
            n = end - begin
            if n == 0:
                continue
            sums = total[begin:end]
            # Sum and candidate as one number: compared many at a time, and of equal sums the lower plane wins.
            lowest = np.int32(2**31 - 1)
            for k in range(n):
                lowest = min(lowest, np.int32(np.int32(sums[k]) * 4096 + np.int32(k)))
            best = lowest % 4096
            second = np.int32(2**31 - 1)
            for k in range(n):
                value = np.int32(sums[k]) if abs(k - best) > 2 else np.int32(2**31 - 1)
                second = min(second, value)
            if second < 2**31 - 1:
                margin[r, c] = np.float32(second - sums[best])
            shift = np.float32(0.0)
            if 0 < best < n - 1:
                before, here, after = np.float32(sums[best - 1]), np.float32(sums[best]), np.float32(sums[best + 1])
                bend = before - 2 * here + after
                if bend > 0:
                    shift = min(max(np.float32(0.5) * (before - after) / bend, np.float32(-0.5)), np.float32(0.5))
            nearest[r, c], own[r, c] = low[r, c] + best, cost[begin + best]
            plane[r, c] = np.float32(low[r, c] + best) + shift
    return Winners(plane, nearest, own, margin)


@njit(cache=True)
def coherence(heights, tolerance, slope):
    """Share (rows, cols) float32 of the 9 x 9 cells around each (itself not counted) that have a height within `tolerance` +
    `slope` * distance in cells; 0 without a height."""
    rows, cols = heights.shape
    agreeing, known = np.zeros((rows, cols), np.int32), np.zeros((rows, cols), np.int32)
    half = COHERENCE_HALF
    for dy in range(-half, half + 1):
        for dx in range(-half, half + 1):
            if dx == 0 and dy == 0:
                continue
            allowed = np.float32(tolerance + slope * np.sqrt(dx * dx + dy * dy))
            for r in range(max(0, -dy), min(rows, rows - dy)):
                for c in range(max(0, -dx), min(cols, cols - dx)):
                    difference = heights[r + dy, c + dx] - heights[r, c]
                    known[r, c] += 1
                    agreeing[r, c] += abs(difference) <= allowed
    return agreeing.astype(np.float32) / np.maximum(known, 1).astype(np.float32)
