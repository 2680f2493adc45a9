"""Inverse-compositional least-squares matching: the recommended form.

Strategy
- Gradients are central differences of the left window at its own whole pixels: nothing is resampled before it is differentiated
  (the weak spot of the published recipe, methods/measured.md), and the normal matrix belongs to the left window alone. With a
  square it is factored once; an ellipse takes its shape from the inverse, so there it is built anew in every iteration.
- Normal matrix and right sides are moments: the six derivatives are gx and gy times 1, x and y, so all products are sums of gx gx,
  gx gy, gy gy times powers of x and y. No image of a derivative is ever stored.
- Gain and offset are eliminated: the derivatives are made orthogonal to the window and to a constant by correcting the moments,
  which is the same as estimating both with the geometric unknowns. The right window is brought to the left one's contrast.
- A window is a block of padded rows, zero outside of its shape, so that every sum is one run over contiguous float32, and
  neighbours in any direction are at a constant distance. Grey values are counted from that of the centre: sums stay small.
- The covariance of the shift is sigma0^2 a' C a, with a the influence of the residuals on the shift and C their correlation:
  smoothing correlates neighbouring residuals, and leaving that out makes sigma two to three times too small.

Source: Baker & Matthews 2004; methods/matching_windows.md 2.1 (rows 1 to 3); matching_and_dsm_check.md 1.3, 1.4.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from tasks.matching.resampling_kernels import EXACT, bicubic, bilinear, leaves, nearest_pixel, on_lattice
from tasks.matching.results import (
    A12, A21, B12, B21, COL, CONVERGED, CORRELATION, COVARIANCE, GAIN, LOW_CORRELATION, LOW_TEXTURE, MOVED_TOO_FAR, NOT_CONVERGED,
    OFFSET, OUTSIDE, REFERENCE_COL, REFERENCE_ROW, ROW, SIGMA0, SINGULAR, VAR_COL, VAR_ROW,
)
from tasks.matching.small_systems import factor, solve
from tasks.matching.window_shape import ellipse_axes, ellipse_window, pixels_of, square_window

_PAD = 2
"""Zeros between the rows of a block, at least: the correlation of residuals reaches that far."""
_FLAT = 1e-6
"""Variance of grey values below which a window is taken as constant."""
_ZERO = np.float32(0.0)


class Template(NamedTuple):
    """What a window is when its block has been cut."""

    reach_x: int
    reach_y: int
    n: int
    """floats of its block"""
    count: int
    """its pixels"""
    level: float
    """grey value that the block counts from"""
    mean: float
    """of the block's pixels"""
    power: float
    """sum of squares of the grey values about their mean"""


class Work(NamedTuple):
    """Arrays that every point uses again."""

    spans: np.ndarray
    drawn: np.ndarray
    """reach of the square whose coordinates are in place"""
    xs: np.ndarray
    ys: np.ndarray
    grey: np.ndarray
    gx: np.ndarray
    gy: np.ndarray
    inside: np.ndarray
    patch: np.ndarray
    moments: np.ndarray
    plain: np.ndarray
    """sums of the derivatives"""
    likewise: np.ndarray
    """sums of the derivatives times the centred grey values"""
    normal: np.ndarray
    lower: np.ndarray
    d: np.ndarray
    on_x: np.ndarray
    on_y: np.ndarray
    """influence of the residuals on both shifts, between zeros"""
    along: np.ndarray
    blurred: np.ndarray
    kernel: tuple[float, float]
    """correlation of residuals one and two pixels apart"""


@njit(cache=True)
def _work(reach, smoothing):
    """Arrays for windows that reach `reach` px from their centre."""
    size = _pitch(reach) * (2 * reach + 1)
    longer = size + 4 * _pitch(reach)
    sigma = max(smoothing, 0.3)
    kernel = np.float32(np.exp(-1.0 / (4.0 * sigma * sigma))), np.float32(np.exp(-1.0 / (sigma * sigma)))
    return Work(
        np.empty((2 * reach + 1, 2), np.int64), np.zeros(1, np.int64), np.empty(size, np.float32), np.empty(size, np.float32),
        np.zeros(size, np.float32), np.zeros(size, np.float32), np.zeros(size, np.float32), np.zeros(size, np.float32),
        np.zeros(size, np.float32), np.empty((3, 6)), np.empty(6), np.empty(6), np.empty((6, 6)), np.empty((6, 6)), np.empty(6),
        np.zeros(longer, np.float32), np.zeros(longer, np.float32), np.zeros(longer, np.float32), np.zeros(longer, np.float32),
        kernel,
    )


@njit(cache=True, inline="always")
def _unknowns(rules):
    return (2 if rules.shift_only else 6) + (0 if rules.radiometry == 0 else 2)


@njit(cache=True, inline="always")
def _pitch(reach):
    """Distance of the rows of a block: room for the window and the padding, and a multiple of what processors add at once."""
    return (2 * reach + 1 + _PAD + 7) // 8 * 8


@njit(cache=True)
def _coordinates(reach_x, reach_y, xs, ys):
    """Column and row of every pixel of a block, from its centre."""
    pitch = _pitch(reach_x)
    for j in range(2 * reach_y + 1):
        for i in range(pitch):
            xs[j * pitch + i] = i - reach_x
            ys[j * pitch + i] = j - reach_y


@njit(cache=True, forceinline=True, fastmath=EXACT)
def _cut(image, col, row, reach, spans, block):
    """Fill a block with the left window about (col, row) and its gradients; returns the grey value it counts from."""
    grey, gx, gy, inside = block
    reach_x, reach_y = reach
    pitch = _pitch(reach_x)
    level, half = image[row, col], np.float32(0.5)
    for j in range(2 * reach_y + 1):
        first, last = spans[j]
        count = last - first + 1
        start, at = col + first, j * pitch + reach_x + first
        if count < 1:
            continue
        line = image[row + j - reach_y, start - 1:start + count + 1]
        above, below = image[row + j - reach_y - 1, start:start + count], image[row + j - reach_y + 1, start:start + count]
        to_grey, to_x, to_y, to_inside = grey[at:at + count], gx[at:at + count], gy[at:at + count], inside[at:at + count]
        for i in range(count):
            to_grey[i] = line[i + 1] - level
            to_x[i] = half * (line[i + 2] - line[i])
            to_y[i] = half * (below[i] - above[i])
            to_inside[i] = np.float32(1.0)
    return level


@njit(cache=True, forceinline=True, fastmath=EXACT)
def _second_moments(p, q, xs, ys, out):
    """Sums of p q times 1, x, y, xx, xy, yy."""
    s = sx = sy = sxx = sxy = syy = np.float32(0.0)
    for i in range(p.size):
        v = p[i] * q[i]
        vx, vy = v * xs[i], v * ys[i]
        s += v
        sx += vx
        sy += vy
        sxx += vx * xs[i]
        sxy += vx * ys[i]
        syy += vy * ys[i]
    out[0], out[1], out[2], out[3], out[4], out[5] = s, sx, sy, sxx, sxy, syy


@njit(cache=True, forceinline=True, fastmath=EXACT)
def _gradient_moments(gx, gy, p, xs, ys, out):
    """Sums of p times the six derivatives."""
    s0 = s1 = s2 = s3 = s4 = s5 = np.float32(0.0)
    for i in range(p.size):
        u, v = gx[i] * p[i], gy[i] * p[i]
        s0 += u
        s1 += u * xs[i]
        s2 += u * ys[i]
        s3 += v
        s4 += v * xs[i]
        s5 += v * ys[i]
    out[0], out[1], out[2], out[3], out[4], out[5] = s0, s1, s2, s3, s4, s5


@njit(cache=True, forceinline=True, fastmath=EXACT)
def _sums(p, q):
    """Sums of p, p p and p q."""
    s = pp = pq = np.float32(0.0)
    for i in range(p.size):
        s += p[i]
        pp += p[i] * p[i]
        pq += p[i] * q[i]
    return s, pp, pq


@njit(cache=True)
def _normal_matrix(moments, normal):
    """The 6 x 6 normal matrix of the derivatives from the moments of gx gx, gx gy and gy gy."""
    for k in range(3):
        m = moments[k]
        r, c = 3 * (k // 2), 3 * ((k + 1) // 2)
        normal[r, c], normal[r, c + 1], normal[r, c + 2] = m[0], m[1], m[2]
        normal[r + 1, c], normal[r + 1, c + 1], normal[r + 1, c + 2] = m[1], m[3], m[4]
        normal[r + 2, c], normal[r + 2, c + 1], normal[r + 2, c + 2] = m[2], m[4], m[5]
    for i in range(3):
        for j in range(3):
            normal[3 + i, j] = normal[j, 3 + i]


@njit(cache=True)
def _without_radiometry(normal, plain, grey, power, count):
    """Make the normal matrix that of derivatives orthogonal to a constant and to the window (of centred power `power`)."""
    for i in range(6):
        for j in range(i + 1):
            normal[i, j] -= plain[i] * plain[j] / count + grey[i] * grey[j] / power
            normal[j, i] = normal[i, j]


@njit(cache=True, forceinline=True, fastmath=EXACT)
def _warp(flat, width, base, t, a, use_bicubic, reach, spans, patch):
    """Fill the block `patch` with the right image at base + t + A (x, y); returns the grey value it counts from.

    flat, width: the right image; base: the whole pixel (col, row) that t (px) is counted from.
    """
    whole_x, whole_y = int(np.floor(t[0])), int(np.floor(t[1]))
    rest_x, rest_y = t[0] - whole_x, t[1] - whole_y
    origin = (base[1] + whole_y) * width + base[0] + whole_x
    reach_x, reach_y = reach
    pitch = _pitch(reach_x)
    step_x, step_y = np.float32(a[0]), np.float32(a[2])
    level = flat[np.uint64(origin)]
    stride = np.uint64(width)
    for j in range(2 * reach_y + 1):
        first, last = spans[j]
        count = last - first + 1
        if count < 1:
            continue
        y = j - reach_y
        u0, v0 = np.float32(rest_x + a[1] * y + a[0] * first), np.float32(rest_y + a[3] * y + a[2] * first)
        line = patch[j * pitch + reach_x + first:j * pitch + reach_x + last + 1]
        if use_bicubic:
            for i in range(count):
                u, v = u0 + step_x * np.float32(i), v0 + step_y * np.float32(i)
                c, r = np.floor(u), np.floor(v)
                line[i] = bicubic(flat, stride, np.uint64(origin + int(r) * width + int(c)), u - c, v - r) - level
        else:
            for i in range(count):
                u, v = u0 + step_x * np.float32(i), v0 + step_y * np.float32(i)
                c, r = np.floor(u), np.floor(v)
                line[i] = bilinear(flat, stride, np.uint64(origin + int(r) * width + int(c)), u - c, v - r) - level
    return level


@njit(cache=True, forceinline=True, fastmath=EXACT)
def _influence(block, pad, xs, ys, weights, grey_share, offset, out):
    """Influence of the residuals on one unknown: the derivatives times `weights` (6,), made orthogonal, zero outside."""
    grey, gx, gy, inside = block
    w0, w1, w2 = np.float32(weights[0]), np.float32(weights[1]), np.float32(weights[2])
    w3, w4, w5 = np.float32(weights[3]), np.float32(weights[4]), np.float32(weights[5])
    share, constant = np.float32(grey_share), np.float32(offset)
    body = out[pad:pad + grey.size]
    out[:pad] = np.float32(0.0)
    out[pad + grey.size:] = np.float32(0.0)
    for i in range(grey.size):
        slope = gx[i] * (w0 + w1 * xs[i] + w2 * ys[i]) + gy[i] * (w3 + w4 * xs[i] + w5 * ys[i])
        body[i] = slope - inside[i] * (share * grey[i] + constant)


@njit(cache=True, forceinline=True, fastmath=EXACT)
def _blurred(influence, pitch, near, far, along, out):
    """C a of an influence a, C separable: 1, `near`, `far` at distances of 0, 1, 2 px. All have 2 `pitch` zeros at both ends."""
    n = influence.size
    m1, p1, m2, p2 = influence[1:n - 3], influence[3:n - 1], influence[0:n - 4], influence[4:n]
    centre, body = influence[2:n - 2], along[2:n - 2]
    for i in range(n - 4):
        body[i] = centre[i] + near * (m1[i] + p1[i]) + far * (m2[i] + p2[i])
    size = n - 4 * pitch
    u2, u1, c0 = along[0:size], along[pitch:pitch + size], along[2 * pitch:2 * pitch + size]
    d1, d2, total = along[3 * pitch:3 * pitch + size], along[4 * pitch:4 * pitch + size], out[2 * pitch:2 * pitch + size]
    for i in range(size):
        total[i] = c0[i] + near * (u1[i] + d1[i]) + far * (u2[i] + d2[i])


@njit(cache=True, forceinline=True, fastmath=EXACT)
def _dot(p, q):
    total = np.float32(0.0)
    for i in range(p.size):
        total += p[i] * q[i]
    return total


@njit(cache=True)
def _compose(a, d):
    """A <- A (I + D)^-1 for the affine a (4,) and the correction d (6,); returns its area."""
    m11, m12, m21, m22 = 1.0 + d[1], d[2], d[4], 1.0 + d[5]
    determinant = m11 * m22 - m12 * m21
    a0, a1, a2, a3 = a
    a[0], a[1] = (a0 * m22 - a1 * m21) / determinant, (a1 * m11 - a0 * m12) / determinant
    a[2], a[3] = (a2 * m22 - a3 * m21) / determinant, (a3 * m11 - a2 * m12) / determinant
    return a[0] * a[3] - a[1] * a[2]


@njit(cache=True)
def _solve(lower, shift_only, d):
    """Overwrite the right side d (6,) with the corrections; those of the affine are 0 when there are shifts only."""
    if not shift_only:
        solve(lower, 6, d)
        return
    d[1] = d[3]
    solve(lower, 2, d)
    d[3] = d[1]
    d[1], d[2], d[4], d[5] = 0.0, 0.0, 0.0, 0.0


@njit(cache=True, forceinline=True)
def _template(left, col, row, half, axes, rules, work):
    """Cut the window, and build and factor its normal matrix; returns (outcome, template), CONVERGED when it can be matched."""
    if rules.ellipse:
        reach_x, reach_y = ellipse_window(half, axes, 0.0, 0.0, work.spans)
    else:
        reach_x, reach_y = square_window(half, work.spans)
    n = _pitch(reach_x) * (2 * reach_y + 1)
    template = Template(reach_x, reach_y, n, 0, 0.0, 0.0, 0.0)
    if not (reach_x < col < left.shape[1] - reach_x - 1 and reach_y < row < left.shape[0] - reach_y - 1):
        return OUTSIDE, template
    grey, gx, gy, inside = work.grey[:n], work.gx[:n], work.gy[:n], work.inside[:n]
    xs, ys, moments = work.xs[:n], work.ys[:n], work.moments
    if rules.ellipse or work.drawn[0] != reach_x:
        _coordinates(reach_x, reach_y, xs, ys)
        work.drawn[0] = reach_x
        grey[:], gx[:], gy[:], inside[:], work.patch[:n] = _ZERO, _ZERO, _ZERO, _ZERO, _ZERO
    level = _cut(left, col, row, (reach_x, reach_y), work.spans, (grey, gx, gy, inside))
    _second_moments(gx, gx, xs, ys, moments[0])
    _second_moments(gx, gy, xs, ys, moments[1])
    _second_moments(gy, gy, xs, ys, moments[2])
    count = pixels_of(work.spans, 2 * reach_y + 1)
    total, power, _ = _sums(grey, grey)
    mean = total / count
    power -= total * mean
    gxx, gxy, gyy = moments[0, 0], moments[1, 0], moments[2, 0]
    if not (power < np.inf and gxx + gyy < np.inf):
        return OUTSIDE, template
    weakest = 0.5 * (gxx + gyy) - np.sqrt(0.25 * (gxx - gyy) ** 2 + gxy * gxy)
    if weakest <= count * rules.min_gradient**2 or power <= _FLAT * count:
        return LOW_TEXTURE, template
    _gradient_moments(gx, gy, inside, xs, ys, work.plain)
    _gradient_moments(gx, gy, grey, xs, ys, work.likewise)
    for k in range(6):
        work.likewise[k] -= mean * work.plain[k]
    _normal_matrix(moments, work.normal)
    if rules.radiometry == 2:
        _without_radiometry(work.normal, work.plain, work.likewise, power, count)
    if rules.shift_only:
        work.normal[1, 0], work.normal[1, 1] = work.normal[3, 0], work.normal[3, 3]
    if count <= _unknowns(rules) or not factor(work.normal, 2 if rules.shift_only else 6, work.lower):
        return SINGULAR, template
    return CONVERGED, Template(reach_x, reach_y, n, count, np.float64(level), mean, power)


@njit(cache=True)
def _axes(rules, work):
    """Axes of the ellipse that the cofactors of both shifts ask for."""
    d = work.d
    d[:] = 0.0
    d[0] = 1.0
    _solve(work.lower, rules.shift_only, d)
    var_x, covariance = d[0], d[3]
    d[:] = 0.0
    d[3] = 1.0
    _solve(work.lower, rules.shift_only, d)
    return ellipse_axes(var_x, d[3], covariance, rules.max_axis_ratio, rules.across)


@njit(cache=True, forceinline=True)
def _correction(template, level_right, rules, work, values):
    """Right sides of the normal equations from the warped window, solved into work.d.

    Returns the outcome so far and the sum of squares of the residuals; correlation, gain and offset go to `values`.
    """
    n, count, mean, power = template.n, template.count, template.mean, template.power
    d, plain, likewise = work.d, work.plain, work.likewise
    patch = work.patch[:n]
    total_right, power_right, product = _sums(patch, work.grey[:n])
    mean_right = total_right / count
    power_right -= total_right * mean_right
    product -= total_right * mean
    if not (abs(product) < np.inf and power_right < np.inf):
        return OUTSIDE, np.inf
    if power_right <= _FLAT * count:
        return LOW_TEXTURE, np.inf
    likeness, scale = product / np.sqrt(power * power_right), np.sqrt(power / power_right)
    gain = product / power
    values[CORRELATION], values[GAIN], values[OFFSET] = likeness, gain, mean_right + level_right - gain * (mean + template.level)
    _gradient_moments(work.gx[:n], work.gy[:n], patch, work.xs[:n], work.ys[:n], d)
    if rules.radiometry == 0:
        brighter = level_right - template.level - mean
        residual = power_right - 2.0 * product + power + count * (mean_right + brighter) ** 2
        for k in range(6):
            d[k] += brighter * plain[k] - likewise[k]
    elif rules.radiometry == 1:
        residual = 2.0 * power * (1.0 - likeness)
        for k in range(6):
            d[k] = scale * (d[k] - mean_right * plain[k]) - likewise[k]
    else:
        rho = min(max(likeness, 1e-3), 1.0)
        residual = power * (1.0 / (rho * rho) - 1.0)
        for k in range(6):
            d[k] = scale * (d[k] - mean_right * plain[k] - likewise[k] * product / power)
    _solve(work.lower, rules.shift_only, d)
    return CONVERGED, residual


@njit(cache=True, forceinline=True)
def _cofactors(template, px, py, rules, work):
    """Cofactors (xx, xy, yy) of the shift of the place (px, py) of the window, with the correlation of the residuals."""
    n, d = template.n, work.d
    block = work.grey[:n], work.gx[:n], work.gy[:n], work.inside[:n]
    pitch = _pitch(template.reach_x)
    pad, size = 2 * pitch, n + 4 * pitch
    on_x, on_y, along, blurred = work.on_x[:size], work.on_y[:size], work.along[:size], work.blurred[:size]
    along[size - 2:] = _ZERO
    for axis in range(2):
        d[:] = 0.0
        d[3 * axis] = 1.0
        if not rules.shift_only:
            d[3 * axis + 1], d[3 * axis + 2] = px, py
        _solve(work.lower, rules.shift_only, d)
        share, constant = 0.0, 0.0
        if rules.radiometry > 0:
            for k in range(6):
                share += d[k] * work.likewise[k] / template.power if rules.radiometry == 2 else 0.0
                constant += d[k] * work.plain[k] / template.count
            constant -= share * template.mean
        _influence(block, pad, work.xs[:n], work.ys[:n], d, share, constant, on_x if axis == 0 else on_y)
    near, far = work.kernel
    _blurred(on_x, pitch, near, far, along, blurred)
    xx, xy = _dot(on_x[pad:pad + n], blurred[pad:pad + n]), _dot(on_y[pad:pad + n], blurred[pad:pad + n])
    _blurred(on_y, pitch, near, far, along, blurred)
    yy = _dot(on_y[pad:pad + n], blurred[pad:pad + n])
    return max(xx, _ZERO), xy, max(yy, _ZERO)


@njit(cache=True, forceinline=True)
def _finish(template, variance, pixel, place, base, t, a, rules, work, values):
    """Write position, reference and covariance of a matched window."""
    px, py = place
    if rules.centroid:
        m = work.moments
        weight = m[0, 0] + m[2, 0]
        px, py = (m[0, 1] + m[2, 1]) / weight, (m[0, 2] + m[2, 2]) / weight
    values[REFERENCE_COL], values[REFERENCE_ROW] = pixel[0] + px, pixel[1] + py
    values[COL] = base[0] + on_lattice(t[0] + a[0] * px + a[1] * py)
    values[ROW] = base[1] + on_lattice(t[1] + a[2] * px + a[3] * py)
    xx, xy, yy = _cofactors(template, px, py, rules, work)
    values[VAR_COL] = variance * (a[0] * a[0] * xx + 2.0 * a[0] * a[1] * xy + a[1] * a[1] * yy)
    values[VAR_ROW] = variance * (a[2] * a[2] * xx + 2.0 * a[2] * a[3] * xy + a[3] * a[3] * yy)
    values[COVARIANCE] = variance * (a[0] * a[2] * xx + (a[0] * a[3] + a[1] * a[2]) * xy + a[1] * a[3] * yy)


@njit(cache=True, forceinline=True)
def _match_one(left, right, flat, pixel, half, place, t, a, rules, work, values):
    """Match the window about the whole pixel (col, row); returns (outcome, iterations).

    place: the point, from that pixel. t (2,), a (4,): right position of the pixel and affine, from their start to the solution.
    """
    base = nearest_pixel(t[0]), nearest_pixel(t[1])
    t[0] -= base[0]
    t[1] -= base[1]
    begin_x, begin_y = t[0], t[1]
    axes, d = (1.0, 1.0, 0.0), work.d
    template = Template(0, 0, 0, 0, 0.0, 0.0, 0.0)
    for iteration in range(1, rules.max_iterations + 1):
        if iteration == 1 or rules.ellipse:
            outcome, template = _template(left, pixel[0], pixel[1], half, axes, rules, work)
            if outcome != CONVERGED:
                return outcome, iteration - 1
            if rules.ellipse:
                axes = _axes(rules, work)
        reach = template.reach_x, template.reach_y
        if leaves(right.shape, base[0] + t[0], base[1] + t[1], reach[0] * abs(a[0]) + reach[1] * abs(a[1]),
                  reach[0] * abs(a[2]) + reach[1] * abs(a[3])):
            return OUTSIDE, iteration
        level_right = _warp(flat, right.shape[1], base, t, a, rules.bicubic, reach, work.spans, work.patch)
        outcome, residual = _correction(template, level_right, rules, work, values)
        if outcome != CONVERGED:
            return outcome, iteration
        for k in range(6):
            limit = rules.max_step if k % 3 == 0 else rules.max_affine_step
            d[k] = min(max(d[k], -limit), limit)
        area = _compose(a, d)
        move_x, move_y = a[0] * d[0] + a[1] * d[3], a[2] * d[0] + a[3] * d[3]
        t[0] -= move_x
        t[1] -= move_y
        if not 0.1 < area < 10.0:
            return NOT_CONVERGED, iteration
        if not (abs(t[0] - begin_x) <= rules.max_shift and abs(t[1] - begin_y) <= rules.max_shift):
            return MOVED_TOO_FAR, iteration
        if abs(move_x) < rules.stop and abs(move_y) < rules.stop:
            variance = max(residual, 0.0) / (template.count - _unknowns(rules))
            values[SIGMA0] = np.sqrt(variance)
            values[A12], values[A21], values[B12], values[B21] = a[0], a[1], a[2], a[3]
            if values[CORRELATION] < rules.min_correlation:
                return LOW_CORRELATION, iteration
            _finish(template, variance, pixel, place, base, t, a, rules, work, values)
            return CONVERGED, iteration
    return NOT_CONVERGED, rules.max_iterations


@njit(cache=True)
def match_inverse(left, right, points, starts, affine, half, reach, rules, values, outcome, iterations):
    """Match points (N, 2) of `left` in `right`, both (H, W) float32, from starts (N, 2); for `least_squares.match_points`.

    affine (N, 4): start values. half (N,): half sides of the windows; reach: the most that one of them covers. Points whose
    `outcome` (N,) is CONVERGED are tried; `values` (N, results.COLUMNS), `outcome` and `iterations` (N,) are filled.
    """
    work, flat = _work(reach, rules.smoothing), right.ravel()
    t, a = np.empty(2), np.empty(4)
    for i in range(points.shape[0]):
        if outcome[i] != CONVERGED:
            continue
        pixel = nearest_pixel(points[i, 0]), nearest_pixel(points[i, 1])
        place = points[i, 0] - pixel[0], points[i, 1] - pixel[1]
        a[:] = affine[i]
        t[0] = starts[i, 0] - (a[0] * place[0] + a[1] * place[1])
        t[1] = starts[i, 1] - (a[2] * place[0] + a[3] * place[1])
        outcome[i], iterations[i] = _match_one(left, right, flat, pixel, half[i], place, t, a, rules, work, values[i])
