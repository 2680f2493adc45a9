"""One semi-global optimisation over heights, over all photographs that see a part of the map.

Strategy: signatures of the rectified photographs, costs of every candidate height of every cell, eight paths, the cheapest height.
Nothing is given up: where photographs say little the paths carry the heights of the surroundings, and cost, margin and coherence
say what they are worth.

Source: Hirschmueller 2008 (paths); Zabih & Woodfill 1994 (census); Collins 1996 (plane sweep).
"""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from orthomill.schemas.memory import array_bytes
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
from orthomill.tasks.matching.volume.volume_settings import HeightVolume
from orthomill.tasks.matching.volume.winners import rival_weights, winners


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


def ranges_of(settings: HeightVolume) -> Ranges:
    """The ranges of candidates that the settings ask for."""
    return Ranges(
        settings.margin, settings.reach, -(-settings.most_heights // UNIT) * UNIT, -(-settings.mean_heights // UNIT) * UNIT
    )


def comparison_of(settings: HeightVolume) -> Comparison:
    """How the photographs of a cell are compared."""
    return Comparison(settings.compared, settings.best_share, settings.blank)


def _penalty(settings: HeightVolume, share: float) -> np.int16:
    """A penalty in units of the costs."""
    return np.int16(round(share * BITS[settings.half] * COST_UNIT))


def optimised(
    photographs: Iterable[RectifiedPhotograph],
    pixels: int,
    choice: Choice,
    candidates: CellRanges,
    settings: HeightVolume,
    jumps: np.ndarray | None = None,
) -> OptimisedCells:
    """The cheapest candidates of a volume under the eight paths; `pixels`: those of all rectified photographs together; jumps
    (rows, cols): how many times the large penalty holds at a cell (None: once)."""
    stack = PhotographStack.of(photographs, pixels, settings.half)
    cost = volume_costs(stack, choice, candidates, settings.half, comparison_of(settings))
    total = np.zeros(cost.shape, np.int16)
    low, offset, planes = candidates.low, candidates.offset, stack.planes.shape[1]
    small, large = _penalty(settings, settings.small_penalty), _penalty(settings, settings.large_penalty)
    leaps = np.full(low.shape, large) if jumps is None else np.rint(jumps * large).astype(np.int16)
    for backwards in (False, True):
        sweep(cost, total, low, offset, planes, small, leaps, backwards)
    unit = BITS[settings.half] * COST_UNIT
    compared = photographs_at(stack, choice.hidden, np.where(candidates.count > 0, candidates.low + candidates.count // 2, -1))
    stretch = stretches(stack, choice, candidates, settings.compared, settings.step * settings.oversampling)
    found = winners(total, cost, low, offset, compared, stretch, rival_weights(8 * unit * settings.doubt, settings.compared))
    counts = (photographs_at(stack, hidden, found.nearest) for hidden in (np.zeros_like(choice.hidden), choice.hidden))
    quality = found.cost / np.float32(unit), found.margin / np.float32(8 * unit), found.spread, stretch
    return OptimisedCells(found.plane, *quality, *counts)


def scratch_bytes(candidates: int, cells: int, pixels: int, settings: HeightVolume) -> int:
    """Working memory of a volume: of its candidates and cells, and of the pixels of all its rectified photographs together."""
    # Costs 1 byte and path sums 2; ranges, masks, penalties and results of a cell.
    volume = array_bytes(3, candidates) + array_bytes(66 + settings.photographs, cells)
    return volume + array_bytes(BITS[settings.half] // 6, pixels)
