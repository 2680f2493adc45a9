"""One tile of an epipolar image from the window of the photograph that it shows.

Strategy. Every epipolar pixel is turned into the system of the photograph, projected there, distorted and looked up in the grey
values: one resampling from the file to the normal case, with the distortion on the way. A pixel depends on nothing but its own
coordinates, so any tiling gives the same image.

Source: Karfis 2009, section 5.2 (methods/relative_orientation_and_epipolar.md, 1.10, inverse mapping).
"""

from dataclasses import dataclass

import numpy as np
from numba import njit

from orthomill.schemas.camera import Camera
from orthomill.schemas.epipolar import EpipolarPair, GreyRange
from orthomill.schemas.orientation import ExteriorOrientation
from orthomill.schemas.raster import Window
from orthomill.tasks.geometry.distortion import distort_point
from orthomill.tasks.geometry.normal_case import EpipolarView, Side, epipolar_view
from orthomill.tasks.geometry.view import view_of
from orthomill.tasks.imagery.bicubic import bicubic_at, bilinear_at
from orthomill.tasks.imagery.radiometry import grey, grey_range

EIGHT_BITS = GreyRange()


@dataclass(frozen=True)
class TileOfPair:
    """Which tile of which image of a pair."""

    pair: EpipolarPair
    side: Side
    orientation: ExteriorOrientation
    camera: Camera
    window: Window
    """of the epipolar image"""

    @property
    def view(self) -> EpipolarView:
        return epipolar_view(self.pair, self.side, view_of(self.orientation, self.camera))


def photograph_range(overview: np.ndarray) -> GreyRange:
    """The stretch of a photograph from its coarsest level (rows, cols, bands)."""
    low, high = grey_range(overview)
    return GreyRange(low=low, high=high)


def resample_tile(
    tile: TileOfPair, photo_window: Window, bicubic: bool, pixels: np.ndarray | None = None, stretch: GreyRange = EIGHT_BITS
) -> np.ndarray:
    """Grey epipolar tile, uint8 (tile.window.shape): 1 to 255, 0 outside the photograph.

    pixels: (rows, cols, bands) uint8 or uint16, the window `photo_window` of the photograph; None where the tile does not meet it.
    stretch: the grey values that become 0 and 255.
    """
    out = np.zeros(tile.window.shape, np.uint8)
    if pixels is not None:
        frame = np.array([tile.camera.height, tile.camera.width, photo_window.row, photo_window.col])
        scale = np.array([stretch.low, 255.0 / (stretch.high - stretch.low)])
        _resample(grey(pixels), scale, tile.view.numbers, frame, (tile.window.row, tile.window.col), bicubic, out)
    return out


@njit(cache=True)
def _resample(image, scale, n, frame, origin, bicubic, out):
    """`n` is `EpipolarView.numbers`; `frame` holds height and width of the photograph and row and column of the window."""
    bottom, right = frame[0] - 1.0, frame[1] - 1.0
    for i in range(out.shape[0]):
        y = n[11] - (origin[0] + i)
        for j in range(out.shape[1]):
            x = origin[1] + j - n[10]
            u = n[0] * x + n[1] * y - n[2] * n[9]
            v = n[3] * x + n[4] * y - n[5] * n[9]
            w = n[6] * x + n[7] * y - n[8] * n[9]
            if w >= 0.0:
                continue
            xd, yd = distort_point(-u / w, -v / w, n[15], n[16], n[17], n[18], n[19])
            col, row = n[13] + n[12] * xd, n[14] - n[12] * yd
            if not (0.0 <= col <= right and 0.0 <= row <= bottom):
                continue
            if bicubic:
                value = bicubic_at(image, row - frame[2], col - frame[3])
            else:
                value = bilinear_at(image, row - frame[2], col - frame[3])
            out[i, j] = np.uint8(min(max((value - scale[0]) * scale[1] + 0.5, 1.0), 255.0))
