"""One tile of an orthoimage of one photograph, from the surface model under test.

Strategy. Every pixel takes its height from the model (bilinear between cell centres), is projected into the photograph and looked
up there. Nothing is hidden: where the model is wrong, or where something stands in front, the image shows it, and that is what the
check looks for. Where the model has no height the orthoimage has no data (0).

Source: methods/matching_and_dsm_check.md, 1.7, step 1.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit

from orthomill.schemas.camera import Camera
from orthomill.schemas.epipolar import GreyRange
from orthomill.schemas.orientation import ExteriorOrientation
from orthomill.schemas.raster import MapGrid, Window
from orthomill.tasks.geometry.view import project_point, view_of
from orthomill.tasks.imagery.bicubic import bicubic_at
from orthomill.tasks.imagery.radiometry import grey

EIGHT_BITS = GreyRange()


@dataclass(frozen=True)
class OrthoTile:
    """Which part of which orthoimage. Windows lie on the grid of the surface model."""

    orientation: ExteriorOrientation
    camera: Camera
    grid: MapGrid
    """of the surface model"""
    window: Window
    """the cells of this tile"""
    heights: Window
    """the cells whose heights are given: the window and its neighbours"""
    pixels_per_cell: int
    photo: Window
    """the window of the photograph"""


def ortho_tile(
    tile: OrthoTile, heights: np.ndarray, pixels: np.ndarray | None = None, stretch: GreyRange = EIGHT_BITS
) -> np.ndarray:
    """Grey orthoimage of a tile, uint8 (window.height * pixels_per_cell, ...): 1 to 255, 0 without height or photograph.

    heights: (tile.heights.shape) m, NaN where there is none. pixels: (rows, cols, bands), the window `tile.photo`; None where the
    photograph does not see the tile.
    """
    factor = tile.pixels_per_cell
    out = np.zeros((tile.window.height * factor, tile.window.width * factor), np.uint8)
    if pixels is not None:
        numbers = view_of(tile.orientation, tile.camera).numbers
        scale = np.array([stretch.low, 255.0 / (stretch.high - stretch.low)])
        own, given, photo = tile.window, tile.heights, tile.photo
        place = np.array([own.row, own.col, given.row, given.col, factor, photo.row, photo.col])
        ground = np.array([tile.grid.west, tile.grid.north, tile.grid.cell])
        _resample(heights.astype(np.float32), grey(pixels), scale, numbers, place, ground, out)
    return out


@njit(cache=True, inline="always")
def height_at(heights, row, col):
    """Height between cell centres, bilinear; NaN where a cell that takes part has none, or outside."""
    r, c = int(np.floor(row)), int(np.floor(col))
    fr, fc = row - r, col - c
    r1, c1 = (r + 1 if fr > 0.0 else r), (c + 1 if fc > 0.0 else c)
    if r < 0 or c < 0 or r1 >= heights.shape[0] or c1 >= heights.shape[1]:
        return np.nan
    top = (1.0 - fc) * heights[r, c] + fc * heights[r, c1]
    bottom = (1.0 - fc) * heights[r1, c] + fc * heights[r1, c1]
    return (1.0 - fr) * top + fr * bottom


@njit(cache=True)
def _resample(heights, image, scale, n, place, ground, out):
    """`n` is `View.numbers`; place: row and column of tile and heights, pixels per cell, row and column of the photo window."""
    factor = place[4]
    for i in range(out.shape[0]):
        cell_row = place[0] + (i + 0.5) / factor - 0.5
        y = ground[1] - (cell_row + 0.5) * ground[2]
        for j in range(out.shape[1]):
            cell_col = place[1] + (j + 0.5) / factor - 0.5
            z = height_at(heights, cell_row - place[2], cell_col - place[3])
            if not np.isfinite(z):
                continue
            col, row, _ = project_point(n, ground[0] + (cell_col + 0.5) * ground[2], y, z)
            if not (0.0 <= col <= n[20] - 1.0 and 0.0 <= row <= n[21] - 1.0):
                continue
            row, col = row - place[5], col - place[6]
            if row < -0.5 or col < -0.5 or row > image.shape[0] - 0.5 or col > image.shape[1] - 0.5:
                continue
            value = (bicubic_at(image, row, col) - scale[0]) * scale[1]
            out[i, j] = np.uint8(min(max(value + 0.5, 1.0), 255.0))
