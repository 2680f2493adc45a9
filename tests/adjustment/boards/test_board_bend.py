"""Bends of boards: their geometry, their derivatives, and the bent board that no longer shifts the camera."""

from dataclasses import replace

import numpy as np
import pytest
from bent_boards import bent_photographs
from board_truth import FREE, LOCAL, all_corners, plain, truth
from hypothesis import given, settings
from hypothesis import strategies as st

from orthomill.tasks.adjustment.boards.board_bend import flat
from orthomill.tasks.adjustment.boards.board_bundle import adjust
from orthomill.tasks.adjustment.boards.board_network import BoardNetwork
from orthomill.tasks.adjustment.boards.board_projection import derivatives, projected
from orthomill.tasks.calibration.detection.board_turns import corner_orders
from orthomill.tasks.calibration.solving.calibration_precision import bend_precision, largest_bend
from orthomill.tasks.calibration.solving.lens_models import MODELS
from orthomill.tasks.calibration.solving.solving import CalibrationTarget, solve, with_bends

TARGET = CalibrationTarget((1280, 960), (9, 6), 0.03, 1, bend=0.005)


def board_of(corners: tuple[int, int]):
    target = CalibrationTarget((1280, 960), corners, 0.03)
    return target, flat(target.local, 2, target.orders)


@settings(deadline=None, max_examples=20)
@given(value=st.lists(st.floats(-0.004, 0.004), min_size=3, max_size=3))
def test_a_bent_board_keeps_its_lengths_along_rows_and_its_middle_plane(value):
    target, bend = board_of((33, 24))
    shifts = bend.moved(np.array([value, value])).shifts[0]
    assert shifts[:, 2].mean() == pytest.approx(0.0, abs=1e-12)
    assert np.abs(target.local.T @ shifts[:, 2]).max() < 1e-4 * len(shifts) * 0.004, "the pose has the tilt"
    bent = (np.column_stack([target.local, np.zeros(len(shifts))]) + shifts).reshape(24, 33, 3)
    # The steps of fine squares follow the sheet to a few hundredths of what a stretched one would gain.
    steps = np.linalg.norm(np.diff(bent, axis=1), axis=2)
    stretched = np.hypot(0.03, np.diff(bent[..., 2], axis=1))
    assert np.abs(steps - 0.03).max() <= 0.05 * (stretched - 0.03).max() + 1e-9


def test_bends_of_one_unit_lift_the_ends_by_one():
    _, bend = board_of((9, 5))
    along, across, twist = bend.height.T.reshape(3, 5, 9)
    assert along[2, 0] - along[2, 4] == pytest.approx(1.0) and across[0, 4] - across[2, 4] == pytest.approx(1.0)
    assert twist[0, 0] - twist[2, 4] == pytest.approx(1.0) and twist[0, 8] - twist[2, 4] == pytest.approx(-1.0)


@pytest.mark.parametrize(("corners", "count"), [((9, 6), 3), ((8, 6), 3), ((7, 7), 3), ((8, 8), 1)])
def test_the_shape_of_a_board_does_not_depend_on_how_its_corners_are_counted(corners, count):
    _, bend = board_of(corners)
    assert bend.count == count
    for order in corner_orders(corners):
        assert bend.height[order] == pytest.approx(bend.height, abs=1e-12)


def bent_state():
    state = truth(boards=2)
    bend = flat(LOCAL[:, :2], 2, corner_orders((5, 4)))
    return replace(state, bend=bend.moved(np.array([[0.003, -0.001, 0.002], [-0.002, 0.001, 0.0]])))


def test_derivatives_by_the_bends_agree_with_differences():
    state = bent_state()
    corners = all_corners(state).take(np.arange(0, 320, 5))
    by_unknowns, _ = derivatives(state, corners)
    for bend in range(3):
        for board in range(2):
            step = np.zeros((2, 3))
            step[board, bend] = 1e-6
            there, back = (projected(replace(state, bend=state.bend.moved(sign * step)), corners) for sign in (1, -1))
            expected = np.where((corners.board == board)[:, None], (there - back) / 2e-6, 0.0)
            own = np.where((corners.board == board)[:, None], by_unknowns[:, :, 29 + bend], 0.0)
            assert np.abs(own - expected).max() < 1e-6 * np.abs(by_unknowns[:, :, 29:]).max()


def test_exact_corners_of_bent_boards_give_their_bends_back():
    true = plain(bent_state())
    flat_one = replace(true, bend=true.bend.moved(-true.bend.value))
    network = BoardNetwork(8, 2, FREE, "plane", LOCAL, image_sigma=1e-4, bends=3, bend_sigma=0.01)
    result = adjust(network, flat_one, all_corners(true))
    assert result.state.bend.value == pytest.approx(true.bend.value, abs=2e-6)
    assert result.redundancy == 2 * len(result.corners) - (48 + 3 + 5), "every bend brings an observation of its own"
    assert bend_precision(result, 1)[0] == pytest.approx([-0.002, 0.001, 0.0], abs=2e-6)
    board, bend, sigma = largest_bend(result)
    assert board == 0 and bend == pytest.approx(0.003, abs=2e-6) and 0 < sigma < 1e-4


def ratios(sag: float, bend: float) -> np.ndarray:
    """(3,) errors of c in standard errors, of three sets of photographs of a board whose middle stands out by `sag` m."""
    target, out = replace(TARGET, bend=bend), []
    for seed in range(3):
        true, corners = bent_photographs(target, sag, seed)
        result = solve(target, (true,), corners, MODELS[0].free)
        out.append((result.state.interior[0] - true.interior[0]) / np.sqrt(result.interior_covariance[0, 0]))
    return np.array(out)


def test_a_board_bent_by_four_millimetres_does_not_shift_the_camera():
    assert np.abs(ratios(0.004, 0.005)).max() < 3.0
    # Without bends the errors are those that a bent board always had, though its standard errors know of bad residuals.
    assert np.abs(ratios(0.001, 0.0)).max() > 4.0


def test_a_flat_board_costs_little_of_the_precision():
    true, corners = bent_photographs(TARGET, 0.0, 3)
    stiff, soft = (solve(replace(TARGET, bend=bend), (true,), corners, MODELS[0].free) for bend in (0.0, 0.005))
    assert largest_bend(stiff) is None and stiff.network.bends == 0
    assert abs(largest_bend(soft)[1]) < 3.5 * largest_bend(soft)[2]
    formal = [np.sqrt(one.interior_covariance[0, 0]) / one.correlated for one in (stiff, soft)]
    assert 1.0 < formal[1] / formal[0] < 1.3


def test_a_stiffer_board_keeps_nearer_to_flat():
    true, corners = bent_photographs(TARGET, 0.004, 1)
    known = solve(replace(TARGET, bend=0.0), (true,), corners, MODELS[0].free)
    soft, stiff = (with_bends(replace(TARGET, bend=bend), known).state.bend.value for bend in (0.01, 1e-6))
    assert np.abs(soft).max() == pytest.approx(0.004, rel=0.05) and np.abs(stiff).max() < 0.001
