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

import numpy as np
from numba import njit

from tasks.matching.resampling_kernels import EXACT, bicubic, bilinear, leaves, nearest_pixel, on_lattice
from tasks.matching.results import (
    A12, B21, COL, CONVERGED, CORRELATION, COVARIANCE, GAIN, LOW_CORRELATION, LOW_TEXTURE, MOVED_TOO_FAR, NOT_CONVERGED, OFFSET,
    OUTSIDE, REFERENCE_COL, REFERENCE_ROW, ROW, SIGMA0, SINGULAR, VAR_COL, VAR_ROW,
)
from tasks.matching.small_systems import factor, solve
from tasks.matching.window_shape import ellipse_axes, ellipse_window, square_window

_PAD = 2
"""Zeros between the rows of a block, at least: the correlation of residuals reaches that far."""
_FLAT = 1e-6
"""Variance of grey values below which a window is taken as constant."""


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
def _without_radiometry(normal, sums, power, count):
    """Make the normal matrix that of derivatives orthogonal to a constant and to the window (of centred power `power`)."""
    plain, grey = sums
    for i in range(6):
        for j in range(i + 1):
            normal[i, j] -= plain[i] * plain[j] / count + grey[i] * grey[j] / power
            normal[j, i] = normal[i, j]


@njit(cache=True, forceinline=True, fastmath=EXACT)
def _warp(flat, width, origin, t, a, use_bicubic, reach, spans, patch):
    """Fill the block `patch` with the right image at origin + t + A (x, y); returns the grey value it counts from.

    flat, width: the right image; origin: index of the pixel that t (px) is counted from.
    """
    reach_x, reach_y = reach
    pitch = _pitch(reach_x)
    step_x, step_y = np.float32(a[0]), np.float32(a[2])
    level = flat[np.uint64(origin + int(np.floor(t[1])) * width + int(np.floor(t[0])))]
    stride = np.uint64(width)
    for j in range(2 * reach_y + 1):
        first, last = spans[j]
        count = last - first + 1
        if count < 1:
            continue
        y = j - reach_y
        u0, v0 = np.float32(t[0] + a[1] * y + a[0] * first), np.float32(t[1] + a[3] * y + a[2] * first)
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


@njit(cache=True, inline="always")
def _limited(value, limit):
    return min(max(value, -limit), limit)


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
def _match_one(left, right, flat, col, row, half, place, start, a, rules, blocks, scratch, values):
    """Match the window about the whole pixel (col, row) from `start` (2,); returns (outcome, iterations).

    place: the point, from that pixel. a (4,): the affine, taken from its start to its solution.
    """
    spans, coordinates, drawn, blurs, d, moments, plain, grey_sums, patch_sums, normal, lower, kernel = scratch
    base_col, base_row = nearest_pixel(start[0]), nearest_pixel(start[1])
    width = right.shape[1]
    origin = base_row * width + base_col
    t = start
    t[0], t[1] = start[0] - base_col, start[1] - base_row
    begin_x, begin_y = t[0], t[1]
    unknowns = (2 if rules.shift_only else 6) + (0 if rules.radiometry == 0 else 2)
    ratio, cos, sin = 1.0, 1.0, 0.0
    for iteration in range(1, rules.max_iterations + 1):
        if iteration == 1 or rules.ellipse:
            if rules.ellipse:
                reach = ellipse_window(half, (ratio, cos, sin), 0.0, 0.0, spans)
            else:
                reach = square_window(half, spans)
            reach_x, reach_y = reach
            if not (reach_x < col < left.shape[1] - reach_x - 1 and reach_y < row < left.shape[0] - reach_y - 1):
                return OUTSIDE, iteration - 1
            pitch = _pitch(reach_x)
            n = pitch * (2 * reach_y + 1)
            xs, ys = coordinates[0, :n], coordinates[1, :n]
            if rules.ellipse or drawn[0] != reach_x:
                _coordinates(reach_x, reach_y, xs, ys)
                drawn[0] = reach_x
                blocks[:, :n] = np.float32(0.0)
            block = (blocks[0, :n], blocks[1, :n], blocks[2, :n], blocks[3, :n])
            grey, gx, gy, inside = block
            patch = blocks[4, :n]
            level = _cut(left, col, row, reach, spans, block)
            _second_moments(gx, gx, xs, ys, moments[0])
            _second_moments(gx, gy, xs, ys, moments[1])
            _second_moments(gy, gy, xs, ys, moments[2])
            count = 0
            for j in range(2 * reach_y + 1):
                count += max(spans[j, 1] - spans[j, 0] + 1, 0)
            total, power, _ = _sums(grey, grey)
            mean = total / count
            power -= total * mean
            gxx, gxy, gyy = moments[0, 0], moments[1, 0], moments[2, 0]
            if not (power == power and gxx == gxx and gyy == gyy and gxx + gyy < np.inf):
                return OUTSIDE, iteration - 1
            weakest = 0.5 * (gxx + gyy) - np.sqrt(0.25 * (gxx - gyy) ** 2 + gxy * gxy)
            if weakest <= count * rules.min_gradient**2 or power <= _FLAT * count:
                return LOW_TEXTURE, iteration - 1
            _normal_matrix(moments, normal)
            _gradient_moments(gx, gy, inside, xs, ys, plain)
            _gradient_moments(gx, gy, grey, xs, ys, grey_sums)
            for k in range(6):
                grey_sums[k] -= mean * plain[k]
            if rules.radiometry == 2:
                _without_radiometry(normal, (plain, grey_sums), power, count)
            if rules.shift_only:
                normal[0, 1], normal[1, 0], normal[1, 1] = normal[0, 3], normal[3, 0], normal[3, 3]
            if count <= unknowns or not factor(normal, 2 if rules.shift_only else 6, lower):
                return SINGULAR, iteration - 1
            if rules.ellipse:
                d[:] = 0.0
                d[0] = 1.0
                _solve(lower, rules.shift_only, d)
                var_x, covariance = d[0], d[3]
                d[:] = 0.0
                d[3] = 1.0
                _solve(lower, rules.shift_only, d)
                ratio, cos, sin = ellipse_axes(var_x, d[3], covariance, rules.max_axis_ratio, rules.across)
        if leaves(right.shape, base_col + t[0], base_row + t[1], reach_x * abs(a[0]) + reach_y * abs(a[1]),
                  reach_x * abs(a[2]) + reach_y * abs(a[3])):
            return OUTSIDE, iteration
        level_right = _warp(flat, width, origin, t, a, rules.bicubic, reach, spans, patch)
        total_right, power_right, product = _sums(patch, grey)
        mean_right = total_right / count
        power_right -= total_right * mean_right
        product -= total_right * mean
        if not abs(product) < np.inf or not power_right < np.inf:
            return OUTSIDE, iteration
        if power_right <= _FLAT * count:
            return LOW_TEXTURE, iteration
        likeness = product / np.sqrt(power * power_right)
        values[CORRELATION] = likeness
        _gradient_moments(gx, gy, patch, xs, ys, patch_sums)
        scale = np.sqrt(power / power_right)
        if rules.radiometry == 0:
            difference = level_right - level - mean
            for k in range(6):
                d[k] = patch_sums[k] + difference * plain[k] - grey_sums[k]
            residual = power_right - 2.0 * product + power + count * (mean_right + difference) ** 2
        elif rules.radiometry == 1:
            for k in range(6):
                d[k] = scale * (patch_sums[k] - mean_right * plain[k]) - grey_sums[k]
            residual = 2.0 * power * (1.0 - likeness)
        else:
            for k in range(6):
                d[k] = scale * (patch_sums[k] - mean_right * plain[k] - grey_sums[k] * product / power)
            rho = min(max(likeness, 1e-3), 1.0)
            residual = power * (1.0 / (rho * rho) - 1.0)
        _solve(lower, rules.shift_only, d)
        for k in range(6):
            d[k] = _limited(d[k], rules.max_step if k % 3 == 0 else rules.max_affine_step)
        area = _compose(a, d)
        move_x, move_y = a[0] * d[0] + a[1] * d[3], a[2] * d[0] + a[3] * d[3]
        t[0] -= move_x
        t[1] -= move_y
        if not 0.1 < area < 10.0:
            return NOT_CONVERGED, iteration
        if not (abs(t[0] - begin_x) <= rules.max_shift and abs(t[1] - begin_y) <= rules.max_shift):
            return MOVED_TOO_FAR, iteration
        if abs(move_x) < rules.stop and abs(move_y) < rules.stop:
            sigma0 = np.sqrt(max(residual, 0.0) / (count - unknowns))
            values[SIGMA0] = sigma0
            gain = product / power
            values[GAIN] = gain
            values[OFFSET] = mean_right + level_right - gain * (mean + level)
            values[A12], values[A12 + 1], values[A12 + 2], values[B21] = a[0], a[1], a[2], a[3]
            if likeness < rules.min_correlation:
                return LOW_CORRELATION, iteration
            px, py = place
            if rules.centroid:
                weight = moments[0, 0] + moments[2, 0]
                px, py = (moments[0, 1] + moments[2, 1]) / weight, (moments[0, 2] + moments[2, 2]) / weight
            values[REFERENCE_COL], values[REFERENCE_ROW] = col + px, row + py
            values[COL] = base_col + on_lattice(t[0] + a[0] * px + a[1] * py)
            values[ROW] = base_row + on_lattice(t[1] + a[2] * px + a[3] * py)
            pad, size = 2 * pitch, n + 4 * pitch
            on_x, on_y, along, blurred = blurs[0, :size], blurs[1, :size], blurs[2, :size], blurs[3, :size]
            along[size - 2:] = np.float32(0.0)
            for axis in range(2):
                d[:] = 0.0
                d[3 * axis] = 1.0
                if not rules.shift_only:
                    d[3 * axis + 1], d[3 * axis + 2] = px, py
                _solve(lower, rules.shift_only, d)
                share, offset = 0.0, 0.0
                if rules.radiometry > 0:
                    for k in range(6):
                        share += d[k] * grey_sums[k] / power if rules.radiometry == 2 else 0.0
                        offset += d[k] * plain[k] / count
                    offset -= share * mean
                _influence(block, pad, xs, ys, d, share, offset, on_x if axis == 0 else on_y)
            _blurred(on_x, pitch, kernel[0], kernel[1], along, blurred)
            xx, xy = _dot(on_x[pad:pad + n], blurred[pad:pad + n]), _dot(on_y[pad:pad + n], blurred[pad:pad + n])
            _blurred(on_y, pitch, kernel[0], kernel[1], along, blurred)
            yy = _dot(on_y[pad:pad + n], blurred[pad:pad + n])
            xx, xy, yy = max(xx, 0.0) * sigma0**2, xy * sigma0**2, max(yy, 0.0) * sigma0**2
            values[VAR_COL] = a[0] * a[0] * xx + 2.0 * a[0] * a[1] * xy + a[1] * a[1] * yy
            values[VAR_ROW] = a[2] * a[2] * xx + 2.0 * a[2] * a[3] * xy + a[3] * a[3] * yy
            values[COVARIANCE] = a[0] * a[2] * xx + (a[0] * a[3] + a[1] * a[2]) * xy + a[1] * a[3] * yy
            return CONVERGED, iteration
    return NOT_CONVERGED, rules.max_iterations


@njit(cache=True)
def match_inverse(left, right, points, starts, affine, half, reach, rules, values, outcome, iterations):
    """Match points (N, 2) of `left` in `right`, both (H, W) float32, from starts (N, 2); for `least_squares.match_points`.

    affine (N, 4): start values. half (N,): half sides of the windows; reach: the most that one of them covers. Points whose
    `outcome` (N,) is CONVERGED are tried; `values` (N, results.COLUMNS), `outcome` and `iterations` (N,) are filled.
    """
    size = _pitch(reach) * (2 * reach + 1)
    sigma = max(rules.smoothing, 0.3)
    kernel = np.array([np.exp(-1.0 / (4.0 * sigma * sigma)), np.exp(-1.0 / (sigma * sigma))]).astype(np.float32)
    blocks = np.zeros((5, size), np.float32)
    scratch = (
        np.empty((2 * reach + 1, 2), np.int64), np.empty((2, size), np.float32), np.zeros(1, np.int64),
        np.zeros((4, size + 4 * _pitch(reach)), np.float32), np.empty(6), np.empty((3, 6)), np.empty(6), np.empty(6), np.empty(6),
        np.empty((6, 6)), np.empty((6, 6)), kernel,
    )
    flat = right.ravel()
    start, a = np.empty(2), np.empty(4)
    for i in range(points.shape[0]):
        if outcome[i] != CONVERGED:
            continue
        col, row = nearest_pixel(points[i, 0]), nearest_pixel(points[i, 1])
        px, py = points[i, 0] - col, points[i, 1] - row
        a[:] = affine[i]
        start[0] = starts[i, 0] - (a[0] * px + a[1] * py)
        start[1] = starts[i, 1] - (a[2] * px + a[3] * py)
        outcome[i], iterations[i] = _match_one(
            left, right, flat, col, row, half[i], (px, py), start, a, rules, blocks, scratch, values[i]
        )
