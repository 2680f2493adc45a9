"""The height model that guides a level: posts on a grid of the map, from tie points, from a file, or from the points of a level.

Strategy. The first model is made in one piece, for tie points are sparse. Those of the levels are made in squares of posts with a
halo of four radii, each cleaned by itself until nothing changes: a fixpoint in one piece would have no bounded reach. Squares and
posts are absolute, so that neither the tile of the project nor the number of workers changes anything. A post without points keeps
what the model before says there.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from orthomill.schemas.observations import GroundPoints
from orthomill.schemas.orientation import Block
from orthomill.schemas.raster import MapGrid, Window
from orthomill.schemas.surface import Surface
from orthomill.tasks.densification.guided.point_block import GuidedPoints, GuidedStatistics
from orthomill.tasks.densification.volume.guide_posts import bands
from orthomill.tasks.densification.volume.terrain import median_heights, terrain
from orthomill.tasks.matching.guided.guided_settings import OutlierDetector
from orthomill.tasks.matching.guided.outlier_detector import without_spikes

SQUARE_POSTS = 64
"""posts along the side of a square that is cleaned by itself"""
HALO_RADII = 4
"""radii of the circle of neighbours around a square"""


def tie_point_guide(points: GroundPoints, block: Block, grid: MapGrid, surface: Surface) -> np.ndarray:
    """The posts (rows, cols, 4) of the tie points."""
    inside = np.isfinite(points.z)
    cloud = np.column_stack([points.x, points.y, points.z])[inside]
    low, high, count = _extremes(cloud, grid, Window(0, 0, *grid.shape))
    closed = terrain(points, block, grid).astype(np.float64)
    return bands(closed, np.where(count > 0, low, closed), np.where(count > 0, high, closed), count, surface)


def no_guide(grid: MapGrid, block: Block, surface: Surface) -> np.ndarray:
    """Posts that let a point lie at any height of the surface."""
    middle, low, high = (np.full(grid.shape, z) for z in (block.ground_mean, surface.height_low, surface.height_high))
    return bands(middle, low, high, np.ones(grid.shape), surface)


@dataclass(frozen=True)
class GuideTile:
    """A square of posts `window`, and the part `around` of the map whose points clean those of it."""

    grid: MapGrid
    window: Window
    around: Window
    radius: float
    """of the circle of neighbours, m"""


class LevelGuide(NamedTuple):
    """What the job of a square writes: the posts (rows, cols, 4), the points that are left, and their number."""

    guide: np.ndarray
    cloud: GuidedPoints
    statistics: GuidedStatistics


def level_guide(
    tile: GuideTile, outliers: OutlierDetector, surface: Surface, before: np.ndarray, points: Iterator[GuidedPoints]
) -> LevelGuide:
    """The posts of a square from the points of a level. before (rows, cols, 4): those of the level before; points: one table per
    block that may show the square and what is around it."""
    found = [_within(table, tile.grid, tile.around) for table in points]
    cloud = _in_order(found)
    kept = cloud.take(without_spikes(np.column_stack([cloud.x, cloud.y, cloud.z]), tile.radius, outliers))
    own = _within(kept, tile.grid, tile.window)
    low, high, count = _extremes(np.column_stack([own.x, own.y, own.z]), tile.grid, tile.window)
    some = count > 0
    middle = np.where(some, median_heights(own.x, own.y, own.z, _part(tile.grid, tile.window)), before[..., 0])
    new = bands(middle, np.where(some, low, before[..., 1]), np.where(some, high, before[..., 2]), count, surface)
    return LevelGuide(new, own, GuidedStatistics(kept=len(own)))


def _within(points: GuidedPoints, grid: MapGrid, window: Window) -> GuidedPoints:
    col, row = _post(points.x, points.y, grid)
    inside = (col >= window.col) & (row >= window.row) & (col < window.col + window.width) & (row < window.row + window.height)
    return points.take(inside)


def _in_order(tables: list[GuidedPoints]) -> GuidedPoints:
    """All points together, in an order that does not depend on that of the tables."""
    columns = [np.concatenate([np.empty(0), *(getattr(table, name) for table in tables)]) for name in ("x", "y", "z", "sigma")]
    order = np.lexsort(columns)
    x, y, z, sigma = (values[order] for values in columns)
    return GuidedPoints(x, y, z, sigma.astype(np.float32))


def _post(x: np.ndarray, y: np.ndarray, grid: MapGrid) -> tuple[np.ndarray, np.ndarray]:
    col, row = grid.pixel(x, y)
    return np.floor(col + 0.5).astype(np.int64), np.floor(row + 0.5).astype(np.int64)


def _extremes(cloud: np.ndarray, grid: MapGrid, window: Window) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Lowest and highest height of the points (N, 3) of every post of a window, infinite without any, and their number."""
    col, row = _post(cloud[:, 0], cloud[:, 1], grid)
    col, row = col - window.col, row - window.row
    inside = (col >= 0) & (row >= 0) & (col < window.width) & (row < window.height)
    place = row[inside] * window.width + col[inside]
    low, high = np.full(window.height * window.width, np.inf), np.full(window.height * window.width, -np.inf)
    np.minimum.at(low, place, cloud[inside, 2])
    np.maximum.at(high, place, cloud[inside, 2])
    count = np.bincount(place, minlength=len(low))
    return low.reshape(window.shape), high.reshape(window.shape), count.reshape(window.shape)


def _part(grid: MapGrid, window: Window) -> MapGrid:
    """The cells of a window as a grid of their own."""
    west, north = grid.west + window.col * grid.cell, grid.north - window.row * grid.cell
    return MapGrid(west=west, north=north, cell=grid.cell, rows=window.height, cols=window.width)
