"""A drift that is tested is the one that would have been adjusted."""

from dataclasses import replace

import numpy as np
import pytest
from small_network import more_control, small_network, surveyed_noise

from orthomill.tasks.adjustment.model.network import NOT_SHIFTED
from orthomill.tasks.adjustment.solve.minimise import minimise
from orthomill.tasks.adjustment.testing.adjustment_result import AS_STATED
from orthomill.tasks.adjustment.testing.drift_test import drift_test
from orthomill.tasks.adjustment.testing.solution_precision import precise_solution


def solved(network, state, rays):
    state, _ = minimise(network, state.with_antenna(network), rays)
    return precise_solution(network, state, rays, np.ones(len(rays), bool), AS_STATED)


@pytest.fixture(scope="module")
def block():
    network, state, rays = small_network(3, photos=8, points=80, noise=1.0)
    network = surveyed_noise(more_control(network, 8), np.random.default_rng(3))
    return replace(network, shift=NOT_SHIFTED), state, rays


def test_the_test_gives_the_value_and_the_standard_error_of_an_unknown_without_adjusting_it(block):
    network, state, rays = block
    # An unknown that is 1 in some photographs and 0 in others is a shift, which the adjustment knows as an unknown.
    own = np.arange(8) < 3
    tested = drift_test(solved(network, state, rays), own.astype(float), np.where(own, 0, -1))
    adjusted = solved(replace(network, shift=np.where(own[:, None], np.arange(3), -1)), state, rays)
    assert tested.value[0] == pytest.approx(adjusted.state.shift, rel=0.01, abs=1e-4)
    assert tested.sigma[0] == pytest.approx(np.sqrt(adjusted.cofactor.variances[adjusted.network.shift_columns]), rel=0.01)


def test_a_planted_drift_is_found_in_its_flight_and_in_no_other(block):
    network, state, rays = block
    flight, moment = np.repeat([0, 1], 4), np.tile(np.linspace(-0.5, 0.5, 4), 2)
    drift = np.array([0.0, 0.0, 40.0]) / np.sqrt(network.centre_weight[0])
    moved = replace(network, centre=network.centre + np.where(flight[:, None] == 1, moment[:, None] * drift, 0.0))
    before, after = (drift_test(solved(each, state, rays), moment, flight) for each in (network, moved))
    assert after.value - before.value == pytest.approx(np.array([np.zeros(3), drift]), abs=0.02 * drift[2])
    assert (np.abs(before.value) < 4 * before.sigma).all() and after.value[1, 2] > 10 * after.sigma[1, 2]


def test_nothing_is_said_of_what_the_block_follows(block):
    network, state, rays = block
    # Without control a height of the one photograph is nobody else's.
    alone = replace(network, point_weight=np.zeros_like(network.point_weight))
    found = drift_test(solved(alone, state, rays), np.ones(8), np.zeros(8, np.int64))
    assert np.isnan(found.value).all(), "a shift of all positions shifts the block"
