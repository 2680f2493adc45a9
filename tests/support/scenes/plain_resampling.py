"""Interpolation written with plain NumPy: the twin that resampling kernels are compared with."""

import numpy as np


def sample_bilinear(image: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """Values of `image` (rows, cols) at `pixels` (N, 2) (col, row): (N,) float64, NaN outside the pixel centres."""
    last = np.array(image.shape[::-1]) - 1
    inside = ((pixels >= 0) & (pixels <= last)).all(axis=1)
    col, row = np.where(inside[:, None], pixels, 0.0).T
    c, r = (np.minimum(np.floor(place).astype(int), top) for place, top in ((col, last[0] - 1), (row, last[1] - 1)))
    u, v = col - c, row - r
    grey = image.astype(np.float64)
    upper = (1 - u) * grey[r, c] + u * grey[r, c + 1]
    lower = (1 - u) * grey[r + 1, c] + u * grey[r + 1, c + 1]
    return np.where(inside, (1 - v) * upper + v * lower, np.nan)


def keys_weight(t: np.ndarray) -> np.ndarray:
    """The cubic convolution kernel with a = -1/2 (Keys 1981) at distances t."""
    t = np.abs(t)
    inner, outer = 1.5 * t**3 - 2.5 * t**2 + 1.0, -0.5 * t**3 + 2.5 * t**2 - 4.0 * t + 2.0
    return np.where(t < 1, inner, np.where(t < 2, outer, 0.0))


def sample_keys(image: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """Values of `image` (rows, cols) at `pixels` (N, 2) (col, row) by cubic convolution, border pixels repeated."""
    grey = np.pad(image.astype(np.float64), 2, mode="edge")
    rows, cols = np.arange(-2, image.shape[0] + 2), np.arange(-2, image.shape[1] + 2)
    return np.array([keys_weight(rows - row) @ grey @ keys_weight(cols - col) for col, row in pixels])
