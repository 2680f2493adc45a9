"""Resampling at fractional pixels: at a list of them by cubic convolution (Keys 1981, a = -1/2), on a lattice bilinearly.

Points outside the pixel centres of the image give NaN, never an extrapolated value. Close to the border, where the kernel would
leave the image, the border pixels are repeated.
"""

import numpy as np

from orthomill.kernels.kernel_compilation import njit


@njit(inline="always")
def _keys(t):
    """Weight of a neighbour at the distance t, px (Keys 1981, a = -1/2)."""
    t = abs(t)
    if t < 1.0:
        return 1.0 + t * t * (1.5 * t - 2.5)
    if t < 2.0:
        return 2.0 + t * (-4.0 + t * (2.5 - 0.5 * t))
    return 0.0


@njit()
def _cubic(image, pixels, out):
    """Fills `out` (N, bands) with the values of `image` (rows, cols, bands) at pixels (N, 2) (col, row); NaN outside."""
    rows, cols, bands = image.shape
    for i in range(pixels.shape[0]):
        x, y = pixels[i, 0], pixels[i, 1]
        # Stated as "not inside", so that NaN coordinates give NaN as well.
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


def sample_cubic(image: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """Values of `image` (rows, cols) or (rows, cols, bands) at `pixels` (N, 2) (col, row): (N,) or (N, bands) float64.

    Source: Keys 1981, cubic convolution with a = -1/2; reproduces polynomials of the second degree.
    """
    bands = image[:, :, None] if image.ndim == 2 else image
    out = np.empty((len(pixels), bands.shape[2]))
    _cubic(bands, np.ascontiguousarray(pixels, dtype=np.float64), out)
    return out[:, 0] if image.ndim == 2 else out


def between(values: np.ndarray, rows: np.ndarray, cols: np.ndarray) -> np.ndarray:
    """Bilinear interpolation of `values` at the fractional `rows` (R,) and `cols` (C,) within it: (R, C) float32.

    Where one of the four values around is NaN, the nearest one.
    """
    i, j = (np.minimum(at.astype(int), max(size - 2, 0)) for at, size in ((rows, values.shape[0]), (cols, values.shape[1])))
    below, right = np.minimum(i + 1, values.shape[0] - 1), np.minimum(j + 1, values.shape[1] - 1)
    s, t = (rows - i)[:, None], (cols - j)[None, :]
    upper = values[np.ix_(i, j)] * (1 - t) + values[np.ix_(i, right)] * t
    lower = values[np.ix_(below, j)] * (1 - t) + values[np.ix_(below, right)] * t
    nearest = values[np.ix_(np.rint(rows).astype(int), np.rint(cols).astype(int))]
    smooth = upper * (1 - s) + lower * s
    return np.where(np.isfinite(smooth), smooth, nearest).astype(np.float32)
