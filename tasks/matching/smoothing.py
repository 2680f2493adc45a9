"""Preparing grey images for matching: float32, NaN where there is no data, smoothed by a small Gaussian.

Strategy: the Gaussian is normalised by the weights of the valid pixels under it, so that missing data do not bleed into the image;
a pixel without data stays NaN. NaN then propagates through every sum of a window, and one test per window detects missing data.
The kernels are our own because a value must not depend on where in a tile its pixel lies.
Smoothing both images with sigma 0.8 px is the largest single gain of least-squares matching (sources/measured.md#windows).
"""

import numpy as np

from orthomill.kernels.kernel_compilation import njit
from orthomill.tasks.matching.gaussian_reach import reach_of


def gaussian_weights(sigma: float) -> np.ndarray:
    """(2 r + 1,) float32 weights of a Gaussian of `sigma` px that sum to 1, r = ceil(3 sigma)."""
    if sigma <= 0.0:
        return np.ones(1, dtype=np.float32)
    x = np.arange(-reach_of(sigma), reach_of(sigma) + 1)
    weights = np.exp(-0.5 * (x / sigma) ** 2)
    return (weights / weights.sum()).astype(np.float32)


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


@njit()
def _gaps_marked(grey):
    """The image with NaN for pixels without value."""
    out = np.empty(grey.shape, np.float32)
    for r in range(grey.shape[0]):
        for c in range(grey.shape[1]):
            value = grey[r, c]
            # Zero is the convention for pixels beyond a photograph (scans, resampled images).
            out[r, c] = value if value != 0.0 and abs(value) < np.inf else np.float32(np.nan)
    return out


@njit()
def _smooth(grey, weights):
    """Along the rows into a ring buffer of as many rows as there are weights, and from there along the columns."""
    rows, cols = grey.shape
    size = weights.size
    reach = size // 2
    # Values and weights are filtered alike; their quotient is the mean of the valid pixels.
    along, share = np.zeros((size, cols), np.float32), np.zeros((size, cols), np.float32)
    # Two rows with zeros at both ends: the loops over the columns need no test at the border and vectorise.
    values, valid = np.zeros(cols + 2 * reach, np.float32), np.zeros(cols + 2 * reach, np.float32)
    total, weight = np.empty(cols, np.float32), np.empty(cols, np.float32)
    out = np.empty((rows, cols), np.float32)
    for newest in range(rows + reach):
        if newest < rows:
            for c in range(cols):
                is_data = grey[newest, c] == grey[newest, c]
                values[c + reach] = grey[newest, c] if is_data else np.float32(0.0)
                valid[c + reach] = np.float32(1.0) if is_data else np.float32(0.0)
            here, part = along[newest % size], share[newest % size]
            here[:] = 0.0
            part[:] = 0.0
            for k in range(size):
                for c in range(cols):
                    here[c] += weights[k] * values[c + k]
                    part[c] += weights[k] * valid[c + k]
        r = newest - reach
        if r < 0:
            continue
        total[:] = 0.0
        weight[:] = 0.0
        # The order of the sum is that of the weights, whatever row of the ring comes first: tiles agree bit for bit.
        for k in range(size):
            source = r + k - reach
            if 0 <= source < rows:
                here, part = along[source % size], share[source % size]
                for c in range(cols):
                    total[c] += weights[k] * here[c]
                    weight[c] += weights[k] * part[c]
        for c in range(cols):
            out[r, c] = total[c] / weight[c] if grey[r, c] == grey[r, c] else np.float32(np.nan)
    return out
