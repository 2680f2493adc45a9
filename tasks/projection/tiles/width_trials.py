"""How wide the zone next to the limits of what is hidden is worth being: found from the photographs themselves.

A zone that is too narrow lets colours pass that belong to something else; one that is too wide takes good colours away. What is
right depends on mesh and orientation, whose errors nobody states. But at many places next to the limit of one photograph another
one sees the surface far from all of its own limits: it is left out as a witness, the colour is blended from the rest with every
width, and compared with what the witness shows. The narrowest width is used, none among them, whose colours are as near to the
witnesses of all outputs as those of the best one, but for chance.
"""

from collections.abc import Iterable
from typing import Unpack

import numpy as np
from pydantic import BaseModel, ConfigDict

from orthomill.tasks.colouring.blending.colour_rules import ColourRules
from orthomill.tasks.colouring.blending.surface_colours import TileColours
from orthomill.tasks.colouring.widening.hidden_edges import ChosenWidth, TriedWidth
from orthomill.tasks.projection.tiles.output_colours import TileAtHand, TileReads
from orthomill.tasks.visibility.sight import PlaceSight

WIDTHS = (1.0, 2.0, 3.0, 5.0)
"""px of the photographs that are tried"""
UNTRIED = 3
"""the zone that is used where no photograph can be a witness"""
_SPACING = 4
"""px between places that are tried"""
_LEAST = 3
"""photographs that must see a place: a witness, and two that may disagree"""
_MOST = 32.0
"""grey levels that a difference counts at most: what passes before a witness says nothing of the others"""
_ENOUGH = 100
"""places that tell"""


class WidthTrial(BaseModel):
    """Sums over places and their witnesses: differences (grey levels) by width, none first, and products of each two of them."""

    model_config = ConfigDict(frozen=True)

    places: int
    differences: tuple[float, ...]
    products: tuple[tuple[float, ...], ...]


def try_widths(rules: ColourRules, **reads: Unpack[TileReads]) -> WidthTrial:
    """The trial of one tile of an output; as `colour_tile`, at some of its pixels."""
    chosen = (reads["sight"] >= PlaceSight.AT_BREAK).sum(axis=2) >= _LEAST
    rows, cols = (np.arange(side) % _SPACING == 0 for side in chosen.shape)
    return tried(TileAtHand.of(reads, chosen & rows[:, None] & cols).colours(rules), rules)


def tried(found: TileColours, rules: ColourRules) -> WidthTrial:
    """The trial of places (photographs, 1, N)."""
    seen = found.weights > 0
    # Where nobody is next to a limit all widths give the same.
    near = (found.zones > 0) & seen
    rows = [np.zeros((0, len(WIDTHS) + 1))]
    for k in range(len(found.weights)):
        rest = np.delete(seen, k, axis=0).sum(axis=0) >= _LEAST - 1
        at = (seen[k] & (found.zones[k] == 0) & near.any(axis=0) & rest)[0]
        if not at.any():
            continue
        others = TileColours(*(np.delete(values, k, axis=0)[:, :, at] for values in _arrays(found)))
        witness = found.colours[k][:, at]
        rows.append(np.column_stack([_apart(others, rules, zone, witness) for zone in range(len(WIDTHS) + 1)]))
    every = np.concatenate(rows)
    products = tuple(map(tuple, (every.T @ every).tolist()))
    return WidthTrial(places=len(every), differences=tuple(every.sum(axis=0).tolist()), products=products)


def _arrays(found: TileColours) -> tuple[np.ndarray, ...]:
    return found.colours, found.weights, found.breaks, found.zones


def _apart(others: TileColours, rules: ColourRules, zone: int, witness: np.ndarray) -> np.ndarray:
    """Differences (N,) of a blend from a witness, grey levels."""
    blended = others.blended(rules, zone)
    return np.asarray(np.minimum(np.abs(blended.colour - witness).mean(axis=2), _MOST), np.float64)[0]


def choose_width(trials: Iterable[WidthTrial]) -> ChosenWidth:
    """The width that serves all outputs best, from the trials of their tiles."""
    every = list(trials)
    places = sum(one.places for one in every)
    if places < _ENOUGH:
        return ChosenWidth(zone=UNTRIED, width=WIDTHS[UNTRIED - 1], places=places)
    mean = np.sum([one.differences for one in every], axis=0) / places
    product, best = np.sum([one.products for one in every], axis=0) / places, int(np.argmin(mean))
    worse = mean - mean[best]
    # Of the difference of two means, from the same places.
    square = np.diag(product) + product[best, best] - 2.0 * product[best] - worse**2
    error = np.sqrt(np.maximum(square, 0.0) / places)
    zone = int(np.flatnonzero(worse <= error)[0])
    rows = tuple(TriedWidth(width=width, difference=float(value)) for width, value in zip((0.0, *WIDTHS), mean, strict=True))
    return ChosenWidth(zone=zone, width=rows[zone].width, places=places, tried=rows)
