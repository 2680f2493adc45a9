"""Precision of a matched shift when neighbouring residuals are correlated.

Strategy. Smoothing correlates the residuals of neighbouring pixels; ignoring that makes standard errors two to three times too
small. The cofactors of the shift are a' C a, with a the influence of the residuals on it and C their correlation: that of white
noise after the Gaussian, truncated at two pixels and separable, so that C a is one short sum along rows and one down columns.
"""

import numpy as np

from orthomill.kernels.kernel_compilation import njit
from orthomill.tasks.matching.least_squares.grey_values import EXACT


@njit(error_model="numpy")
def residual_correlation(smoothing):
    """Correlation of residuals one and two pixels apart in images smoothed by a Gaussian of `smoothing` px.

    Never less than that of 0.3 px, which is what optics and resampling leave.
    """
    # White noise after a Gaussian of sigma has the autocorrelation exp(-d^2 / (4 sigma^2)) at a distance of d.
    sigma = max(smoothing, 0.3)
    return np.float32(np.exp(-1.0 / (4.0 * sigma * sigma))), np.float32(np.exp(-1.0 / (sigma * sigma)))


@njit(error_model="numpy", forceinline=True, fastmath=EXACT)
def influence(block, pad, xs, ys, weights, grey_share, offset, out):
    """Influence of the residuals on one unknown: the derivatives times `weights` (6,), orthogonal to gain and offset, zero outside.

    block: `WindowBlock`. pad: zeros before and after the block in `out`.
    """
    grey, gx, gy, inside = block
    w0, w1, w2 = np.float32(weights[0]), np.float32(weights[1]), np.float32(weights[2])
    w3, w4, w5 = np.float32(weights[3]), np.float32(weights[4]), np.float32(weights[5])
    share, constant = np.float32(grey_share), np.float32(offset)
    body = out[pad : pad + grey.size]
    out[:pad] = np.float32(0.0)
    out[pad + grey.size :] = np.float32(0.0)
    for i in range(grey.size):
        slope = gx[i] * (w0 + w1 * xs[i] + w2 * ys[i]) + gy[i] * (w3 + w4 * xs[i] + w5 * ys[i])
        body[i] = slope - inside[i] * (share * grey[i] + constant)


@njit(error_model="numpy", forceinline=True, fastmath=EXACT)
def correlated_products(influence, other, pitch, near, far, along):
    """a' C a and b' C a of influences a and b (`other`), C separable: 1, `near`, `far` at distances of 0, 1, 2 px.

    All arrays have 2 `pitch` zeros at both ends; `along` is scratch.
    """
    n = influence.size
    # Views at distances of 1 and 2 px along the row; rows are padded by two zeros, so that none reaches the next row.
    m1, p1, m2, p2 = influence[1 : n - 3], influence[3 : n - 1], influence[0 : n - 4], influence[4:n]
    centre, body = influence[2 : n - 2], along[2 : n - 2]
    for i in range(n - 4):
        body[i] = centre[i] + near * (m1[i] + p1[i]) + far * (m2[i] + p2[i])
    size = n - 4 * pitch
    # The same along columns: one row is `pitch` floats away.
    u2, u1, c0 = along[0:size], along[pitch : pitch + size], along[2 * pitch : 2 * pitch + size]
    d1, d2 = along[3 * pitch : 3 * pitch + size], along[4 * pitch : 4 * pitch + size]
    a, b = influence[2 * pitch : 2 * pitch + size], other[2 * pitch : 2 * pitch + size]
    own = cross = np.float32(0.0)
    for i in range(size):
        total = c0[i] + near * (u1[i] + d1[i]) + far * (u2[i] + d2[i])
        own += a[i] * total
        cross += b[i] * total
    return own, cross
