"""One block of a pair: its windows, its matching, and the statistics that the report needs."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from pydantic import BaseModel, ConfigDict

from orthomill.schemas.epipolar import EpipolarPair
from orthomill.schemas.outcome import Outcome
from orthomill.schemas.raster import Window
from orthomill.tasks.matching.dense.blocks import (
    BLOCK,
    DenseMatching,
    ParallaxRange,
    left_window,
    match_block,
    placed,
    right_window,
)

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
    """A block of a pair: nodes `nodes` (window of the grid of nodes) of the left image."""

    pair: EpipolarPair
    nodes: Window
    step: int

    @property
    def offset(self) -> float:
        """Column parallax minus parallax, px."""
        # Matching counts columns of the two rasters; the geometry counts from the principal columns, which differ.
        return self.pair.left_col0 - self.pair.right_col0

    @property
    def parallaxes(self) -> ParallaxRange:
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


class MatchedBlock(NamedTuple):
    """Result of a block: nodes (rows, cols, 3) float32 (parallax px, its standard error px, correlation; NaN without a match) and
    outcome (rows, cols) uint8, codes of Outcome."""

    nodes: np.ndarray
    outcome: np.ndarray
    statistics: MatchingStatistics


def match_pair_block(block: PairBlock, matching: DenseMatching, left: np.ndarray, right: np.ndarray | None = None) -> MatchedBlock:
    """Match a block of a pair.

    left, right: uint8 (rows, cols), the windows `block.left` and `block.right`; right is None where there is nothing to read.
    """
    # A block whose parallax range lies beyond the right image is still written: the surface reads whole windows of nodes.
    right = np.zeros((0, 0), np.uint8) if right is None else right
    found = match_block(
        placed(left, block.left, left_window(block.core)),
        placed(right, block.right, right_window(block.core, block.parallaxes)),
        block.parallaxes,
        matching,
    )
    # The block is a full square; at the right and lower border of the pair only part of it exists in the raster.
    inside = slice(0, block.nodes.height), slice(0, block.nodes.width)
    nodes = found.nodes
    parallax = (nodes.parallax[inside] - block.offset).astype(np.float32)
    stacked = np.stack([parallax, nodes.sigma[inside], nodes.correlation[inside]], axis=-1)
    outcome = nodes.outcome[inside]
    return MatchedBlock(stacked, outcome, _statistics(stacked, outcome, found.y_parallax))


def _statistics(nodes: np.ndarray, outcome: np.ndarray, y_parallax: float) -> MatchingStatistics:
    return MatchingStatistics(
        outcomes=tuple(np.bincount(outcome.ravel(), minlength=len(Outcome)).tolist()),
        precision=tuple(np.histogram(nodes[..., 1], PRECISION_EDGES)[0].tolist()),
        y_parallaxes=(y_parallax,) if np.isfinite(y_parallax) else (),
    )


def sum_matching(parts: tuple[MatchingStatistics, ...]) -> MatchingStatistics:
    """The statistics of all blocks of a pair together."""
    return MatchingStatistics(
        outcomes=tuple(map(sum, zip(*(part.outcomes for part in parts), strict=True))),
        precision=tuple(map(sum, zip(*(part.precision for part in parts), strict=True))),
        y_parallaxes=tuple(y for part in parts for y in part.y_parallaxes),
    )
