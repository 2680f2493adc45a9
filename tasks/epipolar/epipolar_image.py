"""One tile of an epipolar image, resampled from the window of a photograph's pyramid level that it shows.

Strategy. Every epipolar pixel is rotated into the system of the photograph, projected there, distorted, and interpolated in the
grey values: a single resampling leads from the file to the normal case and removes the distortion on the way. A pixel depends only
on its own coordinates, so any tiling gives the same image.

Source: Karfis 2009, section 5.2 (sources/epipolar.md#epipolar-images, inverse mapping).
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from orthomill.kernels.kernel_compilation import njit
from orthomill.schemas.camera import Camera
from orthomill.schemas.epipolar import EpipolarPair, GreyRange
from orthomill.schemas.orientation import ExteriorOrientation
from orthomill.schemas.raster import Window
from orthomill.tasks.geometry.distortion import distort_point
from orthomill.tasks.geometry.normal_case import EpipolarView, Side, epipolar_view
from orthomill.tasks.geometry.photograph_part import level_window
from orthomill.tasks.geometry.view import view_of
from orthomill.tasks.imagery.bicubic import bicubic_at, bilinear_at
from orthomill.tasks.imagery.pyramid import level_shape
from orthomill.tasks.imagery.radiometry import grey, grey_range

EIGHT_BITS = GreyRange()
_MARGIN = 4
"""pixels of the level around what a tile shows, for the interpolation"""


@dataclass(frozen=True)
class TileOfPair:
    """A tile of one image of a pair."""

    pair: EpipolarPair
    side: Side
    orientation: ExteriorOrientation
    camera: Camera
    window: Window
    """of the epipolar image"""

    @property
    def view(self) -> EpipolarView:
        """The geometry of the epipolar image that the tile is part of."""
        return epipolar_view(self.pair, self.side, view_of(self.orientation, self.camera))

    @property
    def source(self) -> Window:
        """The window that the tile shows of the photograph's level."""
        level, frame = self.pair.level, (self.camera.height, self.camera.width)
        return level_window(self.view.photo_window(self.window, _MARGIN * 2**level), level, level_shape(frame, level))


class _Source(NamedTuple):
    """The photograph for the kernel: its last row and column, the pixels that one of its level stands for along a side, first row
    and column of the window read, and the stretch."""

    bottom: float
    right: float
    reduction: float
    shift: float
    """the pixels of a level lie in the middle of those that they stand for, see `full_to_level`"""
    row: int
    col: int
    low: float
    gain: float


def photograph_range(overview: np.ndarray) -> GreyRange:
    """The stretch of a photograph from its coarsest pyramid level (rows, cols, bands)."""
    # One stretch per photograph: tiles stretched by themselves would meet in visible steps that matching takes for texture.
    low, high = grey_range(overview)
    return GreyRange(low=low, high=high)


def resample_tile(
    tile: TileOfPair, photo_window: Window, bicubic: bool, pixels: np.ndarray | None = None, stretch: GreyRange = EIGHT_BITS
) -> np.ndarray:
    """Grey epipolar tile, uint8 (tile.window.shape): 1 to 255, 0 outside the photograph and where it is masked.

    pixels: (rows, cols, bands) uint8 or uint16, the window `photo_window` of the photograph's level; None where the tile does not
    overlap it. stretch: the grey values that become 0 and 255.
    """
    out = np.zeros(tile.window.shape, np.uint8)
    if pixels is not None:
        frame = _Source(
            bottom=tile.camera.height - 1.0,
            right=tile.camera.width - 1.0,
            reduction=2.0**tile.pair.level,
            shift=0.5 - 0.5 / 2**tile.pair.level,
            row=photo_window.row,
            col=photo_window.col,
            low=stretch.low,
            gain=255.0 / (stretch.high - stretch.low),
        )
        _resample(grey(pixels), frame, tile.view.numbers, (tile.window.row, tile.window.col), bicubic, out)
    return out


@njit()
def _resample(image, source, n, origin, bicubic, out):
    """`n` is `EpipolarView.numbers`; `origin` holds row and column of the first pixel of `out` in the epipolar image."""
    for i in range(out.shape[0]):
        y = n.row0 - (origin[0] + i)
        for j in range(out.shape[1]):
            x = origin[1] + j - n.col0
            u = n.t11 * x + n.t12 * y - n.t13 * n.c
            v = n.t21 * x + n.t22 * y - n.t23 * n.c
            w = n.t31 * x + n.t32 * y - n.t33 * n.c
            # a ray away from the camera would come out mirrored through the projection centre
            if w >= 0.0:
                continue
            xd, yd = distort_point(-u / w, -v / w, n.lens)
            col, row = n.photo_col0 + n.photo_c * xd, n.photo_row0 - n.photo_c * yd
            # the frame of the photograph, not of the window read: outside, the distortion polynomial is extrapolated and may
            # fold pixels back into the image
            if not (0.0 <= col <= source.right and 0.0 <= row <= source.bottom):
                continue
            col, row = col / source.reduction - source.shift, row / source.reduction - source.shift
            if bicubic:
                value = bicubic_at(image, row - source.row, col - source.col)
            else:
                value = bilinear_at(image, row - source.row, col - source.col)
            # a place whose neighbours are masked
            if value != value:
                continue
            # from 1 on: 0 means outside the photograph, and black roofs must not become holes for the matching
            out[i, j] = np.uint8(min(max((value - source.low) * source.gain + 0.5, 1.0), 255.0))
