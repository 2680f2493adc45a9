"""Blended colours as the pixels of a picture."""

import numpy as np

from orthomill.kernels.kernel_compilation import njit
from orthomill.tasks.colouring.blending.blending import Blended


def rgba(blended: Blended, bits: int = 8) -> np.ndarray:
    """uint8, or uint16 of 16 `bits`, (rows, cols, 4); transparent black where there is no colour."""
    out = np.zeros((*blended.used.shape, 4), np.uint8 if bits == 8 else np.uint16)
    # Times 257, 255 becomes 65535.
    _paint(blended.colour, blended.used, np.float32(1.0 if bits == 8 else 257.0), np.float32(2**bits - 1), out)
    return out


@njit()
def _paint(colour, used, steps, white, out):
    """Fills `out` (rows, cols, 4), whose full range is `white`, from colours (rows, cols, bands) of 0 to 255, in `steps` of a grey
    level, where values were `used` (rows, cols)."""
    bands = colour.shape[2]
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            if used[i, j]:
                for band in range(3):
                    # A grey orthoimage has three equal bands as well.
                    value = np.floor(colour[i, j, band if bands == 3 else 0] * steps + np.float32(0.5))
                    out[i, j, band] = int(min(max(value, np.float32(0.0)), white))
                out[i, j, 3] = int(white)
