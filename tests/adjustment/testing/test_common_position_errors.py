"""Positions that share an error place a block no better than one of them does."""

from dataclasses import replace

import numpy as np
import pytest
from small_network import small_network

from orthomill.tasks.adjustment.model.common_position_errors import with_common_errors
from orthomill.tasks.adjustment.model.network import NOT_SHIFTED
from orthomill.tasks.adjustment.solve.minimise import minimise
from orthomill.tasks.adjustment.testing.control_in_block import control_in_block

GNSS = 3.0
"""m"""


@pytest.fixture(scope="module")
def block():
    network, state, rays = small_network(1, photos=6, points=60, noise=1.0)
    weight = np.full_like(network.centre_weight, 1 / GNSS**2)
    network = replace(network, shift=NOT_SHIFTED, centre_weight=weight)
    return network, state.with_antenna(network), rays


def height_variance(network, state, rays):
    """m^2: how well the block without its control knows the mean height of the control points"""
    state, _ = minimise(network, state, rays)
    _, equations = control_in_block(network, state, rays, network.point_weight)
    mean = np.tile([0.0, 0.0, 1.0 / equations.points], equations.points)
    return float(mean @ np.linalg.solve(equations.normal, mean))


def test_control_is_compared_with_positions_to_what_these_have_in_common(block):
    network, state, rays = block
    independent = height_variance(network, state, rays)
    assert height_variance(*with_common_errors(network, state), rays) == pytest.approx(independent + GNSS**2, rel=0.05)


def test_each_group_and_coordinate_has_its_own_error_of_its_own_size(block):
    network, state, _ = block
    weight = network.centre_weight.copy()
    weight[:, 2] /= 4.0
    weight[3:] /= 100.0
    weight[5, 0] = 0.0
    network, state = with_common_errors(replace(network, centre_weight=weight, gnss_group=np.array([0, 0, 0, 1, 1, 1])), state)
    assert network.shift.tolist() == [[0, 1, 2]] * 3 + [[3, 4, 5]] * 2 + [[-1, 4, 5]]
    assert 1 / np.sqrt(network.shift_weight) == pytest.approx(GNSS * np.array([1, 1, 2, 10, 10, 20]))
    assert state.shift.tolist() == [0.0] * 6


def test_shifts_that_are_unknowns_already_and_blocks_without_positions_stay_as_they_are(block):
    network, state, _ = block
    once = with_common_errors(network, state)
    assert with_common_errors(*once) == once
    bare = replace(network, centre_weight=np.zeros_like(network.centre_weight))
    assert with_common_errors(bare, state) == (bare, state)
