"""One tile of the result: from the nodes of all pairs to correction, precision, corrected surface, coarse blocks and counts."""

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from orthomill.schemas.raster import Window
from orthomill.tasks.dsm_check.areas import blocks
from orthomill.tasks.dsm_check.correction_map import (
    CorrectionNodes,
    corrected_heights,
    interpolate,
    node_points,
    share_applied,
    without_spikes,
)
from orthomill.tasks.dsm_check.statistics import TileCounts, count_pair, count_tile


@dataclass(frozen=True)
class NodeWindow:
    """The nodes of one pair that a tile needs. Windows count the nodes of the whole surface."""

    pair: str
    given: Window
    own: Window
    """the nodes in the tile itself; the others are its halo"""

    def inner(self, nodes: np.ndarray) -> np.ndarray:
        """The tile's own nodes of the given array."""
        return nodes[Window(self.own.row - self.given.row, self.own.col - self.given.col, *self.own.shape).slices]


@dataclass(frozen=True)
class CorrectionRule:
    """How corrections become a surface."""

    apply: Literal["all", "significant", "none"]
    significance: float
    nodes: CorrectionNodes
    block: int
    """cells along a block of the coarse raster"""
    pixel_height: float
    """m: height error that one pixel of shift stands for"""


class CheckedCells(NamedTuple):
    """A checked tile: dh, its standard error and the corrected height (rows, cols) float32 m, NaN where unknown; `areas.blocks`
    (rows, cols, 3) float32; counts of cells and nodes."""

    dh: np.ndarray
    precision: np.ndarray
    height: np.ndarray
    coarse: np.ndarray
    counts: TileCounts


def take_surface(heights: np.ndarray) -> np.ndarray:
    """The surface under test (rows, cols) float32 m, NaN where it has no height."""
    # infinite values, which some programs write into gaps, would pass every later test for NaN
    return np.where(np.isfinite(heights), heights, np.nan).astype(np.float32)


def correct_tile(
    window: Window, pairs: tuple[NodeWindow, ...], rule: CorrectionRule, heights: np.ndarray, nodes: tuple[np.ndarray, ...] = ()
) -> CheckedCells:
    """The checked cells of `window`.

    heights: (window.shape) m, of the surface under test. nodes: one array (rows, cols, bands) for each of `pairs`.
    """
    clean = [without_spikes(one) for one in nodes]
    points = [node_points(one, (pair.given.row, pair.given.col), rule.nodes) for one, pair in zip(clean, pairs, strict=True)]
    correction = interpolate(np.concatenate([np.empty((0, 4)), *points]), window, rule.nodes.radius)
    share = share_applied(correction, rule.apply, rule.significance)
    # own nodes only: those of the halo are counted by the tiles to which they belong
    counted = tuple(count_pair(pair.pair, pair.inner(one), rule.pixel_height) for one, pair in zip(clean, pairs, strict=True))
    return CheckedCells(
        dh=correction.dh,
        precision=correction.sigma,
        height=corrected_heights(heights, correction, share),
        coarse=blocks(correction.dh, correction.sigma, rule.block),
        counts=count_tile(heights, correction, share, counted, rule.pixel_height),
    )
