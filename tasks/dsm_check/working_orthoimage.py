"""One tile of an orthoimage of one photograph, from the surface model under test.

Strategy. Every pixel takes its height from the model (bilinear between cell centres), is projected into the photograph and
interpolated there. Occlusions are not removed: where the model is wrong, or where an object stands in front, the image shows it,
and that is what the check compares. Where the model has no height the orthoimage has no data (0).

Source: Skarlatos (sources/surface_check.md#step-1).
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from orthomill.kernels.kernel_compilation import njit
from orthomill.schemas.camera import Camera
from orthomill.schemas.epipolar import GreyRange
from orthomill.schemas.orientation import ExteriorOrientation
from orthomill.schemas.raster import MapGrid, Window
from orthomill.tasks.geometry.view import project_point, view_of
from orthomill.tasks.imagery.bicubic import bicubic_at
from orthomill.tasks.imagery.radiometry import grey

EIGHT_BITS = GreyRange()


@dataclass(frozen=True)
class WorkingTile:
    """A tile of an orthoimage. Windows lie on the grid of the surface model."""

    orientation: ExteriorOrientation
    camera: Camera
    grid: MapGrid
    """of the surface model"""
    window: Window
    """the cells of this tile"""
    heights: Window
    """the cells whose heights are given: the window and its neighbouring cells"""
    pixels_per_cell: int
    photo: Window
    """the window of the photograph, at its pyramid level"""
    level: int = 0


def ortho_tile(
    tile: WorkingTile, heights: np.ndarray, pixels: np.ndarray | None = None, stretch: GreyRange = EIGHT_BITS
) -> np.ndarray:
    """Grey orthoimage of a tile, uint8 (window.height * pixels_per_cell, ...): 1 to 255, 0 without height or photograph.

    heights: (tile.heights.shape) m, NaN where there is none. pixels: (rows, cols, bands), the window `tile.photo`; None where the
    photograph does not show the tile.
    """
    # 0 is no data, so tiles that the photograph does not show need nothing but this
    factor = tile.pixels_per_cell
    out = np.zeros((tile.window.height * factor, tile.window.width * factor), np.uint8)
    if pixels is not None:
        view = view_of(tile.orientation, tile.camera).numbers
        scale = _Stretch(stretch.low, 255.0 / (stretch.high - stretch.low))
        _resample(heights.astype(np.float32), grey(pixels), scale, view, _frame(tile), out)
    return out


class _Stretch(NamedTuple):
    """grey value of the orthoimage = (value - low) * gain"""

    low: float
    gain: float


class _TileFrame(NamedTuple):
    """First row and column of the tile and of its heights in the surface, and of the pixels in the photograph; pixels along a cell;
    upper left corner and cell of the surface's grid, m; pixels of the photograph along one of its pyramid level."""

    row: int
    col: int
    heights_row: int
    heights_col: int
    photo_row: int
    photo_col: int
    factor: int
    west: float
    north: float
    cell: float
    shrunk: float


def _frame(tile: WorkingTile) -> _TileFrame:
    own, given, photo, grid = tile.window, tile.heights, tile.photo, tile.grid
    first = own.row, own.col, given.row, given.col, photo.row, photo.col
    return _TileFrame(*first, tile.pixels_per_cell, grid.west, grid.north, grid.cell, float(2**tile.level))


@njit(inline="always")
def height_at(heights, row, col):
    """Height between cell centres, bilinear; NaN where a contributing cell has none, or outside."""
    # A neighbour of weight zero does not contribute: on a cell centre beside a gap the height is known.
    r, c = int(np.floor(row)), int(np.floor(col))
    fr, fc = row - r, col - c
    r1, c1 = (r + 1 if fr > 0.0 else r), (c + 1 if fc > 0.0 else c)
    if r < 0 or c < 0 or r1 >= heights.shape[0] or c1 >= heights.shape[1]:
        return np.nan
    top = (1.0 - fc) * heights[r, c] + fc * heights[r, c1]
    bottom = (1.0 - fc) * heights[r1, c] + fc * heights[r1, c1]
    return (1.0 - fr) * top + fr * bottom


@njit()
def _resample(heights, image, stretch, view, frame, out):
    """`view` is `View.numbers`."""
    for i in range(out.shape[0]):
        # the first of `factor` pixels lies half a cell minus half a pixel before the centre of its cell
        cell_row = frame.row + (i + 0.5) / frame.factor - 0.5
        y = frame.north - (cell_row + 0.5) * frame.cell
        for j in range(out.shape[1]):
            cell_col = frame.col + (j + 0.5) / frame.factor - 0.5
            z = height_at(heights, cell_row - frame.heights_row, cell_col - frame.heights_col)
            if not np.isfinite(z):
                continue
            col, row, _ = project_point(view, frame.west + (cell_col + 0.5) * frame.cell, y, z)
            if not (0.0 <= col <= view.width - 1.0 and 0.0 <= row <= view.height - 1.0):
                continue
            # pixel p of a level lies at 2 p + 0.5 of the one below (imagery/pyramid.py)
            row = (row - (frame.shrunk - 1.0) / 2.0) / frame.shrunk - frame.photo_row
            col = (col - (frame.shrunk - 1.0) / 2.0) / frame.shrunk - frame.photo_col
            # heights beyond the bounds of the surface project outside the window that was read; they stay without data
            if row < -0.5 or col < -0.5 or row > image.shape[0] - 0.5 or col > image.shape[1] - 0.5:
                continue
            value = (bicubic_at(image, row, col) - stretch.low) * stretch.gain
            # a place whose neighbours are masked
            if value != value:
                continue
            out[i, j] = np.uint8(min(max(value + 0.5, 1.0), 255.0))
