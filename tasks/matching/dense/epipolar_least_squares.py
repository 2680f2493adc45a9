"""Least-squares matching along epipolar rows: parallax and its two slopes at the nodes of the left image, one surface at a time.

Strategy
- Rows are homologous, so the unknowns are the parallax and its derivatives along and across the row; resampling is one-dimensional.
- Every node starts on the plane of a start surface and uses only the pixels of its window that lie on that surface, its support
  (node_surfaces.py). Where the support falls below `_WHOLE` of the window, a smaller window replaces it.
- Where the start surface is empty or breaks within a pixel or two, the surfaces on both sides are tried, and the one whose grey
  values fit best at the node itself (not over the whole window) is kept.
- Otherwise as in inverse_compositional.py: inverse-compositional, gain and offset eliminated, covariance with correlated residuals.

Source: methods/matching_windows.md 2.1; relative_orientation_and_epipolar.md 1.18.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from orthomill.tasks.matching.dense.node_surfaces import Node, StartSurface, fit_surface, start_parallaxes, surface_window
from orthomill.tasks.matching.least_squares import result_columns as outcomes
from orthomill.tasks.matching.least_squares.grey_values import EXACT, cubic_weights
from orthomill.tasks.matching.least_squares.small_systems import invert
from orthomill.tasks.matching.least_squares.window_block import dot

_PARALLAX, _SIGMA, _CORRELATION, _MISFIT, _SIGMA0 = range(5)
"""Places in the row of numbers that an attempt leaves behind."""
_CENTRE = 1
"""half the side of the patch at the node in which surfaces compete"""
_WHOLE = 0.85
"""share of the window on the node's surface below which the smaller window is used"""
_FEWEST = 6
"""pixels of support: five unknowns (three of the plane, gain and offset) and one more"""
_DAMPING = 1.001
"""Factor of the diagonal of the normal matrix: slopes that the texture hardly determines stay near their start."""
_MAX_STEP, _MAX_SLOPE_STEP = 1.5, 0.1
"""limits of the change in one iteration: of the parallax (px) and of its slopes"""
_FLAT = 1e-6
"""variance of grey values below which a window counts as constant"""


class EpipolarLimits(NamedTuple):
    """What the kernel needs of the settings: see `DenseMatching` in blocks.py for meaning and units."""

    half: int
    edge_half: int
    max_iterations: int
    stop: float
    max_shift: float
    surface_tolerance: float
    """px of the start surface; the kernel receives px of the image"""
    min_support: float
    min_correlation: float
    min_gradient: float
    smoothing: float


class NodeParallaxes(NamedTuple):
    """Results at a grid of nodes, each (rows, cols)."""

    parallax: np.ndarray
    """float32, px, NaN where not matched"""
    sigma: np.ndarray
    """float32: standard error, px, NaN where not matched"""
    correlation: np.ndarray
    """float32, NaN where the window was never resampled"""
    outcome: np.ndarray
    """uint8 `Outcome`"""

    @classmethod
    def unmatched(cls, outcome: np.ndarray) -> "NodeParallaxes":
        """Nodes without any parallax, with their outcomes (rows, cols)."""
        parallax, sigma, correlation = (np.full(outcome.shape, np.nan, np.float32) for _ in range(3))
        return cls(parallax, sigma, correlation, outcome)


class RowPair(NamedTuple):
    """Two epipolar images, float32, NaN without data: the right column of left column c at parallax q is c + shift - q."""

    left: np.ndarray
    right: np.ndarray
    shift: int


class RowWarp(NamedTuple):
    """Where the pixel (x, y) of a window lies in its right row: at column base + t + a x + b y."""

    base: int
    t: float
    a: float
    b: float


class WindowExposure(NamedTuple):
    """Grey values of both windows: means over the support, and the factor from right to left contrast."""

    mean_left: float
    mean_right: float
    scale: float


class NodeScratch(NamedTuple):
    """Arrays for a window of n pixels, reused by every node."""

    mask: np.ndarray
    """(n,) float32: 1 on the support, else 0"""
    template: np.ndarray
    """(n,) float32: left grey values about their mean, 0 off the support"""
    patch: np.ndarray
    """(n,) float32: the same of the resampled right window"""
    influence: np.ndarray
    """(n,) float32: of the residuals on the parallax"""
    jacobian: np.ndarray
    """(3, n) float32: derivatives by parallax, slope along and slope across the row"""
    normal: np.ndarray
    lower: np.ndarray
    inverse: np.ndarray
    """(3, 3) each"""
    correlation: np.ndarray
    """(3,) float32: of residuals 0, 1 and 2 px apart"""


@njit(cache=True, forceinline=True, fastmath=EXACT)
def _centre_masked(p, mask, count):
    """Subtract from `p` its mean over the support and clear the rest; returns the mean."""
    total = np.float32(0.0)
    for i in range(p.size):
        total += p[i] * mask[i]
    mean = total / np.float32(count)
    for i in range(p.size):
        p[i] = (p[i] - mean) * mask[i]
    return mean


@njit(cache=True, forceinline=True)
def _build_template(left, node, count, scratch):
    """Fill template and derivatives, zero off the support; returns the template's power and that of the row gradients."""
    half, mask, template, jacobian = node.half, scratch.mask, scratch.template, scratch.jacobian
    i = 0
    for y in range(-half, half + 1):
        for x in range(-half, half + 1):
            if mask[i] > 0:
                r, c = node.row + y, node.col + x
                template[i] = left[r, c]
                gx = np.float32(0.5) * (left[r, c + 1] - left[r, c - 1])
            else:
                template[i], gx = np.float32(0.0), np.float32(0.0)
            jacobian[0, i], jacobian[1, i], jacobian[2, i] = gx, gx * np.float32(x), gx * np.float32(y)
            i += 1
    gradient = dot(jacobian[0], jacobian[0])
    _centre_masked(template, mask, count)
    power = dot(template, template)
    # Gain and offset are eliminated: derivatives made orthogonal to a constant and to the template.
    for k in range(3):
        _centre_masked(jacobian[k], mask, count)
        share = dot(jacobian[k], template) / max(power, np.float32(1e-12))
        for i in range(template.size):
            jacobian[k, i] -= share * template[i]
    return power, gradient


@njit(cache=True)
def _resample(right, node, warp, mask, patch):
    """Fill `patch` with the right image under a warp, on the support; False where that leaves the image."""
    base, t, a, b = warp
    half = node.half
    # One pixel before and two behind for the cubic weights; rows cannot leave the image, for both have the same.
    reach = abs(a) * half + abs(b) * half
    if not (base + t - reach >= 1 and base + t + reach < right.shape[1] - 2):
        return False
    i = 0
    for y in range(-half, half + 1):
        line = right[node.row + y]
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
    """a' C a of the influence a (n,), C the correlation of residuals by their distance, up to 2 px each way."""
    total = dot(influence, influence)
    for dy in range(3):
        for dx in range(-2, 3):
            # Half of the plane: the correlation is symmetric, so that every pair is counted once and doubled.
            if dy == 0 and dx <= 0:
                continue
            lag = np.float32(0.0)
            shift = dy * window + dx
            for i in range(influence.size - shift):
                lag += influence[i] * influence[i + shift]
            total += np.float32(2.0) * correlation[dy] * correlation[abs(dx)] * lag
    return max(total, np.float32(0.0))


@njit(cache=True)
def _misfit(pair, node, warp, exposure):
    """Mean absolute grey value residual in the small patch at the node, whether or not it belongs to the support."""
    total, count = 0.0, 0
    for y in range(-_CENTRE, _CENTRE + 1):
        for x in range(-_CENTRE, _CENTRE + 1):
            u = warp.t + warp.a * x + warp.b * y
            c = int(np.floor(u))
            w0, w1, w2, w3 = cubic_weights(np.float32(u - c))
            c += warp.base - 1
            line = pair.right[node.row + y]
            grey = w0 * line[c] + w1 * line[c + 1] + w2 * line[c + 2] + w3 * line[c + 3]
            own = pair.left[node.row + y, node.col + x] - exposure.mean_left
            total += abs((grey - exposure.mean_right) * exposure.scale - own)
            count += 1
    return total / count


@njit(cache=True)
def _mean_left(left, node, mask):
    """Mean grey value of the left window over the support, float64."""
    half, side = node.half, 2 * node.half + 1
    total, n = 0.0, 0
    for i in range(mask.size):
        if mask[i] > 0:
            total += left[node.row + i // side - half, node.col + i % side - half]
            n += 1
    return total / n


@njit(cache=True, forceinline=True)
def _influence(inverse, jacobian, influence):
    """Fill the influence of the residuals on the parallax: the first row of the inverse times the derivatives."""
    influence[:] = 0.0
    for k in range(3):
        factor = np.float32(inverse[0, k])
        for i in range(influence.size):
            influence[i] += factor * jacobian[k, i]


@njit(cache=True, forceinline=True)
def _solution(inverse, jacobian, patch, scale):
    """Corrections of parallax and slopes, limited."""
    j0, j1, j2 = dot(jacobian[0], patch) * scale, dot(jacobian[1], patch) * scale, dot(jacobian[2], patch) * scale
    d0 = inverse[0, 0] * j0 + inverse[0, 1] * j1 + inverse[0, 2] * j2
    d1 = inverse[1, 0] * j0 + inverse[1, 1] * j1 + inverse[1, 2] * j2
    d2 = inverse[2, 0] * j0 + inverse[2, 1] * j1 + inverse[2, 2] * j2
    return (
        min(max(d0, -_MAX_STEP), _MAX_STEP),
        min(max(d1, -_MAX_SLOPE_STEP), _MAX_SLOPE_STEP),
        min(max(d2, -_MAX_SLOPE_STEP), _MAX_SLOPE_STEP),
    )


@njit(cache=True, forceinline=True)
def _refine(pair, node, plane, count, limits, scratch, values):
    """Refine the plane (parallax, slopes) of a node with `count` pixels of support; returns the outcome, fills `values` (5,)."""
    mask, patch, jacobian, inverse = scratch.mask, scratch.patch, scratch.jacobian, scratch.inverse
    power, gradient = _build_template(pair.left, node, count, scratch)
    if not (gradient > count * limits.min_gradient * limits.min_gradient and power > _FLAT * count):
        return outcomes.LOW_TEXTURE
    for i in range(3):
        for j in range(i + 1):
            scratch.normal[i, j] = scratch.normal[j, i] = dot(jacobian[i], jacobian[j])
        scratch.normal[i, i] *= _DAMPING
    if not invert(scratch.normal, 3, scratch.lower, inverse):
        return outcomes.SINGULAR
    # Coordinates count from an integer pixel near by: float32 then resolves 1e-5 px, and tiles agree.
    whole = np.rint(plane[0])
    base = int(node.col + pair.shift - whole)
    t, a, b = whole - plane[0], 1.0 - plane[1], -plane[2]
    begin = t
    for _ in range(limits.max_iterations):
        warp = RowWarp(base, t, a, b)
        if not _resample(pair.right, node, warp, mask, patch):
            return outcomes.OUTSIDE
        mean_right = _centre_masked(patch, mask, count)
        if mean_right != mean_right:
            return outcomes.OUTSIDE
        power_right = dot(patch, patch)
        if power_right <= _FLAT * count:
            return outcomes.LOW_TEXTURE
        scale = np.sqrt(power / power_right)
        values[_CORRELATION] = dot(scratch.template, patch) / np.sqrt(power * power_right)
        d0, d1, d2 = _solution(inverse, jacobian, patch, scale)
        # Composed inversely, as in two dimensions: t + a x + b y of the corrected window.
        a /= 1.0 + d1
        b -= a * d2
        t -= a * d0
        if abs(t - begin) > limits.max_shift:
            return outcomes.MOVED_TOO_FAR
        if not (0.25 < a < 4.0 and abs(b) < 2.0):
            return outcomes.NOT_CONVERGED
        if abs(a * d0) < limits.stop:
            # With the gain estimated, the residual power follows from the correlation alone: (1 - rho^2) / rho^2.
            rho = min(max(values[_CORRELATION], 1e-3), 1.0)
            values[_SIGMA0] = np.sqrt(power * (1.0 / (rho * rho) - 1.0) / max(count - 5, 1))
            _influence(inverse, jacobian, scratch.influence)
            values[_PARALLAX] = whole - t
            correlated = _correlated_power(scratch.influence, 2 * node.half + 1, scratch.correlation)
            values[_SIGMA] = a * values[_SIGMA0] * np.sqrt(correlated)
            exposure = WindowExposure(_mean_left(pair.left, node, mask), mean_right, scale)
            values[_MISFIT] = _misfit(pair, node, RowWarp(base, t, a, b), exposure)
            return outcomes.CONVERGED if values[_CORRELATION] >= limits.min_correlation else outcomes.LOW_CORRELATION
    return outcomes.NOT_CONVERGED


@njit(cache=True)
def _scratch(half, correlation):
    n = (2 * half + 1) ** 2
    return NodeScratch(
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
def _match_nodes(pair, start, rows, cols, limits, correlation, nodes):
    wide, edge, tolerance = limits.half, limits.edge_half, limits.surface_tolerance
    found = np.empty(3, np.float32)
    window, edge_window = np.empty((2 * wide + 1) ** 2, np.float32), np.empty((2 * edge + 1) ** 2, np.float32)
    wide_scratch, edge_scratch = _scratch(wide, correlation), _scratch(edge, correlation)
    guess, plane, values = np.empty(3), np.empty(3), np.empty(5)
    parallax, sigma, likeness, outcome = nodes
    for i in range(rows.size):
        for j in range(cols.size):
            row, col = rows[i], cols[j]
            inside = wide < row < pair.left.shape[0] - wide - 1 and wide < col < pair.left.shape[1] - wide - 1
            if not inside or np.isnan(pair.left[row, col]):
                outcome[i, j] = outcomes.OUTSIDE
                continue
            node = Node(row, col, wide)
            surface_window(start, node, window)
            count = start_parallaxes(window, wide, min(wide, 2 * start.factor), found)
            if count == 0:
                # Next to nothing is known here: any surface within the window is worth trying.
                count = start_parallaxes(window, wide, wide, found)
            best = np.inf
            outcome[i, j] = outcomes.NOT_TRIED
            for h in range(count):
                level, node, scratch = np.float64(found[h]), Node(row, col, wide), wide_scratch
                support = fit_surface(pair.left, node, window, level, tolerance, guess, plane, scratch.mask)
                # Where the window is mostly foreign, a smaller one has the larger share of its own surface.
                if edge < wide and support < _WHOLE * window.size:
                    node, scratch = Node(row, col, edge), edge_scratch
                    surface_window(start, node, edge_window)
                    support = fit_surface(pair.left, node, edge_window, level, tolerance, guess, plane, scratch.mask)
                if support < limits.min_support * (2 * node.half + 1) ** 2 or support < _FEWEST:
                    continue
                # The plane was fitted relative to its level, to keep the digits of the sums.
                plane[0] += level
                values[:] = np.nan
                result = _refine(pair, node, plane, support, limits, scratch, values)
                if result == outcomes.CONVERGED and values[_MISFIT] < best:
                    best = values[_MISFIT]
                    outcome[i, j] = result
                    parallax[i, j], sigma[i, j], likeness[i, j] = values[_PARALLAX], values[_SIGMA], values[_CORRELATION]
                    # A window can fit while its node does not: the node then lies on a surface that the window dropped.
                    if best > 4.0 * values[_SIGMA0] + 1.0:
                        outcome[i, j] = outcomes.INCONSISTENT
                elif best == np.inf:
                    # Without a misfit the node itself lies at the edge of the data, although its window fits.
                    outcome[i, j] = outcomes.OUTSIDE if result == outcomes.CONVERGED else result
                    likeness[i, j] = values[_CORRELATION]
            if outcome[i, j] != outcomes.CONVERGED:
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
    nodes = NodeParallaxes.unmatched(np.zeros(shape, np.uint8))
    # Never below 0.3 px: optics and resampling correlate neighbouring residuals even without smoothing.
    sigma = max(limits.smoothing, 0.3)
    correlation = np.exp(-(np.arange(3) ** 2) / (4.0 * sigma**2)).astype(np.float32)
    rows, cols = np.asarray(rows, np.int64), np.asarray(cols, np.int64)
    scaled = limits._replace(surface_tolerance=limits.surface_tolerance * start.factor)
    _match_nodes(RowPair(left, right, shift), start, rows, cols, scaled, correlation, nodes)
    return nodes
