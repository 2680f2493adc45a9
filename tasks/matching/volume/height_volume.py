"""One semi-global optimisation over heights, over all photographs that see a part of the map.

Strategy: signatures of the rectified photographs, costs of every candidate height of every cell, eight paths, the cheapest height.
Nothing is given up: where photographs say little the paths carry the heights of the surroundings, and cost, margin and coherence
say what they are worth.

Source: Hirschmueller 2008 (paths); Zabih & Woodfill 1994 (census); Collins 1996 (plane sweep).
"""

from collections.abc import Iterable
from typing import Literal, NamedTuple

import numpy as np

from orthomill.schemas.settings import Settings, setting
from orthomill.tasks.matching.volume.candidates import CellRanges, Ranges
from orthomill.tasks.matching.volume.costs import (
    COST_UNIT,
    Choice,
    Comparison,
    PhotographStack,
    photographs_at,
    stretches,
    volume_costs,
)
from orthomill.tasks.matching.volume.paths import UNIT, sweep
from orthomill.tasks.matching.volume.rectified_photograph import RectifiedPhotograph
from orthomill.tasks.matching.volume.signatures import BITS
from orthomill.tasks.matching.volume.winners import rival_weights, winners


class HeightVolume(Settings):
    """Semi-global matching of all photographs in a volume of heights over map cells, coarse to fine."""

    window: Literal[5, 7] = setting(7, "Pixels compared along the side of the census window.", "px")
    oversampling: int = setting(3, "Pixels of a rectified photograph along the side of a cell.", ge=1, le=4)
    spacing: int = setting(2, "Distance of the pixels of a census window.", "px of the rectified photograph", ge=1, le=4)
    step: float = setting(0.5, "Greatest parallax between neighbouring heights.", "cells", gt=0.1, le=4.0)
    photographs: int = setting(8, "Photographs that are chosen for a place.", ge=2, le=32)
    compared: int = setting(8, "Of these, photographs that are compared in a cell: the first that show it.", ge=2, le=16)
    best_share: float = setting(0.5, "Share of the pairs of photographs that decide: the most similar ones.", gt=0.0, le=1.0)
    blank: float = setting(
        0.4, "Cost of a pair of which one photograph does not show the height.", "share of the bits", ge=0.0, le=1.0
    )
    small_penalty: float = setting(0.16, "Cost of a change by one height between neighbours.", "share of the bits", ge=0.0, le=2.0)
    large_penalty: float = setting(0.6, "Cost of a larger jump between neighbours.", "share of the bits", ge=0.0, le=4.0)
    widest: int = setting(96, "Heights of the coarsest level, at most.", ge=32, le=256)
    margin: int = setting(7, "Heights added on both sides to the range that the coarser level found.", ge=1, le=64)
    reach: int = setting(1, "Coarser cells around a cell whose heights are within its range.", "cells", ge=1, le=8)
    most_heights: int = setting(128, "Heights of a cell, at most.", ge=16, le=512)
    mean_heights: int = setting(48, "Mean number of heights of the cells of a tile, at most; bounds the memory.", ge=16, le=512)
    doubt: float = setting(
        0.08,
        "A height whose photographs fit by this less is a rival of a third of the weight.",
        "share of the bits",
        gt=0.0,
        le=1.0,
    )
    coherence: float = setting(2.0, "A neighbour goes along when its height differs by at most this.", "heights", gt=0.0)
    coherence_slope: float = setting(0.75, "Added to it per cell of distance: the slope of a coherent surface.", ge=0.0, le=8.0)

    @property
    def half(self) -> int:
        return self.window // 2

    @property
    def ranges(self) -> Ranges:
        return Ranges(self.margin, self.reach, -(-self.most_heights // UNIT) * UNIT, -(-self.mean_heights // UNIT) * UNIT)

    @property
    def comparison(self) -> Comparison:
        return Comparison(self.compared, self.best_share, self.blank)

    def penalty(self, share: float) -> np.int16:
        """A penalty in units of the costs."""
        return np.int16(round(share * BITS[self.half] * COST_UNIT))


class OptimisedCells(NamedTuple):
    """Per cell (rows, cols): `plane` float32 (fractional number, NaN without candidates); `cost` float32, mean share of bits that
    differ; `margin` float32, the same unit, infinite without a competitor; `spread` float32, planes, of
    the rivals of the height (see `Winners`); `stretch` float32, the planes that count as one there (see `stretches`);
    `shown` uint8, photographs within whose frame it lies; `seen` uint8, those of them from which nothing hides it."""

    plane: np.ndarray
    cost: np.ndarray
    margin: np.ndarray
    spread: np.ndarray
    stretch: np.ndarray
    shown: np.ndarray
    seen: np.ndarray


def optimised(
    photographs: Iterable[RectifiedPhotograph], pixels: int, choice: Choice, candidates: CellRanges, settings: HeightVolume
) -> OptimisedCells:
    """The cheapest candidates of a volume under the eight paths; `pixels`: those of all rectified photographs together."""
    stack = PhotographStack.of(photographs, pixels, settings.half)
    cost = volume_costs(stack, choice, candidates, settings.half, settings.comparison)
    total = np.zeros(cost.shape, np.int16)
    low, offset, planes = candidates.low, candidates.offset, stack.planes.shape[1]
    small, large = settings.penalty(settings.small_penalty), settings.penalty(settings.large_penalty)
    for backwards in (False, True):
        sweep(cost, total, low, offset, planes, small, large, backwards)
    unit = BITS[settings.half] * COST_UNIT
    compared = photographs_at(stack, choice.hidden, np.where(candidates.count > 0, candidates.low + candidates.count // 2, -1))
    stretch = stretches(stack, choice, candidates, settings.compared, settings.step * settings.oversampling)
    found = winners(total, cost, low, offset, compared, stretch, rival_weights(8 * unit * settings.doubt, settings.compared))
    counts = (photographs_at(stack, hidden, found.nearest) for hidden in (np.zeros_like(choice.hidden), choice.hidden))
    quality = found.cost / np.float32(unit), found.margin / np.float32(8 * unit), found.spread, stretch
    return OptimisedCells(found.plane, *quality, *counts)


def scratch_bytes(candidates: int, cells: int, pixels: int, settings: HeightVolume) -> int:
    """Working memory of a volume: of its candidates and cells, and of the pixels of all its rectified photographs together."""
    # Costs 1 byte and path sums 2; ranges, masks and results of a cell.
    return 3 * candidates + (64 + settings.photographs) * cells + BITS[settings.half] // 6 * pixels
