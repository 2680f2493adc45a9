"""The left window of inverse-compositional matching: cut, differentiated, its normal matrix built and factored.

Strategy
- Gradients are central differences of the left window at its own pixels: nothing is resampled before it is differentiated.
- Gain and offset are eliminated: the derivatives are made orthogonal to the window and to a constant by correcting the moments,
  which is equivalent to estimating both along with the geometric unknowns.

Source: Baker & Matthews 2004; Skarlatos (sources/matching.md#least-squares).
"""

from typing import NamedTuple

import numpy as np

from orthomill.kernels.kernel_compilation import njit
from orthomill.tasks.matching.least_squares import result_columns as results
from orthomill.tasks.matching.least_squares.model import RADIOMETRY_ESTIMATED, RADIOMETRY_NONE
from orthomill.tasks.matching.least_squares.shift_precision import residual_correlation
from orthomill.tasks.matching.least_squares.small_systems import factor, solve
from orthomill.tasks.matching.least_squares.window_block import (
    LANES,
    WindowBlock,
    block_pitch,
    cut_window,
    draw_block,
    gradient_moments,
    grey_sums,
    second_moments,
)
from orthomill.tasks.matching.least_squares.window_shape import ellipse_axes, ellipse_window, pixels_of, square_window

FLAT = 1e-6
"""Variance of grey values below which a window counts as constant."""
ZERO = np.float32(0.0)
GX_GX, GX_GY, GY_GY = range(3)
"""Rows of the moments: products of gradients; their columns are the factors 1, x, y, xx, xy, yy."""


class MatchPoint(NamedTuple):
    """A point of the left image and its window."""

    col: int
    row: int
    """the nearest pixel, the centre of the window"""
    x: float
    y: float
    """the point, from that pixel, px"""
    half: int
    """half side of the window, px"""


class Template(NamedTuple):
    """A window once its block has been cut."""

    reach_x: int
    reach_y: int
    n: int
    """floats of its block"""
    pixels: int
    """number of its pixels"""
    level: float
    """grey value that the block counts from"""
    mean: float
    """of the block's pixels"""
    power: float
    """sum of squares of the grey values about their mean"""


class WindowScratch(NamedTuple):
    """Arrays that are reused by every point."""

    spans: np.ndarray
    """(rows, 2) int64: first and last column of every row of the window"""
    drawn: np.ndarray
    """(1,) int64: reach of the square whose coordinates are in place"""
    xs: np.ndarray
    ys: np.ndarray
    """(n,) float32: column and row of every pixel of the block, from its centre"""
    grey: np.ndarray
    gx: np.ndarray
    gy: np.ndarray
    inside: np.ndarray
    """(n,) float32: as in `WindowBlock`"""
    patch: np.ndarray
    """(n,) float32: the right window"""
    moments: np.ndarray
    """(3, 6): rows GX_GX, GX_GY, GY_GY"""
    plain: np.ndarray
    """(6,): sums of the derivatives"""
    likewise: np.ndarray
    """(6,): sums of the derivatives times the centred grey values"""
    normal: np.ndarray
    lower: np.ndarray
    """(6, 6): the normal matrix and its factor"""
    d: np.ndarray
    """(6,): right side and solution, for the shift and the affine of x, then of y"""
    on_x: np.ndarray
    on_y: np.ndarray
    """influence of the residuals on both shifts, between zeros"""
    along: np.ndarray
    """scratch of the correlated products"""
    kernel: tuple[float, float]
    """correlation of residuals one and two pixels apart"""


@njit(error_model="numpy")
def work_for(reach, smoothing):
    """Scratch for windows that reach `reach` px from their centre."""
    size = block_pitch(reach) * (2 * reach + 1) + LANES
    longer = size + 4 * block_pitch(reach)
    return WindowScratch(
        np.empty((2 * reach + 1, 2), np.int64),
        np.zeros(1, np.int64),
        np.empty(size, np.float32),
        np.empty(size, np.float32),
        np.zeros(size, np.float32),
        np.zeros(size, np.float32),
        np.zeros(size, np.float32),
        np.zeros(size, np.float32),
        np.zeros(size, np.float32),
        np.empty((3, 6)),
        np.empty(6),
        np.empty(6),
        np.empty((6, 6)),
        np.empty((6, 6)),
        np.empty(6),
        np.zeros(longer, np.float32),
        np.zeros(longer, np.float32),
        np.zeros(longer, np.float32),
        residual_correlation(smoothing),
    )


@njit(error_model="numpy", inline="always")
def unknowns_of(rules):
    """Unknowns of the adjustment, with gain and offset where the radiometry is not taken as equal."""
    return (2 if rules.shift_only else 6) + (0 if rules.radiometry == RADIOMETRY_NONE else 2)


@njit(error_model="numpy")
def solve_shift(lower, shift_only, d):
    """Overwrite the right side d (6,) with the corrections; those of the affine are 0 where only shifts are estimated."""
    if not shift_only:
        solve(lower, 6, d)
        return
    # The two shifts are unknowns 0 and 3 of the affine, but rows 0 and 1 of their own matrix.
    d[1] = d[3]
    solve(lower, 2, d)
    d[3] = d[1]
    d[1], d[2], d[4], d[5] = 0.0, 0.0, 0.0, 0.0


@njit(error_model="numpy")
def _normal_matrix(moments, normal):
    """The 6 x 6 normal matrix of the derivatives from the moments of gx gx, gx gy and gy gy."""
    for k in range(3):
        # Block (r, c) of the matrix: gx gx above, gx gy off the diagonal, gy gy below.
        m = moments[k]
        r, c = 3 * (k // 2), 3 * ((k + 1) // 2)
        normal[r, c], normal[r, c + 1], normal[r, c + 2] = m[0], m[1], m[2]
        normal[r + 1, c], normal[r + 1, c + 1], normal[r + 1, c + 2] = m[1], m[3], m[4]
        normal[r + 2, c], normal[r + 2, c + 1], normal[r + 2, c + 2] = m[2], m[4], m[5]
    for i in range(3):
        for j in range(3):
            normal[3 + i, j] = normal[j, 3 + i]


@njit(error_model="numpy")
def _without_radiometry(normal, plain, grey, power, count):
    """Make the normal matrix that of derivatives orthogonal to a constant and to the window (of centred power `power`)."""
    for i in range(6):
        for j in range(i + 1):
            normal[i, j] -= plain[i] * plain[j] / count + grey[i] * grey[j] / power
            normal[j, i] = normal[i, j]


@njit(error_model="numpy", forceinline=True)
def build_template(image, point, axes, rules, work):
    """Cut the window of a point, build and factor its normal matrix; the outcome is CONVERGED when it can be matched.

    image: the left one, a `FlatImage`.
    """
    col, row, half = point.col, point.row, point.half
    if rules.ellipse:
        reach_x, reach_y = ellipse_window(half, axes, 0.0, 0.0, work.spans)
    else:
        reach_x, reach_y = square_window(half, work.spans)
    n = block_pitch(reach_x) * (2 * reach_y + 1)
    template = Template(reach_x, reach_y, n, 0, 0.0, 0.0, 0.0)
    if not (reach_x < col < image.cols - reach_x - 1 and reach_y < row < image.rows - reach_y - 1):
        return results.OUTSIDE, template
    grey, gx, gy, inside = work.grey[:n], work.gx[:n], work.gy[:n], work.inside[:n]
    xs, ys, moments = work.xs[:n], work.ys[:n], work.moments
    # The coordinates of a square are those of the point before; only another size draws them again.
    if rules.ellipse or work.drawn[0] != reach_x:
        draw_block(reach_x, reach_y, work.spans, xs, ys, inside)
        work.drawn[0] = reach_x
        grey[:], gx[:], gy[:], work.patch[:n] = ZERO, ZERO, ZERO, ZERO
    level = cut_window(image, (col, row), (reach_x, reach_y), work.spans, WindowBlock(grey, gx, gy, inside))
    second_moments(gx, gx, xs, ys, moments[GX_GX])
    second_moments(gx, gy, xs, ys, moments[GX_GY])
    second_moments(gy, gy, xs, ys, moments[GY_GY])
    count = pixels_of(work.spans, 2 * reach_y + 1)
    total, power, _ = grey_sums(grey, grey)
    mean = total / count
    power -= total * mean
    gxx, gxy, gyy = moments[GX_GX, 0], moments[GX_GY, 0], moments[GY_GY, 0]
    # NaN of pixels without data has run into the sums: one comparison finds it.
    if not (power < np.inf and gxx + gyy < np.inf):
        return results.OUTSIDE, template
    # The smaller eigenvalue of the structure tensor: a straight edge has gradients, but none along itself.
    weakest = 0.5 * (gxx + gyy) - np.sqrt(0.25 * (gxx - gyy) ** 2 + gxy * gxy)
    if weakest <= count * rules.min_gradient**2 or power <= FLAT * count:
        return results.LOW_TEXTURE, template
    gradient_moments(gx, gy, inside, xs, ys, work.plain)
    gradient_moments(gx, gy, grey, xs, ys, work.likewise)
    for k in range(6):
        # Sums over grey values from the centre, made sums over grey values from the mean.
        work.likewise[k] -= mean * work.plain[k]
    _normal_matrix(moments, work.normal)
    if rules.radiometry == RADIOMETRY_ESTIMATED:
        _without_radiometry(work.normal, work.plain, work.likewise, power, count)
    if rules.shift_only:
        # Rows and columns 0 and 3 become the leading 2 x 2 block.
        work.normal[1, 0], work.normal[1, 1] = work.normal[3, 0], work.normal[3, 3]
    if count <= unknowns_of(rules) or not factor(work.normal, 2 if rules.shift_only else 6, work.lower):
        return results.SINGULAR, template
    return results.CONVERGED, Template(reach_x, reach_y, n, count, np.float64(level), mean, power)


@njit(error_model="numpy")
def ellipse_of(rules, work):
    """Axes of the ellipse that follows from the cofactors of both shifts."""
    d = work.d
    d[:] = 0.0
    d[0] = 1.0
    solve_shift(work.lower, rules.shift_only, d)
    var_x, covariance = d[0], d[3]
    d[:] = 0.0
    d[3] = 1.0
    solve_shift(work.lower, rules.shift_only, d)
    return ellipse_axes(var_x, d[3], covariance, rules.max_axis_ratio, rules.across)
