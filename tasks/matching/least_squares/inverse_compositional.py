"""Inverse-compositional least-squares matching: the recommended form.

Strategy
- Gradients and normal matrix belong to the left window alone (template.py): nothing is resampled before it is differentiated, which
  is the weakness of the published recipe (sources/measured.md#windows). With a square both are computed once per point, and an
  iteration is one warp and a few sums. An ellipse takes its shape from the inverse, so both are recomputed in the first iterations.
- The right window is scaled to the contrast of the left one, so that a step has the right length before the gain is known.
- The covariance accounts for correlated residuals (shift_precision.py).

Source: Baker & Matthews 2004; Skarlatos (sources/matching.md#least-squares, #window-shape).
"""

import numpy as np

from orthomill.kernels.kernel_compilation import njit
from orthomill.tasks.matching.least_squares import result_columns as results
from orthomill.tasks.matching.least_squares.grey_values import FlatImage, leaves, nearest_pixel, on_lattice
from orthomill.tasks.matching.least_squares.model import LEAST_AREA, RADIOMETRY_ESTIMATED, RADIOMETRY_NONE, RADIOMETRY_NORMALISED
from orthomill.tasks.matching.least_squares.shift_precision import correlated_products, influence
from orthomill.tasks.matching.least_squares.template import (
    FLAT,
    GX_GX,
    GY_GY,
    ZERO,
    MatchPoint,
    Template,
    build_template,
    ellipse_of,
    solve_shift,
    unknowns_of,
    work_for,
)
from orthomill.tasks.matching.least_squares.window_block import (
    WindowBlock,
    WindowPlacement,
    block_pitch,
    gradient_moments,
    grey_sums,
    warp_window,
)

_RESHAPED = 5
"""Iterations after which an ellipse keeps its shape: small ones can otherwise alternate between two shapes for ever."""


@njit(error_model="numpy")
def _compose(a, d):
    """A <- A (I + D)^-1 for the affine a (4,) and the correction d (6,); returns its area."""
    # The correction belongs to the left window: the right one is updated by its inverse (Baker & Matthews 2004, 3.2).
    m11, m12, m21, m22 = 1.0 + d[1], d[2], d[4], 1.0 + d[5]
    determinant = m11 * m22 - m12 * m21
    a0, a1, a2, a3 = a
    a[0], a[1] = (a0 * m22 - a1 * m21) / determinant, (a1 * m11 - a0 * m12) / determinant
    a[2], a[3] = (a2 * m22 - a3 * m21) / determinant, (a3 * m11 - a2 * m12) / determinant
    return a[0] * a[3] - a[1] * a[2]


@njit(error_model="numpy", forceinline=True)
def _correction(template, level_right, rules, work, values):
    """Right sides of the normal equations from the warped window, solved into work.d.

    Returns the outcome so far and the sum of squares of the residuals; correlation, gain and offset go to `values`.
    """
    n, count, mean, power = template.n, template.pixels, template.mean, template.power
    d, plain, likewise = work.d, work.plain, work.likewise
    patch = work.patch[:n]
    total_right, power_right, product = grey_sums(patch, work.grey[:n])
    mean_right = total_right / count
    power_right -= total_right * mean_right
    product -= total_right * mean
    # Pixels without data inside the right window are NaN and make the sums NaN.
    if not (abs(product) < np.inf and power_right < np.inf):
        return results.OUTSIDE, np.inf
    # A flat right window has no correlation, and its scale below would be infinite.
    if power_right <= FLAT * count:
        return results.LOW_TEXTURE, np.inf
    likeness, scale = product / np.sqrt(power * power_right), np.sqrt(power / power_right)
    gain = product / power
    values[results.CORRELATION], values[results.GAIN] = likeness, gain
    values[results.OFFSET] = mean_right + level_right - gain * (mean + template.level)
    gradient_moments(work.gx[:n], work.gy[:n], patch, work.xs[:n], work.ys[:n], d)
    if rules.radiometry == RADIOMETRY_NONE:
        # Both blocks count from their own centre: the difference of levels is restored where exposure is taken as equal.
        brighter = level_right - template.level - mean
        residual = power_right - 2.0 * product + power + count * (mean_right + brighter) ** 2
        for k in range(6):
            d[k] += brighter * plain[k] - likewise[k]
    elif rules.radiometry == RADIOMETRY_NORMALISED:
        residual = 2.0 * power * (1.0 - likeness)
        for k in range(6):
            d[k] = scale * (d[k] - mean_right * plain[k]) - likewise[k]
    else:
        # With the gain estimated the residual power is that of the right window that the left one does not explain.
        rho = min(max(likeness, 1e-3), 1.0)
        residual = power * (1.0 / (rho * rho) - 1.0)
        for k in range(6):
            d[k] = scale * (d[k] - mean_right * plain[k] - likewise[k] * product / power)
    solve_shift(work.lower, rules.shift_only, d)
    return results.CONVERGED, residual


@njit(error_model="numpy", forceinline=True)
def _cofactors(template, px, py, rules, work):
    """Cofactors (xx, xy, yy) of the shift of the place (px, py) of the window, with the correlation of the residuals."""
    n, d = template.n, work.d
    block = WindowBlock(work.grey[:n], work.gx[:n], work.gy[:n], work.inside[:n])
    pitch = block_pitch(template.reach_x)
    # Two rows of zeros at both ends: the correlation reaches two rows up and down without tests for the border.
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
        if rules.radiometry != RADIOMETRY_NONE:
            for k in range(6):
                share += d[k] * work.likewise[k] / template.power if rules.radiometry == RADIOMETRY_ESTIMATED else 0.0
                constant += d[k] * work.plain[k] / template.pixels
            constant -= share * template.mean
        influence(block, pad, work.xs[:n], work.ys[:n], d, share, constant, on_x if axis == 0 else on_y)
    near, far = work.kernel
    xx, xy = correlated_products(on_x, on_y, pitch, near, far, along)
    yy, _ = correlated_products(on_y, on_x, pitch, near, far, along)
    # The truncated correlation is not positive definite: rounding may leave a tiny negative variance.
    return max(xx, ZERO), xy, max(yy, ZERO)


@njit(error_model="numpy", forceinline=True)
def _finish(template, variance, point, place, rules, work, values):
    """Write position, reference and covariance of a matched window."""
    px, py, t, a = point.x, point.y, place.t, place.a
    if rules.centroid:
        m = work.moments
        weight = m[GX_GX, 0] + m[GY_GY, 0]
        # The centroid of squared gradients is where shift and affine are uncorrelated, hence the most precise place.
        px, py = (m[GX_GX, 1] + m[GY_GY, 1]) / weight, (m[GX_GX, 2] + m[GY_GY, 2]) / weight
    values[results.REFERENCE_COL], values[results.REFERENCE_ROW] = point.col + px, point.row + py
    values[results.COL] = place.base_col + on_lattice(t[0] + a[0] * px + a[1] * py)
    values[results.ROW] = place.base_row + on_lattice(t[1] + a[2] * px + a[3] * py)
    # The adjustment moves the left window, so its covariance is carried to the axes of the right image.
    xx, xy, yy = _cofactors(template, px, py, rules, work)
    values[results.VAR_COL] = variance * (a[0] * a[0] * xx + 2.0 * a[0] * a[1] * xy + a[1] * a[1] * yy)
    values[results.VAR_ROW] = variance * (a[2] * a[2] * xx + 2.0 * a[2] * a[3] * xy + a[3] * a[3] * yy)
    values[results.COVARIANCE] = variance * (a[0] * a[2] * xx + (a[0] * a[3] + a[1] * a[2]) * xy + a[1] * a[3] * yy)


@njit(error_model="numpy", forceinline=True)
def _match_one(left, right, point, t, a, rules, work, values):
    """Match the window of a `MatchPoint`; returns (outcome, iterations).

    left, right: the images, each a `FlatImage`. t (2,), a (4,): right position of the window's centre and affine, start values
    that are overwritten.
    """
    base_col, base_row = nearest_pixel(t[0]), nearest_pixel(t[1])
    t[0] -= base_col
    t[1] -= base_row
    place = WindowPlacement(base_col, base_row, t, a)
    begin_x, begin_y = t[0], t[1]
    axes, d = (1.0, 1.0, 0.0), work.d
    template = Template(0, 0, 0, 0, 0.0, 0.0, 0.0)
    for iteration in range(1, rules.max_iterations + 1):
        if iteration == 1 or (rules.ellipse and iteration <= _RESHAPED):
            outcome, template = build_template(left, point, axes, rules, work)
            if outcome != results.CONVERGED:
                return outcome, iteration - 1
            if rules.ellipse:
                axes = ellipse_of(rules, work)
        reach = template.reach_x, template.reach_y
        if leaves(
            (right.rows, right.cols),
            base_col + t[0],
            base_row + t[1],
            reach[0] * abs(a[0]) + reach[1] * abs(a[1]),
            reach[0] * abs(a[2]) + reach[1] * abs(a[3]),
        ):
            return results.OUTSIDE, iteration
        level_right = warp_window(right, place, rules.bicubic, reach, work.spans, work.patch)
        outcome, residual = _correction(template, level_right, rules, work, values)
        if outcome != results.CONVERGED:
            return outcome, iteration
        for k in range(6):
            # Unknowns 0 and 3 are the shifts (px), the other four belong to the affine.
            limit = rules.max_step if k % 3 == 0 else rules.max_affine_step
            d[k] = min(max(d[k], -limit), limit)
        area = _compose(a, d)
        # The step in the right image: convergence and limits are stated in its pixels.
        move_x, move_y = a[0] * d[0] + a[1] * d[3], a[2] * d[0] + a[3] * d[3]
        t[0] -= move_x
        t[1] -= move_y
        if not LEAST_AREA < area < 1.0 / LEAST_AREA:
            return results.NOT_CONVERGED, iteration
        if not (abs(t[0] - begin_x) <= rules.max_shift and abs(t[1] - begin_y) <= rules.max_shift):
            return results.MOVED_TOO_FAR, iteration
        if abs(move_x) < rules.stop and abs(move_y) < rules.stop:
            variance = max(residual, 0.0) / (template.pixels - unknowns_of(rules))
            values[results.SIGMA0] = np.sqrt(variance)
            values[results.A12], values[results.A21], values[results.B12], values[results.B21] = a[0], a[1], a[2], a[3]
            if values[results.CORRELATION] < rules.min_correlation:
                return results.LOW_CORRELATION, iteration
            _finish(template, variance, point, place, rules, work, values)
            return results.CONVERGED, iteration
    return results.NOT_CONVERGED, rules.max_iterations


@njit(error_model="numpy")
def match_inverse(left, right, attempts, reach, rules, found):
    """Match points of `left` in `right`, both (H, W) float32; for `matching.match_points`.

    attempts: `Attempts`; found: `Found`, filled where its outcome is CONVERGED, which stands for worth trying. reach: the most that
    a window covers, px.
    """
    work = work_for(reach, rules.smoothing)
    flat_left = FlatImage(left.ravel(), left.shape[0], left.shape[1])
    flat_right = FlatImage(right.ravel(), right.shape[0], right.shape[1])
    points, starts = attempts.points, attempts.starts
    t, a = np.empty(2), np.empty(4)
    for i in range(points.shape[0]):
        if found.outcome[i] != results.CONVERGED:
            continue
        col, row = nearest_pixel(points[i, 0]), nearest_pixel(points[i, 1])
        point = MatchPoint(col, row, points[i, 0] - col, points[i, 1] - row, attempts.half[i])
        a[:] = attempts.affine[i]
        t[0] = starts[i, 0] - (a[0] * point.x + a[1] * point.y)
        t[1] = starts[i, 1] - (a[2] * point.x + a[3] * point.y)
        found.outcome[i], found.iterations[i] = _match_one(flat_left, flat_right, point, t, a, rules, work, found.values[i])
