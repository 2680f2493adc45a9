"""Where to start matching: a small correlation search along the line that height errors follow, coarse then fine.

Strategy. A wrong height moves the homologous point along the base of the pair, so that is where it is looked for: on orthoimages of
half the size all shifts along the base up to the reach and one pixel to either side, then the neighbours of the best at full
size. The surface model has the benefit of the doubt: another shift is preferred to none only when it correlates clearly better.
Searching back from the place found must return to the point.

Source: normalised correlation and back-matching: Karfis 2009, 4.3.1 and 4.4; methods/measured.md (limit across the base).
"""

from dataclasses import dataclass

import numpy as np
from numba import njit

from schemas.settings import Settings, setting

_NONE = -2.0


class ShiftSearch(Settings):
    """How far homologous points of two orthoimages may lie apart."""

    reach: int = setting(10, "Greatest shift along the base that is looked for.", "orthoimage pixels", ge=2, le=40)
    window: int = setting(13, "Side of the correlation window on orthoimages of half the size.", "px", ge=5, le=31)
    gain: float = setting(0.05, "How much better than no shift another shift must correlate.", ge=0, le=1)
    across: float = setting(2.0, "Greatest shift across the base; larger ones are wrong matches.", "orthoimage pixels", gt=0)
    back: float = setting(1.5, "Greatest distance from the point when searching back.", "orthoimage pixels", gt=0)


@dataclass(frozen=True)
class OrthoPair:
    """Two orthoimages of the same ground (rows, cols) uint8, 0 without data, at full and at half size."""

    left: np.ndarray
    right: np.ndarray
    left_half: np.ndarray
    right_half: np.ndarray

    @property
    def swapped(self) -> "OrthoPair":
        return OrthoPair(self.right, self.left, self.right_half, self.left_half)


def ortho_pair(left: np.ndarray, right: np.ndarray) -> OrthoPair:
    """Both sizes of a pair of orthoimages (rows, cols) uint8; rows and columns must start at even numbers of the whole image."""
    return OrthoPair(left.astype(np.float32), right.astype(np.float32), half_size(left), half_size(right))


def half_size(image: np.ndarray) -> np.ndarray:
    """Means of 2 x 2 pixels (rows // 2, cols // 2) float32; 0 where one of them has no data."""
    rows, cols = image.shape[0] // 2, image.shape[1] // 2
    blocks = image[: 2 * rows, : 2 * cols].reshape(rows, 2, cols, 2).astype(np.float32)
    return np.where((blocks > 0).all(axis=(1, 3)), blocks.mean(axis=(1, 3)), np.float32(0))


def back_search(search: ShiftSearch) -> ShiftSearch:
    """The search back: no shift has no benefit of the doubt there, it would hide a wrong match."""
    return search.model_copy(update={"gain": 0.0})


def shifts(pair: OrthoPair, points: np.ndarray, direction: np.ndarray, search: ShiftSearch) -> np.ndarray:
    """Whole-pixel shifts (N, 2) (col, row) int32 from points (N, 2) of the left to the right image; 0 where nothing is better.

    direction (2,): unit vector (col, row) along which height errors move points.
    """
    out = np.zeros((len(points), 2), np.int32)
    steps = _steps(direction, search.reach)
    images = pair.left, pair.right, pair.left_half, pair.right_half
    _search(*images, points.astype(np.int64), steps, (search.window // 2, search.gain), out)
    return out


def _steps(direction: np.ndarray, reach: int) -> np.ndarray:
    """Shifts (M, 2) of half-size pixels along the base and one to either side, nearest first."""
    normal = np.array([-direction[1], direction[0]])
    along = [k * direction + m * normal for k in range(-(reach // 2) - 1, reach // 2 + 2) for m in (-1, 0, 1)]
    steps = np.unique(np.rint(along).astype(np.int64), axis=0)
    return steps[np.argsort((steps**2).sum(axis=1), kind="stable")]


@njit(cache=True, fastmath={"reassoc", "contract", "nsz", "arcp"})
def _sums(a, b, ar, ac, br, bc, half):
    """Five sums over two windows of equal size, and the product of the smallest values (0: one touches no data)."""
    sa = sb = saa = sbb = sab = np.float32(0.0)
    low = np.float32(255.0)
    for i in range(-half, half + 1):
        for j in range(-half, half + 1):
            p, q = a[ar + i, ac + j] - np.float32(128.0), b[br + i, bc + j] - np.float32(128.0)
            low = min(low, min(p, q))
            sa += p
            sb += q
            saa += p * p
            sbb += q * q
            sab += p * q
    return sa, sb, saa, sbb, sab, low


@njit(cache=True)
def correlation(a, b, ar, ac, br, bc, half):
    """Normalised correlation of the windows around (ar, ac) of `a` and (br, bc) of `b`; -2 outside the images and without data."""
    for r, c, shape in ((ar, ac, a.shape), (br, bc, b.shape)):
        if r < half or c < half or r >= shape[0] - half or c >= shape[1] - half:
            return _NONE
    sa, sb, saa, sbb, sab, low = _sums(a, b, ar, ac, br, bc, half)
    if low <= -128.0:
        return _NONE
    n = (2 * half + 1) ** 2
    power = (saa - sa * sa / n) * (sbb - sb * sb / n)
    return (sab - sa * sb / n) / np.sqrt(power) if power > 1.0 else _NONE


@njit(cache=True)
def _search(left, right, left_half, right_half, points, steps, numbers, out):
    half, gain = numbers
    for i in range(points.shape[0]):
        col, row = points[i, 0], points[i, 1]
        hc, hr = col // 2, row // 2
        best, step = _NONE, 0
        for k in range(steps.shape[0]):
            found = correlation(left_half, right_half, hr, hc, hr + steps[k, 1], hc + steps[k, 0], half)
            if k == 0:
                found += gain
            if found > best:
                best, step = found, k
        if step == 0 and gain > 0.0:
            continue
        fine, dc, dr = _NONE, 0, 0
        for m in range(-1, 2):
            for n in range(-1, 2):
                c, r = 2 * steps[step, 0] + n, 2 * steps[step, 1] + m
                found = correlation(left, right, row, col, row + r, col + c, half)
                if found > fine:
                    fine, dc, dr = found, c, r
        if fine > _NONE:
            out[i, 0], out[i, 1] = dc, dr
