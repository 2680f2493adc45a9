"""Heights for the places where the surface model has none, for the texture only: holes are draped from their surroundings.

Strategy: pull and push over blocks of 2, 4, 8 and 16 cells. Heights of the blocks of 16 cells come from the whole model and have no
holes, so that every hole is closed however large it is; a tile with `HALO` cells around it gives what the whole model would give.
Blocks are counted from the corner of the model's grid, never from that of a tile.
"""

from typing import NamedTuple

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


class BlockHeights(NamedTuple):
    """float32 (rows / 16, cols / 16) of blocks: mean heights (m), NaN in holes, and the mean weights of their cells (1/m2)."""

    blocks: np.ndarray
    weights: np.ndarray


def block_heights(heights: np.ndarray, precision: np.ndarray, cell: float) -> BlockHeights:
    """The blocks of a tile of heights (rows, cols) m that starts on a block, with their standard errors (rows, cols) m; a height
    without one is sure, and none is better than a `cell` (m)."""
    # fmax: what has no standard error counts as a cell.
    weights = (1.0 / np.fmax(precision, np.float32(cell)) ** 2).astype(np.float32)
    weights = np.where(np.isnan(heights), np.float32(np.nan), weights)
    means, total = _in_blocks(heights), _in_blocks(weights)
    off = heights - np.repeat(np.repeat(means, BLOCK, axis=0), BLOCK, axis=1)[: heights.shape[0], : heights.shape[1]]
    return BlockHeights(means + _in_blocks(weights * off) / total, np.nan_to_num(total))


def _in_blocks(values: np.ndarray) -> np.ndarray:
    for _ in range(LEVELS):
        values = halved(values)
    return values


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
