"""Normalised correlation of templates along a piece of a row, and of the rows beside it.

Strategy. The products of a template with all places of its piece are summed pixel by pixel of the template, so that the innermost
loop runs along the row of places; every place has its own sum in a fixed order, whatever lies beside it. Means and standard
deviations of all windows come from running sums of whole numbers, which are exact: a part of an image gives the bits of the whole.

A place beyond either end of the piece is looked at as well, and a maximum there is refused: the true one may lie farther out.

Source: Karfis 2009, section 4.3.1 (sources/epipolar.md#correlation, #column-interval).
"""

from typing import NamedTuple

import numpy as np

from orthomill.kernels.kernel_compilation import njit
from orthomill.schemas.outcome import Outcome
from orthomill.tasks.matching.guided.guided_settings import BandCorrelation

INTERPOLATION = 0.05
"""px: standard error that a parabola through three correlations has even without noise"""
_LOCATED = np.uint8(Outcome.CONVERGED)
_FLAT, _OUTSIDE, _UNLIKE, _AT_END = (
    np.uint8(code) for code in (Outcome.LOW_TEXTURE, Outcome.OUTSIDE, Outcome.LOW_CORRELATION, Outcome.MOVED_TOO_FAR)
)


class WindowNorms(NamedTuple):
    """Mean and root of the sum of squares about it of the window about every pixel (rows, cols) float64; NaN where it leaves the
    image or touches missing data."""

    mean: np.ndarray
    norm: np.ndarray


class BandPlaces(NamedTuple):
    """One row per template. `col`, `row` float64 px, `correlation` float64, `curvature` of the correlation along the row, per px^2,
    `outcome` uint8, and `places` int64, how many were compared; NaN where nothing could be compared."""

    col: np.ndarray
    row: np.ndarray
    correlation: np.ndarray
    curvature: np.ndarray
    outcome: np.ndarray
    places: np.ndarray


def window_norms(image: np.ndarray, half: int) -> WindowNorms:
    """The norms of an image (rows, cols) float32, NaN without data, whose values are multiples of a power of 1/2 as means of 2 x 2
    pixels are."""
    side, gaps = 2 * half + 1, np.isnan(image)
    mean, norm = np.full(image.shape, np.nan), np.full(image.shape, np.nan)
    if min(image.shape) < side:
        return WindowNorms(mean, norm)
    grey = np.where(gaps, 0.0, image.astype(np.float64))
    sums, squares, missing = (_box_sums(values, side) for values in (grey, grey * grey, gaps.astype(np.float64)))
    inner = slice(half, image.shape[0] - half), slice(half, image.shape[1] - half)
    power = np.sqrt(np.maximum(squares - sums * sums / side**2, 0.0))
    mean[inner], norm[inner] = (np.where(missing == 0.0, values, np.nan) for values in (sums / side**2, power))
    return WindowNorms(mean, norm)


def _box_sums(values: np.ndarray, side: int) -> np.ndarray:
    total = np.zeros((values.shape[0] + 1, values.shape[1] + 1))
    total[1:, 1:] = values.cumsum(axis=0).cumsum(axis=1)
    return total[side:, side:] - total[:-side, side:] - total[side:, :-side] + total[:-side, :-side]


def band_places(
    left: np.ndarray, right: np.ndarray, points: np.ndarray, columns: np.ndarray, shift: int, beside: int, settings: BandCorrelation
) -> BandPlaces:
    """The most alike places of templates about the left pixels `points` (N, 2) (col, row), int64.

    left, right (rows, cols) float32, NaN without data; columns (N, 2) int64: first and last column of the piece in the right
    image, on row `row + shift` and `beside` rows to either side; a last column before the first says that there is no piece.
    """
    half = settings.half
    count = len(points)
    col, row, correlation, curvature = np.full((4, count), np.nan)
    out = BandPlaces(col, row, correlation, curvature, np.full(count, _OUTSIDE, np.uint8), np.zeros(count, np.int64))
    if min(*left.shape, *right.shape) > 2 * half:
        norms = window_norms(left, half), window_norms(right, half)
        least = settings.min_deviation * (2 * half + 1)
        _match(
            left, right, *norms, points, columns, (shift, beside, half), (least, settings.min_correlation), settings.sub_pixel, out
        )
    return out


def column_sigmas(found: BandPlaces, pixels: int) -> np.ndarray:
    """(N,) px: standard errors of the columns by the sharpness of the correlation; `pixels` of a template.

    What the windows do not have in common, (1 - r^2), moves the top by its share of the slopes: variance (1 - r^2) / (n r k) for
    white noise, k the curvature. Relief makes differences that are as wide along the row as the texture, sqrt(pi / k) pixels, and
    count so many times less often.
    """
    like, curvature = np.maximum(found.correlation, 0.05), np.maximum(found.curvature, 1e-6)
    worth = pixels * np.minimum(np.sqrt(curvature / np.pi), 1.0)
    return np.sqrt((1.0 - found.correlation**2) / (worth * like * curvature) + INTERPOLATION**2)


@njit(error_model="numpy")
def _products(right, template, row, first, total):
    """Fill total (K,) with the products of a template (side, side) and the windows about K columns of a row."""
    side = template.shape[0]
    half = side // 2
    total[:] = 0.0
    for j in range(side):
        line = right[row - half + j, first - half : first + half + total.size]
        for i in range(side):
            weight = template[j, i]
            here = line[i : i + total.size]
            for k in range(total.size):
                total[k] += weight * here[k]


@njit(error_model="numpy")
def _parabola(before, at, after):
    """Place of the top from the middle one, and curvature there."""
    curvature = 2.0 * at - before - after
    return (0.5 * (after - before) / curvature, curvature) if curvature > 0.0 else (0.0, 0.0)


@njit(error_model="numpy")
def _match(left, right, of_left, of_right, points, columns, extent, limits, sub_pixel, out):
    """Correlate the window about each of `points` (n, 2) (col, row) along its row of the other image, within `columns` (n, 2), into
    `out`. of_left, of_right: means and norms of all windows; extent: shift of columns, room for the sub-pixel place, half window;
    limits: least norm and least correlation."""
    shift, beside, half = extent
    least, min_correlation = limits
    side, cols = 2 * half + 1, right.shape[1]
    template = np.empty((side, side), np.float32)
    # Gaps take part in sums of places whose norm is NaN anyway.
    filled = np.where(np.isnan(right), np.float32(0.0), right)
    sums = np.empty(cols, np.float32)
    for n in range(points.shape[0]):
        col, row = points[n]
        if not (half <= col < left.shape[1] - half and half <= row < left.shape[0] - half):
            continue
        norm = of_left.norm[row, col]
        if np.isnan(norm):
            continue
        if norm < least:
            out.outcome[n] = _FLAT
            continue
        first, last = max(columns[n, 0] - 1, half), min(columns[n, 1] + 1, cols - 1 - half)
        if columns[n, 1] < columns[n, 0] or last < first:
            continue
        mean = np.float32(of_left.mean[row, col])
        for j in range(side):
            for i in range(side):
                template[j, i] = left[row - half + j, col - half + i] - mean
        best, best_row, best_col, flat = -2.0, -1, -1, False
        top = (np.nan, np.nan)
        total = sums[: last - first + 1]
        for r in range(row + shift - beside, row + shift + beside + 1):
            if not half <= r < right.shape[0] - half:
                continue
            _products(filled, template, r, first, total)
            for k in range(total.size):
                power = of_right.norm[r, first + k]
                if not power >= least:
                    flat = flat or power == power
                    continue
                out.places[n] += 1
                value = total[k] / (norm * power)
                if value > best:
                    best, best_row, best_col = value, r, first + k
                    before = total[k - 1] / (norm * of_right.norm[r, first + k - 1]) if k > 0 else np.nan
                    after = total[k + 1] / (norm * of_right.norm[r, first + k + 1]) if k + 1 < total.size else np.nan
                    top = (before, after)
        if best_row < 0:
            out.outcome[n] = _FLAT if flat else _OUTSIDE
            continue
        out.correlation[n] = min(best, 1.0)
        moved, curvature = _parabola(top[0], best, top[1])
        out.col[n], out.row[n] = best_col + (moved if sub_pixel else 0.0), best_row
        out.curvature[n] = curvature
        if best < min_correlation:
            out.outcome[n] = _UNLIKE
        elif best_col < columns[n, 0] or best_col > columns[n, 1]:
            out.outcome[n] = _AT_END
        elif not (top[0] == top[0] and top[1] == top[1]):
            out.outcome[n] = _OUTSIDE
        else:
            out.outcome[n] = _LOCATED
