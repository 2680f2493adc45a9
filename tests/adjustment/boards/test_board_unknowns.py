"""Boards: their unknowns and columns, projections against the collinearity of a bundle, and failures with their sentences."""

from dataclasses import replace

import numpy as np
import pytest
from board_truth import FREE, LOCAL, all_corners, disturbed, network, plain, truth

from orthomill.schemas.errors import GeometryError
from orthomill.tasks.adjustment.boards.board_bundle import CornerTest, adjust, minimise
from orthomill.tasks.adjustment.boards.board_network import PARAMETERS, BoardCorners, BoardNetwork
from orthomill.tasks.adjustment.boards.board_projection import BEHIND, projected, residuals
from orthomill.tasks.adjustment.model.collinearity import residuals as bundle_residuals
from orthomill.tasks.adjustment.model.network import Rays, State


@pytest.fixture(scope="module")
def calibration():
    state = plain(truth())
    return adjust(network(state), disturbed(state), all_corners(state, 0.2))


@pytest.mark.parametrize(("arrangement", "each"), [("plane", 3), ("space", 6), ("fixed", 0)])
@pytest.mark.parametrize("boards", [1, 4])
def test_every_unknown_has_one_column(arrangement, each, boards):
    net = BoardNetwork(5, boards, FREE, arrangement, LOCAL)
    parts = [net.photo_columns, net.board_columns, net.interior_columns]
    columns = np.concatenate([part[part >= 0] for part in parts])
    assert sorted(columns) == list(range(net.unknowns)) and net.unknowns == 30 + each * (boards - 1) + len(FREE)
    assert (net.board_columns[0] == -1).all(), "board 0 is the datum"
    assert net.group_start[-1] == net.unknowns and len(net.group_start) == 1 + 5 + (boards - 1) + 1


def test_boards_in_a_plane_shift_in_it_and_rotate_about_its_normal():
    columns = BoardNetwork(1, 2, (), "plane", LOCAL).board_columns[1]
    assert list(columns >= 0) == [True, True, False, False, False, True]


def test_corners_depend_on_their_photograph_board_and_the_interior():
    net = BoardNetwork(3, 2, ("c",), "space", LOCAL)
    corners = BoardCorners(np.array([2, 0]), np.array([1, 0]), np.array([5, 6]), np.zeros((2, 2)))
    row, columns = net.columns_of(corners)
    assert list(columns[row[0]][:6]) == list(range(12, 18)) and list(columns[row[0]][6:12]) == list(range(18, 24))
    assert (columns[row[1]][6:12] == -1).all() and columns[row[0]][12] == columns[row[1]][12] == net.unknowns - 1


def test_projections_are_those_of_the_bundle_without_affinity_and_skew():
    state = truth(height=0.1).with_interior(affinity=0.0, skew=0.0)
    corners = all_corners(state).take(np.arange(0, 480, 7))
    point = state.points[corners.board, corners.corner]
    index = np.arange(len(corners), dtype=np.int32)
    rays = Rays(index, corners.photo.astype(np.int32), corners.xy, np.ones(len(corners)))
    bundle = State(state.rotation, state.centre, point, state.interior[None, :8], np.zeros(3))
    assert np.allclose(bundle_residuals(bundle, rays, np.zeros(len(state.rotation), np.int64)), 0.0, atol=1e-9)


def test_affinity_stretches_x_and_skew_shears_it():
    state = truth().with_interior(x0=0.0, y0=0.0, affinity=0.0, skew=0.0)
    corners = all_corners(state).take(np.arange(0, 480, 9))
    plain_xy = projected(state, corners)
    stretched = projected(state.with_interior(affinity=0.01), corners)
    sheared = projected(state.with_interior(skew=0.02), corners)
    assert stretched - plain_xy == pytest.approx(plain_xy * [0.01, 0.0], abs=1e-9)
    assert sheared - plain_xy == pytest.approx(np.column_stack([0.02 * plain_xy[:, 1], 0 * plain_xy[:, 1]]), abs=1e-9)


def test_corners_behind_the_camera_have_the_residual_behind():
    state = truth(photos=2)
    behind = replace(state, centre=state.centre * [1, 1, -1])
    assert (residuals(behind, all_corners(state)) == BEHIND).all()
    assert np.isnan(projected(behind, all_corners(state))).all()


def test_covariances_are_reported_by_parameter(calibration):
    covariance = calibration.interior_covariance
    free = np.isin(PARAMETERS, FREE)
    assert covariance.shape == (17, 17) and (np.diag(covariance)[free] > 0).all()
    assert not covariance[~free].any() and not covariance[:, ~free].any()
    correlation = calibration.correlation
    assert np.diag(correlation) == pytest.approx(np.ones(len(correlation))) and np.abs(correlation).max() <= 1 + 1e-9


def test_the_rms_is_that_of_residual_vectors_and_sigma0_of_coordinates(calibration):
    length = np.linalg.norm(calibration.residual[calibration.used], axis=1)
    assert calibration.rms == pytest.approx(np.sqrt((length**2).mean()))
    expected = np.sqrt((length**2).sum() / calibration.redundancy)
    assert calibration.sigma0 == pytest.approx(expected) and calibration.rms == pytest.approx(np.sqrt(2) * 0.2, rel=0.1)


def test_standardised_residuals_of_corners_are_standard_normal(calibration):
    assert calibration.standardised[calibration.used].std() == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize(("name", "loose", "strict"), [("limit", 6.0, 2.0), ("gross", 100.0, 1.5)])
def test_limits_of_the_corner_test_decide_what_is_rejected(name, loose, strict):
    state = plain(truth())
    corners = all_corners(state, 0.2)
    counts = [int(adjust(network(state), disturbed(state), corners, CornerTest(**{name: v})).used.sum()) for v in (loose, strict)]
    assert counts[0] > counts[1]


def test_without_rounds_left_the_last_solution_is_kept():
    state = plain(truth())
    corners = all_corners(state, 0.2)
    corners.xy[::25] += 1.0
    one, many = (adjust(network(state), disturbed(state), corners, CornerTest(rounds=rounds)) for rounds in (1, 12))
    assert one.rounds == 0 and many.rounds > 0 and many.used.sum() < one.used.sum()


def test_corners_without_noise_are_not_rejected_for_rounding():
    state = plain(truth())
    assert adjust(network(state), disturbed(state), all_corners(state)).used.all()
    strict = adjust(network(state), disturbed(state), all_corners(state), CornerTest(floor=0.0))
    assert not strict.used.all()


def test_uncertain_boards_want_their_corners_in_order():
    state = plain(truth(photos=6))
    loose = network(state, local_sigma=(1e-4, 1e-4, 0.0), image_sigma=0.1)
    corners = all_corners(state, 0.1)
    with pytest.raises(ValueError, match="board after board, corner after corner"):
        minimise(loose, state, corners.take(np.arange(len(corners))[::-1]))


def test_a_coordinate_without_error_keeps_its_value():
    state = plain(truth(photos=10))
    bent = state.local + np.random.default_rng(4).normal(0, 2e-4, state.local.shape) * [1, 1, 0]
    loose = network(state, local_sigma=(2e-4, 2e-4, 0.0), image_sigma=0.05)
    found, _ = minimise(loose, state, all_corners(replace(state, local=bent), 0.05))
    assert (found.local[:, :, 2] == state.local[:, :, 2]).all()
    assert np.corrcoef((found.local - state.local)[:, :, 0].ravel(), (bent - state.local)[:, :, 0].ravel())[0, 1] > 0.8


def test_too_few_corners_are_refused():
    state = plain(truth(photos=1, boards=1))
    corners = all_corners(state, 0.1).take(np.arange(5))
    with pytest.raises(GeometryError, match="do not determine the camera"):
        adjust(network(state), state, corners)


def test_too_few_iterations_are_an_error_that_names_their_number():
    state = plain(truth())
    with pytest.raises(GeometryError, match="did not converge in 1 iterations"):
        minimise(network(state), disturbed(state), all_corners(state), most=1)
