"""Resampling at fractional pixels: bilinear and cubic (Keys 1981, a = -1/2) kernels.

Points outside the pixel centres of the image give NaN, never an invented value. Close to the border, where the cubic kernel
would leave the image, the border pixels are repeated.
"""

import numpy as np
from numba import njit


@njit(cache=True)
def _bilinear(image, pixels, out):
    rows, cols, bands = image.shape
    for i in range(pixels.shape[0]):
        x, y = pixels[i, 0], pixels[i, 1]
        if not (0.0 <= x <= cols - 1.0 and 0.0 <= y <= rows - 1.0):
            out[i] = np.nan
            continue
        col, row = min(int(x), max(cols - 2, 0)), min(int(y), max(rows - 2, 0))
        right, below = min(col + 1, cols - 1), min(row + 1, rows - 1)
        u, v = x - col, y - row
        for band in range(bands):
            upper = (1.0 - u) * image[row, col, band] + u * image[row, right, band]
            lower = (1.0 - u) * image[below, col, band] + u * image[below, right, band]
            out[i, band] = (1.0 - v) * upper + v * lower


@njit(cache=True, inline="always")
def _keys(t):
    t = abs(t)
    if t < 1.0:
        return 1.0 + t * t * (1.5 * t - 2.5)
    if t < 2.0:
        return 2.0 + t * (-4.0 + t * (2.5 - 0.5 * t))
    return 0.0


@njit(cache=True)
def _cubic(image, pixels, out):
    rows, cols, bands = image.shape
    for i in range(pixels.shape[0]):
        x, y = pixels[i, 0], pixels[i, 1]
        if not (0.0 <= x <= cols - 1.0 and 0.0 <= y <= rows - 1.0):
            out[i] = np.nan
            continue
        col, row = int(np.floor(x)), int(np.floor(y))
        for band in range(bands):
            total = 0.0
            for m in range(-1, 3):
                weight = _keys(y - row - m)
                at_row = min(max(row + m, 0), rows - 1)
                for n in range(-1, 3):
                    at_col = min(max(col + n, 0), cols - 1)
                    total += weight * _keys(x - col - n) * image[at_row, at_col, band]
            out[i, band] = total


def sample_bilinear(image: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """Values of `image` (rows, cols) or (rows, cols, bands) at `pixels` (N, 2) (col, row): (N,) or (N, bands) float64."""
    return _sample(_bilinear, image, pixels)


def sample_cubic(image: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """Values of `image` (rows, cols) or (rows, cols, bands) at `pixels` (N, 2) (col, row): (N,) or (N, bands) float64.

    Source: Keys 1981, cubic convolution with a = -1/2; reproduces polynomials of the second degree.
    """
    return _sample(_cubic, image, pixels)


def _sample(kernel, image: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    bands = image[:, :, None] if image.ndim == 2 else image
    out = np.empty((len(pixels), bands.shape[2]))
    kernel(bands, np.ascontiguousarray(pixels, dtype=np.float64), out)
    return out[:, 0] if image.ndim == 2 else out
