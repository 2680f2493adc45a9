"""Least-squares matching along epipolar rows: parallax and its two slopes at nodes of the left image, on one surface at a time.

Strategy
- Rows are homologous, so the unknowns are the parallax and its derivatives along and across the row; resampling is one-dimensional.
- A start surface (whole-pixel parallaxes of semi-global matching) gives every node its start plane, and its *support*: the pixels
  of the window that lie on the same surface as the node. At a roof edge the window keeps the roof and drops the ground, so that
  parallaxes do not smear over the wall. Where it would have to drop more than a little, a smaller window takes its place.
- Where the start surface is empty or breaks within a pixel or two, the surfaces on both sides are tried, and the one whose grey
  values fit best at the node itself (not in the window as a whole) is kept.
- Otherwise as in inverse_compositional.py: inverse-compositional, gain and offset eliminated, covariance with correlated residuals.

Source: methods/matching_windows.md 2.1; relative_orientation_and_epipolar.md 1.18; the support is our own.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit

from orthomill.schemas.outcome import Outcome
from orthomill.tasks.matching.least_squares.grey_values import EXACT, cubic_weights
from orthomill.tasks.matching.least_squares.small_systems import invert
from orthomill.tasks.matching.least_squares.window_block import dot

_CONVERGED, _LOW_TEXTURE, _OUTSIDE = int(Outcome.CONVERGED), int(Outcome.LOW_TEXTURE), int(Outcome.OUTSIDE)
_NOT_CONVERGED, _MOVED_TOO_FAR, _SINGULAR = int(Outcome.NOT_CONVERGED), int(Outcome.MOVED_TOO_FAR), int(Outcome.SINGULAR)
_LOW_CORRELATION, _INCONSISTENT, _NOT_TRIED = int(Outcome.LOW_CORRELATION), int(Outcome.INCONSISTENT), int(Outcome.NOT_TRIED)
_CENTRE = 1
"""half the side of the patch at the node in which surfaces compete"""
_WHOLE = 0.85
"""share of the window on the node's surface below which the smaller window is taken"""


@dataclass(frozen=True)
class EpipolarLimits:
    """What the kernel needs of the settings: see `DenseMatching` in blocks.py for meaning and units."""

    half: int
    edge_half: int
    max_iterations: int
    stop: float
    max_shift: float
    surface_tolerance: float
    min_support: float
    min_correlation: float
    min_gradient: float
    smoothing: float

    def numbers_for(self, factor: int) -> tuple[float, ...]:
        """For the kernel, with a start surface whose pixels are `factor` px wide."""
        return (
            self.half,
            self.max_iterations,
            self.stop,
            self.max_shift,
            self.surface_tolerance * factor,
            self.min_support,
            self.min_correlation,
            self.min_gradient,
            self.edge_half,
        )


@dataclass(frozen=True)
class NodeParallaxes:
    """Of a grid of nodes (rows, cols): parallax and sigma (float32, px, NaN where there is none), correlation, outcome (uint8)."""

    parallax: np.ndarray
    sigma: np.ndarray
    correlation: np.ndarray
    outcome: np.ndarray


@dataclass(frozen=True)
class StartSurface:
    """Parallaxes (H / factor, W / factor) float32 in px of the left image (H, W), NaN where there are none."""

    parallax: np.ndarray
    factor: int


@njit(cache=True)
def _surface_window(start, factor, row, col, half, window):
    """Start parallaxes of the pixels of a window (n,), NaN where there are none."""
    i = 0
    for r in range(row - half, row + half + 1):
        for c in range(col - half, col + half + 1):
            y, x = r // factor, c // factor
            window[i] = start[y, x] if 0 <= y < start.shape[0] and 0 <= x < start.shape[1] else np.float32(np.nan)
            i += 1


@njit(cache=True)
def _plane(window, half, level, reach, guess, plane, sums):
    """Plane (value, slope x, slope y) through the pixels within `reach` of `guess` (3,); False when there are too few."""
    sums[:] = 0.0
    i = 0
    for y in range(-half, half + 1):
        for x in range(-half, half + 1):
            value = window[i] - level
            if abs(value - guess[0] - guess[1] * x - guess[2] * y) <= reach:
                sums[0] += 1
                sums[1] += x
                sums[2] += y
                sums[3] += x * x
                sums[4] += x * y
                sums[5] += y * y
                sums[6] += value
                sums[7] += value * x
                sums[8] += value * y
            i += 1
    n = sums[0]
    if n < 6:
        return False
    mx, my, mv = sums[1] / n, sums[2] / n, sums[6] / n
    cxx, cxy, cyy = sums[3] - n * mx * mx + 0.05 * n, sums[4] - n * mx * my, sums[5] - n * my * my + 0.05 * n
    cvx, cvy = sums[7] - n * mv * mx, sums[8] - n * mv * my
    determinant = cxx * cyy - cxy * cxy
    sx, sy = (cvx * cyy - cvy * cxy) / determinant, (cvy * cxx - cvx * cxy) / determinant
    plane[1], plane[2] = min(max(sx, -0.8), 0.8), min(max(sy, -0.8), 0.8)
    plane[0] = mv - plane[1] * mx - plane[2] * my
    return True


@njit(cache=True)
def _support(left, row, col, half, window, level, plane, tolerance, mask):
    """Mark the pixels of the window (n,) that lie on the plane; pixels of unknown parallax count where nothing else is in sight."""
    foreign = 0
    for i in range(window.size):
        y, x = i // (2 * half + 1) - half, i % (2 * half + 1) - half
        if abs(window[i] - level - plane[0] - plane[1] * x - plane[2] * y) > tolerance:
            foreign += 1
    count = 0
    for i in range(window.size):
        y, x = i // (2 * half + 1) - half, i % (2 * half + 1) - half
        value = window[i]
        mask[i] = 0.0
        if value != value:
            belongs = foreign * 10 <= window.size
        else:
            belongs = abs(value - level - plane[0] - plane[1] * x - plane[2] * y) <= tolerance
        if belongs:
            r, c = row + y, col + x
            data = left[r, c] + left[r, c - 1] + left[r, c + 1]
            if data == data:
                mask[i] = 1.0
                count += 1
    return count


@njit(cache=True, forceinline=True, fastmath=EXACT)
def _centre_masked(p, mask, count):
    total = np.float32(0.0)
    for i in range(p.size):
        total += p[i] * mask[i]
    mean = total / np.float32(count)
    for i in range(p.size):
        p[i] = (p[i] - mean) * mask[i]
    return mean


@njit(cache=True, forceinline=True)
def _template(left, row, col, half, mask, count, template, jacobian):
    """Template (n,) and derivatives (3, n), zero outside the support; returns its power and that of the row gradients."""
    i = 0
    for y in range(-half, half + 1):
        for x in range(-half, half + 1):
            if mask[i] > 0:
                r, c = row + y, col + x
                template[i] = left[r, c]
                gx = np.float32(0.5) * (left[r, c + 1] - left[r, c - 1])
            else:
                template[i], gx = np.float32(0.0), np.float32(0.0)
            jacobian[0, i], jacobian[1, i], jacobian[2, i] = gx, gx * np.float32(x), gx * np.float32(y)
            i += 1
    gradient = dot(jacobian[0], jacobian[0])
    _centre_masked(template, mask, count)
    power = dot(template, template)
    for k in range(3):
        _centre_masked(jacobian[k], mask, count)
        share = dot(jacobian[k], template) / max(power, np.float32(1e-12))
        for i in range(template.size):
            jacobian[k, i] -= share * template[i]
    return power, gradient


@njit(cache=True)
def _warp(right, row, base, t, a, b, half, mask, patch):
    """Right image at column base + t + a x + b y of row + y, on the support; False where that leaves the image."""
    reach = abs(a) * half + abs(b) * half
    if not (base + t - reach >= 1 and base + t + reach < right.shape[1] - 2):
        return False
    i = 0
    for y in range(-half, half + 1):
        line = right[row + y]
        start = t + b * y
        for x in range(-half, half + 1):
            if mask[i] > 0:
                u = start + a * x
                c = int(np.floor(u))
                w0, w1, w2, w3 = cubic_weights(np.float32(u - c))
                c += base - 1
                patch[i] = (w0 * line[c] + w1 * line[c + 1]) + (w2 * line[c + 2] + w3 * line[c + 3])
            else:
                patch[i] = np.float32(0.0)
            i += 1
    return True


@njit(cache=True, forceinline=True, fastmath=EXACT)
def _correlated_power(influence, window, correlation):
    """a' C a of the influence a (n,), C the correlation of pixels by their distance, up to 2 px each way."""
    total = dot(influence, influence)
    for dy in range(3):
        for dx in range(-2, 3):
            if dy == 0 and dx <= 0:
                continue
            lag = np.float32(0.0)
            shift = dy * window + dx
            for i in range(influence.size - shift):
                lag += influence[i] * influence[i + shift]
            total += np.float32(2.0) * correlation[dy] * correlation[abs(dx)] * lag
    return max(total, np.float32(0.0))


@njit(cache=True)
def _misfit(template, patch, scale, half, mask, mean_left, mean_right, left, right, row, col, base, t, a, b):
    """Mean absolute grey value residual in the small patch at the node, support or not."""
    total, count = 0.0, 0
    for y in range(-_CENTRE, _CENTRE + 1):
        for x in range(-_CENTRE, _CENTRE + 1):
            u = t + a * x + b * y
            c = int(np.floor(u))
            w0, w1, w2, w3 = cubic_weights(np.float32(u - c))
            c += base - 1
            line = right[row + y]
            grey = w0 * line[c] + w1 * line[c + 1] + w2 * line[c + 2] + w3 * line[c + 3]
            total += abs((grey - mean_right) * scale - (left[row + y, col + x] - mean_left))
            count += 1
    return total / count


@njit(cache=True, forceinline=True)
def _refine(left, right, row, col, shift, half, plane, count, numbers, buffers, values):
    """Refine the plane of a node; values: parallax, sigma, correlation, misfit at the node, sigma0. Returns the outcome.

    The right column of left column c at parallax q is c + shift - q.
    """
    _, max_iterations, stop, max_shift, _, _, min_correlation, min_gradient, _ = numbers
    mask, template, patch, influence, jacobian, normal, lower, inverse, correlation = buffers
    power, gradient = _template(left, row, col, half, mask, count, template, jacobian)
    if not (gradient > count * min_gradient * min_gradient and power > 1e-6 * count):
        return _LOW_TEXTURE
    for i in range(3):
        for j in range(i + 1):
            normal[i, j] = normal[j, i] = dot(jacobian[i], jacobian[j])
        normal[i, i] *= 1.001
    if not invert(normal, 3, lower, inverse):
        return _SINGULAR
    base = int(col + shift - np.rint(plane[0]))
    t, a, b = np.rint(plane[0]) - plane[0], 1.0 - plane[1], -plane[2]
    begin = t
    for _ in range(int(max_iterations)):
        if not _warp(right, row, base, t, a, b, half, mask, patch):
            return _OUTSIDE
        mean_right = _centre_masked(patch, mask, count)
        if mean_right != mean_right:
            return _OUTSIDE
        power_right = dot(patch, patch)
        if power_right <= 1e-6 * count:
            return _LOW_TEXTURE
        scale = np.sqrt(power / power_right)
        values[2] = dot(template, patch) / np.sqrt(power * power_right)
        j0, j1, j2 = dot(jacobian[0], patch) * scale, dot(jacobian[1], patch) * scale, dot(jacobian[2], patch) * scale
        d0 = inverse[0, 0] * j0 + inverse[0, 1] * j1 + inverse[0, 2] * j2
        d1 = inverse[1, 0] * j0 + inverse[1, 1] * j1 + inverse[1, 2] * j2
        d2 = inverse[2, 0] * j0 + inverse[2, 1] * j1 + inverse[2, 2] * j2
        d0, d1, d2 = min(max(d0, -1.5), 1.5), min(max(d1, -0.1), 0.1), min(max(d2, -0.1), 0.1)
        a /= 1.0 + d1
        b -= a * d2
        t -= a * d0
        if abs(t - begin) > max_shift:
            return _MOVED_TOO_FAR
        if not (0.25 < a < 4.0 and abs(b) < 2.0):
            return _NOT_CONVERGED
        if abs(a * d0) < stop:
            rho = min(max(values[2], 1e-3), 1.0)
            values[4] = np.sqrt(power * (1.0 / (rho * rho) - 1.0) / max(count - 5, 1))
            influence[:] = 0.0
            for k in range(3):
                factor = np.float32(inverse[0, k])
                for i in range(influence.size):
                    influence[i] += factor * jacobian[k, i]
            values[0] = np.rint(plane[0]) - t
            values[1] = a * values[4] * np.sqrt(_correlated_power(influence, 2 * half + 1, correlation))
            mean_left, n = 0.0, 0
            for i in range(mask.size):
                if mask[i] > 0:
                    mean_left += left[row + i // (2 * half + 1) - half, col + i % (2 * half + 1) - half]
                    n += 1
            values[3] = _misfit(template, patch, scale, half, mask, mean_left / n, mean_right, left, right, row, col, base, t, a, b)
            return _CONVERGED if values[2] >= min_correlation else _LOW_CORRELATION
    return _NOT_CONVERGED


@njit(cache=True)
def _hypotheses(window, half, reach, found):
    """Start parallaxes worth trying at the centre of a window: its own, and the lowest and highest within `reach` px of it."""
    side = 2 * half + 1
    own = window[half * side + half]
    low, high = np.float32(np.inf), np.float32(-np.inf)
    for y in range(-reach, reach + 1):
        for x in range(-reach, reach + 1):
            value = window[(half + y) * side + half + x]
            if value == value:
                low, high = min(low, value), max(high, value)
    count = 0
    if own == own:
        found[0] = own
        count = 1
    for value in (low, high):
        new = abs(value) < np.float32(1e9)
        for i in range(count):
            new = new and abs(value - found[i]) > np.float32(2.5)
        if new:
            found[count] = value
            count += 1
    return count


@njit(cache=True)
def _buffers(half, correlation):
    n = (2 * half + 1) ** 2
    return (
        np.empty(n, np.float32),
        np.empty(n, np.float32),
        np.empty(n, np.float32),
        np.empty(n, np.float32),
        np.empty((3, n), np.float32),
        np.empty((3, 3)),
        np.empty((3, 3)),
        np.empty((3, 3)),
        correlation,
    )


@njit(cache=True)
def _surface(left, row, col, half, window, level, tolerance, plane, scratch, mask):
    """The plane of the surface at `level` in a window and its support; the number of its pixels, 0 when there is no plane."""
    guess, sums = scratch
    guess[:] = 0.0
    if not _plane(window, half, level, tolerance + 0.1 * half, guess, plane, sums):
        return 0
    guess[:] = plane
    _plane(window, half, level, tolerance, guess, plane, sums)
    return _support(left, row, col, half, window, level, plane, tolerance, mask)


@njit(cache=True)
def _match_nodes(left, right, start, factor, rows, cols, shift, correlation, numbers, parallax, sigma, likeness, outcome):
    wide, edge, tolerance, min_support = int(numbers[0]), int(numbers[8]), numbers[4], numbers[5]
    found = np.empty(3, np.float32)
    window, edge_window = np.empty((2 * wide + 1) ** 2, np.float32), np.empty((2 * edge + 1) ** 2, np.float32)
    wide_buffers, edge_buffers = _buffers(wide, correlation), _buffers(edge, correlation)
    plane, scratch, values = np.empty(3), (np.empty(3), np.empty(9)), np.empty(5)
    for i in range(rows.size):
        for j in range(cols.size):
            row, col = rows[i], cols[j]
            inside = wide < row < left.shape[0] - wide - 1 and wide < col < left.shape[1] - wide - 1
            if not inside or np.isnan(left[row, col]):
                outcome[i, j] = _OUTSIDE
                continue
            _surface_window(start, factor, row, col, wide, window)
            count = _hypotheses(window, wide, min(wide, 2 * factor), found)
            if count == 0:
                count = _hypotheses(window, wide, wide, found)
            best = np.inf
            outcome[i, j] = _NOT_TRIED
            for h in range(count):
                level, half, buffers = np.float64(found[h]), wide, wide_buffers
                support = _surface(left, row, col, half, window, level, tolerance, plane, scratch, buffers[0])
                if edge < wide and support < _WHOLE * window.size:
                    half, buffers = edge, edge_buffers
                    _surface_window(start, factor, row, col, half, edge_window)
                    support = _surface(left, row, col, half, edge_window, level, tolerance, plane, scratch, buffers[0])
                if support < min_support * (2 * half + 1) ** 2 or support < 6:
                    continue
                plane[0] += level
                values[:] = np.nan
                result = _refine(left, right, row, col, shift, half, plane, support, numbers, buffers, values)
                if result == _CONVERGED and values[3] < best:
                    best = values[3]
                    outcome[i, j] = result
                    parallax[i, j], sigma[i, j], likeness[i, j] = values[0], values[1], values[2]
                    if best > 4.0 * values[4] + 1.0:
                        outcome[i, j] = _INCONSISTENT
                elif best == np.inf:
                    outcome[i, j] = result
                    likeness[i, j] = values[2]
            if outcome[i, j] != _CONVERGED:
                parallax[i, j] = np.nan
                sigma[i, j] = np.nan


def match_nodes(
    left: np.ndarray, right: np.ndarray, start: StartSurface, rows: np.ndarray, cols: np.ndarray, shift: int, limits: EpipolarLimits
) -> NodeParallaxes:
    """Match the nodes (rows x cols) of a left image along the rows of a right image.

    left (H, W), right (H, W'): float32, smoothed, NaN without data. rows, cols: pixel rows (n,) and columns (m,) of the nodes.
    shift: the right column of left column c at parallax q is c + shift - q.
    """
    shape = len(rows), len(cols)
    nodes = NodeParallaxes(*(np.full(shape, np.nan, np.float32) for _ in range(3)), np.zeros(shape, np.uint8))
    sigma = max(limits.smoothing, 0.3)
    correlation = np.exp(-(np.arange(3) ** 2) / (4.0 * sigma**2)).astype(np.float32)
    rows, cols = np.asarray(rows, np.int64), np.asarray(cols, np.int64)
    _match_nodes(
        left,
        right,
        start.parallax,
        start.factor,
        rows,
        cols,
        shift,
        correlation,
        limits.numbers_for(start.factor),
        nodes.parallax,
        nodes.sigma,
        nodes.correlation,
        nodes.outcome,
    )
    return nodes
