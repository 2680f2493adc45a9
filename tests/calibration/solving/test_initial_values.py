"""Initial camera constant, exterior orientation and observations from exact homographies and their rules for poor ones."""

import numpy as np
import pytest
from board_corners import easy_arrangement
from hypothesis import given, settings
from hypothesis import strategies as st

from orthomill.tasks.calibration.naming.board_names import NamedPhoto, Naming
from orthomill.tasks.calibration.solving.initial_constant import constant_from_conic, constants, estimate, median_and_spread
from orthomill.tasks.calibration.solving.initial_pose import pose_of_projection
from orthomill.tasks.calibration.solving.starting_values import corners_of, restart_of, start_of
from orthomill.tasks.geometry.rotation import rotation_matrix

C = 2500.0
LOCAL = np.array([[0.04 * i, 0.04 * j] for j in range(3) for i in range(4)])


def projection(omega: float, phi: float, kappa: float = 0.3, c: float = C) -> np.ndarray:
    """(3, 4) of a camera 1.5 m above the plane."""
    R = rotation_matrix(omega, phi, kappa)
    return np.diag([-c, -c, 1.0]) @ np.column_stack([R, -R @ np.array([0.1, 0.2, 1.5])])


def plane(P: np.ndarray) -> np.ndarray:
    """(3, 3) homography of the plane Z = 0."""
    return P[:, [0, 1, 3]] / P[2, 3]


TILTED = [plane(projection(omega, phi)) for omega, phi in ((0.4, 0.2), (-0.3, 0.4), (0.2, -0.5))]


PUBLISHED = {
    "Phantom 4 Pro": (
        (3686.66, 3039.03, 3255.84, 2767.17, 3828.43, 3782.84, 3659.10),
        (3643.44, 3598.63, 3618.62, 3459.89, 3668.88, 3661.90, 3721.77),
        (3652.67, 232.23, 43.10),
    ),
    "NEX-5N": (
        (
            4194.37,
            4023.35,
            4032.86,
            4190.20,
            4001.13,
            3890.58,
            4206.47,
            4023.65,
            4621.46,
            4173.26,
            7035.14,
            4102.55,
            4206.07,
            4451.07,
        ),
        (
            3961.27,
            4132.00,
            4396.24,
            4264.08,
            4082.63,
            4201.82,
            5029.20,
            4263.86,
            4196.29,
            3954.96,
            3280.83,
            4307.88,
            1516.99,
            4320.94,
        ),
        (4201.82, 195.80, 144.53),
    ),
    "EOS 550D": (
        (
            4950.97,
            4759.63,
            4891.09,
            4896.79,
            3964.22,
            5011.34,
            4572.62,
            4910.55,
            4927.04,
            4522.27,
            4894.89,
            4007.11,
            4916.43,
            5028.67,
            4941.94,
            4873.13,
        ),
        (
            4865.47,
            4969.64,
            4705.72,
            4059.17,
            4912.70,
            4860.57,
            4918.92,
            4861.59,
            4842.96,
            18330.20,
            4937.11,
            4952.25,
            4851.93,
            4939.61,
            4798.93,
            4940.43,
        ),
        (4910.55, 117.69, 226.86),
    ),
}
"""c1 and c2 of every photo, and the chosen constant with both spreads (sources/calibration.md#table-3-1, tables 3-1 to 3-6)."""


@pytest.mark.parametrize("name", PUBLISHED)
def test_the_published_rule_gives_the_published_constant(name):
    c1, c2, (c, sigma1, sigma2) = PUBLISHED[name]
    known = estimate(np.array(c1), np.array(c2))
    assert (known.c, known.sigma1, known.sigma2) == (
        pytest.approx(c, abs=0.01),
        pytest.approx(sigma1, abs=0.02),
        pytest.approx(sigma2, abs=0.02),
    )


@settings(deadline=None)
@given(omega=st.floats(-0.6, 0.6), phi=st.floats(-0.6, 0.6), kappa=st.floats(-3.1, 3.1))
def test_constant_and_pose_follow_from_a_homography(omega, phi, kappa):
    c, R, centre = 3000.0, rotation_matrix(omega, phi, kappa), np.array([0.2, -0.1, 1.4])
    view = np.diag([-c, -c, 1.0]) @ np.column_stack([R, -R @ centre])
    rotation, place = pose_of_projection(view * 0.3, c)
    H = view[:, [0, 1, 3]] / view[2, 3]
    assert rotation == pytest.approx(R, abs=1e-9) and place == pytest.approx(centre, abs=1e-9)
    assert np.abs(H[2, 0] * H[2, 1]) < 1e-4 or constants(H)[0] == pytest.approx(c, rel=1e-7)
    assert np.hypot(*H[2, :2]) < 0.02 or constant_from_conic([H]) == pytest.approx(c, rel=1e-7)


def test_a_photo_straight_down_gives_no_constant():
    assert np.isnan(constants(np.diag([2000.0, 2000.0, 1.0]))).all()
    assert np.isnan(constant_from_conic([np.diag([2000.0, 2000.0, 1.0])]))


def test_both_constants_of_an_exact_homography_are_the_camera_constant():
    assert np.array([constants(H) for H in TILTED]) == pytest.approx(np.full((3, 2), C), rel=1e-9)
    assert constant_from_conic(TILTED) == pytest.approx(C, rel=1e-9)


@settings(deadline=None, max_examples=30)
@given(scale=st.floats(0.01, 100.0))
def test_units_of_the_plane_do_not_change_the_constant(scale):
    stretched = TILTED[0] @ np.diag([scale, scale, 1.0])
    assert constants(stretched) == pytest.approx((C, C), rel=1e-7)
    assert constant_from_conic([stretched, TILTED[1]]) == pytest.approx(C, rel=1e-7)


def test_a_photo_without_tilt_does_not_disturb_the_conic():
    straight = plane(projection(0.0, 0.0))
    assert np.isnan(constants(straight)).all()
    assert constant_from_conic([straight, *TILTED]) == pytest.approx(C, rel=1e-9)


def test_the_estimate_with_the_smaller_spread_is_used():
    steady, wild = np.array([100.0, 101.0, 102.0, 101.0]), np.array([90.0, 140.0, 105.0, 60.0])
    assert estimate(steady, wild).c == estimate(wild, steady).c == pytest.approx(101.0)
    known = estimate(steady, wild)
    assert known.sigma1 < known.sigma2 and np.array_equal(known.c2, wild)


def test_one_value_has_no_spread_and_is_used_when_it_is_the_only_one():
    assert median_and_spread(np.array([7.0])) == (7.0, np.inf)
    assert estimate(np.array([np.nan, 7.0]), np.array([np.nan, np.nan])).c == 7.0
    assert np.isnan(estimate(np.empty(0), np.empty(0)).c)


def test_the_spread_is_about_the_median_with_one_degree_of_freedom_less():
    assert median_and_spread(np.array([1.0, 2.0, 6.0])) == (2.0, pytest.approx(np.sqrt((1 + 0 + 16) / 2)))


def test_a_value_beyond_the_spread_is_rejected_once():
    assert estimate(np.array([100.0, 101.0, 102.0, 180.0]), np.full(4, np.nan)).c == 101.0


@settings(deadline=None, max_examples=30)
@given(omega=st.floats(-0.6, 0.6), phi=st.floats(-0.6, 0.6), share=st.floats(0.9, 1.1), scale=st.floats(0.1, 10.0))
def test_a_pose_is_a_rotation_even_from_a_wrong_constant(omega, phi, share, scale):
    rotation, centre = pose_of_projection(scale * projection(omega, phi), share * C)
    assert rotation @ rotation.T == pytest.approx(np.eye(3), abs=1e-12) and np.linalg.det(rotation) > 0
    assert centre[2] > 0, "above the boards"
    exact, at = pose_of_projection(scale * projection(omega, phi), C)
    assert exact == pytest.approx(rotation_matrix(omega, phi, 0.3), abs=1e-9) and at == pytest.approx([0.1, 0.2, 1.5], abs=1e-9)


def test_observations_are_sorted_by_board_corner_and_photo_without_unknown_corners():
    boards = np.arange(2 * 12 * 2, dtype=float).reshape(2, 12, 2)
    boards[1, 3] = np.nan
    found = corners_of([boards, boards], [np.array([1, 0]), np.array([0, -1])])
    assert len(found) == 12 + 11 + 12
    order = np.column_stack([found.board, found.corner, found.photo])
    assert np.array_equal(order, np.unique(order, axis=0))
    own = found.take((found.photo == 0) & (found.board == 0))
    assert 3 not in own.corner and np.array_equal(own.xy, boards[1][own.corner])


def naming(*projections: np.ndarray | None) -> Naming:
    photos = tuple(NamedPhoto(np.array([0 if P is not None else -1]), np.zeros(1, int), P, True) for P in projections)
    return Naming(np.eye(4)[None], photos)


def imaged(P: np.ndarray) -> np.ndarray:
    u = np.column_stack([LOCAL, np.zeros(12), np.ones(12)]) @ P.T
    return (u[:, :2] / u[:, 2:])[None]


def test_the_start_uses_the_constant_of_the_homographies_first():
    projections = [projection(0.4, 0.2), projection(-0.3, 0.4), projection(0.2, -0.5)]
    found = [imaged(projections[0]), np.empty((0, 12, 2)), imaged(projections[1]), imaged(projections[2])]
    start = start_of(found, naming(projections[0], None, *projections[1:]), LOCAL, (4000, 3000))
    assert start.photo.tolist() == [0, 2, 3] and len(start.corners) == 36
    assert start.states[0].interior.tolist() == pytest.approx([C, *[0.0] * 16])
    assert np.isnan(start.constant.c1[1]) and start.constant.c == pytest.approx(C)
    others = [state.interior[0] for state in start.states[3:]]
    assert others == [3200.0, 5200.0, 2000.0, 8800.0], "from wide to tele, in units of the longer side"


def test_an_absurd_constant_is_not_tried():
    found = [imaged(projection(0.4, 0.2, c=60.0))] * 3
    start = start_of(found, naming(*[projection(0.4, 0.2, c=60.0)] * 3), LOCAL, (4000, 3000))
    assert start.constant.c == pytest.approx(60.0) and min(state.interior[0] for state in start.states) == 2000.0


def test_a_restart_keeps_the_interior_orientation():
    interior = np.array([C, 3.0, -2.0, -0.1, 0.02, *[0.0] * 12])
    start = restart_of([imaged(projection(0.4, 0.2))], naming(projection(0.4, 0.2)), LOCAL, interior)
    (state,) = start.states
    assert np.array_equal(state.interior, interior) and state.interior is not interior
    assert state.centre[0] == pytest.approx([0.1, 0.2, 1.5]) and np.isnan(start.constant.c)


def test_initial_values_of_a_calibration_are_near_its_result():
    _, known = easy_arrangement()
    assert known.constant.c == pytest.approx(known.result.state.interior[0], rel=0.05)
    assert known.start.states[0].centre == pytest.approx(known.result.state.centre, abs=0.05)
