"""Prior information on a block: residuals by hand, derivatives by differences, and the null space of a free network."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from small_network import moved, prior_alone, small_network

from orthomill.tasks.adjustment.model.datum import (
    distance_derivatives,
    distance_residuals,
    freedoms,
    position_derivatives,
    position_residuals,
    prior_cost,
    prior_factors,
    prior_sizes,
    vertical_residuals,
)
from orthomill.tasks.adjustment.model.network import Distances
from orthomill.tasks.geometry.rotation import rotation_matrix
from orthomill.tasks.geometry.rotation_vector import rotation_of_vector

ENDS = np.array([[5, 20], [6, 21], [5, 22]])


def with_everything(seed=0, receivers=1):
    """A block with GNSS, shift, lever arms, control, distances and verticality, away from its solution."""
    network, state, _ = small_network(seed=seed, interior_free=(0, 1, 3))
    length = np.linalg.norm(state.point[ENDS[:, 0]] - state.point[ENDS[:, 1]], axis=1)
    network = replace(
        network,
        kept=np.unique(ENDS),
        distances=Distances(ENDS, length, np.array([1e4, 4e4, 0.0])),
        lever=np.array([[0.3, -0.2, 0.5], [0.1, 0.2, -0.4]])[:receivers],
        receiver=np.arange(network.photos) % receivers,
        lever_weight=np.full(3, 400.0),
        vertical_weight=np.full(network.photos, 900.0),
        shift_weight=np.array([4.0, 0.0, 9.0]),
    )
    return network, replace(moved(state, np.random.default_rng(seed), 0.3), lever=network.lever + 0.1)


def stepped(network, state, column, step):
    """The state with one unknown of the reduced system changed."""
    correction = np.zeros(network.unknowns)
    correction[column] = step
    photo = correction[: 6 * network.photos].reshape(-1, 6)
    interior, point = state.interior.copy(), state.point.copy()
    interior[network.interior.free] += correction[network.interior_columns[network.interior.free]]
    point[network.kept] += correction[network.kept_columns]
    return replace(
        state,
        rotation=np.array([rotation_of_vector(w) @ R for w, R in zip(photo[:, 3:], state.rotation, strict=True)]),
        centre=state.centre + photo[:, :3],
        interior=interior,
        point=point,
        shift=state.shift + correction[network.shift_columns],
        lever=state.lever + correction[network.lever_columns],
    )


@pytest.mark.parametrize("receivers", [1, 2])
@pytest.mark.parametrize("seed", range(3))
def test_the_right_hand_side_is_half_the_negative_slope_of_the_cost(seed, receivers):
    network, state = with_everything(seed, receivers)
    _, right = prior_alone(network, state)
    for column in range(network.unknowns):
        ahead, behind = (prior_cost(network, stepped(network, state, column, step)) for step in (1e-6, -1e-6))
        assert right[column] == pytest.approx(-(ahead - behind) / 4e-6, rel=1e-4, abs=1e-3), column


def test_the_prior_matrix_is_the_curvature_of_linear_observations():
    network, state = with_everything()
    matrix, _ = prior_alone(network, state)
    for columns, weight in ((network.lever_columns[0], 400.0), (network.interior_columns[0, [0, 1, 3]], None)):
        for column in columns:
            cost = [prior_cost(network, stepped(network, state, int(column), step)) for step in (-1e-3, 0.0, 1e-3)]
            curvature = (cost[0] - 2 * cost[1] + cost[2]) / 2e-6
            assert matrix[column, column] == pytest.approx(curvature, rel=1e-3)
            assert weight is None or matrix[column, column] == pytest.approx(weight + 4 * 100.0)


def test_the_antenna_is_at_the_centre_plus_lever_arm_plus_shift():
    network, state, _ = small_network()
    lever, shift = np.array([1.0, 2.0, 3.0]), np.array([0.1, 0.2, 0.3])
    state = replace(state, lever=lever[None], shift=shift)
    expected = network.centre - state.centre - [R.T @ lever for R in state.rotation] - shift
    assert position_residuals(network, state) == pytest.approx(expected)
    nothing = replace(network, centre_weight=np.zeros_like(network.centre_weight))
    assert not position_residuals(nothing, state).any()


def test_antenna_positions_depend_on_rotations_only_with_a_lever_arm():
    network, state, _ = small_network()
    photos = np.arange(network.photos)
    J, columns = position_derivatives(network, state, photos)
    assert J.shape == (4, 3, 6) and (columns[:, 3:] == network.shift_columns).all()
    J, columns = position_derivatives(network, replace(state, lever=np.array([[0.0, 0.0, 1.0]])), photos)
    assert J.shape == (4, 3, 9) and (columns[1, 3:6] == [9, 10, 11]).all()


@settings(max_examples=25, deadline=None)
@given(tilt=st.floats(0.0, 1.5), direction=st.floats(0.0, 6.3), kappa=st.floats(-3.0, 3.0))
def test_the_vertical_residual_is_the_sine_of_the_tilt(tilt, direction, kappa):
    network, state, _ = small_network()
    tilted = rotation_of_vector(tilt * np.array([np.cos(direction), np.sin(direction), 0.0]))
    rotation = np.tile(rotation_matrix(0.0, 0.0, kappa) @ tilted, (network.photos, 1, 1))
    length = np.linalg.norm(vertical_residuals(network, replace(state, rotation=rotation)), axis=1)
    assert length == pytest.approx(np.full(network.photos, np.sin(tilt)), abs=1e-12)


def test_a_photograph_that_looks_at_the_horizon_agrees_with_its_expected_up_direction():
    network, state, _ = small_network()
    level = np.array([[1.0, 0, 0], [0, 0, 1.0], [0, -1.0, 0]])
    network = replace(network, up=np.array([0.0, 1.0, 0.0]))
    assert not vertical_residuals(network, replace(state, rotation=np.tile(level, (4, 1, 1)))).any()


def test_distances_and_their_derivatives():
    network, state = with_everything()
    exact = replace(state, point=state.point.copy())
    exact.point[20] = exact.point[5] + [3.0, 0.0, 4.0]
    assert distance_residuals(network, exact)[0] == pytest.approx(network.distances.length[0] - 5.0)
    J, columns = distance_derivatives(network, exact)
    assert J[0] == pytest.approx([-0.6, 0, -0.8, 0.6, 0, 0.8])
    assert (columns[0] == network.kept_columns[np.searchsorted(network.kept, [5, 20])].ravel()).all()


def test_coincident_ends_give_no_direction_and_no_nan():
    network, state = with_everything()
    state.point[20] = state.point[5]
    J, _ = distance_derivatives(network, state)
    assert not J[0].any() and np.isfinite(J).all()


def test_sizes_are_in_standard_errors_and_zero_without_weight():
    network, state, _ = small_network()
    state = replace(state, centre=state.centre - [0.3, 0.4, 0.0], point=state.point + 0.02 * np.eye(3)[1])
    size = prior_sizes(network, state)
    assert size.centre == pytest.approx(np.full(4, 5.0))
    assert size.point[:4] == pytest.approx(np.full(4, 1.0)) and not size.point[4:].any()
    assert size.distance.shape == (0,)


def test_robust_factors_weigh_a_position_as_a_whole():
    network, state, _ = small_network()
    network = replace(network, centre=network.centre + np.outer([0, 0, 0, 1], [3.0, 0.0, 0.0]))
    factors = prior_factors(network, state, 2.0)
    assert factors.centre == pytest.approx([1, 1, 1, 2.0 / 30.0]) and (factors.point == 1.0).all()
    assert (prior_factors(network, state, np.inf).centre == 1.0).all()
    assert prior_cost(network, state, 2.0) == pytest.approx(2 * 2 * 30 - 4)


@pytest.mark.parametrize(("weight", "count"), [(1e4, 6), (0.0, 7)])
def test_the_freedoms_move_distances_by_scale_alone(weight, count):
    network, state, _ = small_network(free=True, interior_free=())
    network = replace(network, kept=np.unique(ENDS), distances=Distances(ENDS, np.ones(3), np.full(3, weight)))
    H = freedoms(network, state)
    J, columns = distance_derivatives(network, state)
    change = np.array([row @ H[at] for row, at in zip(J, columns, strict=True)])
    assert H.shape == (network.unknowns, count) and np.linalg.matrix_rank(H) == count
    assert np.abs(change[:, :6]).max() < 1e-9
    if count == 7:
        lengths = np.linalg.norm(state.point[ENDS[:, 0]] - state.point[ENDS[:, 1]], axis=1)
        assert change[:, 6] == pytest.approx(lengths)
