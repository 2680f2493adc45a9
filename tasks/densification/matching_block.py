"""Blocks of a pair: their windows, their matching, and the statistics that the report needs."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from pydantic import BaseModel, ConfigDict

from orthomill.schemas.epipolar import EpipolarPair
from orthomill.schemas.memory import array_bytes
from orthomill.schemas.outcome import Outcome
from orthomill.schemas.raster import MapGrid, Window, enclosing, windows_in
from orthomill.schemas.surface import Surface
from orthomill.tasks.densification.start_parallaxes import STRIP, start_parallaxes
from orthomill.tasks.geometry.epipolar_window import map_window
from orthomill.tasks.matching.dense.blocks import (
    BLOCK,
    ParallaxRange,
    left_window,
    placed,
    refined_block,
    right_window,
    scratch_bytes,
)
from orthomill.tasks.matching.dense.dense_settings import DenseMatching
from orthomill.tasks.matching.dense.node_surfaces import StartSurface

PRECISION_EDGES = (0.0, 0.02, 0.04, 0.06, 0.08, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5)
"""classes of the standard error of a parallax, px"""


class MatchingStatistics(BaseModel):
    """Outcomes of the nodes of a block or of a pair."""

    model_config = ConfigDict(frozen=True)

    outcomes: tuple[int, ...] = (0,) * len(Outcome)
    """nodes by code of `orthomill.schemas.outcome.Outcome`"""
    precision: tuple[int, ...] = (0,) * (len(PRECISION_EDGES) - 1)
    """matched nodes by class of PRECISION_EDGES"""
    y_parallaxes: tuple[float, ...] = ()
    """median residual y-parallax of every block with enough points to measure it, px"""


@dataclass(frozen=True)
class PairBlock:
    """A block of a pair: nodes `nodes` (window of the grid of nodes) of the left image, and the cells of the volume that it
    shows."""

    pair: EpipolarPair
    nodes: Window
    step: int
    grid: MapGrid
    cells: Window

    @classmethod
    def over(cls, pair: EpipolarPair, nodes: Window, step: int, surface: Surface) -> "PairBlock":
        """A block of a pair over the grid of a surface."""
        core = Window(nodes.row * step, nodes.col * step, BLOCK, BLOCK)
        cells = map_window(pair, left_window(core), surface.grid, surface.height_low, surface.height_high)
        return cls(pair, nodes, step, surface.grid, cells)

    @property
    def offset(self) -> float:
        """Column parallax minus parallax, px."""
        # Matching counts columns of the two rasters; the geometry counts from the principal columns, which differ.
        return self.pair.column_offset

    @property
    def parallaxes(self) -> ParallaxRange:
        """The column parallaxes that the heights of the surface allow."""
        return ParallaxRange.around(self.pair.parallax_low + self.offset, self.pair.parallax_high + self.offset)

    @property
    def core(self) -> Window:
        """The full square in pixels, also where it extends beyond the image."""
        # Blocks at the border keep their full size, so that a block's result does not depend on where the image ends.
        return Window(self.nodes.row * self.step, self.nodes.col * self.step, BLOCK, BLOCK)

    @property
    def left(self) -> Window:
        """The window that is read of the left image."""
        return left_window(self.core).clipped((self.pair.rows, self.pair.left_cols))

    @property
    def right(self) -> Window:
        """The window that is read of the right image; empty where the whole parallax range lies beyond it."""
        return right_window(self.core, self.parallaxes).clipped((self.pair.rows, self.pair.right_cols))

    def scratch(self, matching: DenseMatching) -> int:
        """Working memory of `match_pair_block`, bytes."""
        # Per cell of a strip, and of a row beside it, three float64 places with their copies in pixels of the left image.
        cells = min(self.cells.cells, STRIP + 3 * self.cells.width)
        return scratch_bytes(self.parallaxes, matching) + array_bytes(64, cells)


@dataclass(frozen=True)
class PairTile:
    """Blocks of a pair side by side, which one job matches one after the other: what they find is stored in one piece.

    `left`, `right`, `cells`: what all of them read, see `PairBlock`; empty where none reads anything.
    """

    pair: EpipolarPair
    nodes: Window
    step: int
    surface: Surface
    left: Window
    right: Window
    cells: Window

    @classmethod
    def over(cls, pair: EpipolarPair, nodes: Window, step: int, surface: Surface) -> "PairTile":
        """The tile of whole blocks whose nodes are these."""
        blocks = _blocks(pair, nodes, step, surface)
        left, right, cells = (enclosing(getattr(block, name) for block in blocks) for name in ("left", "right", "cells"))
        return cls(pair, nodes, step, surface, left, right, cells)

    @property
    def blocks(self) -> tuple[PairBlock, ...]:
        """Its blocks, row by row."""
        return _blocks(self.pair, self.nodes, self.step, self.surface)

    def scratch(self, matching: DenseMatching) -> int:
        """Working memory of `match_pair_tile`, bytes."""
        # A block works on a copy of its part of what is read.
        return max(
            block.scratch(matching) + array_bytes(4, block.cells) + array_bytes(1, block.left) + array_bytes(1, block.right)
            for block in self.blocks
        )


def _blocks(pair: EpipolarPair, nodes: Window, step: int, surface: Surface) -> tuple[PairBlock, ...]:
    return tuple(PairBlock.over(pair, window, step, surface) for window in windows_in(nodes, BLOCK // step))


class MatchedBlock(NamedTuple):
    """Result of a block, or of several: nodes (rows, cols, 3) float32 (parallax px, its standard error px, correlation; NaN without
    a match) and outcome (rows, cols) uint8, codes of Outcome."""

    nodes: np.ndarray
    outcome: np.ndarray
    statistics: MatchingStatistics


def match_pair_block(
    block: PairBlock, matching: DenseMatching, left: np.ndarray, right: np.ndarray | None = None, heights: np.ndarray | None = None
) -> MatchedBlock:
    """Match a block of a pair near the heights of the volume.

    left, right: uint8 (rows, cols), the windows `block.left` and `block.right`; heights: float32 m, the window `block.cells` of the
    volume. None where there is nothing to read.
    """
    # A block whose parallax range lies beyond the right image is still written: the surface reads whole windows of nodes.
    right = np.zeros((0, 0), np.uint8) if right is None else right
    whole = left_window(block.core)
    heights = np.full(block.cells.shape, np.nan, np.float32) if heights is None else heights
    start = start_parallaxes(block.pair, heights, block.grid, block.cells, whole)
    found = refined_block(
        placed(left, block.left, whole),
        placed(right, block.right, right_window(block.core, block.parallaxes)),
        StartSurface(start.parallax + np.float32(block.offset), start.factor),
        block.parallaxes,
        matching,
    )
    # The block is a full square; at the right and lower border of the pair only part of it exists in the raster.
    inside = slice(0, block.nodes.height), slice(0, block.nodes.width)
    nodes = found.nodes
    parallax = (nodes.parallax[inside] - block.offset).astype(np.float32)
    stacked = np.stack([parallax, nodes.sigma[inside], nodes.correlation[inside]], axis=-1)
    outcome = nodes.outcome[inside]
    return MatchedBlock(stacked, outcome, matching_statistics(stacked, outcome, found.y_parallax))


def match_pair_tile(
    tile: PairTile, matching: DenseMatching, left: np.ndarray, right: np.ndarray | None = None, heights: np.ndarray | None = None
) -> MatchedBlock:
    """Match the blocks of a tile, each as `match_pair_block` does it alone; left, right, heights: the windows of the tile."""
    nodes = np.empty((*tile.nodes.shape, 3), np.float32)
    outcome = np.empty(tile.nodes.shape, np.uint8)
    statistics = []
    for block in tile.blocks:
        found = match_pair_block(
            block,
            matching,
            _part(left, tile.left, block.left),
            None if right is None or block.right.empty else _part(right, tile.right, block.right),
            None if heights is None or block.cells.empty else _part(heights, tile.cells, block.cells),
        )
        own = block.nodes.within(tile.nodes).slices
        nodes[own], outcome[own] = found.nodes, found.outcome
        statistics.append(found.statistics)
    return MatchedBlock(nodes, outcome, sum_matching(tuple(statistics)))


def _part(values: np.ndarray, window: Window, wanted: Window) -> np.ndarray:
    return np.ascontiguousarray(values[wanted.within(window).slices])


def matching_statistics(nodes: np.ndarray, outcome: np.ndarray, y_parallax: float) -> MatchingStatistics:
    """The counts of a block; nodes (rows, cols, 3) and outcome (rows, cols) as in `MatchedBlock`, y_parallax in px or NaN."""
    return MatchingStatistics(
        outcomes=tuple(np.bincount(outcome.ravel(), minlength=len(Outcome)).tolist()),
        precision=tuple(np.histogram(nodes[..., 1], PRECISION_EDGES)[0].tolist()),
        y_parallaxes=(y_parallax,) if np.isfinite(y_parallax) else (),
    )


def sum_matching(parts: tuple[MatchingStatistics, ...]) -> MatchingStatistics:
    """The statistics of several blocks together."""
    return MatchingStatistics(
        outcomes=tuple(map(sum, zip(*(part.outcomes for part in parts), strict=True))),
        precision=tuple(map(sum, zip(*(part.precision for part in parts), strict=True))),
        y_parallaxes=tuple(y for part in parts for y in part.y_parallaxes),
    )
