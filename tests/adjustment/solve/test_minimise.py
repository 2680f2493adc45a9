"""Minimisation: exact data give the truth back, space resection and intersection among them; what is not determined is refused."""

from dataclasses import replace

import numpy as np
import pytest
from small_network import moved, small_network

from orthomill.schemas.errors import GeometryError
from orthomill.tasks.adjustment.model.collinearity import residual_lengths
from orthomill.tasks.adjustment.model.datum import prior_cost
from orthomill.tasks.adjustment.model.network import NOT_SHIFTED, Distances, common_shift
from orthomill.tasks.adjustment.solve.minimise import NotConverged, minimise
from orthomill.tasks.geometry.rotation_vector import rotation_of_vector

SHIFT = np.array([0.5, -0.3, 1.0])


def with_control(network, points=None, sigma=1e-6):
    """The network with (nearly) error-free control on the first points, and nothing known of the positions."""
    weight = np.zeros_like(network.point_weight)
    weight[:points] = 1 / sigma**2
    return replace(network, point_weight=weight, centre_weight=np.zeros_like(network.centre_weight), shift=NOT_SHIFTED)


@pytest.mark.parametrize("seed", range(4))
def test_space_resection_from_control_alone(seed):
    network, truth, rays = small_network(seed=seed, photos=1, points=8, interior_free=())
    start = replace(moved(truth, np.random.default_rng(seed), 8.0), point=truth.point)
    state, _ = minimise(with_control(network), start, rays)
    assert np.abs(state.centre - truth.centre).max() < 1e-6
    assert np.abs(state.rotation - truth.rotation).max() < 1e-8


@pytest.mark.parametrize("turn", [0.3, 0.6])
def test_resection_finds_large_rotations(turn):
    network, truth, rays = small_network(seed=1, photos=1, points=10, interior_free=())
    start = replace(truth, rotation=rotation_of_vector(np.array([0.1, 0.1, turn])) @ truth.rotation)
    state, iterations = minimise(with_control(network), start, rays)
    assert np.abs(state.rotation - truth.rotation).max() < 1e-8 and iterations < 30


def test_calibration_from_control_in_depth():
    network, truth, rays = small_network(photos=4, points=60, interior_free=(0, 1, 2, 3))
    network = with_control(network)
    network = replace(network, interior=replace(network.interior, weight=np.zeros((1, 8, 8))))
    start = replace(truth, interior=truth.interior + np.array([20.0, 3.0, -3.0, 0.02, 0, 0, 0, 0]))
    state, _ = minimise(network, start, rays)
    assert state.interior[0, :4] == pytest.approx(truth.interior[0, :4], rel=1e-6, abs=1e-5)
    assert (state.interior[0, 4:] == truth.interior[0, 4:]).all(), "what is not free keeps its value"


def test_a_distance_gives_a_free_block_its_scale():
    network, truth, rays = small_network(free=True, interior_free=())
    ends = np.array([[4, 17]])
    length = np.linalg.norm(truth.point[4] - truth.point[17])
    network = replace(network, kept=ends[0], distances=Distances(ends, np.array([length]), np.array([1e6])))
    start = replace(truth, centre=1.3 * truth.centre, point=1.3 * truth.point)
    state, _ = minimise(network, start, rays)
    for pair in ([0, 3], [1, 2]):
        found, true = (np.linalg.norm(s.centre[pair[0]] - s.centre[pair[1]]) for s in (state, truth))
        assert found == pytest.approx(true, rel=1e-6)


def test_the_shift_of_the_positions_is_separated_by_control():
    network, truth, rays = small_network(photos=4)
    network = replace(network, centre=network.centre + SHIFT, centre_weight=np.full((4, 3), 1e4))
    state, _ = minimise(network, truth, rays)
    assert state.shift == pytest.approx(SHIFT, abs=1e-3)
    rigid, _ = minimise(replace(network, shift=NOT_SHIFTED, point_weight=np.zeros_like(network.point_weight)), truth, rays)
    assert not rigid.shift.any() and rigid.centre - truth.centre == pytest.approx(np.tile(SHIFT, (4, 1)), abs=1e-3)


@pytest.mark.parametrize("receiver", [np.zeros(0, np.int64), np.array([0, 0, 0, 1, 1, 1])])
def test_the_lever_arm_of_each_receiver_is_estimated_from_rotated_photographs(receiver):
    network, truth, rays = small_network(photos=6, seed=2)
    lever = np.array([[0.4, -0.6, 0.3], [-0.2, 0.1, 0.5]])[: 1 + receiver.max(initial=0)]
    own = lever[receiver] if len(receiver) else np.tile(lever, (6, 1))
    antenna = truth.centre + np.einsum("pji,pj->pi", truth.rotation, own)
    network = replace(
        with_control(network),
        centre=antenna,
        centre_weight=np.full((6, 3), 1e6),
        lever=np.zeros_like(lever),
        lever_weight=np.full(3, 1e-2),
        receiver=receiver,
    )
    state, _ = minimise(network, truth.with_antenna(network), rays)
    assert state.lever == pytest.approx(lever, abs=1e-3)


def test_hubers_weights_limit_the_influence_of_a_wrong_position():
    network, truth, rays = small_network(photos=6, points=40)
    centre = network.centre.copy()
    centre[2] += [3.0, 0.0, 0.0]
    wrong = replace(network, centre=centre, shift=NOT_SHIFTED)
    plain, robust = (minimise(wrong, truth, rays, huber)[0] for huber in (np.inf, 2.0))
    pulled, kept = (np.linalg.norm(s.centre - truth.centre, axis=1).max() for s in (plain, robust))
    assert kept < 0.2 * pulled


def test_the_cost_never_rises():
    network, truth, rays = small_network(noise=1.0)
    start = moved(truth, np.random.default_rng(2), 3.0)
    costs = []
    for most in (1, 2, 3, 5):
        state, _ = minimise(network, start, rays, huber=1e6, most=most)
        costs.append(float((residual_lengths(network, state, rays) ** 2).sum()) + prior_cost(network, state))
    assert costs == sorted(costs, reverse=True)


def test_photographs_without_a_datum_are_refused():
    network, truth, rays = small_network(interior_free=())
    nothing = replace(
        network, centre_weight=np.zeros((4, 3)), point_weight=np.zeros_like(network.point_weight), shift=common_shift(4), free=False
    )
    with pytest.raises(GeometryError, match=r"not determined|did not converge"):
        minimise(nothing, moved(truth, np.random.default_rng(0), 1.0), rays)


def test_too_few_iterations_are_an_error_that_names_their_number():
    network, truth, rays = small_network()
    with pytest.raises(GeometryError, match="did not converge in 1 iterations"):
        minimise(network, moved(truth, np.random.default_rng(4), 4.0), rays, most=1)


def test_robust_solutions_may_end_early():
    network, truth, rays = small_network(noise=1.0)
    _, steps = minimise(network, moved(truth, np.random.default_rng(4), 4.0), rays, huber=2.0, most=2)
    assert steps == 2


def test_the_photograph_that_keeps_steps_short_is_named():
    network, truth, rays = small_network(photos=6, points=40, interior_free=())
    turned = truth.rotation.copy()
    turned[2] = rotation_of_vector(np.array([0.9, 0.5, 1.8])) @ turned[2]
    with pytest.raises(NotConverged) as failed:
        minimise(network, replace(truth, rotation=turned), rays, most=2)
    assert failed.value.photo == 2


def test_steps_that_pass_the_minimum_to_and_fro_are_shortened():
    """Positions that contradict the block by hundreds of standard errors bend the cost: whole steps take 16 iterations."""
    network, truth, rays = small_network(points=40, noise=1.0, interior_free=(0, 1, 2, 3))
    network = replace(network, centre=network.centre + np.random.default_rng(0).normal(0, 30.0, (2, 4, 3))[1])
    state, iterations = minimise(network, truth, rays, damping=0.0)
    sharp, _ = minimise(network, state, rays, damping=0.0)
    cost, least = (float((residual_lengths(network, s, rays) ** 2).sum()) + prior_cost(network, s) for s in (state, sharp))
    assert iterations <= 12 and 0 <= cost - least <= 0.01


def test_a_step_that_keeps_its_promise_needs_no_other_to_confirm_it():
    """As after every round of the blunder tests, which rejects a few rays of many."""
    network, truth, rays = small_network(photos=6, points=60, noise=1.0)
    before, _ = minimise(network, truth, rays)
    left = rays.take(np.arange(len(rays)) % 50 > 0)
    state, iterations = minimise(network, before, left, damping=0.0)
    cost = (residual_lengths(network, state, left) ** 2).sum() + prior_cost(network, state)
    sharp, _ = minimise(network, state, left, damping=0.0)
    least = (residual_lengths(network, sharp, left) ** 2).sum() + prior_cost(network, sharp)
    assert iterations == 1 and 0 <= cost - least <= 0.01
