"""The adjustment of identified boards: coordinates of the target, refusals, uncertain boards and resected photographs."""

from dataclasses import replace

import numpy as np
import pytest
from board_corners import EASY, easy_arrangement, easy_calibration
from hypothesis import given, settings
from hypothesis import strategies as st

from orthomill.schemas.errors import GeometryError
from orthomill.tasks.calibration.solving.calibration_precision import board_precision, correlations, photo_precision
from orthomill.tasks.calibration.solving.lens_models import MODELS
from orthomill.tasks.calibration.solving.model_choice import HeldOut, held_out
from orthomill.tasks.calibration.solving.solving import CalibrationTarget, resected, solve, too_few, with_uncertain_boards
from orthomill.tasks.geometry.rotation import rotation_matrix

TARGET = CalibrationTarget((800, 600), (4, 3), 0.05)


@settings(deadline=None, max_examples=30)
@given(col=st.floats(-10, 810), row=st.floats(-10, 610))
def test_pixels_and_image_coordinates_are_inverse_with_y_up(col, row):
    xy = TARGET.centred(np.array([col, row]))
    assert TARGET.pixels(xy) == pytest.approx([col, row]) and xy == pytest.approx([col - 399.5, 299.5 - row])


def test_corners_of_a_board_start_at_its_first_corner():
    assert TARGET.local.shape == (12, 2) and TARGET.local[0].tolist() == [0.0, 0.0]
    assert TARGET.local[1].tolist() == [0.05, 0.0] and TARGET.local[4].tolist() == [0.0, 0.05]


def test_the_network_of_a_target_counts_its_unknowns():
    network = replace(TARGET, arrangement="space").network(5, 3, MODELS[0].free)
    assert network.unknowns == 6 * 5 + 6 * 2 + 5 and network.local.shape == (12, 3)
    assert TARGET.network(5, 3, MODELS[0].free).unknowns == 6 * 5 + 3 * 2 + 5


@pytest.mark.parametrize(
    ("photos", "words"), [(0, "Only 0 photographs show"), (1, "Only 1 photograph shows"), (2, "Only 2 photographs")]
)
def test_too_few_photographs_are_counted_in_the_message(photos, words):
    assert words in str(too_few(photos)) and "at least 3 are needed" in str(too_few(photos))


def test_no_initial_state_is_too_few_photographs():
    _, known = easy_arrangement()
    with pytest.raises(GeometryError, match="Only 0 photographs"):
        solve(TARGET, (), known.start.corners.take(np.empty(0, dtype=int)), MODELS[0].free)


def test_a_poor_start_is_followed_by_the_next_one():
    target, known = easy_arrangement()
    good = known.start.states[0]
    blind = replace(good, centre=good.centre * [1.0, 1.0, -1.0])
    result = solve(target, (blind, good), known.start.corners, MODELS[0].free)
    assert result.state.interior == pytest.approx(known.result.state.interior, rel=1e-4, abs=1e-2)
    with pytest.raises(GeometryError):
        solve(target, (blind,), known.start.corners, MODELS[0].free)


def test_boards_without_standard_errors_are_exact():
    target, result = easy_calibration()
    assert with_uncertain_boards(target, result) is result
    assert np.array_equal(result.state.local[0], result.state.local[1])


@pytest.mark.parametrize("uncertain", [{"sigma_in_plane": 2e-4}, {"sigma_height": 1e-3}])
def test_standard_errors_of_boards_make_their_corners_unknowns(uncertain):
    target, result = easy_calibration()
    free = with_uncertain_boards(replace(target, **uncertain), result)
    moved = np.abs(free.state.local - result.state.local).max(axis=(0, 1))
    assert (moved[:2].max() > 1e-6) == ("sigma_in_plane" in uncertain) and (moved[2] > 1e-6) == ("sigma_height" in uncertain)
    assert free.network.image_sigma == result.sigma0 and free.sigma0 < 1.05 * result.sigma0


def test_resected_photographs_keep_the_camera_and_the_boards():
    _, result = easy_calibration()
    shaken = replace(result.state, centre=result.state.centre + 0.01)
    residual = resected(result, shaken, result.corners, result.used)
    assert residual[result.used] == pytest.approx(result.residual[result.used], abs=0.2)
    assert np.sqrt((residual[result.used] ** 2).sum(axis=1).mean()) <= result.rms * 1.001
    wrong = resected(result, shaken.with_interior(c=1.02 * shaken.interior[0]), result.corners, result.used)
    assert np.sqrt((wrong[result.used] ** 2).sum(axis=1).mean()) > 2.0 * result.rms, "c is not re-estimated"


def test_sigma0_is_the_noise_and_the_truth_is_within_four_standard_errors():
    _, result = easy_calibration()
    sigma = np.sqrt(np.diag(result.interior_covariance))[:8]
    assert result.sigma0 == pytest.approx(0.3, rel=0.1)
    assert (np.abs(result.state.interior[:8] - EASY.camera.interior[:8]) < 4.0 * sigma).all()


def test_precision_of_a_photo_is_that_of_its_angles():
    _, result = easy_calibration()
    value, sigma = photo_precision(result, 2)
    assert rotation_matrix(*value[3:]) == pytest.approx(result.state.rotation[2]) and np.array_equal(
        value[:3], result.state.centre[2]
    )
    columns = result.network.photo_columns[2]
    assert sigma[:3] == pytest.approx(np.sqrt(np.diag(result.covariance)[columns[:3]])) and (sigma > 0).all()


def test_board_0_has_no_standard_errors_and_the_others_only_in_their_plane():
    _, result = easy_calibration()
    assert (board_precision(result, 0)[1] == 0).all()
    _, sigma = board_precision(result, 1)
    assert (sigma[[0, 1, 5]] > 0).all() and (sigma[[2, 3, 4]] == 0).all()


def test_correlations_of_the_interior_with_itself_are_one_on_the_diagonal():
    _, result = easy_calibration()
    table = correlations(result)
    own = table.typical[:, [table.columns.index(name) for name in table.rows]]
    assert table.rows == MODELS[3].free and np.diag(own) == pytest.approx(np.ones(8)) and own == pytest.approx(own.T)


def test_one_board_alone_has_no_correlations_with_boards():
    target, known = easy_arrangement()
    corners = known.start.corners.take(known.start.corners.board == 0)
    state = replace(
        known.result.state, turn=known.result.state.turn[:1], shift=known.result.state.shift[:1], local=known.result.state.local[:1]
    )
    result = solve(replace(target, boards=1), (state,), corners, MODELS[0].free)
    assert correlations(result).columns == ("X0", "Y0", "Z0", "omega", "phi", "kappa", *MODELS[0].free)


def test_halves_differ_by_chance_only():
    _, result = easy_calibration()
    check = held_out(result)
    assert check is not None and (check.sigma[:8] > 0).all() and (check.sigma[8:] == 0).all()
    assert (np.abs(check.difference[:8]) < 4.0 * check.sigma[:8]).all() and (check.difference[8:] == 0).all()
    assert check.rms == pytest.approx(0.3 * np.sqrt(2), rel=0.1) and check.rms_all >= 0.99 * check.rms


def test_parameters_that_are_not_estimated_stay_zero_in_both_halves():
    _, known = easy_arrangement()
    check = held_out(known.result)
    assert check is not None and (check.difference[5:] == 0).all() and check.sigma[5:].max() == 0.0


def test_the_worst_parameter_is_named_in_its_standard_errors():
    difference, sigma = np.zeros(17), np.zeros(17)
    difference[[0, 2, 9]], sigma[[0, 2]] = [3.0, -8.0, 100.0], [1.0, 2.0]
    assert HeldOut(1.0, 1.0, difference, sigma).worst == ("y0", 4.0), "without a standard error nothing was estimated"
