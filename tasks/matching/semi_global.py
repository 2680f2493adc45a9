"""Semi-global matching of two epipolar images on one pyramid level: whole-pixel parallaxes to start least squares from.

Strategy: census signatures (7 x 7, blind to gain and offset), Hamming costs, eight paths with a small penalty for a change of
one pixel and a large one for a jump, the cheapest candidate per pixel, and the same read along the right image's rays from the
same sums. A pixel survives if left and right agree and if it belongs to a connected patch that is not a speck.
The claim of the system is not here but in the refinement by least squares; this finds roofs and does not stumble over repeats.

Source: Hirschmueller 2008 (paths, left-right check); Zabih & Woodfill 1994 (census).
"""

import numpy as np
from numba import njit

from schemas.settings import Settings, setting

_WHOLE = {"reassoc", "nsz", "nnan"}
"""The path costs are whole numbers in float32, so that reordering changes nothing."""
CENSUS_HALF = 3
_BITS = (2 * CENSUS_HALF + 1) ** 2 - 1


class SemiGlobal(Settings):
    """The start of dense matching: semi-global matching of census signatures."""

    small_penalty: int = setting(8, "Cost of a parallax change of one pixel between neighbours.", "census bits", ge=0, le=200)
    large_penalty: int = setting(40, "Cost of a larger parallax jump between neighbours.", "census bits", ge=0, le=400)
    tolerance: int = setting(1, "Largest difference of the parallaxes found from left and from right.", "px", ge=0, le=8)
    speckle: int = setting(60, "Connected patches with fewer pixels are removed.", "px", ge=0)


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
                for c in range(CENSUS_HALF, cols - CENSUS_HALF):
                    value = grey[r + dy, c + dx]
                    signature[r, c] = (signature[r, c] << one) | np.uint64(value < grey[r, c])
                    valid[r, c] &= value == value
    return signature, valid


@njit(cache=True, inline="always")
def _bits(v):
    v = v - ((v >> np.uint64(1)) & np.uint64(0x5555555555555555))
    v = (v & np.uint64(0x3333333333333333)) + ((v >> np.uint64(2)) & np.uint64(0x3333333333333333))
    v = (v + (v >> np.uint64(4))) & np.uint64(0x0F0F0F0F0F0F0F0F)
    v = v + (v >> np.uint64(8))
    v = v + (v >> np.uint64(16))
    return (v + (v >> np.uint64(32))) & np.uint64(0x7F)


@njit(cache=True)
def _costs(left, left_valid, right, right_valid, candidates):
    """Hamming distances (H, W, K) uint8, half the bits without data; candidate k of left column x is right column x + K - 1 - k."""
    rows, cols = left.shape
    cost = np.full((rows, cols, candidates), np.uint8(_BITS // 2), np.uint8)
    for r in range(rows):
        backwards, usable = right[r, ::-1].copy(), right_valid[r, ::-1].copy()
        for c in range(cols):
            if not left_valid[r, c]:
                continue
            mine, first, row = left[r, c], cols - 1 - c, cost[r, c]
            theirs, good = backwards[first:first + candidates], usable[first:first + candidates]
            for k in range(candidates):
                bits = _bits(mine ^ theirs[k])
                row[k] = np.uint8(bits) if good[k] else np.uint8(_BITS // 2)
    return cost


@njit(cache=True, fastmath=_WHOLE)
def _step(before, after, cost, total, penalties):
    """One step of one path: `before`, `after` (K + 2,) have a high wall at both ends; penalties: low of `before`, small, large."""
    lowest, small, large = penalties
    jump = lowest + large
    for k in range(cost.size):
        best = min(min(before[k + 1], before[k] + small), min(before[k + 2] + small, jump))
        value = np.float32(cost[k]) + best - lowest
        after[k + 1] = value
        total[k] += value


@njit(cache=True)
def _lowest(bits):
    """Least of positive floats by their bit patterns: integers, unlike floats, are compared many at a time."""
    least = bits[0]
    for k in range(1, bits.size):
        least = min(least, bits[k])
    return least


@njit(cache=True)
def _sweep(cost, total, small, large, backwards):
    """Add four paths: along the row and the three from the row above; read backwards, those are the other four."""
    rows, cols, candidates = cost.shape
    paths = np.zeros((2, 4, cols + 2, candidates + 2), np.float32)
    paths[..., 0] = 1e9
    paths[..., candidates + 1] = 1e9
    bits = paths.view(np.int32)
    lowest = np.zeros((2, 4, cols + 2), np.float32)
    lowest_bits = lowest.view(np.int32)
    for r in range(rows):
        now, above = r % 2, (r + 1) % 2
        for c in range(1, cols + 1):
            y, x = (rows - 1 - r, cols - c) if backwards else (r, c - 1)
            here, sums = cost[y, x], total[y, x]
            for path in range(4):
                row, col = (now, c - 1) if path == 0 else (above, c + path - 2)
                _step(paths[row, path, col], paths[now, path, c], here, sums, (lowest[row, path, col], small, large))
                lowest_bits[now, path, c] = _lowest(bits[now, path, c])


@njit(cache=True)
def _winners(total):
    """Cheapest candidate of every left pixel (H, W) and of every right pixel (H, W + K - 1), int16."""
    rows, cols, candidates = total.shape
    left = np.zeros((rows, cols), np.int16)
    right = np.full((rows, cols + candidates - 1), np.int16(-1), np.int16)
    best = np.empty(cols + candidates - 1, np.float32)
    for r in range(rows):
        best[:] = 1e9
        for c in range(cols):
            here, rays, seen = total[r, c], best[c:c + candidates], right[r, c:c + candidates]
            lowest, winner = here[0], 0
            for k in range(candidates):
                value = here[k]
                if value < lowest:
                    lowest, winner = value, k
                if value < rays[candidates - 1 - k]:
                    rays[candidates - 1 - k], seen[candidates - 1 - k] = value, k
            left[r, c] = winner
    return left, right


@njit(cache=True)
def _agreeing(left, right, left_valid, tolerance):
    """Winners (H, W) float32 where left and right agree, NaN elsewhere."""
    rows, cols = left.shape
    candidates = right.shape[1] - cols + 1
    out = np.full((rows, cols), np.float32(np.nan))
    for r in range(rows):
        for c in range(cols):
            k = left[r, c]
            if left_valid[r, c] and abs(right[r, c + candidates - 1 - k] - k) <= tolerance:
                out[r, c] = k
    return out


@njit(cache=True)
def remove_specks(parallax, step, smallest):
    """Put to NaN, in place, the 4-connected patches (neighbours differ by `step` at most) with fewer than `smallest` pixels."""
    rows, cols = parallax.shape
    seen = np.zeros((rows, cols), np.bool_)
    stack = np.empty(rows * cols, np.int64)
    for first in range(rows * cols):
        if seen[first // cols, first % cols] or np.isnan(parallax[first // cols, first % cols]):
            continue
        seen[first // cols, first % cols] = True
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

    left (H, W), right (H, W + K - 1), float32 with NaN without data: the right window begins so that candidate k of left column x
    is right column x + K - 1 - k. K >= 2.
    """
    candidates = right.shape[1] - left.shape[1] + 1
    left_code, left_valid = census(left)
    right_code, right_valid = census(right)
    cost = _costs(left_code, left_valid, right_code, right_valid, candidates)
    total = np.zeros(cost.shape, np.float32)
    small, large = np.float32(settings.small_penalty), np.float32(settings.large_penalty)
    _sweep(cost, total, small, large, False)
    _sweep(cost, total, small, large, True)
    winners, seen_from_right = _winners(total)
    result = _agreeing(winners, seen_from_right, left_valid, settings.tolerance)
    remove_specks(result, np.float32(1.0), settings.speckle)
    return result
