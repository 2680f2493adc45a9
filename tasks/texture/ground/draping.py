"""Heights for the places where the surface model has none, for the texture only: holes are draped from their surroundings.

Strategy: pull and push over blocks of 2, 4, 8 and 16 cells. Heights of the blocks of 16 cells come from the whole model and have no
holes, so that every hole is closed however large it is; a tile with `HALO` cells around it gives what the whole model would give.
Blocks are counted from the corner of the model's grid, never from that of a tile.
"""

import cv2
import numpy as np

from orthomill.schemas.raster import MapGrid, Window
from orthomill.schemas.surface import ESTIMATED, HeightSource
from orthomill.tasks.imagery.pull_push import halved, pushed

LEVELS = 4
BLOCK = 2**LEVELS
"""Side of the blocks of the whole model's ground, cells."""
HALO = 2 * BLOCK
"""Cells around a cell that its draped height depends on, beyond the blocks of the ground."""


def block_grid(grid: MapGrid) -> MapGrid:
    """The grid of the blocks of a grid of cells; the last blocks may reach beyond it."""
    return MapGrid(
        west=grid.west, north=grid.north, cell=grid.cell * BLOCK, rows=-(-grid.rows // BLOCK), cols=-(-grid.cols // BLOCK)
    )


def blocks_of(window: Window) -> Window:
    """The blocks that a window of cells touches."""
    return window.reduced(BLOCK)


def ground_window(grid: MapGrid, cells: Window) -> Window:
    """The blocks of the ground that draping of `cells` needs: those it touches and one more on every side."""
    return blocks_of(cells).grown(1).clipped(block_grid(grid).shape)


def block_heights(heights: np.ndarray) -> np.ndarray:
    """float32 (rows / 16, cols / 16) m: mean heights of the blocks of a tile (rows, cols) that starts on a block."""
    for _ in range(LEVELS):
        heights = halved(heights)
    return heights


def drape(heights: np.ndarray, window: Window, ground: np.ndarray, blocks: Window) -> np.ndarray:
    """float32 heights (rows, cols) m of the cells `window` with their holes closed.

    ground: heights of the blocks of the whole model at `blocks`, as from `ground_window`. Cells nearer than HALO to an edge of the
    window that is not one of the model may differ from those of the whole model.
    """
    if not np.isnan(heights).any():
        return heights.astype(np.float32)
    row, col = window.row - blocks.row * BLOCK, window.col - blocks.col * BLOCK
    aligned = np.full((blocks.height * BLOCK, blocks.width * BLOCK), np.nan, np.float32)
    inside = np.s_[row : row + window.height, col : col + window.width]
    aligned[inside] = heights
    levels = [aligned]
    for _ in range(LEVELS - 1):
        levels.append(halved(levels[-1]))
    surface = ground
    while levels:
        surface = pushed(levels.pop(), surface)
    return surface[inside]


def far_from_heights(heights: np.ndarray, cells: float) -> np.ndarray:
    """bool (rows, cols): holes farther than `cells` from any height."""
    holes = np.isnan(heights)
    if holes.all():
        return holes
    return cv2.distanceTransform(holes.astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE) > cells


def height_sources(heights: np.ndarray, painted: np.ndarray, provenance: np.ndarray) -> np.ndarray:
    """uint8 codes of HeightSource of cells from the surface's heights, those used for the texture, and codes of Provenance."""
    own = np.where(np.isin(provenance, ESTIMATED), HeightSource.ESTIMATED, HeightSource.MEASURED)
    without = np.where(np.isnan(painted), HeightSource.NONE, HeightSource.DRAPED)
    return np.where(np.isnan(heights), without, own).astype(np.uint8)
