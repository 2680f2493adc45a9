"""Two points of the control whose names were exchanged are found, also where the photographs would otherwise look up from below."""

from itertools import combinations

import numpy as np
import pytest
from surveyed_model import GROUND, SITE, block

from orthomill.tasks.orientation.start.exchanged_points import exchanged_points, without_exchanged

FLAT = np.array([[0, 0, 1.0], [90, 0, 1.2], [90, 70, 0.9], [0, 70, 1.1], [35, 20, 1.0]])


def exchanged(ground, pair, noise=0.02):
    """The model and what is known, with the coordinates of two points exchanged."""
    model, known = block(control=ground)
    known.control[:] += np.random.default_rng(4).normal(0, noise, ground.shape)
    known.control[list(pair)] = known.control[list(pair)[::-1]]
    return model, known


@pytest.mark.parametrize("pair", list(combinations(range(5), 2)))
@pytest.mark.parametrize("ground", [GROUND, FLAT], ids=["rolling", "flat"])
def test_every_pair_is_found(ground, pair):
    found = exchanged_points(*exchanged(ground, pair))
    assert (found.first, found.second) == pair and found.exchanged_m < 0.2


KITE = np.array([[50, 70, 1.0], [50, 10, 1.0], [20, 40, 1.0], [110, 40, 1.0]])
SQUARE = np.array([[10, 10, 1.0], [70, 10, 1.0], [70, 70, 1.0], [10, 70, 1.0]])


def test_a_mirrored_figure_shows_the_ground_from_below():
    # The reflection of a flat figure is a rotation of it in space, so that it fits as given.
    found = exchanged_points(*exchanged(KITE, (0, 1)))
    assert (found.first, found.second) == (0, 1) and found.given_m is None


def test_which_corners_of_a_square_are_exchanged_cannot_be_told():
    assert exchanged_points(*exchanged(SQUARE, (0, 2))) is None


@pytest.mark.parametrize("seed", range(20))
def test_points_in_order_are_left_alone(seed):
    model, known = block(control=GROUND)
    rng = np.random.default_rng(seed)
    # One typing error, or a survey that is worse than it says.
    known.control[rng.integers(5)] += rng.normal(0, 10, 3)
    assert exchanged_points(model, known) is None
    model, known = block(control=GROUND)
    known.control[:] += rng.normal(0, 2, known.control.shape)
    assert exchanged_points(model, known) is None


def test_three_points_tell_nothing():
    assert exchanged_points(*exchanged(GROUND[:3], (0, 1))) is None


def test_exchanged_points_are_left_out_of_the_model():
    model, known = exchanged(GROUND, (1, 3))
    kept = without_exchanged(known, exchanged_points(model, known))
    assert kept.placed.tolist() == [True, False, True, False, True] and known.placed.all()
    np.testing.assert_allclose(kept.control - SITE, GROUND[[0, 3, 2, 1, 4]], atol=0.1)
