"""The redundancy of a group of observations lies between 0 and their number, whatever is known, stated or only considered."""

from dataclasses import replace

import numpy as np
import pytest
from small_network import more_control, small_network, surveyed_noise

from orthomill.tasks.adjustment.bundle import adjust
from orthomill.tasks.adjustment.model.network import NOT_SHIFTED, Distances, common_shift
from orthomill.tasks.adjustment.solve.minimise import minimise
from orthomill.tasks.adjustment.testing.adjustment_result import AS_STATED, Group, ObservationKind
from orthomill.tasks.adjustment.testing.solution_precision import precise_solution
from orthomill.tasks.adjustment.testing.surveyed_blunders import surveyed_blunder
from orthomill.tasks.adjustment.testing.variance_components import estimated_factors, position_covariances

ENDS = np.array([[20, 24], [21, 25], [22, 26]])


def random_block(seed):
    """A block with any precision of positions, control and distances, and with interior parameters that are considered or not."""
    rng = np.random.default_rng(seed)
    network, state, rays = small_network(seed, photos=int(rng.integers(3, 8)), points=30, noise=1.0)
    network = more_control(network, int(rng.integers(0, 8)))
    size = 10.0 ** rng.uniform(-2, 1.5, 3)
    network = replace(
        network,
        centre_weight=np.full_like(network.centre_weight, 1 / size[0] ** 2),
        point_weight=network.point_weight * 0.02**2 / size[1] ** 2,
        shift=common_shift(network.photos) if rng.random() < 0.3 and network.point_weight.any(axis=1).sum() > 2 else NOT_SHIFTED,
    )
    if rng.random() < 0.5:
        length = np.linalg.norm(state.point[ENDS[:, 0]] - state.point[ENDS[:, 1]], axis=1)
        network = replace(network, kept=np.unique(ENDS), distances=Distances(ENDS, length, np.full(3, 1 / size[2] ** 2)))
    if rng.random() < 0.7:
        considered = network.interior.free & (np.arange(8) < 2)
        # A nominal camera: five per cent of the constant, as a millimetre would change the heights of every position.
        weight = network.interior.weight.copy()
        weight[0, [0, 1], [0, 1]] = 1 / np.array([50.0, 15.0]) ** 2
        network = replace(network, interior=replace(network.interior, considered=considered, weight=weight))
    network = surveyed_noise(network, rng)
    return network, state.with_antenna(network), rays


def solved(network, state, rays):
    state, _ = minimise(network, state, rays)
    return precise_solution(network, state, rays, np.ones(len(rays), bool), AS_STATED)


@pytest.mark.parametrize("seed", range(24))
def test_redundancies_of_random_blocks_are_within_their_bounds_and_sum_to_that_of_the_block(seed):
    result = solved(*random_block(seed))
    _, groups = estimated_factors(result)
    for group in groups:
        assert 0.0 <= group.redundancy <= group.count, group
    total, priors = sum(group.redundancy for group in groups), int(result.network.interior.free.sum())
    assert result.redundancy - priors - 0.01 <= total <= result.redundancy + 0.01


def considered_camera(sigma=0.02):
    network, state, rays = small_network(3, photos=6, points=60, noise=0.3, interior_free=(0, 1))
    weight = network.interior.weight.copy()
    weight[0, [0, 1], [0, 1]] = 1 / np.array([50.0, 15.0]) ** 2
    interior = replace(network.interior, considered=network.interior.free.copy(), weight=weight)
    nothing = np.zeros_like(network.point_weight)
    centre_weight = np.full_like(network.centre_weight, 1 / sigma**2)
    network = replace(network, interior=interior, point_weight=nothing, centre_weight=centre_weight, shift=NOT_SHIFTED)
    return network, state.with_antenna(network), rays


def test_a_nominal_camera_does_not_take_redundancy_from_precise_positions():
    """The covariance of what a nominal camera may be wrong by is no part of the projection that redundancy numbers are."""
    result = solved(*considered_camera())
    of_all = position_covariances(result, np.arange(6))
    assert (np.diagonal(of_all, axis1=1, axis2=2) / 0.02**2).sum() > 18, "with it the positions would have less than none"
    (positions,) = [group for group in estimated_factors(result)[1] if group.name == ObservationKind.POSITIONS]
    assert 0 < positions.redundancy < 18


def test_positions_that_a_nominal_camera_explains_are_no_blunders():
    network, state, rays = considered_camera(sigma=0.02)
    # A principal point that is off by a standard error tilts the photographs; along the flight that moves no position alike.
    values = network.interior.value.copy()
    values[0, :2] += [40.0, 12.0]
    wrong = replace(network, interior=replace(network.interior, value=values))
    assert surveyed_blunder(solved(wrong, replace(state, interior=values), rays), 4.0) is None
    centre = network.centre.copy()
    centre[2] += [3.0, 0.0, 0.0]
    found = surveyed_blunder(solved(replace(network, centre=centre), state, rays), 4.0)
    assert found is not None and found.number == 2


@pytest.mark.parametrize(
    ("constant_px", "worse", "least", "most"),
    [(-60.0, 1.0, 1.0, 1.5), (90.0, 1.0, 1.0, 3.0), (0.0, 5.0, 3.5, 7.0), (90.0, 5.0, 3.5, 8.0)],
)
def test_a_receiver_is_blamed_for_its_own_errors_and_not_for_a_wrong_nominal_constant(constant_px, worse, least, most):
    """The constant of 1000 px is nominal, to 5 per cent; stated positions are good to 2 cm, and 6 or 9 per cent move them by far
    more. Without what the camera explains, the factors of the first two would be 15 and 21."""
    network, state, rays = considered_camera(sigma=0.02)
    network = surveyed_noise(network, np.random.default_rng(0), position=worse)
    values = network.interior.value + np.eye(8)[[0]] * constant_px
    wrong = replace(network, interior=replace(network.interior, value=values))
    result = adjust(wrong, replace(state, interior=values), rays)
    assert least <= max(result.factors.position) <= most and result.blunders == ()


def test_the_whole_adjustment_reports_redundancies_within_their_bounds():
    for group in adjust(*considered_camera()).groups:
        assert 0.0 <= group.redundancy <= group.count


@pytest.mark.parametrize("redundancy", [-163.2, 61.0, float("nan")])
def test_a_redundancy_out_of_its_bounds_stops_the_program(redundancy):
    with pytest.raises(ArithmeticError, match="an error of the program"):
        Group(ObservationKind.POSITIONS, 60, redundancy, 1.0)
