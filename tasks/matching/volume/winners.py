"""From path sums to heights: the cheapest candidate of every cell, between planes, and what says how good it is.

Spread: how far the rivals of a height lie from it, each counted the less the dearer it is. Where the photographs are of one mind
it is nothing; where they fit almost as well elsewhere (leaves, a blank wall, something that moved) it says how wrong the height may
be.

Coherence: the share of the 9 x 9 cells around a cell whose heights go along with it. Where photographs see different leaves, or
nothing at all, the paths still prefer some height, but neighbours are not of one mind.
"""

from typing import NamedTuple

import numpy as np

from orthomill.kernels.kernel_compilation import njit

COHERENCE_HALF = 4
FARTHEST_RIVAL = 16
"""planes; a spread must not depend on how many candidates a cell happens to have"""


class Winners(NamedTuple):
    """Per cell (rows, cols): `plane` float32, fractional number of the plane, NaN without candidates; `nearest` int32, its whole
    number, -1 without; `cost` uint8 at it; `margin` float32, path sums by which the best candidate farther than two planes is
    dearer, infinite without any; `spread` float32, planes, root mean square distance of the winner and all candidates from three to
    FARTHEST_RIVAL planes away, 1 the weight of the winner and less those of the others. Where several planes count as one, all
    distances are in as many."""

    plane: np.ndarray
    nearest: np.ndarray
    cost: np.ndarray
    margin: np.ndarray
    spread: np.ndarray


def rival_weights(tolerance: float, most: int) -> np.ndarray:
    """Weights (most + 1, S) float32 of candidates whose path sums are by 0, 1, 2 ... greater than that of the winner, where 0, 1,
    ... `most` photographs see it: for two of them a factor e less for every `tolerance`.

    Costs are means: with n photographs, of which one is the reference, they vary by sqrt(n - 1) less by chance.
    """
    tolerances = tolerance / np.sqrt(np.maximum(np.arange(most + 1), 2) - 1)
    return np.exp(-np.arange(int(8 * tolerance) + 1) / tolerances[:, None]).astype(np.float32)


@njit()
def winners(total, cost, low, offset, photographs, stretch, weights):
    """Winners of packed path sums int16 and costs uint8; photographs (rows, cols) uint8 that are compared; stretch (rows, cols)
    float32, the planes that count as one (1 or more); weights of rivals, see `rival_weights`."""
    rows, cols = low.shape
    spread = np.zeros((rows, cols), np.float32)
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
            near, far = np.int64(np.rint(2 * stretch[r, c])), np.int64(np.rint(FARTHEST_RIVAL * stretch[r, c]))
            second = np.int32(2**31 - 1)
            for k in range(n):
                value = np.int32(sums[k]) if abs(k - best) > near else np.int32(2**31 - 1)
                second = min(second, value)
            if second < 2**31 - 1:
                margin[r, c] = np.float32(second - sums[best])
            of_rivals = weights[min(photographs[r, c], weights.shape[0] - 1)]
            # The winner weighs as much as the planes that count as one with it.
            squares, count = np.float32(0.0), stretch[r, c]
            for k in range(n):
                dearer = np.int32(sums[k]) - np.int32(sums[best])
                if dearer < of_rivals.size and near < abs(k - best) <= far:
                    count += of_rivals[dearer]
                    squares += of_rivals[dearer] * np.float32((k - best) * (k - best))
            spread[r, c] = np.sqrt(squares / count) / stretch[r, c]
            shift = np.float32(0.0)
            if 0 < best < n - 1:
                before, here, after = np.float32(sums[best - 1]), np.float32(sums[best]), np.float32(sums[best + 1])
                bend = before - 2 * here + after
                if bend > 0:
                    shift = min(max(np.float32(0.5) * (before - after) / bend, np.float32(-0.5)), np.float32(0.5))
            nearest[r, c], own[r, c] = low[r, c] + best, cost[begin + best]
            plane[r, c] = np.float32(low[r, c] + best) + shift
    return Winners(plane, nearest, own, margin, spread)


@njit()
def coherence(heights, tolerance, slope):
    """Share (rows, cols) float32 of the 9 x 9 cells around each (itself not counted) that have a height within its `tolerance`
    (rows, cols) float32 + `slope` * distance in cells; 0 without a height."""
    rows, cols = heights.shape
    agreeing, known = np.zeros((rows, cols), np.int32), np.zeros((rows, cols), np.int32)
    half = COHERENCE_HALF
    for dy in range(-half, half + 1):
        for dx in range(-half, half + 1):
            if dx == 0 and dy == 0:
                continue
            farther = np.float32(slope * np.sqrt(dx * dx + dy * dy))
            for r in range(max(0, -dy), min(rows, rows - dy)):
                for c in range(max(0, -dx), min(cols, cols - dx)):
                    difference = heights[r + dy, c + dx] - heights[r, c]
                    known[r, c] += 1
                    agreeing[r, c] += abs(difference) <= tolerance[r, c] + farther
    return agreeing.astype(np.float32) / np.maximum(known, 1).astype(np.float32)
