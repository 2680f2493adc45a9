"""One window of the left image against the warped right one: correction of the parallax and of its slopes, with their precision.

Strategy
- Unknowns are a correction of the parallax, its two slopes, gain and offset; the grey values are linear in all five, so that one
  solution of the normal equations is one step of inverse-compositional least squares.
- Only the pixels on the surface of the node take part, its *support*: those whose parallax lies on its plane.
- The variance is the larger of two. The first is that of noise which smoothing has correlated. The second compares the sums of
  gradient times residual (the *scores*) of nine parts of the window: with mere noise they scatter as the noise does; a surface that
  bends or breaks within the window, other radiometry and aliasing make them scatter more.

Source: Skarlatos (sources/matching.md#least-squares); Huber 1967 (variance from the scores).
"""

from typing import NamedTuple

import numpy as np

from orthomill.kernels.kernel_compilation import njit
from orthomill.tasks.matching.dense.kernel import kernel
from orthomill.tasks.matching.dense.shared_sums import PARTS, squared_shared_scores, sums_of
from orthomill.tasks.matching.dense.surface_warp import LANES
from orthomill.tasks.matching.least_squares import result_columns as outcomes
from orthomill.tasks.matching.least_squares.grey_values import EXACT

CORRECTION, SLOPE_X, SLOPE_Y, VARIANCE, CORRELATION, STRENGTH, SUPPORT, SPREAD, ASIDE, KERNEL = range(10)
"""Places in a solution: correction of the parallax (px) and of its slopes, variance of the parallax (px^2), correlation of the grey
values, root mean square gradient, pixels of the support, variance from the scores (px^2), how far from the node the texture lies
(px), and the variance that cubic interpolation adds, noise or none (px^2)"""
FEWEST = 10
"""pixels of support: five unknowns and as many more"""
_FLAT = 1e-6
"""variance of grey values below which a window counts as constant"""
_SINGLE = 1e-6
"""the same as a share of their mean square: sums of single precision leave that much, in an order that depends on the processor"""
_LEAST_GAIN = 0.05
"""gain below which the right window shows something else"""
_SLOPES = 0.05
"""px per px: expected size of the corrections of the slopes; what the texture hardly determines stays near its start"""
_ROUNDING = 0.3
"""grey values squared: least variance of residuals, about that of two images in whole grey values"""
_PIVOT = 1e-6
"""share of a diagonal element below which its pivot counts as zero: the texture does not determine that unknown"""
_PHASE = 0.025
"""px: by what the cubic kernel moves a wave of frequency f (per px), root mean square over all places between pixels, divided by
1 - cos(2 pi f); 0.023 for long waves, 0.031 at a quarter of the sampling rate"""
_FREE = 1.5
"""parts of a window per part that the unknowns leave free"""


class SurfaceBlock(NamedTuple):
    """The pixels of a window row by row, rows filled up to a multiple of LANES; all float32, the first four 0 off the support."""

    left: np.ndarray
    right: np.ndarray
    """grey values from that of the node in the left image"""
    gradient: np.ndarray
    """of the left image along the row"""
    inside: np.ndarray
    """1 on the support"""
    x: np.ndarray
    y: np.ndarray
    """px: coordinates, counted from the node, see `lay_out`"""
    ramp: np.ndarray
    """0, 1, 2, ... along a row"""


class SurfaceScratch(NamedTuple):
    """Arrays that are reused by every window."""

    block: SurfaceBlock
    sums: np.ndarray
    """(21,)"""
    line: np.ndarray
    """(n,) float32: of a row"""


@njit()
def scratch_for(half):
    """Scratch for windows of half side `half` at most."""
    wide = (2 * half + LANES) // LANES * LANES
    n = wide * (2 * half + 1)
    return SurfaceScratch(
        SurfaceBlock(
            np.zeros(n, np.float32),
            np.zeros(n, np.float32),
            np.zeros(n, np.float32),
            np.zeros(n, np.float32),
            np.zeros(n, np.float32),
            np.zeros(n, np.float32),
            np.arange(wide).astype(np.float32),
        ),
        np.empty(21),
        np.empty(wide, np.float32),
    )


@kernel(forceinline=True)
def lay_out(half, block):
    """Fill the coordinates of a block: they serve all windows of half side `half`."""
    lanes = (2 * half + LANES) // LANES * LANES
    for row in range(2 * half + 1):
        for col in range(lanes):
            block.x[row * lanes + col], block.y[row * lanes + col] = col - half, row - half


@kernel(forceinline=True, fastmath=EXACT)
def cut_block(pair, centre, half, plane, tolerance, flat, block):
    """Fill the block of a window, laid out for its half side; returns its size and the length of a row.

    centre: flat place of the node in the images of `pair`. plane: (parallax, slope x, slope y). flat: whether the corrections count
    from the plane itself instead of the field, which is smooth over a normal window only.
    """
    grey, warped, steepness, field, cols, _ = pair
    left, right, gradient, inside, _, _, ramp = block
    side = 2 * half + 1
    lanes = (side + LANES - 1) // LANES * LANES
    zero, one, limit = np.float32(0.0), np.float32(1.0), np.float32(tolerance)
    level, slope = grey[np.uint64(centre)], np.float32(plane[1])
    bend, last = np.float32(1.0 if flat else 0.0), np.float32(2 * half)
    for row in range(side):
        # The row is read from memory: were it known, the compiler would test before all rows at once whether arrays overlap, find
        # that they might, and take one pixel after the other.
        y = np.int64(ramp[row]) - half
        # Unsigned places need no test for negative ones, and slices would cost more than the loop itself.
        k, at = np.uint64(centre + y * cols - half), np.uint64((y + half) * lanes)
        begin = np.float32(plane[0] + plane[2] * y - plane[1] * half)
        for i in range(np.uint64(lanes)):
            x = ramp[i]
            apart = field[k + i] - (begin + slope * x)
            belongs = (abs(apart) <= limit) & (x <= last)
            # Few arrays are written, and read without conditions: tests whether they overlap would take longer than the loop.
            steep, own, other = steepness[k + i], grey[k + i] - level, warped[k + i] - level
            steep = steep if belongs else zero
            own = own if belongs else zero
            other = other + bend * steep * apart if belongs else zero
            left[at + i] = own
            right[at + i] = other
            gradient[at + i] = steep
            inside[at + i] = one if belongs else zero
    return side * lanes, lanes


@kernel(forceinline=True, fastmath=EXACT)
def block_sums(block, n, sums):
    """Fill the 21 sums of products of a block: 1, left, right, their squares and product; gradients; their products; with both."""
    left, right, g, inside, x, y = block.left[:n], block.right[:n], block.gradient[:n], block.inside[:n], block.x[:n], block.y[:n]
    # Three runs of a few sums each: all 21 at once would not fit into the registers.
    a = b = c = d = e = f = p = q = r = np.float32(0.0)
    for i in range(n):
        a += inside[i]
        b += left[i]
        c += right[i]
        d += left[i] * left[i]
        e += left[i] * right[i]
        f += right[i] * right[i]
        p += g[i]
        q += g[i] * x[i]
        r += g[i] * y[i]
    sums[0], sums[1], sums[2], sums[3], sums[4], sums[5], sums[6], sums[7], sums[8] = a, b, c, d, e, f, p, q, r
    a = b = c = d = e = f = np.float32(0.0)
    for i in range(n):
        gx, gy = g[i] * x[i], g[i] * y[i]
        a += g[i] * g[i]
        b += g[i] * gx
        c += g[i] * gy
        d += gx * gx
        e += gx * gy
        f += gy * gy
    sums[9], sums[10], sums[11], sums[12], sums[13], sums[14] = a, b, c, d, e, f
    a = b = c = d = e = f = np.float32(0.0)
    for i in range(n):
        gx, gy = g[i] * x[i], g[i] * y[i]
        a += g[i] * left[i]
        b += gx * left[i]
        c += gy * left[i]
        d += g[i] * right[i]
        e += gx * right[i]
        f += gy * right[i]
    sums[15], sums[16], sums[17], sums[18], sums[19], sums[20] = a, b, c, d, e, f


@kernel(forceinline=True, fastmath=EXACT)
def correlated_pairs(gradient, n, lanes, near, far):
    """Sum of the squared gradients of a window; of the products of neighbours, times the correlation of residuals, which is `near`
    and `far` at distances of 1 and 2 px; and of the products of neighbours in a row.

    gradient: of a block of n pixels in rows of `lanes`; the pairs that begin in its last two rows are left out.
    """
    size, row = np.uint64(max(n - 2 * lanes, 0)), np.uint64(lanes)
    one, two = np.uint64(1), np.uint64(2)
    here, right, second = gradient[:size], gradient[one : size + one], gradient[two : size + two]
    below, beside, lower = (
        gradient[row : size + row],
        gradient[row + one : size + row + one],
        gradient[two * row : size + two * row],
    )
    own = along = across = diagonal = farther = np.float32(0.0)
    for i in range(here.size):
        own += here[i] * here[i]
        along += here[i] * right[i]
        across += here[i] * below[i]
        diagonal += here[i] * beside[i] + right[i] * below[i]
        farther += here[i] * second[i] + here[i] * lower[i]
    return own, near * (along + across) + near * near * diagonal + far * farther, along


@kernel(forceinline=True)
def correlation_factor(pairs):
    """Factor of the variance of the parallax by residuals that correlate, and the correlation of the gradient itself along the row.

    pairs: from `correlated_pairs`.
    """
    own, share, along = pairs
    # The truncated correlation is not positive definite: texture of one wavelength may make the sum negative.
    power = max(own, 1e-6)
    return max(1.0 + 2.0 * share / power, 0.3), along / power


@kernel(forceinline=True, fastmath=EXACT)
def squared_scores(scratch, half, lanes, unknowns):
    """Sum of the squared scores of the parts of a window, after its adjustment; unknowns: see `_adjusted`."""
    sums, line = scratch.sums, scratch.line
    left, right, g, inside, x, y, ramp = scratch.block
    side = 2 * half + 1
    gain, b, c, a = np.float32(unknowns[0]), np.float32(unknowns[1]), np.float32(unknowns[2]), np.float32(unknowns[3])
    mean = np.float32(sums[6] / sums[0])
    constant = np.float32(_constant(sums, unknowns))
    total = 0.0
    for part in range(PARTS):
        line[:lanes] = np.float32(0.0)
        for row in range(part * side // PARTS, (part + 1) * side // PARTS):
            # See `cut_block`.
            k = np.uint64(np.int64(ramp[row]) * lanes)
            for i in range(np.uint64(lanes)):
                moved = g[k + i] * (a + b * x[k + i] + c * y[k + i])
                residual = right[k + i] - constant - gain * left[k + i] - moved
                line[i] += (g[k + i] - mean) * residual * inside[k + i]
        for other in range(PARTS):
            score = 0.0
            for i in range(other * side // PARTS, (other + 1) * side // PARTS):
                score += line[i]
            total += score * score
    return total


@kernel(forceinline=True)
def _adjusted(sums, prior):
    """Solve for gain, slopes and parallax, the offset eliminated; `prior`: weight of the observations that the slopes are zero.

    Returns the unknowns, the cofactor of the parallax (NaN where the texture does not determine it) and what they explain of the
    power of the right window.
    """
    # The parallax comes last: its pivot is the inverse of its cofactor, and no inverse is computed. Written out, for loops over
    # four unknowns would take longer than all sums of a window.
    share = 1.0 / sums[0]
    left, right, p, q, r = sums[1] * share, sums[2] * share, sums[6] * share, sums[7] * share, sums[8] * share
    gain, gain_x, gain_y = sums[3] - sums[1] * left, sums[16] - sums[7] * left, sums[17] - sums[8] * left
    gain_p, x_p, y_p = sums[15] - sums[6] * left, sums[10] - sums[7] * p, sums[11] - sums[8] * p
    x_x, x_y, y_y = sums[12] - sums[7] * q + prior, sums[13] - sums[8] * q, sums[14] - sums[8] * r + prior
    to_x, to_y, to_p = gain_x / gain, gain_y / gain, gain_p / gain
    pivot_x, rest_xy, rest_xp = x_x - to_x * gain_x, x_y - to_y * gain_x, x_p - to_p * gain_x
    x_to_y, x_to_p = rest_xy / pivot_x, rest_xp / pivot_x
    pivot_y, rest_yp = y_y - to_y * gain_y - x_to_y * rest_xy, y_p - to_p * gain_y - x_to_p * rest_xy
    y_to_p = rest_yp / pivot_y
    pivot_p = sums[9] - sums[6] * p - to_p * gain_p - x_to_p * rest_xp - y_to_p * rest_yp
    of_gain = sums[4] - sums[1] * right
    of_x = sums[19] - sums[7] * right - to_x * of_gain
    of_y = sums[20] - sums[8] * right - to_y * of_gain - x_to_y * of_x
    of_p = sums[18] - sums[6] * right - to_p * of_gain - x_to_p * of_x - y_to_p * of_y
    parallax = of_p / pivot_p
    slope_y = of_y / pivot_y - y_to_p * parallax
    slope_x = of_x / pivot_x - x_to_y * slope_y - x_to_p * parallax
    own_gain = of_gain / gain - to_x * slope_x - to_y * slope_y - to_p * parallax
    explained = of_gain * of_gain / gain + of_x * of_x / pivot_x + of_y * of_y / pivot_y + of_p * parallax
    sound = pivot_x > _PIVOT * x_x and pivot_y > _PIVOT * y_y and pivot_p > _PIVOT * sums[9]
    return own_gain, slope_x, slope_y, parallax, 1.0 / pivot_p if sound else np.nan, explained


@kernel(forceinline=True)
def solved(scratch, half, size, correlation, slope, out):
    """Solve a window whose block is cut: fills `out` (10,), a solution; returns its outcome.

    size: of the block and of its rows, from `cut_block`. correlation: of residuals 1 and 2 px apart. slope: of the plane, x.
    """
    n, lanes = size
    sums = scratch.sums
    block_sums(scratch.block, n, sums)
    found, unknowns = solved_sums(sums, slope, out)
    if found == outcomes.CONVERGED:
        pairs = correlated_pairs(scratch.block.gradient, n, lanes, correlation[0], correlation[1])
        state_variances(pairs, squared_scores(scratch, half, lanes, unknowns), half, out)
    return found


@kernel(forceinline=True)
def solved_whole(shared, at, half, off, slope, sums, out):
    """Solve a whole window from the sums of its run (shared_sums.py), as `solved` does; sums (21,): scratch.

    at: column of its first pixel in the run. off: what the plane of the run has more than that of the node.
    """
    pairs = sums_of(shared, at, half, off, sums)
    found, unknowns = solved_sums(sums, slope, out)
    if found == outcomes.CONVERGED:
        constant = _constant(sums, unknowns)
        state_variances(pairs, squared_shared_scores(shared, at, half, off, constant, sums[6] / sums[0], unknowns), half, out)
    return found


@kernel(forceinline=True)
def _constant(sums, unknowns):
    """The offset of the grey values; unknowns: see `_adjusted`."""
    explained = unknowns[0] * sums[1] + unknowns[1] * sums[7] + unknowns[2] * sums[8] + unknowns[3] * sums[6]
    return (sums[2] - explained) / sums[0]


@kernel(forceinline=True)
def state_variances(pairs, scores, half, out):
    """Complete a solution: what the correlation of residuals and the squared scores say of its variances."""
    factor, alike = correlation_factor(pairs)
    out[VARIANCE] *= factor
    # The mean of 1 - cos over the waves of the gradient is one minus its correlation at 1 px; a row has one pair less than pixels.
    out[KERNEL] = (_PHASE * (1.0 - alike * (2 * half + 1) / (2 * half))) ** 2
    out[SPREAD] = _FREE * scores * out[SPREAD]


@kernel(forceinline=True)
def solved_sums(sums, slope, out):
    """What the sums of a window give: fills `out` (10,), with the variances of uncorrelated noise and of a unit of squared scores;
    returns its outcome and the unknowns, see `_adjusted`. slope: of the plane, x."""
    nothing = 0.0, 0.0, 0.0, 0.0
    out[SUPPORT] = sums[0]
    if sums[0] < FEWEST:
        return outcomes.NOT_TRIED, nothing
    out[STRENGTH] = np.sqrt(sums[9] / sums[0])
    # The centroid of the squared gradients: where the window is determined.
    out[ASIDE] = max(abs(sums[10]), abs(sums[11])) / max(sums[9], 1e-6)
    contrast, power = sums[3] - sums[1] * sums[1] / sums[0], sums[5] - sums[2] * sums[2] / sums[0]
    if contrast <= _FLAT * sums[0] + _SINGLE * sums[3] or power <= _FLAT * sums[0] + _SINGLE * sums[5]:
        return outcomes.LOW_TEXTURE, nothing
    common = sums[4] - sums[1] * sums[2] / sums[0]
    out[CORRELATION] = common / np.sqrt(contrast * power)
    gain = common / contrast
    if not gain > _LEAST_GAIN:
        return outcomes.LOW_CORRELATION, nothing
    # Slopes are observed as zero with `_SLOPES` as standard error, beside the residuals before the adjustment.
    before = max(power - gain * common, 0.0) / sums[0] + _ROUNDING
    gain, slope_x, slope_y, parallax, cofactor, explained = _adjusted(sums, before / (gain * _SLOPES) ** 2)
    if np.isnan(cofactor):
        return outcomes.SINGULAR, nothing
    if not gain > _LEAST_GAIN:
        return outcomes.LOW_CORRELATION, nothing
    # From derivatives of the left image to parallaxes: the right one shows the window stretched by 1 - slope.
    stretch = (1.0 - slope) / gain
    out[CORRECTION], out[SLOPE_X], out[SLOPE_Y] = stretch * parallax, stretch * slope_x, stretch * slope_y
    scaled = cofactor * stretch * stretch
    out[VARIANCE] = max(power - explained, 0.0) / (sums[0] - 5.0) * scaled
    out[SPREAD] = cofactor * scaled
    return outcomes.CONVERGED, (gain, slope_x, slope_y, parallax)
