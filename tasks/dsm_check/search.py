"""Start values for matching: a correlation search along the base of the pair, coarse to fine.

Strategy. A wrong height moves the homologous point along the base of the pair, so the search is restricted to that line: on
orthoimages of half size all shifts along the base up to the reach and one pixel to either side, then the neighbours of the best at
full size. The surface model has the benefit of the doubt: a shift is accepted only if it correlates clearly better than no shift.
The reverse search from the place found must return to the point.

Source: normalised correlation and reverse matching: Karfis 2009, 4.3.1 and 4.4 (sources/epipolar.md#correlation, #return);
sources/measured.md#check (limit across the base).
"""

from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np

from orthomill.kernels.kernel_compilation import njit
from orthomill.tasks.dsm_check.comparison_settings import ShiftSearch

_NONE = -2.0
"""correlation where none can be computed: below every coefficient"""
_LEAST_POWER = 1.0
"""product of the centred sums of squares: windows below it are flat, and rounding would decide their correlation"""


@dataclass(frozen=True, eq=False)
class HalfSize:
    """An orthoimage at half size, with the sums that its correlation windows need; arrays (rows, cols)."""

    grey: np.ndarray
    """float32, 0 without data"""
    total: np.ndarray
    squares: np.ndarray
    """float64: sums of the window around each pixel, NaN where it extends beyond the image or contains no data"""


class _Halves(NamedTuple):
    """Both orthoimages at half size for kernels, arrays (rows, cols) as in HalfSize."""

    left: np.ndarray
    right: np.ndarray
    left_total: np.ndarray
    right_total: np.ndarray
    left_squares: np.ndarray
    right_squares: np.ndarray


@dataclass(frozen=True, eq=False)
class OrthoPair:
    """Two orthoimages of the same ground, (rows, cols) float32, 0 without data, at full and at half size."""

    left: np.ndarray
    right: np.ndarray
    left_half: HalfSize
    right_half: HalfSize

    @property
    def swapped(self) -> "OrthoPair":
        """The same pair with left and right exchanged."""
        return OrthoPair(self.right, self.left, self.right_half, self.left_half)


def ortho_pair(left: np.ndarray, right: np.ndarray, search: ShiftSearch) -> OrthoPair:
    """Both sizes of a pair of orthoimages (rows, cols) uint8; rows and columns must start at even numbers of the whole image."""
    left_half, right_half = (half_size(image, search.window // 2) for image in (left, right))
    return OrthoPair(left.astype(np.float32), right.astype(np.float32), left_half, right_half)


def half_size(image: np.ndarray, half: int) -> HalfSize:
    """Means of 2 x 2 pixels, no data where one of the four has none, and sums over windows of 2 half + 1 pixels.

    All values are multiples of a quarter, so their sums are exact: no window depends on the tile that it is computed in.
    """
    rows, cols = image.shape[0] // 2, image.shape[1] // 2
    quarters = [image[r : 2 * rows : 2, c : 2 * cols : 2] for r in (0, 1) for c in (0, 1)]
    mean = sum(quarter.astype(np.float64) for quarter in quarters) / 4.0
    grey = np.where(np.minimum.reduce(quarters) > 0, mean, 0.0)
    # a window with a single pixel without data would correlate its shape instead of the ground
    incomplete = cv2.dilate((grey == 0).astype(np.uint8), np.ones((2 * half + 1, 2 * half + 1), np.uint8)) > 0
    sums = [window_sums(values, half) for values in (grey, grey**2)]
    for values in sums:
        values[incomplete] = np.nan
    return HalfSize(grey.astype(np.float32), *sums)


def window_sums(values: np.ndarray, half: int) -> np.ndarray:
    """Sums (rows, cols) float64 over the window of 2 half + 1 pixels around each; NaN where it extends beyond the array."""
    side = 2 * half + 1
    if min(values.shape) < side:
        return np.full(values.shape, np.nan)
    out = cv2.boxFilter(values, cv2.CV_64F, (side, side), normalize=False, borderType=cv2.BORDER_CONSTANT)
    out[:half], out[-half:], out[:, :half], out[:, -half:] = np.nan, np.nan, np.nan, np.nan
    return out


def shifts(pair: OrthoPair, points: np.ndarray, direction: np.ndarray, search: ShiftSearch, gain: float) -> np.ndarray:
    """Integer pixel shifts (N, 2) (col, row) int32 from points (N, 2) of the left to the right image.

    direction (2,): unit vector (col, row) along which height errors move points. gain: how much better than no shift another must
    correlate; with 0 the result is refined at full size even where no shift is best.
    """
    out = np.zeros((len(points), 2), np.int32)
    a, b = pair.left_half, pair.right_half
    halves = _Halves(a.grey, b.grey, a.total, b.total, a.squares, b.squares)
    steps = _steps(direction, search.reach)
    _search(pair.left, pair.right, halves, points.astype(np.int64), steps, search.window // 2, gain, out)
    return out


def distance_back(pair: OrthoPair, points: np.ndarray, there: np.ndarray, direction: np.ndarray, search: ShiftSearch) -> np.ndarray:
    """Distance (N,) px from points (N, 2) at which the reverse search from their matches `there` (N, 2) ends; NaN for NaN.

    Where the match lies so close to the point that no shift is already a return, no shift has the benefit of the doubt; elsewhere
    that would hide a wrong match.
    """
    whole = np.rint(np.where(np.isfinite(there), there, points)).astype(np.int64)
    far = ~(np.hypot(*(there - points).T) <= search.back)
    back = np.zeros((len(points), 2), np.int32)
    for group, gain in ((far, 0.0), (~far, search.gain)):
        back[group] = shifts(pair.swapped, whole[group], direction, search, gain)
    return np.hypot(*(there + back - points).T)


def _steps(direction: np.ndarray, reach: int) -> np.ndarray:
    """Shifts (M, 2) of half-size pixels along the base and one to either side, nearest first."""
    # nearest first: of shifts that correlate equally well on repetitive texture the smallest is kept, and the first is none
    # one pixel to either side: residual y-parallaxes of the orientation, and the rounding of an oblique line to pixels
    normal = np.array([-direction[1], direction[0]])
    along = [k * direction + m * normal for k in range(-(reach // 2) - 1, reach // 2 + 2) for m in (-1, 0, 1)]
    steps = np.unique(np.rint(along).astype(np.int64), axis=0)
    return steps[np.argsort((steps**2).sum(axis=1), kind="stable")]


@njit(forceinline=True, fastmath={"reassoc", "contract", "nsz", "arcp"})
def _product(a, b, ar, ac, br, bc, half):
    """Sum of products of two windows relative to the grey value 128."""
    # relative to the middle grey value: float32 sums of raw products would lose the digits that the covariance needs
    total = np.float32(0.0)
    for i in range(-half, half + 1):
        for j in range(-half, half + 1):
            total += (a[ar + i, ac + j] - np.float32(128.0)) * (b[br + i, bc + j] - np.float32(128.0))
    return total


@njit(inline="always")
def _coefficient(product, sa, saa, sb, sbb, n):
    """Normalised correlation from sums over n pixels; NaN sums and flat windows give -2."""
    power = (saa - sa * sa / n) * (sbb - sb * sb / n)
    if not power > _LEAST_POWER:
        return _NONE
    return (product - (sa - 128.0 * n) * (sb - 128.0 * n) / n) / np.sqrt(power)


@njit()
def _window_sums(image, row, col, half):
    """Sum and sum of squares of the window; NaN where it extends beyond the image or contains no data."""
    total = squares = 0.0
    if row < half or col < half or row >= image.shape[0] - half or col >= image.shape[1] - half:
        return np.nan, np.nan
    for i in range(row - half, row + half + 1):
        for j in range(col - half, col + half + 1):
            value = image[i, j]
            if value == 0.0:
                return np.nan, np.nan
            total += value
            squares += value * value
    return total, squares


@njit(forceinline=True)
def _coarse(halves, row, col, steps, half, gain):
    """Number of the step that correlates best at half size; 0 is no shift."""
    a, b = halves.left, halves.right
    n = (2 * half + 1) ** 2
    best, step = _NONE, 0
    if row >= a.shape[0] or col >= a.shape[1] or not np.isfinite(halves.left_total[row, col]):
        return 0
    for k in range(steps.shape[0]):
        r, c = row + steps[k, 1], col + steps[k, 0]
        if r < half or c < half or r >= b.shape[0] - half or c >= b.shape[1] - half or not np.isfinite(halves.right_total[r, c]):
            continue
        product = _product(a, b, row, col, r, c, half)
        sa, saa = halves.left_total[row, col], halves.left_squares[row, col]
        found = _coefficient(product, sa, saa, halves.right_total[r, c], halves.right_squares[r, c], n)
        # the surface under test is right until the images clearly say otherwise
        if k == 0:
            found += gain
        if found > best:
            best, step = found, k
        # no shift with its gain cannot be beaten: a coefficient is at most 1
        if best >= 1.0:
            break
    return step


@njit(forceinline=True)
def _fine(left, right, col, row, first, half):
    """The shift next to `first` (2,) that correlates best at full size; `first` where none can be computed."""
    # at full size only the eight neighbours: half size leaves an uncertainty of one pixel
    n = (2 * half + 1) ** 2
    best, dc, dr = _NONE, first[0], first[1]
    sa, saa = _window_sums(left, row, col, half)
    if not np.isfinite(sa):
        return dc, dr
    for m in range(-1, 2):
        for k in range(-1, 2):
            c, r = first[0] + k, first[1] + m
            sb, sbb = _window_sums(right, row + r, col + c, half)
            if np.isfinite(sb):
                found = _coefficient(_product(left, right, row, col, row + r, col + c, half), sa, saa, sb, sbb, n)
                if found > best:
                    best, dc, dr = found, c, r
    return dc, dr


@njit()
def _search(left, right, halves, points, steps, half, gain, out):
    """Fills shifts (N, 2) px of points (N, 2); steps (M, 2) of half-size pixels, the first none."""
    for i in range(points.shape[0]):
        col, row = points[i, 0], points[i, 1]
        if col < 0 or row < 0:
            continue
        step = _coarse(halves, row // 2, col // 2, steps, half, gain)
        # without a shift at half size the start stays exactly on the node, and least-squares matching begins with the identity
        if step > 0 or gain == 0.0:
            out[i, 0], out[i, 1] = _fine(left, right, col, row, 2 * steps[step], half)
