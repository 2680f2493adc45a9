"""One grey value between pixels, for kernels that compute their own coordinates.

Strategy. A resampling kernel computes where each of its pixels lies in the source and calls `bicubic_at` or `bilinear_at` there, so
that no coordinate maps are held in memory. Pixel centres are at integers, and the border pixels of the array are repeated: callers
pass windows with two pixels to spare, so that this happens at the true border of a photograph only.

Source: Keys, "Cubic convolution interpolation for digital image processing", IEEE Trans. ASSP 29 (1981), with a = -1/2.
"""

import numpy as np

from orthomill.kernels.kernel_compilation import njit


@njit(inline="always")
def _clamped(i, n):
    """The nearest to i of the places 0 to n - 1."""
    return min(max(i, 0), n - 1)


@njit(inline="always")
def bilinear_at(image, row, col):
    """The value of `image` (rows, cols) at a fractional place."""
    r0, c0 = int(np.floor(row)), int(np.floor(col))
    fr, fc = row - r0, col - c0
    ra, rb = _clamped(r0, image.shape[0]), _clamped(r0 + 1, image.shape[0])
    ca, cb = _clamped(c0, image.shape[1]), _clamped(c0 + 1, image.shape[1])
    top = image[ra, ca] + fc * (image[ra, cb] - image[ra, ca])
    bottom = image[rb, ca] + fc * (image[rb, cb] - image[rb, ca])
    return top + fr * (bottom - top)


@njit(inline="always")
def bicubic_at(image, row, col):
    """The value of `image` (rows, cols) at a fractional place, from 4 x 4 pixels; may overshoot the pixels' range."""
    r0, c0 = int(np.floor(row)), int(np.floor(col))
    t, u = row - r0, col - c0
    # The kernel of Keys with a = -1/2, multiplied out for the pixels at -1, 0, 1 and 2.
    w0 = ((-0.5 * u + 1.0) * u - 0.5) * u
    w1 = (1.5 * u - 2.5) * u * u + 1.0
    w2 = ((-1.5 * u + 2.0) * u + 0.5) * u
    w3 = (0.5 * u - 0.5) * u * u
    a, b, c, d = c0 - 1, c0, c0 + 1, c0 + 2
    # Columns are clamped only where it is needed: the branch is cheaper than four clamps for every pixel.
    if a < 0 or d >= image.shape[1]:
        a, b = _clamped(a, image.shape[1]), _clamped(b, image.shape[1])
        c, d = _clamped(c, image.shape[1]), _clamped(d, image.shape[1])
    # Row by row in float64 in a fixed order, so that a tile gives bit for bit what the whole image gives.
    value = 0.0
    for k in range(4):
        if k == 0:
            wr = ((-0.5 * t + 1.0) * t - 0.5) * t
        elif k == 1:
            wr = (1.5 * t - 2.5) * t * t + 1.0
        elif k == 2:
            wr = ((-1.5 * t + 2.0) * t + 0.5) * t
        else:
            wr = (0.5 * t - 0.5) * t * t
        r = _clamped(r0 - 1 + k, image.shape[0])
        value += wr * (w0 * image[r, a] + w1 * image[r, b] + w2 * image[r, c] + w3 * image[r, d])
    return value
