"""Tests of positions, control and distances: the quadratic form against textbook statistics, and the rules of rejection."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2, norm
from small_network import dense, more_control, small_network, surveyed_noise

from orthomill.tasks.adjustment.bundle import adjust
from orthomill.tasks.adjustment.model.network import NOT_SHIFTED
from orthomill.tasks.adjustment.model.surveyed_observations import Blunder, SurveyedKind, without
from orthomill.tasks.adjustment.solve.minimise import minimise
from orthomill.tasks.adjustment.testing.adjustment_result import AS_STATED
from orthomill.tasks.adjustment.testing.solution_precision import precise_solution
from orthomill.tasks.adjustment.testing.surveyed_blunders import (
    CLEAR,
    _misfits,
    is_outlier,
    largest_square,
    surveyed_blunder,
    usual_misfit,
    with_reinstated,
    worst_of,
)

CONTROL, POSITION, DISTANCE = SurveyedKind


def solved(network, state, rays):
    state, _ = minimise(network, state, rays)
    return precise_solution(network, state, rays, np.ones(len(rays), bool), AS_STATED)


@pytest.fixture(scope="module")
def good():
    """A block with 12 control points and 8 positions, all as precise as stated."""
    network, state, rays = small_network(seed=5, photos=8, points=60, noise=1.0)
    return surveyed_noise(more_control(network, 12), np.random.default_rng(5)), state, rays


@pytest.mark.parametrize("limit", [2.0, 3.29, 4.0])
@pytest.mark.parametrize("dof", [1, 2, 3])
def test_the_limit_of_the_square_is_exceeded_as_rarely_as_the_normal_one(limit, dof):
    assert chi2.sf(largest_square(limit, dof), dof) == pytest.approx(2 * norm.sf(limit))


def test_one_number_has_the_limit_itself():
    assert float(largest_square(3.0, 1)) == pytest.approx(9.0)


def test_misfits_of_control_are_the_quadratic_forms_of_dense_algebra(good):
    network, state, rays = good
    result = solved(network, state, rays)
    _, normal, _ = dense(network, result.state, rays)
    Q, n = np.linalg.inv(normal), network.unknowns
    number, square, dof, _ = _misfits(result, CONTROL)
    assert list(number) == list(range(12)) and (dof == 3).all()
    for i in number[::3]:
        place = n + 3 * i + np.arange(3)
        v = network.point[i] - result.state.point[i]
        Qvv = np.diag(1 / network.point_weight[i]) - Q[np.ix_(place, place)]
        assert square[i] == pytest.approx(v @ np.linalg.solve(Qvv, v), rel=1e-4)


def test_misfits_of_positions_are_those_of_the_antennas(good):
    network, state, rays = good
    result = solved(replace(network, shift=NOT_SHIFTED), state, rays)
    number, square, dof, _ = _misfits(result, POSITION)
    Q = result.cofactor.joint(np.arange(3))
    v = network.centre[0] - result.state.centre[0]
    assert list(number) == list(range(8)) and (dof == 3).all()
    assert square[0] == pytest.approx(v @ np.linalg.solve(0.1**2 * np.eye(3) - Q, v), rel=1e-6)


def test_a_coordinate_that_defines_the_datum_is_not_tested():
    network, state, rays = small_network(photos=4, noise=1.0)
    weight = np.zeros_like(network.point_weight)
    weight[:3] = 1e4
    # Seven coordinates hold the datum alone: none of them is checked by another.
    weight[1, 2] = weight[2, 0] = 0.0
    minimal = replace(network, point_weight=weight, centre_weight=np.zeros((4, 3)), shift=NOT_SHIFTED)
    _, _, dof, _ = _misfits(solved(minimal, state, rays), CONTROL)
    assert not dof.any()
    assert surveyed_blunder(solved(minimal, state, rays), 3.0) is None


@pytest.mark.parametrize("kind", [CONTROL, POSITION])
def test_a_blunder_is_named_and_the_others_are_not(good, kind):
    network, state, rays = good
    assert surveyed_blunder(solved(network, state, rays), 4.0) is None
    name = "point" if kind == CONTROL else "centre"
    values = getattr(network, name).copy()
    values[3] += [0.5, -0.5, 0.5] if kind == CONTROL else [3.0, 2.0, -3.0]
    found = surveyed_blunder(solved(replace(network, **{name: values}), state, rays), 4.0)
    assert found is not None and (found.kind, found.number) == (kind, 3) and found.misfit > 4.0


def test_optimistic_standard_errors_make_no_blunders_of_good_points(good):
    network, state, rays = good
    optimistic = replace(network, point_weight=network.point_weight * 15.0**2)
    result = solved(optimistic, state, rays)
    assert surveyed_blunder(result, 3.0, by_group=False) is not None, "each of them contradicts its own standard error"
    assert surveyed_blunder(result, 4.0) is None


def test_a_wrong_pointing_does_not_blame_the_coordinates(good):
    network, state, rays = good
    own = np.flatnonzero(rays.point == 4)
    xy = rays.xy.copy()
    xy[own[0]] += 60.0
    found = surveyed_blunder(solved(network, state, replace(rays, xy=xy)), 4.0)
    assert found is None or found.number != 4


@pytest.mark.parametrize(("shift", "expected"), [(0.0, False), (1.0, True)])
def test_an_observation_outside_the_solution_is_predicted_by_it(good, shift, expected):
    network, state, rays = good
    point = network.point.copy()
    point[5] += shift
    given = replace(network, point=point)
    blunder = Blunder(CONTROL, 5, 9.0)
    rest = solved(without(given, blunder), state, rays)
    assert is_outlier(rest, given, blunder, 4.0) == expected
    back = with_reinstated(rest.network, rest, (blunder,), given, 4.0)
    assert back.point_weight[5].any() != expected
    assert (back is rest.network) == expected


def test_a_point_that_the_block_does_not_determine_is_not_reinstated(good):
    network, state, rays = good
    blunder = Blunder(CONTROL, 5, 9.0)
    rest = solved(without(network, blunder), state, rays.take(rays.point != 5))
    assert with_reinstated(rest.network, rest, (blunder,), network, 4.0) is rest.network


@pytest.mark.parametrize(
    ("misfits", "left", "named"),
    [((9.0,), 12, True), ((9.0, 8.9), 12, True), ((9.0, 8.9), 4, False), ((9.0, 9.0 / CLEAR - 0.1), 4, True), ((9.0,), 2, False)],
)
def test_the_worst_is_rejected_if_the_rest_holds_the_block(misfits, left, named):
    network, _, _ = small_network(photos=4)
    weight = np.zeros_like(network.point_weight)
    weight[: left + 1] = 1.0
    network = replace(network, point_weight=weight, centre_weight=np.zeros((4, 3)))
    found = worst_of(network, [Blunder(CONTROL, i, misfit) for i, misfit in enumerate(misfits)])
    assert (found is not None and found.number == 0) if named else found is None


def test_a_distance_is_rejected_from_a_controlled_block_without_asking_for_others():
    network, _, _ = small_network(photos=4)
    assert worst_of(network, [Blunder(DISTANCE, 0, 5.0)]) == Blunder(DISTANCE, 0, 5.0)
    assert worst_of(replace(network, free=True), [Blunder(DISTANCE, 0, 5.0)]) is None, "it gives a free block its scale"
    assert worst_of(network, []) is None


def test_the_usual_misfit_of_good_points_is_one_and_needs_four_of_them():
    lengths = np.linalg.norm(np.random.default_rng(0).standard_normal((4000, 3)), axis=1)
    assert usual_misfit(lengths) == pytest.approx(1.0, rel=0.03)
    assert usual_misfit(3.0 * lengths) == pytest.approx(3.0, rel=0.03)
    assert usual_misfit(np.full(3, 50.0)) == 1.0 and usual_misfit(0.1 * lengths) == 1.0


def test_squares_of_good_control_follow_chi_squared():
    network, state, rays = small_network(seed=5, photos=8, points=60)
    squares = []
    for seed in range(8):
        rng = np.random.default_rng(100 + seed)
        noisy = replace(rays, xy=rays.xy + rays.sigma[:, None] * rng.standard_normal(rays.xy.shape))
        result = solved(surveyed_noise(more_control(network, 12), rng), state, noisy)
        squares += list(_misfits(result, CONTROL).square)
    assert np.mean(squares) == pytest.approx(3.0, rel=0.2), "its expectation is the degrees of freedom"
    assert np.mean(np.array(squares) > chi2.ppf(0.9, 3)) == pytest.approx(0.1, abs=0.08)


def test_the_adjustment_names_its_blunders_in_order(good):
    network, state, rays = good
    point, centre = network.point.copy(), network.centre.copy()
    point[2] += [0.4, 0.4, -0.4]
    centre[6] += [4.0, -4.0, 4.0]
    result = adjust(replace(network, point=point, centre=centre), state, rays)
    assert {(b.kind, b.number) for b in result.blunders} == {(CONTROL, 2), (POSITION, 6)}
    assert not result.network.point_weight[2].any() and not result.network.centre_weight[6].any()
    assert result.network.point_weight[3].any() and 2 in result.network.named
