"""One tile of the answer: nodes of all pairs in, correction, precision, corrected surface, coarse blocks and counts out."""

from dataclasses import dataclass
from typing import Any, Literal

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
from orthomill.tasks.dsm_check.statistics import count_pair, count_tile


@dataclass(frozen=True)
class NodeWindow:
    """The nodes of one pair that a tile needs. Windows count nodes over the whole surface."""

    pair: str
    given: Window
    own: Window
    """those in the tile itself; the others are its halo"""

    def inner(self, nodes: np.ndarray) -> np.ndarray:
        """The tile's own nodes of the array given."""
        return nodes[Window(self.own.row - self.given.row, self.own.col - self.given.col, *self.own.shape).slices]


@dataclass(frozen=True)
class CorrectionRule:
    """How corrections become a surface."""

    apply: Literal["all", "significant", "none"]
    significance: float
    nodes: CorrectionNodes
    block: int
    pixel_height: float


def take_surface(heights: np.ndarray) -> np.ndarray:
    """The surface under test (rows, cols) float32 m, NaN where it has no height."""
    return np.where(np.isfinite(heights), heights, np.nan).astype(np.float32)


def correct_tile(
    window: Window, pairs: tuple[NodeWindow, ...], rule: CorrectionRule, heights: np.ndarray, nodes: tuple[np.ndarray, ...] = ()
) -> dict[str, Any]:
    """dh, sigma and corrected height (window.shape) float32 m, coarse blocks, and `TileCounts`.

    heights: of the surface under test. nodes: one array (rows, cols, bands) for each of `pairs`.
    """
    clean = [without_spikes(one) for one in nodes]
    points = [node_points(one, (pair.given.row, pair.given.col), rule.nodes) for one, pair in zip(clean, pairs, strict=True)]
    correction = interpolate(np.concatenate([np.empty((0, 4)), *points]), window, rule.nodes.radius)
    share = share_applied(correction, rule.apply, rule.significance)
    counted = tuple(count_pair(pair.pair, pair.inner(one), rule.pixel_height) for one, pair in zip(clean, pairs, strict=True))
    return {
        "dh": correction.dh,
        "precision": correction.sigma,
        "height": corrected_heights(heights, correction, share),
        "coarse": blocks(correction.dh, correction.sigma, rule.block),
        "counts": count_tile(heights, correction, share, counted, rule.pixel_height),
    }
