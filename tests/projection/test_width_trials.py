"""How wide the zone next to hidden surface is: chosen by photographs that take no part, and nothing where nothing is gained."""

from dataclasses import replace

import numpy as np
import pytest

from orthomill.tasks.colouring.blending.blending import Blend
from orthomill.tasks.colouring.blending.colour_rules import ColourRules
from orthomill.tasks.colouring.blending.rejection import Rejection
from orthomill.tasks.colouring.blending.surface_colours import TileColours
from orthomill.tasks.projection.tiles.width_trials import UNTRIED, WIDTHS, WidthTrial, choose_width, tried

RULES = ColourRules(0.0, Blend(Rejection("none")), breaks=False)


def places(wrong_within: int, count: int = 900, photographs: int = 5) -> TileColours:
    """Noisy grey values of places; half of the values lie in a zone, and those of the first `wrong_within` zones are of something
    else."""
    rng = np.random.default_rng(4)
    truth = rng.uniform(80, 160, (1, 1, count, 1))
    zones = rng.integers(1, len(WIDTHS) + 1, (photographs, 1, count)) * (rng.random((photographs, 1, count)) < 0.5)
    colours = truth + rng.normal(0, 8, (photographs, 1, count, 1))
    colours[(zones > 0) & (zones <= wrong_within)] += 45.0
    return TileColours(
        colours.astype(np.float32), np.ones(zones.shape, np.float32), np.zeros(zones.shape, bool), zones.astype(np.uint8)
    )


@pytest.mark.parametrize("wrong", range(len(WIDTHS) + 1))
def test_the_zone_is_as_wide_as_its_colours_are_wrong_and_no_wider(wrong):
    chosen = choose_width([tried(places(wrong), RULES)])
    assert chosen.zone == wrong and chosen.width == (0.0, *WIDTHS)[wrong]
    assert [one.width for one in chosen.tried] == [0.0, *WIDTHS]
    assert min(chosen.tried, key=lambda one: one.difference).width == chosen.width


def test_without_witnesses_the_usual_width_is_used():
    near = replace(places(2), zones=np.ones((5, 1, 900), np.uint8))
    assert choose_width([tried(near, RULES)]).zone == UNTRIED
    # Two photographs: one of them as a witness leaves nothing to choose from.
    pair = TileColours(*(values[:2] for values in (near.colours, near.weights, near.breaks, places(2).zones)))
    assert choose_width([tried(pair, RULES)]).width == WIDTHS[UNTRIED - 1]


def trial(rows: np.ndarray) -> WidthTrial:
    """From differences (places, widths)."""
    products = tuple(map(tuple, (rows.T @ rows).tolist()))
    return WidthTrial(places=len(rows), differences=tuple(rows.sum(axis=0).tolist()), products=products)


def test_a_gain_by_chance_widens_nothing():
    rows, rng = np.full((400, len(WIDTHS) + 1), 20.0), np.random.default_rng(2)
    change = rng.normal(0, 1, 400)
    rows[:, 1] += change - change.mean() - 0.04
    assert choose_width([trial(rows)]).zone == 0
    rows[:, 1] -= 0.04
    assert choose_width([trial(rows)]).zone == 1
    # A wider one that is hardly better is not worth the colours that it takes away.
    rows[:, 3] = rows[:, 1] + change - change.mean() - 0.04
    assert choose_width([trial(rows)]).zone == 1


def test_trials_of_tiles_count_by_their_places():
    few, many = np.full((200, len(WIDTHS) + 1), 20.0), np.full((2000, len(WIDTHS) + 1), 4.0)
    few[:, 1], many[:, 2] = 15.0, 2.5
    assert choose_width([trial(few)]).zone == 1
    assert choose_width([trial(few), trial(many)]).zone == 2
