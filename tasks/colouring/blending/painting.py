"""Blended colours as the pixels of a picture."""

import numpy as np

from orthomill.kernels.kernel_compilation import njit
from orthomill.tasks.colouring.blending.blending import Blended


def rgba(blended: Blended) -> np.ndarray:
    """uint8 (rows, cols, 4); transparent black where there is no colour."""
    out = np.zeros((*blended.used.shape, 4), np.uint8)
    _paint(blended.colour, blended.used, out)
    return out


@njit()
def _paint(colour, used, out):
    """Fills `out` (rows, cols, 4) from colours (rows, cols, bands) where values were `used` (rows, cols)."""
    bands = colour.shape[2]
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            if used[i, j]:
                for band in range(3):
                    # A grey orthoimage has three equal bands as well.
                    value = np.floor(colour[i, j, band if bands == 3 else 0] + np.float32(0.5))
                    out[i, j, band] = np.uint8(min(max(value, np.float32(0.0)), np.float32(255.0)))
                out[i, j, 3] = 255
