"""A block of a pair that is matched by a strategy: what it reads, its nodes, and what the surface makes of them."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from orthomill.schemas.epipolar import EpipolarPair
from orthomill.schemas.memory import array_bytes
from orthomill.schemas.outcome import Outcome
from orthomill.schemas.raster import Window
from orthomill.tasks.densification.completion import VolumeWindow
from orthomill.tasks.densification.matching_block import MatchedBlock, matching_statistics
from orthomill.tasks.densification.settings.pair_strategy_settings import PairStrategy
from orthomill.tasks.densification.strategies.assigned_windows import AssignedWindows
from orthomill.tasks.densification.strategies.near_model import ModelArea, NearModel
from orthomill.tasks.densification.strategies.pair_strategies import matches
from orthomill.tasks.densification.surface_tile import SurfaceCells, SurfaceRules, SurfaceTile, make_surface
from orthomill.tasks.densification.volume.quality import Judgement
from orthomill.tasks.matching.guided.column_interval import GuidePosts
from orthomill.tasks.matching.least_squares.matching import Matches
from orthomill.tasks.matching.strategies.coarse_to_fine import SearchRange
from orthomill.tasks.matching.strategies.node_grid import ImagePart, NodeGrid

SIDE = 1024
"""px along the side of a block: halos of pyramids and regions are several hundred pixels wide"""
_ROWS = 2.0
"""px of y-parallax that an orientation may leave"""


@dataclass(frozen=True)
class StrategyBlock:
    """Nodes `nodes` (window of the grid of nodes) of a pair, and the strategy's halo and number of pyramid levels."""

    pair: EpipolarPair
    nodes: Window
    step: int
    halo: int
    levels: int
    model: ModelArea | None = None
    """posts of an existing model over it, where one bounds the search"""

    @property
    def offset(self) -> float:
        """Left minus right column of a parallax of 0, px."""
        return self.pair.column_offset

    @property
    def search(self) -> SearchRange:
        """The shifts that the parallaxes of the pair allow, px."""
        low, high = (p + self.offset for p in (self.pair.parallax_low, self.pair.parallax_high))
        return SearchRange(-high, -low, -_ROWS, _ROWS)

    def near(self, posts: np.ndarray | None) -> SearchRange:
        """The range of the search: that of the pair, or near the posts (rows, cols, 4) of a model."""
        search = self.search
        if self.model is None or posts is None:
            return search
        known = GuidePosts.of(self.model.grid, self.model.window, posts)
        return NearModel(search.col_low, search.col_high, search.row_low, search.row_high, self.pair, known)

    @property
    def left(self) -> Window:
        """The window that is read of the left image."""
        core = self.nodes.scaled(self.step)
        return self._aligned(core.grown(self.halo)).clipped((self.pair.rows, self.pair.left_cols))

    @property
    def right(self) -> Window:
        """The window that is read of the right image; empty where the whole search lies beyond it."""
        left, search, spare = self.left, self.search, int(_ROWS) + 2**self.levels
        first, last = (
            left.col + int(np.floor(search.col_low)) - spare,
            left.col + left.width + int(np.ceil(search.col_high)) + spare,
        )
        wide = Window(left.row - spare, first, left.height + 2 * spare, last - first)
        return self._aligned(wide).clipped((self.pair.rows, self.pair.right_cols))

    def _aligned(self, window: Window) -> Window:
        """Wider to the left and upwards, so that its pixels of every level are those of the whole image."""
        unit = 2**self.levels
        row, col = window.row // unit * unit, window.col // unit * unit
        return Window(row, col, window.row + window.height - row, window.col + window.width - col)

    @property
    def scratch(self) -> int:
        """Working memory of `match_by_strategy`, bytes."""
        # Both images in float32 with their smoothing and gradients, halved levels, and the tables of all nodes of left window.
        pixels = self.left.cells
        return array_bytes(40, pixels + self.right.cells) + array_bytes(400, pixels // self.step**2 + 1)


def match_by_strategy(
    block: StrategyBlock,
    strategy: PairStrategy,
    left: np.ndarray | None = None,
    right: np.ndarray | None = None,
    posts: np.ndarray | None = None,
    windows: AssignedWindows | None = None,
) -> MatchedBlock:
    """Match the nodes of a block; left, right: uint8 (rows, cols), the windows `block.left` and `block.right`, None where empty;
    posts (rows, cols, 4): those of a model that bounds the search; windows: with limits that give a share of the points one."""
    strategy = windows.of(strategy) if windows else strategy
    nodes = np.full((*block.nodes.shape, 3), np.nan, np.float32)
    outcome = np.full(block.nodes.shape, Outcome.OUTSIDE, np.uint8)
    if left is None or right is None:
        return MatchedBlock(nodes, outcome, matching_statistics(nodes, outcome, float("nan")))
    grid = NodeGrid(block.nodes.row, block.nodes.col, *block.nodes.shape, block.step)
    parts = ImagePart(left, block.left.col, block.left.row), ImagePart(right, block.right.col, block.right.row)
    found = matches(strategy, *parts, grid, block.near(posts))
    outcome = found.outcome.reshape(grid.shape)
    nodes[...] = _node_values(found, grid, block.offset).reshape(*grid.shape, 3)
    off = found.row[found.converged] - found.reference[found.converged, 1]
    return MatchedBlock(nodes, outcome, matching_statistics(nodes, outcome, float(np.median(off)) if len(off) else float("nan")))


def _node_values(found: Matches, grid: NodeGrid, offset: float) -> np.ndarray:
    """(N, 3) float32: parallax px, its standard error px, correlation; NaN without a match."""
    parallax = grid.points()[:, 0] - found.col - offset
    values = np.column_stack([parallax, np.sqrt(found.covariance[:, 0, 0]), found.correlation])
    return np.where(found.converged[:, None], values, np.nan).astype(np.float32)


def make_pair_surface(tile: SurfaceTile, rules: SurfaceRules, nodes: Iterator[np.ndarray]) -> SurfaceCells:
    """The cells of a tile from the nodes of pairs alone: one array (rows, cols, 3) float32 per piece, in their order."""
    # Without a volume nothing rivals a match that its strategy accepted, and what none of the pairs has is interpolated.
    volume = VolumeWindow.unknown(tile.work.shape)
    volume.judgement[..., Judgement.DISTINCTIVENESS] = 100
    return make_surface(tile, rules, volume.height, volume.judgement, volume.confidence, nodes)
