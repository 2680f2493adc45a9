"""Preparing grey images for matching: float32, NaN where there is no data, smoothed by a small Gaussian.

Strategy: the Gaussian is normalised by the weights of the valid pixels under it, so that no-data never bleeds into an image; a
pixel without data stays NaN. NaN then runs through every sum of a window, and one test per window tells that it touched no data.
The kernels are our own because a value must not depend on where in a tile its pixel lies.
Smoothing both images with sigma 0.8 px is the largest single gain of least-squares matching (methods/measured.md).
"""

import numpy as np
from numba import njit


def gaussian_weights(sigma: float) -> np.ndarray:
    """(2 r + 1,) float32 weights of a Gaussian of `sigma` px that sum to 1, r = ceil(3 sigma)."""
    if sigma <= 0.0:
        return np.ones(1, dtype=np.float32)
    x = np.arange(-reach_of(sigma), reach_of(sigma) + 1)
    weights = np.exp(-0.5 * (x / sigma) ** 2)
    return (weights / weights.sum()).astype(np.float32)


def reach_of(sigma: float) -> int:
    """How many pixels away the smoothing of `gaussian_weights` looks."""
    return int(np.ceil(3.0 * sigma)) if sigma > 0.0 else 0


def with_gaps(image: np.ndarray, mask: np.ndarray | None = None) -> np.ndarray:
    """(H, W) float32 copy of a grey image of any dtype, NaN where it is 0 or not finite, or where `mask` (bool) is False."""
    grey = np.ascontiguousarray(image, dtype=np.float32)
    gapped = _gaps_marked(grey)
    if mask is not None:
        gapped[~np.asarray(mask, dtype=bool)] = np.nan
    return gapped


def smoothed(grey: np.ndarray, sigma: float) -> np.ndarray:
    """(H, W) float32 smoothed by a Gaussian of `sigma` px; NaN stays NaN and does not spread. Beyond the border is no data."""
    if sigma <= 0.0 or grey.size == 0:
        return grey
    return _smooth(grey, gaussian_weights(sigma))


@njit(cache=True)
def _gaps_marked(grey):
    out = np.empty(grey.shape, np.float32)
    for r in range(grey.shape[0]):
        for c in range(grey.shape[1]):
            value = grey[r, c]
            out[r, c] = value if value != 0.0 and abs(value) < np.inf else np.float32(np.nan)
    return out


@njit(cache=True)
def _smooth(grey, weights):
    rows, cols = grey.shape
    reach = weights.size // 2
    along, share = np.zeros((rows, cols), np.float32), np.zeros((rows, cols), np.float32)
    values, valid = np.zeros(cols + 2 * reach, np.float32), np.zeros(cols + 2 * reach, np.float32)
    for r in range(rows):
        for c in range(cols):
            is_data = grey[r, c] == grey[r, c]
            values[c + reach] = grey[r, c] if is_data else np.float32(0.0)
            valid[c + reach] = np.float32(1.0) if is_data else np.float32(0.0)
        for k in range(weights.size):
            for c in range(cols):
                along[r, c] += weights[k] * values[c + k]
                share[r, c] += weights[k] * valid[c + k]
    out = np.empty((rows, cols), np.float32)
    total, weight = np.empty(cols, np.float32), np.empty(cols, np.float32)
    for r in range(rows):
        total[:] = 0.0
        weight[:] = 0.0
        for k in range(weights.size):
            source = r + k - reach
            if 0 <= source < rows:
                for c in range(cols):
                    total[c] += weights[k] * along[source, c]
                    weight[c] += weights[k] * share[source, c]
        for c in range(cols):
            out[r, c] = total[c] / weight[c] if grey[r, c] == grey[r, c] else np.float32(np.nan)
    return out
