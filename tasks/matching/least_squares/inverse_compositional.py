"""Inverse-compositional least-squares matching: the recommended form.

Strategy
- Gradients and normal matrix belong to the left window alone (template.py): nothing is resampled before it is differentiated, which
  is the weak spot of the published recipe (methods/measured.md). With a square both are made once per point, and an iteration is
  one warp and a few sums. An ellipse takes its shape from the inverse, so there they are made anew in the first iterations.
- The right window is brought to the left one's contrast, so that a step is right before the gain is known.
- The covariance is that of correlated residuals (shift_precision.py).

Source: Baker & Matthews 2004; methods/matching_windows.md 2.1 (rows 1 to 3); matching_and_dsm_check.md 1.3, 1.4.
"""

import numpy as np
from numba import njit

from orthomill.tasks.matching.least_squares import result_columns as results
from orthomill.tasks.matching.least_squares.grey_values import leaves, nearest_pixel, on_lattice
from orthomill.tasks.matching.least_squares.model import LEAST_AREA
from orthomill.tasks.matching.least_squares.shift_precision import correlated_products, influence
from orthomill.tasks.matching.least_squares.template import (
    FLAT,
    ZERO,
    Template,
    build_template,
    ellipse_of,
    solve_shift,
    unknowns_of,
    work_for,
)
from orthomill.tasks.matching.least_squares.window_block import block_pitch, gradient_moments, grey_sums, warp_window

_RESHAPED = 5
"""Iterations after which an ellipse keeps its shape: small ones can go to and fro between two, for ever."""


@njit(cache=True, error_model="numpy")
def _compose(a, d):
    """A <- A (I + D)^-1 for the affine a (4,) and the correction d (6,); returns its area."""
    m11, m12, m21, m22 = 1.0 + d[1], d[2], d[4], 1.0 + d[5]
    determinant = m11 * m22 - m12 * m21
    a0, a1, a2, a3 = a
    a[0], a[1] = (a0 * m22 - a1 * m21) / determinant, (a1 * m11 - a0 * m12) / determinant
    a[2], a[3] = (a2 * m22 - a3 * m21) / determinant, (a3 * m11 - a2 * m12) / determinant
    return a[0] * a[3] - a[1] * a[2]


@njit(cache=True, error_model="numpy", forceinline=True)
def _correction(template, level_right, rules, work, values):
    """Right sides of the normal equations from the warped window, solved into work.d.

    Returns the outcome so far and the sum of squares of the residuals; correlation, gain and offset go to `values`.
    """
    n, count, mean, power = template.n, template.count, template.mean, template.power
    d, plain, likewise = work.d, work.plain, work.likewise
    patch = work.patch[:n]
    total_right, power_right, product = grey_sums(patch, work.grey[:n])
    mean_right = total_right / count
    power_right -= total_right * mean_right
    product -= total_right * mean
    if not (abs(product) < np.inf and power_right < np.inf):
        return results.OUTSIDE, np.inf
    if power_right <= FLAT * count:
        return results.LOW_TEXTURE, np.inf
    likeness, scale = product / np.sqrt(power * power_right), np.sqrt(power / power_right)
    gain = product / power
    values[results.CORRELATION], values[results.GAIN] = likeness, gain
    values[results.OFFSET] = mean_right + level_right - gain * (mean + template.level)
    gradient_moments(work.gx[:n], work.gy[:n], patch, work.xs[:n], work.ys[:n], d)
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
    solve_shift(work.lower, rules.shift_only, d)
    return results.CONVERGED, residual


@njit(cache=True, error_model="numpy", forceinline=True)
def _cofactors(template, px, py, rules, work):
    """Cofactors (xx, xy, yy) of the shift of the place (px, py) of the window, with the correlation of the residuals."""
    n, d = template.n, work.d
    block = work.grey[:n], work.gx[:n], work.gy[:n], work.inside[:n]
    pitch = block_pitch(template.reach_x)
    pad, size = 2 * pitch, n + 4 * pitch
    on_x, on_y, along = work.on_x[:size], work.on_y[:size], work.along[:size]
    along[size - 2 :] = ZERO
    for axis in range(2):
        d[:] = 0.0
        d[3 * axis] = 1.0
        if not rules.shift_only:
            d[3 * axis + 1], d[3 * axis + 2] = px, py
        solve_shift(work.lower, rules.shift_only, d)
        share, constant = 0.0, 0.0
        if rules.radiometry > 0:
            for k in range(6):
                share += d[k] * work.likewise[k] / template.power if rules.radiometry == 2 else 0.0
                constant += d[k] * work.plain[k] / template.count
            constant -= share * template.mean
        influence(block, pad, work.xs[:n], work.ys[:n], d, share, constant, on_x if axis == 0 else on_y)
    near, far = work.kernel
    xx, xy = correlated_products(on_x, on_y, pitch, near, far, along)
    yy, _ = correlated_products(on_y, on_x, pitch, near, far, along)
    return max(xx, ZERO), xy, max(yy, ZERO)


@njit(cache=True, error_model="numpy", forceinline=True)
def _finish(template, variance, pixel, place, base, t, a, rules, work, values):
    """Write position, reference and covariance of a matched window."""
    px, py = place
    if rules.centroid:
        m = work.moments
        weight = m[0, 0] + m[2, 0]
        px, py = (m[0, 1] + m[2, 1]) / weight, (m[0, 2] + m[2, 2]) / weight
    values[results.REFERENCE_COL], values[results.REFERENCE_ROW] = pixel[0] + px, pixel[1] + py
    values[results.COL] = base[0] + on_lattice(t[0] + a[0] * px + a[1] * py)
    values[results.ROW] = base[1] + on_lattice(t[1] + a[2] * px + a[3] * py)
    xx, xy, yy = _cofactors(template, px, py, rules, work)
    values[results.VAR_COL] = variance * (a[0] * a[0] * xx + 2.0 * a[0] * a[1] * xy + a[1] * a[1] * yy)
    values[results.VAR_ROW] = variance * (a[2] * a[2] * xx + 2.0 * a[2] * a[3] * xy + a[3] * a[3] * yy)
    values[results.COVARIANCE] = variance * (a[0] * a[2] * xx + (a[0] * a[3] + a[1] * a[2]) * xy + a[1] * a[3] * yy)


@njit(cache=True, error_model="numpy", forceinline=True)
def _match_one(left, right, shapes, pixel, half, place, t, a, rules, work, values):
    """Match the window about the whole pixel (col, row); returns (outcome, iterations).

    left, right: the images as one row, `shapes` their (rows, columns). place: the point, from that pixel. t (2,), a (4,): right
    position of the pixel and affine, from their start to the solution.
    """
    base = nearest_pixel(t[0]), nearest_pixel(t[1])
    t[0] -= base[0]
    t[1] -= base[1]
    begin_x, begin_y = t[0], t[1]
    axes, d = (1.0, 1.0, 0.0), work.d
    template = Template(0, 0, 0, 0, 0.0, 0.0, 0.0)
    for iteration in range(1, rules.max_iterations + 1):
        if iteration == 1 or (rules.ellipse and iteration <= _RESHAPED):
            outcome, template = build_template(left, shapes[0], pixel[0], pixel[1], half, axes, rules, work)
            if outcome != results.CONVERGED:
                return outcome, iteration - 1
            if rules.ellipse:
                axes = ellipse_of(rules, work)
        reach = template.reach_x, template.reach_y
        if leaves(
            shapes[1],
            base[0] + t[0],
            base[1] + t[1],
            reach[0] * abs(a[0]) + reach[1] * abs(a[1]),
            reach[0] * abs(a[2]) + reach[1] * abs(a[3]),
        ):
            return results.OUTSIDE, iteration
        level_right = warp_window(right, shapes[1][1], base, t, a, rules.bicubic, reach, work.spans, work.patch)
        outcome, residual = _correction(template, level_right, rules, work, values)
        if outcome != results.CONVERGED:
            return outcome, iteration
        for k in range(6):
            limit = rules.max_step if k % 3 == 0 else rules.max_affine_step
            d[k] = min(max(d[k], -limit), limit)
        area = _compose(a, d)
        move_x, move_y = a[0] * d[0] + a[1] * d[3], a[2] * d[0] + a[3] * d[3]
        t[0] -= move_x
        t[1] -= move_y
        if not LEAST_AREA < area < 1.0 / LEAST_AREA:
            return results.NOT_CONVERGED, iteration
        if not (abs(t[0] - begin_x) <= rules.max_shift and abs(t[1] - begin_y) <= rules.max_shift):
            return results.MOVED_TOO_FAR, iteration
        if abs(move_x) < rules.stop and abs(move_y) < rules.stop:
            variance = max(residual, 0.0) / (template.count - unknowns_of(rules))
            values[results.SIGMA0] = np.sqrt(variance)
            values[results.A12], values[results.A21], values[results.B12], values[results.B21] = a[0], a[1], a[2], a[3]
            if values[results.CORRELATION] < rules.min_correlation:
                return results.LOW_CORRELATION, iteration
            _finish(template, variance, pixel, place, base, t, a, rules, work, values)
            return results.CONVERGED, iteration
    return results.NOT_CONVERGED, rules.max_iterations


@njit(cache=True, error_model="numpy")
def match_inverse(left, right, points, starts, affine, half, reach, rules, values, outcome, iterations):
    """Match points (N, 2) of `left` in `right`, both (H, W) float32, from starts (N, 2); for `least_squares.match_points`.

    affine (N, 4): start values. half (N,): half sides of the windows; reach: the most that one of them covers. Points whose
    `outcome` (N,) is CONVERGED are tried; `values` (N, results.COLUMNS), `outcome` and `iterations` (N,) are filled.
    """
    work, shapes = work_for(reach, rules.smoothing), (left.shape, right.shape)
    flat_left, flat_right = left.ravel(), right.ravel()
    t, a = np.empty(2), np.empty(4)
    for i in range(points.shape[0]):
        if outcome[i] != results.CONVERGED:
            continue
        pixel = nearest_pixel(points[i, 0]), nearest_pixel(points[i, 1])
        place = points[i, 0] - pixel[0], points[i, 1] - pixel[1]
        a[:] = affine[i]
        t[0] = starts[i, 0] - (a[0] * place[0] + a[1] * place[1])
        t[1] = starts[i, 1] - (a[2] * place[0] + a[3] * place[1])
        outcome[i], iterations[i] = _match_one(flat_left, flat_right, shapes, pixel, half[i], place, t, a, rules, work, values[i])
