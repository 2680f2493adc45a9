"""Forward least-squares matching: the form of the textbooks and of the dissertation, in float64.

Strategy
- Every pixel of the window is one observation f - g = gx (da11 + x da12 + y da21) + gy (db11 + x db12 + y db21), with f of the left
  image, g of the right one, x and y from the centre of the left window. Corrections are added to the affine.
- Either the window lies on pixels of the left image and the right one is resampled, or it lies on pixels of the right image and the
  left one is resampled through the inverse affine. Gradients are differences of the resampled window, or of the right image at its
  own pixels. The equations need derivatives along the axes of the right image; `window_right` uses differences along the left axes
  as they are, as the published equations do, and no pixel outside its window.
- An ellipse is reshaped in every iteration from the covariance of both shifts; the first one is a circle.
- Gain and offset, where estimated, act on the right image (f = gain g + offset), starting from 1 and 0.
- The covariance is the formal one of the adjustment: optimistic, as the sources say.

Source: Skarlatos, PhD thesis, 2.7.4 to 2.7.7, 3.1.7, 4.2.4.2 (sources/matching.md#least-squares,
#window-shape).
"""

from typing import NamedTuple

import numpy as np

from orthomill.kernels.kernel_compilation import njit
from orthomill.tasks.matching.least_squares import result_columns as results
from orthomill.tasks.matching.least_squares.grey_values import FlatImage, bicubic, bilinear, leaves, nearest_pixel, on_lattice
from orthomill.tasks.matching.least_squares.model import GRADIENTS, RADIOMETRY_ESTIMATED, RADIOMETRY_NORMALISED
from orthomill.tasks.matching.least_squares.small_systems import factor, solve
from orthomill.tasks.matching.least_squares.template import MatchPoint
from orthomill.tasks.matching.least_squares.window_shape import ellipse_axes, ellipse_window, square_window

_F, _G, _GX, _GY, _X, _Y = range(6)
"""Rows of the table of observations."""
_GAIN, _OFFSET = 6, 7
"""Places of gain and offset in the solution, after the six parameters of the affine."""
_WHOLE_PIXELS, _RESAMPLED_LEFT, _RESAMPLED_RIGHT, _WINDOW_RIGHT = range(len(GRADIENTS))
_FLAT = 1e-6
"""Variance of grey values below which a window counts as constant."""


class GreyPair(NamedTuple):
    """Both images as (H, W) float32 and flat: differences are taken from the former, interpolation from the latter."""

    left: np.ndarray
    right: np.ndarray
    flat_left: FlatImage
    flat_right: FlatImage


class ForwardPlace(NamedTuple):
    """Centre of the left window, and its place in the right image."""

    col: int
    row: int
    """of the left image"""
    base_col: int
    base_row: int
    """an integer pixel of the right image"""
    t0: float
    t1: float
    """(col, row) from there, px"""


class ForwardScratch(NamedTuple):
    """Arrays that are reused by every point."""

    spans: np.ndarray
    """(rows, 2) int64: first and last column of every row of the window"""
    patch: np.ndarray
    """(rows + 2, rows + 2) float32: the resampled window, with a ring of one pixel where its gradients need it"""
    seen: np.ndarray
    """(6, n) observations, rows _F to _Y"""
    normal: np.ndarray
    lower: np.ndarray
    """(8, 8): the normal matrix and its factor"""
    line: np.ndarray
    """(8,): one row of the design matrix"""
    d: np.ndarray
    """(8,): the solution da11, da12, da21, db11, db12, db21, gain, offset"""


@njit(error_model="numpy", inline="always")
def _value(image, origin, u, v, cubic):
    """The grey value at (u, v) px from the pixel of index `origin`. image: a `FlatImage`."""
    flat, width = image.pixels, image.cols
    c, r = np.floor(u), np.floor(v)
    # Unsigned: numba adds a test for negative indices to every signed one.
    k = np.uint64(origin + int(r) * width + int(c))
    if cubic:
        return bicubic(flat, np.uint64(width), k, np.float32(u - c), np.float32(v - r))
    return bilinear(flat, np.uint64(width), k, np.float32(u - c), np.float32(v - r))


@njit(error_model="numpy", inline="always")
def _difference(before, after, steps):
    """The slope between two pixels `steps` apart: 2 inside a block, 1 at its border, where one of them is the pixel itself."""
    return (after - before) / np.float32(steps)


@njit(error_model="numpy", inline="always")
def _slopes(patch, j, i, last_j, last_i):
    """Differences of a block at row j, column i: central inside, one-sided in its first and last rows and columns."""
    west, east, north, south = max(i - 1, 0), min(i + 1, last_i), max(j - 1, 0), min(j + 1, last_j)
    return _difference(patch[j, west], patch[j, east], east - west), _difference(patch[north, i], patch[south, i], south - north)


@njit(error_model="numpy")
def _on_left_pixels(images, place, a, reach, rules, scratch):
    """Observations of a window on pixels of the left image; their number, -1 where the window leaves an image.

    images: `GreyPair`. a (4,): the affine. reach: (columns, rows) to either side. Fills `patch` and `seen` of the scratch.
    """
    left, right = images.left, images.right
    col, row, base_col, base_row, t0, t1 = place
    spans, patch, seen = scratch.spans, scratch.patch, scratch.seen
    reach_x, reach_y = reach
    alone = rules.gradients == _WINDOW_RIGHT
    # Windows alone need no ring in the left image, for no differences are taken there.
    if not (reach_x <= col < left.shape[1] - reach_x and reach_y <= row < left.shape[0] - reach_y):
        return -1
    block_x, block_y = reach_x + (0 if alone else 1), reach_y + (0 if alone else 1)
    if leaves(
        right.shape,
        base_col + t0,
        base_row + t1,
        block_x * abs(a[0]) + block_y * abs(a[1]),
        block_x * abs(a[2]) + block_y * abs(a[3]),
    ):
        return -1
    origin = base_row * right.shape[1] + base_col
    for j in range(2 * block_y + 1):
        y = j - block_y
        for i in range(2 * block_x + 1):
            x = i - block_x
            u, v = t0 + a[0] * x + a[1] * y, t1 + a[2] * x + a[3] * y
            patch[j, i] = _value(images.flat_right, origin, u, v, rules.bicubic)
    area = a[0] * a[3] - a[1] * a[2]
    n = 0
    for j in range(2 * reach_y + 1):
        y = j - reach_y
        for x in range(spans[j, 0], spans[j, 1] + 1):
            gx, gy = _slopes(patch, y + block_y, x + block_x, 2 * block_y, 2 * block_x)
            if not alone:
                # Differences of the resampled window are along the left axes: the inverse affine carries them to the right ones.
                gx, gy = (a[3] * gx - a[2] * gy) / area, (a[0] * gy - a[1] * gx) / area
            seen[_F, n], seen[_G, n] = left[row + y, col + x], patch[y + block_y, x + block_x]
            seen[_GX, n], seen[_GY, n] = gx, gy
            seen[_X, n], seen[_Y, n] = x, y
            n += 1
    return n


@njit(error_model="numpy")
def _on_right_pixels(images, place, centre, a, reach, rules, scratch):
    """As `_on_left_pixels`, of a window on the pixels of the right image about `centre` (col, row), the left one resampled."""
    left, right = images.left, images.right
    col, row, base_col, base_row, t0, t1 = place
    spans, patch, seen = scratch.spans, scratch.patch, scratch.seen
    reach_x, reach_y = reach
    if not (reach_x < centre[0] < right.shape[1] - reach_x - 1 and reach_y < centre[1] < right.shape[0] - reach_y - 1):
        return -1
    area = a[0] * a[3] - a[1] * a[2]
    # The inverse affine takes pixels of the right window to the left image.
    i0, i1, i2, i3 = a[3] / area, -a[1] / area, -a[2] / area, a[0] / area
    dx, dy = centre[0] - base_col - t0, centre[1] - base_row - t1
    whole = rules.gradients == _WHOLE_PIXELS
    block_x, block_y = reach_x + (0 if whole else 1), reach_y + (0 if whole else 1)
    if leaves(
        left.shape,
        col + i0 * dx + i1 * dy,
        row + i2 * dx + i3 * dy,
        block_x * abs(i0) + block_y * abs(i1),
        block_x * abs(i2) + block_y * abs(i3),
    ):
        return -1
    origin = row * left.shape[1] + col
    n = 0
    if not whole:
        for j in range(2 * block_y + 1):
            v = dy + j - block_y
            for i in range(2 * block_x + 1):
                u = dx + i - block_x
                patch[j, i] = _value(images.flat_left, origin, i0 * u + i1 * v, i2 * u + i3 * v, rules.bicubic)
    for j in range(2 * reach_y + 1):
        r = centre[1] + j - reach_y
        for i in range(spans[j, 0], spans[j, 1] + 1):
            c = centre[0] + i
            x, y = i0 * (dx + i) + i1 * (dy + j - reach_y), i2 * (dx + i) + i3 * (dy + j - reach_y)
            if whole:
                f = _value(images.flat_left, origin, x, y, rules.bicubic)
                gx, gy = _difference(right[r, c - 1], right[r, c + 1], 2), _difference(right[r - 1, c], right[r + 1, c], 2)
            else:
                f = patch[j + 1, i + block_x]
                gx, gy = _slopes(patch, j + 1, i + block_x, 2 * block_y, 2 * block_x)
            seen[_F, n], seen[_G, n] = f, right[r, c]
            seen[_GX, n], seen[_GY, n] = gx, gy
            seen[_X, n], seen[_Y, n] = x, y
            n += 1
    return n


@njit(error_model="numpy")
def _grey_moments(seen, n):
    """Means of f and g, and their centred powers and product."""
    f, g = seen[_F, :n], seen[_G, :n]
    mean_f, mean_g, ff, gg, fg = 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(n):
        mean_f += f[k]
        mean_g += g[k]
    # Two passes: centred sums keep the digits that differences of large squares would lose.
    mean_f, mean_g = mean_f / n, mean_g / n
    for k in range(n):
        u, v = f[k] - mean_f, g[k] - mean_g
        ff += u * u
        gg += v * v
        fg += u * v
    return mean_f, mean_g, ff, gg, fg


@njit(error_model="numpy")
def _weakest_gradient(seen, n):
    """Sum of squares of the gradients in the direction that has the least; NaN where the window touches missing data."""
    xx, xy, yy = 0.0, 0.0, 0.0
    for k in range(n):
        gx, gy = seen[_GX, k], seen[_GY, k]
        xx += gx * gx
        xy += gx * gy
        yy += gy * gy
    return 0.5 * (xx + yy) - np.sqrt(0.25 * (xx - yy) ** 2 + xy * xy)


@njit(error_model="numpy")
def _adjust(n, radiometry, mean_g, shift_only, estimated, scratch):
    """Build and solve the normal equations of n observations; the sum of squared residuals, NaN where they are singular.

    radiometry: gain and offset of the right image. The solution is left in the scratch; its offset belongs to centred grey values.
    """
    seen, normal, lower, line, d = scratch.seen, scratch.normal, scratch.lower, scratch.line, scratch.d
    gain, offset = radiometry
    geometric = 2 if shift_only else 6
    unknowns = geometric + (2 if estimated else 0)
    normal[:], d[:] = 0.0, 0.0
    power = 0.0
    for k in range(n):
        gx, gy, x, y = gain * seen[_GX, k], gain * seen[_GY, k], seen[_X, k], seen[_Y, k]
        if shift_only:
            line[0], line[1] = gx, gy
        else:
            line[0], line[1], line[2], line[3], line[4], line[5] = gx, gx * x, gx * y, gy, gy * x, gy * y
        if estimated:
            # Centred grey values: gain and offset are then nearly uncorrelated, and the pivots well scaled.
            line[geometric], line[geometric + 1] = seen[_G, k] - mean_g, 1.0
        difference = seen[_F, k] - gain * seen[_G, k] - offset
        power += difference * difference
        for i in range(unknowns):
            d[i] += line[i] * difference
            for j in range(i + 1):
                normal[i, j] += line[i] * line[j]
    if not factor(normal, unknowns, lower):
        return np.nan
    # Residual power without another pass over the pixels: l'l - x'(A'l).
    line[:] = d
    solve(lower, unknowns, d)
    for i in range(unknowns):
        power -= line[i] * d[i]
    _spread(d, shift_only)
    return max(power, 0.0)


@njit(error_model="numpy")
def _spread(d, shift_only):
    """Move a solution of two shifts (and gain, offset) to the places that they have in that of the affine."""
    if shift_only:
        d[_GAIN], d[_OFFSET] = d[2], d[3]
        d[3] = d[1]
        d[1], d[2], d[4], d[5] = 0.0, 0.0, 0.0, 0.0


@njit(error_model="numpy")
def _shift_cofactors(lower, shift_only, estimated, px, py, z):
    """Cofactors (xx, yy, xy) of the shift of the place (px, py) of the window."""
    unknowns = (2 if shift_only else 6) + (2 if estimated else 0)
    found = (0.0, 0.0)
    for axis in range(2):
        z[:] = 0.0
        if shift_only:
            z[axis] = 1.0
        else:
            z[3 * axis], z[3 * axis + 1], z[3 * axis + 2] = 1.0, px, py
        solve(lower, unknowns, z)
        _spread(z, shift_only)
        on_x, on_y = z[0] + px * z[1] + py * z[2], z[3] + px * z[4] + py * z[5]
        if axis == 0:
            found = (on_x, on_y)
    return found[0], on_y, found[1]


@njit(error_model="numpy")
def _centroid(seen, n):
    """Mean of the coordinates of the window's pixels, weighted by their squared gradients."""
    weight, x, y = 0.0, 0.0, 0.0
    for k in range(n):
        w = seen[_GX, k] ** 2 + seen[_GY, k] ** 2
        weight += w
        x += w * seen[_X, k]
        y += w * seen[_Y, k]
    return x / weight, y / weight


@njit(error_model="numpy", inline="always")
def _limited(value, limit):
    """`value`, at most `limit` away from zero."""
    return min(max(value, -limit), limit)


@njit(error_model="numpy", inline="always")
def _gone_astray(a, limit):
    """Whether the affine mirrors the window or changes its area beyond the limit."""
    return limit < np.inf and not 1.0 / limit < a[0] * a[3] - a[1] * a[2] < limit


@njit(error_model="numpy")
def _finish(point, place, a, variance, n, rules, scratch, values):
    """Write position, reference and covariance of a matched window of n pixels."""
    px, py = _centroid(scratch.seen, n) if rules.centroid else (point.x, point.y)
    values[results.REFERENCE_COL], values[results.REFERENCE_ROW] = point.col + px, point.row + py
    values[results.COL] = place.base_col + on_lattice(place.t0 + a[0] * px + a[1] * py)
    values[results.ROW] = place.base_row + on_lattice(place.t1 + a[2] * px + a[3] * py)
    estimated = rules.radiometry == RADIOMETRY_ESTIMATED
    xx, yy, xy = _shift_cofactors(scratch.lower, rules.shift_only, estimated, px, py, scratch.line)
    values[results.VAR_COL], values[results.VAR_ROW] = variance * xx, variance * yy
    values[results.COVARIANCE] = variance * xy


@njit(error_model="numpy")
def _match_one(images, point, start, a, rules, scratch, values):
    """Match the window of a `MatchPoint` from `start` (2,); returns (outcome, iterations).

    images: `GreyPair`. a (4,): the affine, start values that are overwritten.
    """
    seen, d, half = scratch.seen, scratch.d, point.half
    base_col, base_row = nearest_pixel(start[0]), nearest_pixel(start[1])
    t0, t1 = start[0] - base_col, start[1] - base_row
    begin_x, begin_y = t0, t1
    estimated = rules.radiometry == RADIOMETRY_ESTIMATED
    in_right = rules.gradients == _WHOLE_PIXELS or rules.gradients == _RESAMPLED_LEFT
    unknowns = (2 if rules.shift_only else 6) + (2 if estimated else 0)
    gain, offset, axes = 1.0, 0.0, (1.0, 1.0, 0.0)
    for iteration in range(1, rules.max_iterations + 1):
        centre = (nearest_pixel(base_col + t0), nearest_pixel(base_row + t1)) if in_right else (base_col, base_row)
        if rules.ellipse and in_right:
            reach = ellipse_window(half, axes, base_col + t0 - centre[0], base_row + t1 - centre[1], scratch.spans)
        elif rules.ellipse:
            reach = ellipse_window(half, axes, 0.0, 0.0, scratch.spans)
        else:
            reach = square_window(half, scratch.spans)
        place = ForwardPlace(point.col, point.row, base_col, base_row, t0, t1)
        if in_right:
            n = _on_right_pixels(images, place, centre, a, reach, rules, scratch)
        else:
            n = _on_left_pixels(images, place, a, reach, rules, scratch)
        if n < 0:
            return results.OUTSIDE, iteration
        mean_f, mean_g, ff, gg, fg = _grey_moments(seen, n)
        weakest = _weakest_gradient(seen, n)
        if not (ff < np.inf and gg < np.inf and weakest < np.inf):
            return results.OUTSIDE, iteration
        # Tested in every iteration: these gradients are those of the window where it lies now.
        if weakest <= n * rules.min_gradient**2 or ff <= _FLAT * n or gg <= _FLAT * n:
            return results.LOW_TEXTURE, iteration
        values[results.CORRELATION] = fg / np.sqrt(ff * gg)
        if rules.radiometry == RADIOMETRY_NORMALISED:
            gain = np.sqrt(ff / gg)
            offset = mean_f - gain * mean_g
        residual = np.nan
        if n > unknowns:
            residual = _adjust(n, (gain, offset), mean_g, rules.shift_only, estimated, scratch)
        if residual != residual:
            return results.SINGULAR, iteration
        # The offset was solved for centred grey values, and is stated for the grey values themselves.
        gain += d[_GAIN]
        offset += d[_OFFSET] - d[_GAIN] * mean_g
        for k in range(6):
            d[k] = _limited(d[k], rules.max_step if k % 3 == 0 else rules.max_affine_step)
        t0 += d[0]
        t1 += d[3]
        a[0] += d[1]
        a[1] += d[2]
        a[2] += d[4]
        a[3] += d[5]
        if _gone_astray(a, rules.max_area_change):
            return results.NOT_CONVERGED, iteration
        if not (abs(t0 - begin_x) <= rules.max_shift and abs(t1 - begin_y) <= rules.max_shift):
            return results.MOVED_TOO_FAR, iteration
        if abs(d[0]) < rules.stop and abs(d[3]) < rules.stop:
            variance = residual / (n - unknowns)
            values[results.SIGMA0] = np.sqrt(variance)
            # The adjustment has f = gain g + offset; results are stated from left to right.
            values[results.GAIN], values[results.OFFSET] = 1.0 / gain, -offset / gain
            values[results.A12], values[results.A21], values[results.B12], values[results.B21] = a[0], a[1], a[2], a[3]
            if values[results.CORRELATION] < rules.min_correlation:
                return results.LOW_CORRELATION, iteration
            solved = ForwardPlace(point.col, point.row, base_col, base_row, t0, t1)
            _finish(point, solved, a, variance, n, rules, scratch, values)
            return results.CONVERGED, iteration
        if rules.ellipse:
            xx, yy, xy = _shift_cofactors(scratch.lower, rules.shift_only, estimated, 0.0, 0.0, scratch.line)
            # Cofactors of the centre, not of the point: the shape belongs to the window.
            axes = ellipse_axes(xx, yy, xy, rules.max_axis_ratio, rules.across)
    return results.NOT_CONVERGED, rules.max_iterations


@njit(error_model="numpy")
def _forward_scratch(reach):
    """The arrays that a window of `reach` px about its centre needs."""
    side = 2 * reach + 1
    return ForwardScratch(
        np.empty((side, 2), np.int64),
        np.empty((side + 2, side + 2), np.float32),
        np.empty((6, side * side)),
        np.empty((8, 8)),
        np.empty((8, 8)),
        np.empty(8),
        np.empty(8),
    )


@njit(error_model="numpy")
def match_forward(left, right, attempts, reach, rules, found):
    """Match points of `left` in `right`: arguments as of `inverse_compositional.match_inverse`."""
    scratch = _forward_scratch(reach)
    images = GreyPair(
        left, right, FlatImage(left.ravel(), left.shape[0], left.shape[1]), FlatImage(right.ravel(), right.shape[0], right.shape[1])
    )
    points, starts = attempts.points, attempts.starts
    start, a = np.empty(2), np.empty(4)
    for i in range(points.shape[0]):
        if found.outcome[i] != results.CONVERGED:
            continue
        col, row = nearest_pixel(points[i, 0]), nearest_pixel(points[i, 1])
        point = MatchPoint(col, row, points[i, 0] - col, points[i, 1] - row, attempts.half[i])
        a[:] = attempts.affine[i]
        start[0] = starts[i, 0] - (a[0] * point.x + a[1] * point.y)
        start[1] = starts[i, 1] - (a[2] * point.x + a[3] * point.y)
        found.outcome[i], found.iterations[i] = _match_one(images, point, start, a, rules, scratch, found.values[i])
