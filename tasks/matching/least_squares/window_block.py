"""The block of a window, and the sums over it that least-squares matching needs.

Strategy
- A window is a block of padded rows, zero outside of its shape, so that every sum is one run over contiguous float32, and
  neighbours in any direction are at a constant distance. Grey values are counted from that of the centre: sums stay small.
- Moments: derivatives by the affine are gx and gy times 1, x and y, so all their products are sums of gx gx, gx gy, gy gy times
  powers of x and y. No image of a derivative is ever stored.
"""

import numpy as np
from numba import njit

from tasks.matching.least_squares.resampling import EXACT, bicubic, bilinear

PAD = 2
"""Zeros between the rows of a block, at least: the correlation of residuals reaches that far."""


@njit(cache=True, error_model="numpy", inline="always")
def block_pitch(reach):
    """Distance of the rows of a block: room for the window and the padding, and a multiple of what processors add at once."""
    return (2 * reach + 1 + PAD + 7) // 8 * 8


@njit(cache=True, error_model="numpy")
def block_coordinates(reach_x, reach_y, xs, ys):
    """Column and row of every pixel of a block, from its centre."""
    pitch = block_pitch(reach_x)
    for j in range(2 * reach_y + 1):
        for i in range(pitch):
            xs[j * pitch + i] = i - reach_x
            ys[j * pitch + i] = j - reach_y


@njit(cache=True, error_model="numpy", forceinline=True, fastmath=EXACT)
def cut_window(image, col, row, reach, spans, block):
    """Fill a block with the left window about (col, row) and its gradients; returns the grey value it counts from."""
    grey, gx, gy, inside = block
    reach_x, reach_y = reach
    pitch = block_pitch(reach_x)
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


@njit(cache=True, error_model="numpy", forceinline=True, fastmath=EXACT)
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


@njit(cache=True, error_model="numpy", forceinline=True, fastmath=EXACT)
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


@njit(cache=True, error_model="numpy", forceinline=True, fastmath=EXACT)
def grey_sums(p, q):
    """Sums of p, p p and p q."""
    s = pp = pq = np.float32(0.0)
    for i in range(p.size):
        s += p[i]
        pp += p[i] * p[i]
        pq += p[i] * q[i]
    return s, pp, pq


@njit(cache=True, error_model="numpy", forceinline=True, fastmath=EXACT)
def warp_window(flat, width, base, t, a, use_bicubic, reach, spans, patch):
    """Fill the block `patch` with the right image at base + t + A (x, y); returns the grey value it counts from.

    flat, width: the right image; base: the whole pixel (col, row) that t (px) is counted from.
    """
    whole_x, whole_y = int(np.floor(t[0])), int(np.floor(t[1]))
    rest_x, rest_y = t[0] - whole_x, t[1] - whole_y
    origin = (base[1] + whole_y) * width + base[0] + whole_x
    reach_x, reach_y = reach
    pitch = block_pitch(reach_x)
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
