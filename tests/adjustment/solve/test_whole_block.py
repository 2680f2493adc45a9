"""The similarity transformation of a block onto what is known of it."""

from dataclasses import replace

import numpy as np
import pytest
from small_network import small_network

from orthomill.tasks.adjustment.model.collinearity import residuals
from orthomill.tasks.adjustment.model.datum import prior_cost
from orthomill.tasks.adjustment.model.network import NOT_SHIFTED, Distances
from orthomill.tasks.adjustment.solve.whole_block import fitted_whole
from orthomill.tasks.geometry.rotation_vector import rotation_of_vector


def transformed(state, turn=(0.0, 0.0, 0.0), scale=1.0, shift=(0.0, 0.0, 0.0)):
    R = rotation_of_vector(np.array(turn))
    return replace(
        state, rotation=state.rotation @ R.T, centre=scale * state.centre @ R.T + shift, point=scale * state.point @ R.T + shift
    )


@pytest.mark.parametrize("turn", [(0.02, -0.03, 0.05), (0.4, 0.3, -0.8), (0.0, 0.0, 2.5)])
def test_a_transformed_block_returns_to_its_positions_and_control(turn):
    network, truth, _ = small_network(photos=6, seed=3)
    state = fitted_whole(network, transformed(truth, turn, 1.4, (30.0, -20.0, 5.0)))
    assert np.abs(state.centre - truth.centre).max() < 1e-6
    assert np.abs(state.point - truth.point).max() < 1e-6
    assert np.abs(state.rotation - truth.rotation).max() < 1e-8


def test_residuals_of_rays_do_not_change():
    network, truth, rays = small_network(photos=6, noise=1.0)
    start = transformed(truth, (0.1, 0.1, 0.1), 0.8, (5.0, 5.0, 5.0))
    state = fitted_whole(network, start)
    before, after = (residuals(s, rays, network.camera_of) for s in (start, state))
    assert np.allclose(before, after, atol=1e-7) and prior_cost(network, state) < prior_cost(network, start)


def test_a_free_network_is_left_as_it_is():
    network, truth, _ = small_network(free=True)
    start = transformed(truth, (0.1, 0.1, 0.1), 0.8)
    assert fitted_whole(network, start) is start


def test_a_block_at_its_optimum_is_left_as_it_is():
    network, truth, _ = small_network()
    assert fitted_whole(network, truth) is truth


def test_what_is_not_determined_stays():
    network, truth, _ = small_network(photos=4)
    height = replace(
        network,
        centre_weight=network.centre_weight * [0, 0, 1],
        point_weight=np.zeros_like(network.point_weight),
        shift=NOT_SHIFTED,
    )
    state = fitted_whole(height, transformed(truth, shift=(3.0, 4.0, 5.0)))
    assert state.centre[:, 2] == pytest.approx(truth.centre[:, 2], abs=1e-6)
    assert state.centre[:, :2] == pytest.approx(truth.centre[:, :2] + [3.0, 4.0], abs=1e-6), "the smallest motion"


def test_verticality_turns_a_block_upright():
    network, truth, _ = small_network(photos=4)
    level = replace(truth, rotation=np.tile(np.eye(3), (4, 1, 1)))
    vertical = replace(
        network, centre_weight=np.zeros((4, 3)), point_weight=np.zeros_like(network.point_weight), vertical_weight=np.full(4, 1e4)
    )
    state = fitted_whole(vertical, transformed(level, (0.2, -0.1, 0.0)))
    assert np.abs(state.rotation[:, :, 2] - [0, 0, 1]).max() < 1e-8


def test_a_wrong_position_counts_less_with_hubers_weights():
    network, truth, _ = small_network(photos=6, seed=1)
    centre = network.centre.copy()
    centre[0] += [20.0, 0.0, 0.0]
    wrong = replace(network, centre=centre, point_weight=np.zeros_like(network.point_weight), shift=NOT_SHIFTED)
    plain, robust = (fitted_whole(wrong, transformed(truth, shift=(1.0, 0.0, 0.0)), huber) for huber in (np.inf, 2.0))
    away = [np.abs(s.centre - truth.centre).max() for s in (plain, robust)]
    assert away[1] < 0.5 * away[0]


def test_a_distance_between_points_that_nobody_surveyed_scales_a_block():
    network, truth, _ = small_network(photos=4)
    length = float(np.linalg.norm(truth.point[5] - truth.point[2]))
    measured = replace(
        network,
        centre_weight=np.zeros((4, 3)),
        point_weight=np.zeros_like(network.point_weight),
        distances=Distances(np.array([[2, 5]]), np.array([length]), np.array([1e4])),
        shift=NOT_SHIFTED,
    )
    state = fitted_whole(measured, transformed(truth, scale=1.3))
    assert np.linalg.norm(state.point[5] - state.point[2]) == pytest.approx(length, abs=1e-6)
    assert np.linalg.norm(state.centre[3] - state.centre[0]) == pytest.approx(
        np.linalg.norm(truth.centre[3] - truth.centre[0]), abs=1e-6
    )
