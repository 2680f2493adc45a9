"""The block of a window, and the sums over it that least-squares matching needs.

Strategy
- A window is a block of padded rows, zero outside its shape, so that every sum is one run over contiguous float32 and neighbours in
  any direction are at a constant distance. Grey values are counted from that of the centre, so that float32 sums stay small.
- Moments: derivatives by the affine are gx and gy times 1, x and y, so all their products are sums of gx gx, gx gy, gy gy times
  powers of x and y. No image of a derivative is ever stored.
"""

from typing import NamedTuple

import numpy as np

from orthomill.kernels.kernel_compilation import njit
from orthomill.tasks.matching.least_squares.grey_values import EXACT, cubic_weights

LANES = 16
"""Pixels that are resampled at once; an array for a block has as many more at its end."""
PAD = 2
"""Zeros between the rows of a block, at least: the correlation of residuals reaches that far."""


class WindowBlock(NamedTuple):
    """A window as padded rows, each (n,) float32, zero outside the window's shape."""

    grey: np.ndarray
    """from the grey value of the centre"""
    gx: np.ndarray
    gy: np.ndarray
    """gradients, grey values per px"""
    inside: np.ndarray
    """1 inside the shape"""


class WindowPlacement(NamedTuple):
    """Where the pixel (x, y) of a window lies in the right image: at base + t + A (x, y), px."""

    base_col: int
    base_row: int
    """an integer pixel near by"""
    t: np.ndarray
    """(2,) float64"""
    a: np.ndarray
    """(4,) float64: a12, a21, b12, b21, the rows of A"""


@njit(error_model="numpy", inline="always")
def block_pitch(reach):
    """Distance between the rows of a block: the window and its padding."""
    return 2 * reach + 1 + PAD


@njit(error_model="numpy")
def draw_block(reach_x, reach_y, spans, xs, ys, inside):
    """Column and row of every pixel of a block, from its centre, and 1 where it belongs to the window, else 0."""
    pitch = block_pitch(reach_x)
    for j in range(2 * reach_y + 1):
        first, last = spans[j]
        for i in range(pitch):
            x = i - reach_x
            xs[j * pitch + i], ys[j * pitch + i] = x, j - reach_y
            inside[j * pitch + i] = 1.0 if first <= x <= last else 0.0


@njit(error_model="numpy", inline="always")
def full_lanes(n, room):
    """`n` rounded up to whole vectors where the image has `room` for it: a remainder would be processed pixel by pixel."""
    wide = (n + LANES - 1) // LANES * LANES
    return wide if wide <= room else n


@njit(error_model="numpy", forceinline=True, fastmath=EXACT)
def cut_window(image, pixel, reach, spans, block):
    """Fill a `WindowBlock` with the left window about `pixel` (col, row) and its gradients; returns the grey value it counts from.

    image: the left one, a `FlatImage`.
    """
    flat, width = image.pixels, image.cols
    grey, gx, gy, _ = block
    col, row = pixel
    reach_x, reach_y = reach
    pitch = block_pitch(reach_x)
    level, half, zero = flat[np.uint64(row * width + col)], np.float32(0.5), np.float32(0.0)
    for j in range(2 * reach_y + 1):
        first, last = spans[j]
        n, at = last - first + 1, j * pitch + reach_x + first
        # An ellipse may leave its first or last row empty.
        if n < 1:
            continue
        k = (row + j - reach_y) * width + col + first
        wide = full_lanes(n, flat.size - k - width)
        up, centre, down, length = np.uint64(k - width), np.uint64(k - 1), np.uint64(k + width), np.uint64(wide)
        above, line, below = flat[up : up + length], flat[centre : centre + length + np.uint64(2)], flat[down : down + length]
        to_grey, to_x, to_y = grey[at : at + wide], gx[at : at + wide], gy[at : at + wide]
        # One loop per result: with several results in one loop compilers do not vectorise.
        for i in range(wide):
            to_grey[i] = line[i + 1] - level if i < n else zero
        for i in range(wide):
            to_x[i] = half * (line[i + 2] - line[i]) if i < n else zero
        for i in range(wide):
            to_y[i] = half * (below[i] - above[i]) if i < n else zero
    return level


@njit(error_model="numpy", forceinline=True, fastmath=EXACT)
def second_moments(p, q, xs, ys, out):
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


@njit(error_model="numpy", forceinline=True, fastmath=EXACT)
def gradient_moments(gx, gy, p, xs, ys, out):
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


@njit(error_model="numpy", forceinline=True, fastmath=EXACT)
def grey_sums(p, q):
    """Sums of p, p p and p q."""
    s = pp = pq = np.float32(0.0)
    for i in range(p.size):
        s += p[i]
        pp += p[i] * p[i]
        pq += p[i] * q[i]
    return s, pp, pq


@njit(error_model="numpy", inline="always")
def _same_steps(rest, drift, most):
    """For how many pixels, at most `most`, a coordinate `rest` in [0, 1) beyond an integer keeps that integer while drifting."""
    if drift == 0.0:
        return most
    room = (np.float32(1.0) - rest) / drift if drift > 0.0 else rest / -drift
    return most if room >= most else int(room) + 1


@njit(error_model="numpy", forceinline=True, fastmath=EXACT)
def _bicubic_run(image, k, rest, drift, level, n, patch, at):
    """Fill n pixels of `patch` from `at` on, zero beyond them: their neighbours are contiguous, so that many are read at once."""
    flat, width, one = image.pixels, np.uint64(image.cols), np.uint64(1)
    wide = full_lanes(n, flat.size - int(k + width + width) - 2)
    length = np.uint64(wide + 3)
    a, b, c, d = k - width - one, k - one, k + width - one, k + width + width - one
    first, second, third, fourth = flat[a : a + length], flat[b : b + length], flat[c : c + length], flat[d : d + length]
    line = patch[at : at + wide]
    for i in range(wide):
        x = np.float32(i)
        w0, w1, w2, w3 = cubic_weights(rest[0] + drift[0] * x)
        v0, v1, v2, v3 = cubic_weights(rest[1] + drift[1] * x)
        value = (
            v0 * (w0 * first[i] + w1 * first[i + 1] + w2 * first[i + 2] + w3 * first[i + 3])
            + v1 * (w0 * second[i] + w1 * second[i + 1] + w2 * second[i + 2] + w3 * second[i + 3])
            + v2 * (w0 * third[i] + w1 * third[i + 1] + w2 * third[i + 2] + w3 * third[i + 3])
            + v3 * (w0 * fourth[i] + w1 * fourth[i + 1] + w2 * fourth[i + 2] + w3 * fourth[i + 3])
        )
        line[i] = value - level if i < n else np.float32(0.0)


@njit(error_model="numpy", forceinline=True, fastmath=EXACT)
def _bilinear_run(image, k, rest, drift, level, n, patch, at):
    """As `_bicubic_run`, from 2 x 2 pixels."""
    flat, width = image.pixels, np.uint64(image.cols)
    wide = full_lanes(n, flat.size - int(k + width) - 1)
    length = np.uint64(wide + 1)
    above, below = flat[k : k + length], flat[k + width : k + width + length]
    line = patch[at : at + wide]
    for i in range(wide):
        x = np.float32(i)
        f, g = rest[0] + drift[0] * x, rest[1] + drift[1] * x
        top, bottom = above[i] + f * (above[i + 1] - above[i]), below[i] + f * (below[i + 1] - below[i])
        value = top + g * (bottom - top)
        line[i] = value - level if i < n else np.float32(0.0)


@njit(error_model="numpy", forceinline=True, fastmath=EXACT)
def warp_window(image, place, use_bicubic, reach, spans, patch):
    """Fill the block `patch` with the right image under a `WindowPlacement`; returns the grey value it counts from.

    image: the right one, a `FlatImage`. A row of the window is cut into runs whose pixels fall between neighbouring pixels of one
    row of the image.
    """
    flat, width = image.pixels, image.cols
    base_col, base_row, t, a = place
    # Integer and fractional part apart: float32 then holds the fraction to 1e-7 px whatever the column.
    whole_x, whole_y = int(np.floor(t[0])), int(np.floor(t[1]))
    rest_x, rest_y = t[0] - whole_x, t[1] - whole_y
    origin = (base_row + whole_y) * width + base_col + whole_x
    reach_x, reach_y = reach
    pitch = block_pitch(reach_x)
    drift = np.float32(a[0] - 1.0), np.float32(a[2])
    level = flat[np.uint64(origin)]
    for j in range(2 * reach_y + 1):
        first, last = spans[j]
        y = j - reach_y
        u, v = np.float32(rest_x + a[1] * y + (a[0] - 1.0) * first), np.float32(rest_y + a[3] * y + a[2] * first)
        x = first
        while x <= last:
            along = np.float32(x - first)
            p, q = u + drift[0] * along, v + drift[1] * along
            c, r = np.floor(p), np.floor(q)
            rest = p - c, q - r
            # Within a run the 4 x 4 neighbours move by one pixel per step: contiguous loads instead of gathers.
            count = min(_same_steps(rest[0], drift[0], last - x + 1), _same_steps(rest[1], drift[1], last - x + 1))
            k = np.uint64(origin + int(r) * width + int(c) + x)
            at = j * pitch + reach_x + x
            if use_bicubic:
                _bicubic_run(image, k, rest, drift, level, count, patch, at)
            else:
                _bilinear_run(image, k, rest, drift, level, count, patch, at)
            x += count
    return level


@njit(error_model="numpy", forceinline=True, fastmath=EXACT)
def dot(p, q):
    """Sum of p q."""
    total = np.float32(0.0)
    for i in range(p.size):
        total += p[i] * q[i]
    return total
