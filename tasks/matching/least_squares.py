"""Least-squares matching of points: inverse-compositional, affine, free of gain and offset, with precision and outcome per point.

Strategy
- Both images are smoothed; pixels without data are NaN (smoothing.py). A window that touches NaN anywhere is OUTSIDE.
- The template is the window around the pixel nearest to the left point. Its gradients are central differences at whole pixels, so
  nothing is resampled before it is differentiated (the weak spot of the published recipe, methods/measured.md). What is left of
  the sub-pixel position is carried over by the affine: right(point) = t + A (point - pixel).
- Gain and offset: the six derivative images are made orthogonal to the template and to a constant, which is the same as estimating
  both radiometric unknowns with the six geometric ones; the right patch is brought to the template's mean and standard deviation.
- The normal matrix belongs to the template alone: factored once, every iteration is one warp and six dot products.
- The covariance of the shift is sigma0^2 a' C a, with a the influence of the residuals on the shift and C their correlation:
  smoothing correlates neighbouring residuals, and leaving that out makes sigma two to three times too small.
- All positions inside the kernel are relative to whole pixels, so a point in a tile moves as it does in the whole image.

Source: methods/matching_windows.md 2.1 (rows 1 and 2); matching_and_dsm_check.md 1.3 (correction limiter, stop);
Baker & Matthews 2004.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numba import njit

from schemas.outcome import Outcome
from schemas.settings import Settings, setting
from tasks.matching.smoothing import smoothed, with_gaps

_EXACT = {"reassoc", "contract", "nsz", "arcp"}
"""Sums may be reordered; NaN keeps its meaning.

A kernel with it, and every kernel that calls one, is to be `forceinline`: else a process that has just compiled it and one that
loads it from the cache may call two differently optimised copies, whose sums differ in the last bit.
"""
_CONVERGED, _LOW_TEXTURE, _OUTSIDE = int(Outcome.CONVERGED), int(Outcome.LOW_TEXTURE), int(Outcome.OUTSIDE)
_NOT_CONVERGED, _MOVED_TOO_FAR = int(Outcome.NOT_CONVERGED), int(Outcome.MOVED_TOO_FAR)
_SINGULAR, _LOW_CORRELATION = int(Outcome.SINGULAR), int(Outcome.LOW_CORRELATION)


class LeastSquaresMatching(Settings):
    """How points are matched by least squares."""

    window: int = setting(21, "Side of the square window; an even number is taken as the next odd one.", "px", ge=5, le=101)
    smoothing: float = setting(0.8, "Sigma of the Gaussian that both images are smoothed with.", "px", ge=0.0, le=5.0)
    interpolation: Literal["bilinear", "bicubic"] = setting("bicubic", "How the right image is resampled.")
    max_iterations: int = setting(20, "Iterations after which a point is given up.", ge=1, le=200)
    stop: float = setting(0.02, "Converged when both shifts change by less than this.", "px", gt=0.0, le=1.0)
    max_step: float = setting(3.0, "Limit of the shift of one iteration.", "px", gt=0.0)
    max_affine_step: float = setting(0.1, "Limit of the change of the other four parameters in one iteration.", gt=0.0)
    max_shift: float = setting(6.0, "A point that moves further than this from its start is rejected.", "px", gt=0.0)
    min_correlation: float = setting(0.6, "Normalised correlation that the matched windows must reach.", ge=-1.0, le=1.0)
    min_gradient: float = setting(
        0.3, "Root mean square grey value gradient that a window must have in every direction.", "grey values per px", ge=0.0
    )

    @property
    def half(self) -> int:
        return self.window // 2


@dataclass(frozen=True)
class Matches:
    """One row per point. Where `outcome` is not CONVERGED, col, row, sigma_col and sigma_row are NaN."""

    col: np.ndarray
    row: np.ndarray
    """float64: position in the right image, px"""
    sigma_col: np.ndarray
    sigma_row: np.ndarray
    """float32: standard error of the position, px"""
    sigma0: np.ndarray
    """float32: standard deviation of the grey value residuals, in grey values of the left image"""
    correlation: np.ndarray
    """float32: of the matched windows; NaN when it never came to that"""
    affine: np.ndarray
    """(N, 4) float32: d right / d left as a12, a21, b12, b21; col' = a12 x + a21 y, row' = b12 x + b21 y"""
    iterations: np.ndarray
    """uint8"""
    outcome: np.ndarray
    """uint8: `schemas.outcome.Outcome`"""

    def __len__(self) -> int:
        return len(self.col)

    @property
    def converged(self) -> np.ndarray:
        """(N,) bool"""
        return self.outcome == _CONVERGED


@dataclass(frozen=True)
class PreparedImage:
    """A grey image made ready for matching, to be used in many calls: float32, smoothed, NaN without data."""

    grey: np.ndarray


def prepare(image: np.ndarray, settings: LeastSquaresMatching, mask: np.ndarray | None = None) -> PreparedImage:
    """Smooth a (H, W) image once; 0, NaN and False of `mask` (H, W) are no data."""
    return PreparedImage(smoothed(with_gaps(image, mask), settings.smoothing))


def match_points(left: np.ndarray | PreparedImage, right: np.ndarray | PreparedImage, points: np.ndarray, starts: np.ndarray,
                 settings: LeastSquaresMatching, affine: np.ndarray | None = None) -> Matches:
    """Match points of the left image in the right one.

    left, right: (H, W) of uint8, uint16 or float32, of any two sizes, 0 or NaN is no data; or images from `prepare`.
    points, starts: (N, 2) (col, row) in px, left positions and where to start in the right image. affine: (N, 4) start values as
    in `Matches.affine`, None for identity. Never raises on the contents of images or points: every point gets its outcome.
    """
    left, right = (image if isinstance(image, PreparedImage) else prepare(image, settings) for image in (left, right))
    points = np.asarray(points, dtype=np.float64).reshape(-1, 2)
    starts = np.asarray(starts, dtype=np.float64).reshape(-1, 2)
    identity = np.tile(np.array([1.0, 0.0, 0.0, 1.0]), (len(points), 1))
    affine = identity if affine is None else np.array(affine, dtype=np.float64).reshape(-1, 4)
    values = np.full((len(points), 10), np.nan)
    outcome, iterations = np.zeros(len(points), np.uint8), np.zeros(len(points), np.uint8)
    _match_all(left.grey, right.grey, points, starts, affine, _numbers(settings), values, outcome, iterations)
    return Matches(
        col=values[:, 0], row=values[:, 1], sigma_col=values[:, 2].astype(np.float32), sigma_row=values[:, 3].astype(np.float32),
        sigma0=values[:, 4].astype(np.float32), correlation=values[:, 5].astype(np.float32),
        affine=values[:, 6:10].astype(np.float32), iterations=iterations, outcome=outcome,
    )


def _numbers(s: LeastSquaresMatching) -> tuple[float, ...]:
    return (
        s.half, float(s.interpolation == "bicubic"), s.max_iterations, s.stop, s.max_step, s.max_affine_step, s.max_shift,
        s.min_correlation, s.min_gradient, s.smoothing,
    )


@njit(cache=True, inline="always")
def nearest_pixel(x):
    """Halves always go up: rounding them to even would make a point depend on where its tile begins."""
    return int(np.floor(x + 0.5))


@njit(cache=True, inline="always")
def cubic_weights(f):
    """Weights of the pixels at -1, 0, 1, 2 for a position f in [0, 1) (Keys 1981, a = -0.5)."""
    g = np.float32(1.0) - f
    half = np.float32(0.5)
    return (
        -half * f * g * g, np.float32(1.0) + f * f * (np.float32(1.5) * f - np.float32(2.5)),
        np.float32(1.0) + g * g * (np.float32(1.5) * g - np.float32(2.5)), -half * g * f * f,
    )


@njit(cache=True, forceinline=True, fastmath=_EXACT)
def _warp_bicubic(image, base_col, base_row, t, a, half, patch):
    """Fill `patch` (n,) with the right image at base + t + A (x, y)."""
    i = 0
    for y in range(-half, half + 1):
        for x in range(-half, half + 1):
            u, v = t[0] + a[0] * x + a[1] * y, t[1] + a[2] * x + a[3] * y
            c, r = int(np.floor(u)), int(np.floor(v))
            w0, w1, w2, w3 = cubic_weights(np.float32(u - c))
            v0, v1, v2, v3 = cubic_weights(np.float32(v - r))
            c += base_col - 1
            r += base_row - 1
            patch[i] = (
                v0 * (w0 * image[r, c] + w1 * image[r, c + 1] + w2 * image[r, c + 2] + w3 * image[r, c + 3])
                + v1 * (w0 * image[r + 1, c] + w1 * image[r + 1, c + 1] + w2 * image[r + 1, c + 2] + w3 * image[r + 1, c + 3])
                + v2 * (w0 * image[r + 2, c] + w1 * image[r + 2, c + 1] + w2 * image[r + 2, c + 2] + w3 * image[r + 2, c + 3])
                + v3 * (w0 * image[r + 3, c] + w1 * image[r + 3, c + 1] + w2 * image[r + 3, c + 2] + w3 * image[r + 3, c + 3])
            )
            i += 1


@njit(cache=True, forceinline=True, fastmath=_EXACT)
def _warp_bilinear(image, base_col, base_row, t, a, half, patch):
    i = 0
    for y in range(-half, half + 1):
        for x in range(-half, half + 1):
            u, v = t[0] + a[0] * x + a[1] * y, t[1] + a[2] * x + a[3] * y
            c, r = int(np.floor(u)), int(np.floor(v))
            f, g = np.float32(u - c), np.float32(v - r)
            c += base_col
            r += base_row
            top = image[r, c] + f * (image[r, c + 1] - image[r, c])
            bottom = image[r + 1, c] + f * (image[r + 1, c + 1] - image[r + 1, c])
            patch[i] = top + g * (bottom - top)
            i += 1


@njit(cache=True, inline="always")
def _leaves(image, base_col, base_row, t, a, half):
    """Whether a corner of the warped window, with the reach of the interpolation, is outside (NaN counts as outside)."""
    reach_x, reach_y = half * (abs(a[0]) + abs(a[1])), half * (abs(a[2]) + abs(a[3]))
    inside = (
        base_col + t[0] - reach_x >= 1 and base_col + t[0] + reach_x < image.shape[1] - 2
        and base_row + t[1] - reach_y >= 1 and base_row + t[1] + reach_y < image.shape[0] - 2
    )
    return not inside


@njit(cache=True, forceinline=True, fastmath=_EXACT)
def _dot(p, q):
    total = np.float32(0.0)
    for i in range(p.size):
        total += p[i] * q[i]
    return total


@njit(cache=True, forceinline=True, fastmath=_EXACT)
def _centre(p):
    """Subtract the mean; returns it (NaN when the window touches no data)."""
    total = np.float32(0.0)
    for i in range(p.size):
        total += p[i]
    mean = total / np.float32(p.size)
    for i in range(p.size):
        p[i] -= mean
    return mean


@njit(cache=True, forceinline=True, fastmath=_EXACT)
def _template(image, col, row, half, template, jacobian):
    """Template (n,) free of its mean, and derivatives (6, n) by the shifts and the affine, orthogonal to it and to 1.

    Returns the sum of squares of the template and the three gradient products (NaN when the window touches no data).
    """
    i = 0
    for y in range(-half, half + 1):
        for x in range(-half, half + 1):
            r, c = row + y, col + x
            template[i] = image[r, c]
            gx = np.float32(0.5) * (image[r, c + 1] - image[r, c - 1])
            gy = np.float32(0.5) * (image[r + 1, c] - image[r - 1, c])
            jacobian[0, i], jacobian[1, i], jacobian[2, i] = gx, gx * np.float32(x), gx * np.float32(y)
            jacobian[3, i], jacobian[4, i], jacobian[5, i] = gy, gy * np.float32(x), gy * np.float32(y)
            i += 1
    gxx, gxy, gyy = _dot(jacobian[0], jacobian[0]), _dot(jacobian[0], jacobian[3]), _dot(jacobian[3], jacobian[3])
    _centre(template)
    power = _dot(template, template)
    for k in range(6):
        _centre(jacobian[k])
        share = _dot(jacobian[k], template) / max(power, np.float32(1e-12))
        for i in range(template.size):
            jacobian[k, i] -= share * template[i]
    return power, gxx, gxy, gyy


@njit(cache=True)
def invert_symmetric(matrix, size, inverse):
    """Invert a positive definite matrix by Cholesky; False when a pivot falls below 1e-6 of its diagonal element."""
    lower = np.zeros((size, size))
    for i in range(size):
        for j in range(i + 1):
            total = matrix[i, j]
            for k in range(j):
                total -= lower[i, k] * lower[j, k]
            if i != j:
                lower[i, j] = total / lower[j, j]
            elif total > 1e-6 * matrix[i, i] and matrix[i, i] > 0.0:
                lower[i, i] = np.sqrt(total)
            else:
                return False
    for column in range(size):
        for i in range(size):
            total = 1.0 if i == column else 0.0
            for k in range(i):
                total -= lower[i, k] * inverse[k, column]
            inverse[i, column] = total / lower[i, i]
        for i in range(size - 1, -1, -1):
            total = inverse[i, column]
            for k in range(i + 1, size):
                total -= lower[k, i] * inverse[k, column]
            inverse[i, column] = total / lower[i, i]
    return True


@njit(cache=True, forceinline=True, fastmath=_EXACT)
def _correlated_power(influence, window, correlation):
    """a' C a of the influence a (n,) of a square window, C the correlation of pixels by their distance, up to 2 px each way."""
    total = _dot(influence, influence)
    for dy in range(3):
        for dx in range(-2, 3):
            if dy == 0 and dx <= 0:
                continue
            lag = np.float32(0.0)
            for r in range(window - dy):
                for c in range(max(0, -dx), window - max(0, dx)):
                    lag += influence[r * window + c] * influence[(r + dy) * window + c + dx]
            total += np.float32(2.0) * correlation[dy] * correlation[abs(dx)] * lag
    return max(total, np.float32(0.0))


@njit(cache=True, forceinline=True)
def _shift_variance(jacobian, inverse, first, window, correlation, influence):
    """Variance factor of the shift whose row in the inverse is `first`, with the correlation of the residuals."""
    influence[:] = 0.0
    for k in range(6):
        factor = np.float32(inverse[first, k])
        for i in range(influence.size):
            influence[i] += factor * jacobian[k, i]
    return _correlated_power(influence, window, correlation)


@njit(cache=True, forceinline=True)
def _match_one(left, right, pixel, start, a, numbers, buffers, values):
    """Match the window around the whole pixel (col, row) from `start` (2,); returns (outcome, iterations)."""
    half, bicubic, max_iterations, stop, max_step, max_affine, max_shift, min_correlation, min_gradient, _ = numbers
    half, window = int(half), 2 * int(half) + 1
    template, patch, influence, jacobian, normal, inverse, correlation = buffers
    col, row = pixel
    if not (half < col < left.shape[1] - half - 1 and half < row < left.shape[0] - half - 1):
        return _OUTSIDE, 0
    power, gxx, gxy, gyy = _template(left, col, row, half, template, jacobian)
    if not (power == power and gxx == gxx and gyy == gyy):
        return _OUTSIDE, 0
    weakest = 0.5 * (gxx + gyy) - np.sqrt(0.25 * (gxx - gyy) ** 2 + gxy * gxy)
    if weakest <= window * window * min_gradient**2 or power <= 1e-6 * window * window:
        return _LOW_TEXTURE, 0
    for i in range(6):
        for j in range(i + 1):
            normal[i, j] = normal[j, i] = _dot(jacobian[i], jacobian[j])
    if not invert_symmetric(normal, 6, inverse):
        return _SINGULAR, 0
    base_col, base_row = nearest_pixel(start[0]), nearest_pixel(start[1])
    t = np.array([start[0] - base_col, start[1] - base_row])
    begin = t.copy()
    d = np.zeros(6)
    for iteration in range(1, int(max_iterations) + 1):
        if _leaves(right, base_col, base_row, t, a, half):
            return _OUTSIDE, iteration
        if bicubic > 0.5:
            _warp_bicubic(right, base_col, base_row, t, a, half, patch)
        else:
            _warp_bilinear(right, base_col, base_row, t, a, half, patch)
        mean = _centre(patch)
        if mean != mean:
            return _OUTSIDE, iteration
        power_right = _dot(patch, patch)
        if power_right <= 1e-6 * window * window:
            return _LOW_TEXTURE, iteration
        scale = np.sqrt(power / power_right)
        values[5] = _dot(template, patch) / np.sqrt(power * power_right)
        for k in range(6):
            d[k] = 0.0
        for j in range(6):
            right_side = scale * _dot(jacobian[j], patch)
            for k in range(6):
                d[k] += inverse[k, j] * right_side
        for k in range(6):
            limit = max_step if k % 3 == 0 else max_affine
            d[k] = min(max(d[k], -limit), limit)
        m11, m12, m21, m22 = 1.0 + d[1], d[2], d[4], 1.0 + d[5]
        determinant = m11 * m22 - m12 * m21
        a0, a1, a2, a3 = a
        a[0], a[1] = (a0 * m22 - a1 * m21) / determinant, (a1 * m11 - a0 * m12) / determinant
        a[2], a[3] = (a2 * m22 - a3 * m21) / determinant, (a3 * m11 - a2 * m12) / determinant
        move_x, move_y = -(a[0] * d[0] + a[1] * d[3]), -(a[2] * d[0] + a[3] * d[3])
        t[0] += move_x
        t[1] += move_y
        if abs(t[0] - begin[0]) > max_shift or abs(t[1] - begin[1]) > max_shift:
            return _MOVED_TOO_FAR, iteration
        area = a[0] * a[3] - a[1] * a[2]
        if not 0.1 < area < 10.0:
            return _NOT_CONVERGED, iteration
        if abs(move_x) < stop and abs(move_y) < stop:
            r = min(max(values[5], 1e-3), 1.0)
            values[4] = np.sqrt(power * (1.0 / (r * r) - 1.0) / (window * window - 8))
            if values[5] < min_correlation:
                return _LOW_CORRELATION, iteration
            values[0], values[1] = base_col + t[0], base_row + t[1]
            variance_x = _shift_variance(jacobian, inverse, 0, window, correlation, influence)
            variance_y = _shift_variance(jacobian, inverse, 3, window, correlation, influence)
            values[2] = values[4] * np.sqrt(a[0] * a[0] * variance_x + a[1] * a[1] * variance_y)
            values[3] = values[4] * np.sqrt(a[2] * a[2] * variance_x + a[3] * a[3] * variance_y)
            for k in range(4):
                values[6 + k] = a[k]
            return _CONVERGED, iteration
    return _NOT_CONVERGED, int(max_iterations)


@njit(cache=True)
def _match_all(left, right, points, starts, affine, numbers, values, outcome, iterations):
    window = 2 * int(numbers[0]) + 1
    n = window * window
    sigma = max(numbers[9], 0.3)
    correlation = np.array([1.0, np.exp(-1.0 / (4.0 * sigma * sigma)), np.exp(-4.0 / (4.0 * sigma * sigma))]).astype(np.float32)
    buffers = (np.empty(n, np.float32), np.empty(n, np.float32), np.empty(n, np.float32), np.empty((6, n), np.float32),
               np.empty((6, 6)), np.empty((6, 6)), correlation)
    a, start = np.empty(4), np.empty(2)
    for i in range(points.shape[0]):
        known = np.isfinite(points[i]).all() and np.isfinite(starts[i]).all() and np.isfinite(affine[i]).all()
        if not known or np.abs(points[i]).max() > 1e9 or np.abs(starts[i]).max() > 1e9:
            outcome[i] = _OUTSIDE
            continue
        col, row = nearest_pixel(points[i, 0]), nearest_pixel(points[i, 1])
        dx, dy = points[i, 0] - col, points[i, 1] - row
        a[:] = affine[i]
        start[0] = starts[i, 0] - (a[0] * dx + a[1] * dy)
        start[1] = starts[i, 1] - (a[2] * dx + a[3] * dy)
        outcome[i], iterations[i] = _match_one(left, right, (col, row), start, a, numbers, buffers, values[i])
        values[i, 0] += a[0] * dx + a[1] * dy
        values[i, 1] += a[2] * dx + a[3] * dy
