"""Semi-global matching of two epipolar images on one pyramid level: integer-pixel parallaxes as start values of least squares.

Strategy: census signatures (7 x 7, invariant to gain and offset), Hamming costs, eight paths with a small penalty for a change of
one pixel and a large one for a jump, the cheapest candidate per pixel, and the same along the rays of the right image from the same
sums. A pixel is kept if left and right agree and if it belongs to a connected patch of sufficient size.
Precision comes from the refinement by least squares; this step finds roofs and resolves repeated patterns.

Source: Hirschmueller 2008 (paths, left-right check); Zabih & Woodfill 1994 (census).
"""

import numpy as np
from numba import njit

from orthomill.schemas.settings import Settings, setting
from orthomill.tasks.matching.volume.paths import UNIT, sweep

CENSUS_HALF = 3
_NONE = np.int32(2**31 - 1)


class SemiGlobal(Settings):
    """The start of dense matching: semi-global matching of census signatures."""

    small_penalty: int = setting(8, "Cost of a parallax change of one pixel between neighbours.", "census bits", ge=0, le=200)
    large_penalty: int = setting(40, "Cost of a larger parallax jump between neighbours.", "census bits", ge=0, le=400)
    tolerance: int = setting(1, "Largest difference of the parallaxes found from left and from right.", "px", ge=0, le=8)
    speckle: int = setting(60, "Connected patches with fewer pixels are removed.", "px", ge=0)
    blank: int = setting(
        14, "Cost of a candidate outside the other image; low, so that only a good match is cheaper.", "census bits", ge=0, le=48
    )


@njit(cache=True)
def census(grey):
    """(H, W) float32, NaN without data -> signatures (H, W) uint64 and validity (H, W) bool (whole window with data)."""
    rows, cols = grey.shape
    signature, valid = np.zeros((rows, cols), np.uint64), np.zeros((rows, cols), np.bool_)
    one = np.uint64(1)
    for r in range(CENSUS_HALF, rows - CENSUS_HALF):
        for c in range(CENSUS_HALF, cols - CENSUS_HALF):
            valid[r, c] = grey[r, c] == grey[r, c]
        for dy in range(-CENSUS_HALF, CENSUS_HALF + 1):
            for dx in range(-CENSUS_HALF, CENSUS_HALF + 1):
                if dx == 0 and dy == 0:
                    continue
                # The window runs outside and the columns inside, so that the inner loop is contiguous and vectorised.
                for c in range(CENSUS_HALF, cols - CENSUS_HALF):
                    value = grey[r + dy, c + dx]
                    signature[r, c] = (signature[r, c] << one) | np.uint64(value < grey[r, c])
                    valid[r, c] &= value == value
    return signature, valid


@njit(cache=True, inline="always")
def _bits(v):
    """Number of bits set in a uint64."""
    # Additions in parallel: unlike a table or a loop, LLVM vectorises it, and numba knows no popcount.
    v = v - ((v >> np.uint64(1)) & np.uint64(0x5555555555555555))
    v = (v & np.uint64(0x3333333333333333)) + ((v >> np.uint64(2)) & np.uint64(0x3333333333333333))
    v = (v + (v >> np.uint64(4))) & np.uint64(0x0F0F0F0F0F0F0F0F)
    v = v + (v >> np.uint64(8))
    v = v + (v >> np.uint64(16))
    return (v + (v >> np.uint64(32))) & np.uint64(0x7F)


@njit(cache=True)
def _costs(left, right, right_valid, low, offset, blank):
    """Packed Hamming distances uint8 of all candidates of every pixel, `blank` where the right image has no data."""
    rows, cols = left.shape
    cost = np.empty(offset[-1], np.uint8)
    for r in range(rows):
        # Candidates run to the left in the right image: reversed, both operands are contiguous.
        backwards, usable = right[r, ::-1].copy(), right_valid[r, ::-1].copy()
        for c in range(cols):
            begin, end = offset[r * cols + c], offset[r * cols + c + 1]
            mine, first = left[r, c], cols - 1 - c + low[r, c]
            here, theirs, good = cost[begin:end], backwards[first : first + end - begin], usable[first : first + end - begin]
            for k in range(end - begin):
                bits = _bits(mine ^ theirs[k])
                here[k] = np.uint8(bits) if good[k] else blank
    return cost


@njit(cache=True)
def _winners(total, low, offset, right_valid, candidates):
    """Cheapest candidate of every left pixel (H, W) and of every right pixel (H, W + K - 1), int16; -1 where there is none.

    Sum and candidate are compared as one number, sum * 4096 + candidate: many at a time, and of equal sums the first wins.
    """
    rows, cols = low.shape
    left, right = np.full((rows, cols), np.int16(-1), np.int16), np.full(right_valid.shape, np.int16(-1), np.int16)
    best = np.empty(cols + candidates - 1, np.int32)
    for r in range(rows):
        best[:] = _NONE
        for c in range(cols):
            begin, end = offset[r * cols + c], offset[r * cols + c + 1]
            first, lowest = low[r, c], _NONE
            here, rays = total[begin:end], best[c + candidates - first - (end - begin) : c + candidates - first]
            for k in range(rays.size):
                # One comparison instead of two keeps the loop vectorised; ties then go to the lower candidate in both views.
                number = np.int32(np.int32(here[rays.size - 1 - k]) * 4096 + np.int32(first + rays.size - 1 - k))
                lowest = min(lowest, number)
                rays[k] = min(rays[k], number)
            # A blank candidate may be the cheapest: it says that the pixel is not seen on the right.
            if lowest < _NONE and right_valid[r, c + candidates - 1 - lowest % 4096]:
                left[r, c] = lowest % 4096
        for x in range(best.size):
            if best[x] < _NONE:
                right[r, x] = best[x] % 4096
    return left, right


@njit(cache=True)
def _agreeing(left, right, tolerance):
    """Winners (H, W) float32 where left and right agree, NaN elsewhere."""
    rows, cols = left.shape
    candidates = right.shape[1] - cols + 1
    out = np.full((rows, cols), np.float32(np.nan))
    for r in range(rows):
        for c in range(cols):
            k = left[r, c]
            if k >= 0 and abs(right[r, c + candidates - 1 - k] - k) <= tolerance:
                out[r, c] = k
    return out


@njit(cache=True)
def remove_specks(parallax, step, smallest):
    """Set to NaN, in place, the 4-connected patches (neighbours differ by `step` at most) with fewer than `smallest` pixels."""
    rows, cols = parallax.shape
    seen = np.zeros((rows, cols), np.bool_)
    stack = np.empty(rows * cols, np.int64)
    for first in range(rows * cols):
        if seen[first // cols, first % cols] or np.isnan(parallax[first // cols, first % cols]):
            continue
        seen[first // cols, first % cols] = True
        # The stack is a queue: its first `count` entries remain the list of the patch's pixels.
        stack[0] = first
        count, done = 1, 0
        while done < count:
            r, c = stack[done] // cols, stack[done] % cols
            done += 1
            for dr, dc in ((0, 1), (1, 0), (0, -1), (-1, 0)):
                y, x = r + dr, c + dc
                if 0 <= y < rows and 0 <= x < cols and not seen[y, x] and abs(parallax[y, x] - parallax[r, c]) <= step:
                    seen[y, x] = True
                    stack[count] = y * cols + x
                    count += 1
        if count < smallest:
            for i in range(count):
                parallax[stack[i] // cols, stack[i] % cols] = np.nan


def semi_global(left: np.ndarray, right: np.ndarray, settings: SemiGlobal) -> np.ndarray:
    """Candidate numbers (H, W) float32 of a left image, NaN where none is trusted.

    left (H, W), right (H, W + K - 1), float32 with NaN without data: candidate k of left column x is right column x + K - 1 - k.
    2 <= K < 4096.
    """
    candidates = right.shape[1] - left.shape[1] + 1
    padded = -(-candidates // UNIT) * UNIT
    left_code, left_valid = census(left)
    right_code, right_valid = (np.pad(array, ((0, 0), (padded - candidates, 0))) for array in census(right))
    # Pixels without a whole census window get no candidate at all: no cost, no memory, and walls for the paths.
    low, offset = _packing(left_valid, padded)
    cost = _costs(left_code, right_code, right_valid, low, offset, np.uint8(settings.blank))
    total = np.zeros(cost.shape, np.int16)
    small, large = np.int16(settings.small_penalty), np.int16(settings.large_penalty)
    sweep(cost, total, low, offset, padded, small, large, False)
    sweep(cost, total, low, offset, padded, small, large, True)
    winners, seen_from_right = _winners(total, low, offset, right_valid, padded)
    result = _agreeing(winners, seen_from_right, settings.tolerance)
    remove_specks(result, np.float32(1.0), settings.speckle)
    return result


def _packing(valid: np.ndarray, padded: int) -> tuple[np.ndarray, np.ndarray]:
    """First candidate (H, W) int32 of every pixel, and where its candidates begin in the packed costs (H * W + 1,)."""
    count = np.where(valid, padded, 0)
    return np.zeros(valid.shape, np.int32), np.concatenate([[0], np.cumsum(count.ravel(), dtype=np.int64)])
