"""Grey values between pixels, for the kernels of matching: image (H, W) float32, pixel centres at integers, NaN without data.

Strategy
- Nothing is clamped: the caller has made sure that the neighbouring pixels exist, and NaN propagates.
- Images are flat with unsigned indices, so that the inner loops need no test for negative ones.
- Coordinates are float32 and relative to an integer pixel near by: exact to 1e-5 px, and the same in every tile.

Source: Keys 1981 (cubic convolution, a = -1/2).
"""

from typing import NamedTuple

import numpy as np

from orthomill.kernels.kernel_compilation import njit

EXACT = {"reassoc", "contract", "nsz", "arcp"}
"""Sums may be reordered; NaN keeps its meaning.

A kernel with these flags, and every kernel that calls one, must be `forceinline`: otherwise a process that has just compiled it and
one that loads it from the cache may call two differently optimised copies, whose sums differ in the last bit.
"""


class FlatImage(NamedTuple):
    """A grey image (rows, cols), row by row in one dimension."""

    pixels: np.ndarray
    """(rows * cols,) float32"""
    rows: int
    cols: int


@njit(error_model="numpy", inline="always")
def nearest_pixel(x):
    """Halves always round up: rounding them to even would make a point depend on where its tile begins."""
    return int(np.floor(x + 0.5))


@njit(error_model="numpy", inline="always")
def on_lattice(x):
    """Rounded to 2^-32 px, so that adding any column or row of an image is exact: a tile returns the very number of the whole."""
    return np.floor(x * 4294967296.0 + 0.5) / 4294967296.0


@njit(error_model="numpy", inline="always")
def cubic_weights(f):
    """Weights of the pixels at -1, 0, 1, 2 for a position f in [0, 1)."""
    g = np.float32(1.0) - f
    half = np.float32(0.5)
    return (
        -half * f * g * g,
        np.float32(1.0) + f * f * (np.float32(1.5) * f - np.float32(2.5)),
        np.float32(1.0) + g * g * (np.float32(1.5) * g - np.float32(2.5)),
        -half * g * f * f,
    )


@njit(error_model="numpy", inline="always")
def bilinear(flat, width, k, f, g):
    """The value at (f, g) in [0, 1)^2 right of and below pixel k (uint64) of an image with `width` (uint64) columns."""
    one = np.uint64(1)
    top = flat[k] + f * (flat[k + one] - flat[k])
    bottom = flat[k + width] + f * (flat[k + width + one] - flat[k + width])
    return top + g * (bottom - top)


@njit(error_model="numpy", inline="always")
def bicubic(flat, width, k, f, g):
    """As `bilinear`, from 4 x 4 pixels; may overshoot their range."""
    one, two = np.uint64(1), np.uint64(2)
    w0, w1, w2, w3 = cubic_weights(f)
    v0, v1, v2, v3 = cubic_weights(g)
    a, b, c = k - width, k + width, k + width + width
    return (
        v0 * (w0 * flat[a - one] + w1 * flat[a] + w2 * flat[a + one] + w3 * flat[a + two])
        + v1 * (w0 * flat[k - one] + w1 * flat[k] + w2 * flat[k + one] + w3 * flat[k + two])
        + v2 * (w0 * flat[b - one] + w1 * flat[b] + w2 * flat[b + one] + w3 * flat[b + two])
        + v3 * (w0 * flat[c - one] + w1 * flat[c] + w2 * flat[c + one] + w3 * flat[c + two])
    )


@njit(error_model="numpy", inline="always")
def leaves(shape, centre_x, centre_y, reach_x, reach_y):
    """Whether a window about (centre_x, centre_y), with the pixels that interpolation needs, leaves an image of that shape."""
    # Stated as "not inside", so that NaN counts as outside; 0.001 px cover the rounding of coordinates to float32.
    inside = (
        centre_x - reach_x >= 1.001
        and centre_x + reach_x < shape[1] - 2.001
        and centre_y - reach_y >= 1.001
        and centre_y + reach_y < shape[0] - 2.001
    )
    return not inside
