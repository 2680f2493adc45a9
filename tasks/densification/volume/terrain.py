"""How high the ground lies, from the tie points alone: before anything is matched it says what two photographs can see.

Strategy: at the places of a lattice the median height of the tie points around, gaps closed from their surroundings. Where only one
photograph shows the terrain there is nothing to match; left alone, such cells find chance agreement at heights far below, which
more photographs show because their frames are wider there.
"""

from math import ceil

import numpy as np

from orthomill.schemas.observations import GroundPoints
from orthomill.schemas.orientation import Block
from orthomill.schemas.raster import MapGrid, Window
from orthomill.tasks.imagery.pull_push import filled
from orthomill.tasks.imagery.resampling import between

SPACING = 32
"""cells of the surface between the places"""


def terrain_grid(grid: MapGrid, spacing: float = SPACING) -> MapGrid:
    """The places as cells of a grid: their centres lie on the corners of every `spacing`-th cell of `grid`, all around it."""
    cell = grid.cell * spacing
    rows, cols = ceil(grid.rows / spacing) + 1, ceil(grid.cols / spacing) + 1
    return MapGrid(west=grid.west - cell / 2, north=grid.north + cell / 2, cell=cell, rows=rows, cols=cols)


def terrain(points: GroundPoints, block: Block, grid: MapGrid) -> np.ndarray:
    """Heights (rows, cols) float32, m, of the places `grid`; the block's mean height without any tie point around them."""
    heights = known_terrain(points, grid)
    return filled(heights) if np.isfinite(heights).any() else np.full(grid.shape, block.ground_mean, np.float32)


def known_terrain(points: GroundPoints, grid: MapGrid) -> np.ndarray:
    """Median heights (rows, cols) float32, m, of the tie points around the places `grid`; NaN where there are none."""
    return median_heights(points.x, points.y, points.z, grid)


def median_heights(x: np.ndarray, y: np.ndarray, z: np.ndarray, grid: MapGrid) -> np.ndarray:
    """Median heights (rows, cols) float32, m, of the points x, y, z (N,) in the cells of `grid`; NaN where there are none."""
    col, row = grid.pixel(x, y)
    with np.errstate(invalid="ignore"):
        inside = (col >= -0.5) & (row >= -0.5) & (col < grid.cols - 0.5) & (row < grid.rows - 0.5) & np.isfinite(z)
    place = np.rint(row[inside]).astype(np.int64) * grid.cols + np.rint(col[inside]).astype(np.int64)
    # Sorted by height around every place: the middle one is the median, which a single wrong point does not move.
    order = np.lexsort((z[inside], place))
    occupied, first, count = np.unique(place[order], return_index=True, return_counts=True)
    heights = np.full(grid.rows * grid.cols, np.nan, np.float32)
    heights[occupied] = z[inside][order][first + count // 2]
    return heights.reshape(grid.shape)


def places_around(window: Window, factor: int, shape: tuple[int, ...]) -> Window:
    """The places (of `shape` in all) between which the cells of a window of a level lie, `factor` cells of the surface wide."""
    meshes = window.scaled(factor).reduced(SPACING)
    return Window(meshes.row, meshes.col, meshes.height + 1, meshes.width + 1).clipped(shape)


def at_cells(values: np.ndarray, places: Window, window: Window, factor: int) -> np.ndarray:
    """Values (rows, cols) float32 at the cells of a window of a level, interpolated from those of `places_around` it."""
    row = (np.arange(window.row, window.row + window.height) + 0.5) * factor / SPACING - places.row
    col = (np.arange(window.col, window.col + window.width) + 0.5) * factor / SPACING - places.col
    # The cells of a coarse level may reach beyond the surface, where there are no places.
    return between(values, np.clip(row, 0, places.height - 1), np.clip(col, 0, places.width - 1))
