"""Heights for the places where the surface model has none, for the texture only: holes are draped from their surroundings.

Strategy: pull and push. Pull: means of the known heights over blocks of 2, 4, 8 and 16 cells. Push: from coarse to fine, a block
without heights takes the coarser level, interpolated bilinearly. Heights of the blocks of 16 cells come from the whole model and
have no holes (`filled`), so that every hole is closed however large it is; a tile with `HALO` cells around it gives what the whole
model would give. Blocks are counted from the corner of the model's grid, never from that of a tile.

Source: pull-push of Gortler et al. 1996 (The Lumigraph, section 3.4), with blocks that are either known or not.
"""

from enum import IntEnum

import cv2
import numpy as np

from orthomill.schemas.raster import MapGrid, Window
from orthomill.schemas.surface import ESTIMATED


class HeightSource(IntEnum):
    """Where the height of an ortho pixel comes from; uint8 in `texture/height_source`."""

    # The numbers are those of the product ortho_height_source.tif, so they never change.
    NONE = 0
    MEASURED = 1
    DRAPED = 2
    ESTIMATED = 3


HEIGHT_SOURCE_CODES: tuple[tuple[int, str, str], ...] = (
    (HeightSource.NONE, "#000000", "no height, no texture"),
    (HeightSource.MEASURED, "#9a9a9a", "measured"),
    (HeightSource.DRAPED, "#d7191c", "draped: interpolated for the texture only"),
    (HeightSource.ESTIMATED, "#fdae61", "estimated by the surface model"),
)
"""(code, colour, meaning) for pictures"""

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
    row, col = window.row // BLOCK, window.col // BLOCK
    bottom, right = -(-(window.row + window.height) // BLOCK), -(-(window.col + window.width) // BLOCK)
    return Window(row, col, bottom - row, right - col)


def ground_window(grid: MapGrid, cells: Window) -> Window:
    """The blocks of the ground that draping of `cells` needs: those it touches and one more on every side."""
    return blocks_of(cells).grown(1).clipped(block_grid(grid).shape)


def halved(heights: np.ndarray) -> np.ndarray:
    """Means (rows / 2, cols / 2) of the known heights in blocks of 2 x 2, NaN where none is; odd edges are padded."""
    padded = np.pad(heights, [(0, heights.shape[0] % 2), (0, heights.shape[1] % 2)], constant_values=np.nan)
    shape = padded.shape[0] // 2, padded.shape[1] // 2
    total, count = np.zeros(shape), np.zeros(shape)
    # Four slices of single cells: a sum over two short axes would take ten times as long.
    for values in (padded[row::2, col::2] for row in (0, 1) for col in (0, 1)):
        known = ~np.isnan(values)
        total += np.where(known, values, 0)
        count += known
    with np.errstate(invalid="ignore"):
        return (total / count).astype(np.float32)


def block_heights(heights: np.ndarray) -> np.ndarray:
    """float32 (rows / 16, cols / 16) m: mean heights of the blocks of a tile (rows, cols) that starts on a block."""
    for _ in range(LEVELS):
        heights = halved(heights)
    return heights


def doubled(coarse: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """The level below `coarse`, of `shape`, interpolated bilinearly; constant beyond the outer blocks."""
    # Centres of the finer blocks lie a quarter of a block before and behind that of the coarser one.
    for axis in (0, 1):
        before = np.take(coarse, np.maximum(np.arange(coarse.shape[axis]) - 1, 0), axis)
        after = np.take(coarse, np.minimum(np.arange(coarse.shape[axis]) + 1, coarse.shape[axis] - 1), axis)
        pair = np.stack([0.75 * coarse + 0.25 * before, 0.75 * coarse + 0.25 * after], axis + 1)
        coarse = pair.reshape([2 * n if k == axis else n for k, n in enumerate(coarse.shape)])
    return coarse[: shape[0], : shape[1]]


def filled(blocks: np.ndarray) -> np.ndarray:
    """The ground: block heights of the whole model (rows, cols) with every gap closed; all NaN only where the model is empty."""
    levels = [blocks.astype(np.float32)]
    while max(levels[-1].shape) > 1:
        levels.append(halved(levels[-1]))
    ground = levels.pop()
    while levels:
        ground = _pushed(levels.pop(), ground)
    return ground.astype(np.float32)


def _pushed(known: np.ndarray, coarser: np.ndarray) -> np.ndarray:
    return np.where(np.isnan(known), doubled(coarser, known.shape), known).astype(np.float32)


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
        surface = _pushed(levels.pop(), surface)
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
