"""Edges of roofs: ground beside a roof that got the roof's height, and roof along its edge that got the ground's.

Every rule that decides between two surfaces trades one for the other, so both are counted, each with its own number of cells.
"""

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from orthomill.schemas.job import Columns
from orthomill.schemas.surface import Provenance
from orthomill.tasks.evaluation.classes import MARGIN, PlaceClass

_WALL = 2.0
"""least step between roof and ground, in cells: where a roof lies lower, its height and the ground's can hardly be told apart"""


@dataclass(frozen=True)
class EdgeCounts(Columns):
    """One row per code of Provenance; cells without a height are not counted."""

    code: np.ndarray
    """uint8"""
    beside: np.ndarray
    grown: np.ndarray
    """int64: cells of ground within MARGIN cells of a roof, and those of them whose height is closer to the roof's"""
    rim: np.ndarray
    lost: np.ndarray
    """int64: cells along the edge of a roof (ROOF_EDGE), and those of them whose height is closer to the ground's"""


def no_edges() -> EdgeCounts:
    """The counts where no roofs are known."""
    return EdgeCounts(np.zeros(0, np.uint8), *(np.zeros(0, np.int64) for _ in range(4)))


def _highest_near(heights: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """(rows, cols): the highest of the masked heights within MARGIN cells; -inf where there is none."""
    low = np.float32(-np.inf)
    return ndimage.maximum_filter(
        np.where(mask & np.isfinite(heights), heights, low), size=2 * MARGIN + 1, mode="constant", cval=low
    )


def edge_counts(
    height: np.ndarray, code: np.ndarray, true: np.ndarray, classes: np.ndarray, cell: float, inner: tuple[slice, slice]
) -> EdgeCounts:
    """Counts of the heights (m) and codes (rows, cols) of a tile.

    true (m) and classes (PlaceClass): of the tile with a halo of at least MARGIN cells; `inner` is the tile in them.
    """
    roof = np.isin(classes, (PlaceClass.ROOF_INTERIOR, PlaceClass.ROOF_EDGE))
    ground = classes == PlaceClass.BUILDING_MARGIN
    # the farther surface of the two, so that the eaves of a lean-to do not stand for the hall behind it
    other = np.where(ground, _highest_near(true, roof), -_highest_near(-true, ground))[inner]
    own, rim, ground = true[inner], (classes == PlaceClass.ROOF_EDGE)[inner], ground[inner]
    judged = np.isfinite(height) & np.isfinite(other) & (np.abs(other - own) >= _WALL * cell)
    taken = np.abs(height - other) < np.abs(height - own)
    masks = (judged & ground, judged & ground & taken, judged & rim, judged & rim & taken)
    codes = np.array([int(c) for c in Provenance], np.uint8)
    return EdgeCounts(codes, *(np.bincount(code[mask], minlength=256)[codes].astype(np.int64) for mask in masks))


def edge_shares(parts: tuple[EdgeCounts, ...], codes: tuple[Provenance, ...]) -> tuple[float, float]:
    """% of the ground beside roofs that grew, and of the edges of roofs that were lost; NaN where there are none."""
    beside, grown, rim, lost = (
        sum(int(getattr(part, name)[np.isin(part.code, codes)].sum()) for part in parts)
        for name in ("beside", "grown", "rim", "lost")
    )
    return (100 * grown / beside if beside else float("nan")), (100 * lost / rim if rim else float("nan"))
