"""An existing height model as posts: its heights, and how far from them the ground may lie."""

import numpy as np

from orthomill.schemas.observations import GroundPoints
from orthomill.schemas.orientation import Block
from orthomill.schemas.raster import MapGrid
from orthomill.schemas.surface import Surface
from orthomill.tasks.densification.volume.guide_heights import guided_terrain


def post_grid(surface: MapGrid, spacing: float) -> MapGrid:
    """The posts: cells of a whole number of cells of the surface near `spacing` m, with one more all around it."""
    cells = max(1, round(spacing / surface.cell))
    post = surface.cell * cells
    rows, cols = -(-surface.rows // cells) + 2, -(-surface.cols // cells) + 2
    return MapGrid(west=surface.west - post, north=surface.north + post, cell=post, rows=rows, cols=cols)


def bands(middle: np.ndarray, low: np.ndarray, high: np.ndarray, count: np.ndarray, surface: Surface) -> np.ndarray:
    """(rows, cols, 4) float32 of posts, their heights within the bounds of the surface."""
    heights = (np.clip(values, surface.height_low, surface.height_high) for values in (middle, low, high))
    return np.stack([*heights, count], axis=-1).astype(np.float32)


def file_guide(points: GroundPoints, block: Block, guide: np.ndarray, grid: MapGrid, path: str, surface: Surface) -> np.ndarray:
    """The posts of an existing model, `guide` (rows, cols) its heights there; tie points close its holes, and say how far from it
    heights may lie.

    Raises GeometryError for a model that cannot belong to the block.
    """
    heights, reach = guided_terrain(points, block, guide, grid, path)
    return bands(heights, heights - reach[..., 0], heights + reach[..., 1], np.isfinite(guide), surface)
