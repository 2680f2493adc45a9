"""Where the homologues of a pair may lie when an existing height model says about how high the ground is.

Strategy. The left ray of a node meets the model (monoplotting); the heights that lie as far below and above it there as tie points
lie from the model are put on the same ray, and their parallaxes bound the starts. So the range of a node is that of its place, and
not that of the whole pair.

Source: Karfis 2009, 6.4 (sources/epipolar.md#column-interval).
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from orthomill.schemas.epipolar import EpipolarPair
from orthomill.schemas.raster import MapGrid, Window
from orthomill.schemas.surface import Surface
from orthomill.tasks.densification.volume.guide_posts import post_grid
from orthomill.tasks.geometry.epipolar_window import map_window
from orthomill.tasks.matching.guided.column_interval import GuidePosts, parallax_intervals
from orthomill.tasks.matching.guided.guided_settings import ColumnInterval
from orthomill.tasks.matching.strategies.coarse_to_fine import SearchRange

_POST, CHUNK = 16, 256
"""cells of the surface between posts, and posts along the side of a chunk"""
_NEAREST = ColumnInterval(min_points=1, margin=0.0)
"""the nearest post alone says how far heights may lie: what a model does not have between its posts, tie points have told"""


@dataclass(frozen=True)
class ModelArea:
    """The posts `window` of `grid` over a part of a pair."""

    grid: MapGrid
    window: Window


def model_area(pair: EpipolarPair, left: Window, surface: Surface) -> ModelArea:
    """The posts that the rays of the pixels `left` of the left image can meet."""
    grid = model_posts(surface)
    return ModelArea(grid, map_window(pair, left, grid, surface.height_low, surface.height_high, 2))


def model_posts(surface: Surface) -> MapGrid:
    """The posts of an existing model under a surface."""
    return post_grid(surface.grid, _POST * surface.grid.cell)


@dataclass(frozen=True)
class NearModel(SearchRange):
    """A range that lies elsewhere at every node: near the posts of a model, within the range of the pair."""

    pair: EpipolarPair | None = None
    posts: GuidePosts | None = None

    def starts(self, points: np.ndarray, spacing: float) -> Iterator[np.ndarray]:
        low, high = self.columns(points)
        count = np.maximum(np.ceil((high - low) / spacing), 1.0)
        rows = SearchRange(0.0, 0.0, self.row_low, self.row_high).offsets(spacing)[:, 1]
        for turn in range(int(np.nanmax(count, initial=0.0))):
            # A node has as many starts as its own range asks for.
            column = np.where(turn < count, low + (high - low) * (turn + 0.5) / count, np.nan)
            for row in rows:
                yield np.column_stack([column, np.full(len(points), row)])

    def columns(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Least and greatest right column - left column (N,) of left points (N, 2), px; NaN where a ray misses the model."""
        assert self.pair is not None and self.posts is not None
        offset = self.pair.column_offset
        parallax = parallax_intervals(self.pair, points, self.posts, _NEAREST, 0.0)
        low, high = (np.clip(-(parallax[:, end] + offset), self.col_low, self.col_high) for end in (2, 0))
        return low, high
