"""Homographies against closed forms, their invariances, and the joint refinement against numerical derivatives."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from orthomill.schemas.errors import GeometryError
from orthomill.tasks.calibration.detection.homographies import (
    _linearised,
    applied,
    homography,
    moved,
    refined_together,
    rigid_motion,
)

SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
LOCAL = np.array([[0.04 * i, 0.04 * j] for j in range(3) for i in range(4)])
H0 = np.array([[900.0, 80.0, 10.0], [-60.0, 950.0, -20.0], [0.2, -0.3, 1.0]])
small = st.floats(-0.25, 0.25)


@settings(deadline=None, max_examples=40)
@given(a=small, b=small, c=small, d=small, x=st.floats(-300, 300), y=st.floats(-300, 300), p=small, q=small)
def test_a_homography_is_found_from_its_own_points(a, b, c, d, x, y, p, q):
    H = np.array([[800 * (1 + a), 800 * b, x], [800 * c, 800 * (1 + d), y], [p, q, 1.0]])
    plane = np.random.default_rng(3).uniform(-1.0, 1.0, (12, 2))
    assert homography(plane, applied(H, plane)) == pytest.approx(H, rel=1e-6, abs=1e-5)


def test_the_unit_square_onto_a_quadrilateral_has_a_closed_form():
    quad = np.array([[10.0, 20.0], [210.0, 30.0], [190.0, 220.0], [5.0, 180.0]])
    # Heckbert 1989, equations 2.7 and 2.8.
    (x0, y0), (x1, y1), (x2, y2), (x3, y3) = quad
    dx1, dx2, dy1, dy2 = x1 - x2, x3 - x2, y1 - y2, y3 - y2
    sx, sy = x0 - x1 + x2 - x3, y0 - y1 + y2 - y3
    g = (sx * dy2 - dx2 * sy) / (dx1 * dy2 - dx2 * dy1)
    h = (dx1 * sy - sx * dy1) / (dx1 * dy2 - dx2 * dy1)
    expected = [[x1 - x0 + g * x1, x3 - x0 + h * x3, x0], [y1 - y0 + g * y1, y3 - y0 + h * y3, y0], [g, h, 1.0]]
    assert homography(SQUARE, quad) == pytest.approx(np.array(expected), rel=1e-9)


def test_a_similarity_is_a_homography_without_perspective():
    H = homography(SQUARE, SQUARE * 50.0 + [3.0, -4.0])
    assert pytest.approx(np.array([[50.0, 0.0, 3.0], [0.0, 50.0, -4.0], [0.0, 0.0, 1.0]]), abs=1e-9) == H


def test_units_and_origin_of_the_plane_do_not_matter():
    noisy = applied(H0, LOCAL) + np.random.default_rng(0).normal(0.0, 0.5, LOCAL.shape)
    metres, millimetres = homography(LOCAL, noisy), homography(1000.0 * LOCAL + 7000.0, noisy)
    assert applied(millimetres, 1000.0 * LOCAL + 7000.0) == pytest.approx(applied(metres, LOCAL), abs=1e-6)


@pytest.mark.parametrize("points", [SQUARE[:3], np.array([[i, 2.0 * i] for i in range(6)])], ids=["three", "one line"])
def test_points_that_determine_no_homography_are_refused(points):
    with pytest.raises(GeometryError, match="Four corners or more that do not lie on one line"):
        homography(points.astype(float), points.astype(float) * 3.0)


def test_the_horizon_is_not_finite_and_raises_no_warning():
    H = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 0.0, 1.0]])
    assert not np.isfinite(applied(H, np.array([[-1.0, 2.0]]))).any()


@settings(deadline=None, max_examples=30)
@given(angle=st.floats(-3, 3), x=st.floats(-2, 2), y=st.floats(-2, 2))
def test_a_rigid_motion_and_its_inverse_cancel(angle, x, y):
    there = moved(np.array([angle, x, y]), LOCAL)
    assert moved(rigid_motion(there, LOCAL), there) == pytest.approx(LOCAL, abs=1e-9)


def test_a_rigid_motion_averages_errors_that_no_motion_explains():
    onto = 1.1 * (SQUARE - 0.5) + np.array([2.0, 3.0])
    assert rigid_motion(SQUARE - 0.5, onto) == pytest.approx([0.0, 2.0, 3.0], abs=1e-12)


def observed(motions: np.ndarray) -> np.ndarray:
    return np.array([applied(H0, moved(motion, LOCAL)) for motion in motions])


MOTIONS = np.array([[0.0, 0.0, 0.0], [0.4, 0.3, 0.1], [-1.2, -0.2, 0.4]])
NEAR = MOTIONS + np.array([[0, 0, 0], [0.02, 0.01, 0], [0, 0.01, 0.01]])


def test_derivatives_agree_with_differences():
    A, residual = _linearised(H0, MOTIONS, LOCAL, observed(MOTIONS))
    assert np.abs(residual).max() < 1e-9 and A.shape == (2 * 3 * 12, 8 + 6)
    for column in range(14):
        step = np.zeros(14)
        step[column] = 1e-6
        H = (H0.ravel() + np.append(step[:8], 0.0)).reshape(3, 3)
        motions = MOTIONS + np.vstack([np.zeros(3), step[8:].reshape(-1, 3)])
        computed = np.array([applied(H, moved(motion, LOCAL)) for motion in motions])
        numerical = (computed - observed(MOTIONS)).ravel() / 1e-6
        assert A[:, column] == pytest.approx(numerical, rel=1e-4, abs=1e-3)


def test_unknown_corners_have_no_equation_and_do_not_disturb():
    xy = observed(MOTIONS)
    xy[1, :4] = np.nan
    A, residual = _linearised(H0, MOTIONS, LOCAL, xy)
    assert len(A) == len(residual) == 2 * (3 * 12 - 4)
    _, refined = refined_together(homography(LOCAL, xy[0] + 0.2), NEAR, LOCAL, xy)
    assert refined == pytest.approx(MOTIONS, abs=1e-5)


def test_the_first_board_stays_fixed():
    _, refined = refined_together(H0 * 1.01, NEAR, LOCAL, observed(MOTIONS))
    assert refined[0].tolist() == [0.0, 0.0, 0.0]


def test_refinement_never_makes_it_worse():
    xy = observed(MOTIONS)
    H, refined = refined_together(H0, MOTIONS, LOCAL, xy)
    after = np.abs(np.array([applied(H, moved(motion, LOCAL)) for motion in refined]) - xy).max()
    assert after <= np.abs(observed(MOTIONS) - xy).max() + 1e-9
    wild = MOTIONS + np.array([[0, 0, 0], [2.0, 40.0, -30.0], [0, 0, 0]])
    misfit = [
        np.nansum((np.array([applied(h, moved(m, LOCAL)) for m in own]) - xy) ** 2)
        for h, own in ((H0, wild), refined_together(H0, wild, LOCAL, xy))
    ]
    assert misfit[1] <= misfit[0]


@settings(deadline=None)
@given(angle=st.floats(-3, 3), x=st.floats(-2, 2), y=st.floats(-2, 2))
def test_motions_in_the_plane_are_found(angle, x, y):
    points = np.array([[0, 0], [0.3, 0.1], [0.2, 0.5], [-0.4, 0.2]])
    motion = np.array([angle, x, y])
    assert rigid_motion(points, moved(motion, points)) == pytest.approx(motion, abs=1e-9)


def test_joint_refinement_finds_homography_and_motions():
    local = np.array([[0.04 * i, 0.04 * j] for j in range(4) for i in range(5)])
    motions = np.array([[0, 0, 0], [0.4, 0.3, 0.1], [-1.2, -0.2, 0.4]])
    H = np.array([[900.0, 80.0, 10.0], [-60.0, 950.0, -20.0], [0.2, -0.3, 1.0]])
    xy = np.array([applied(H, moved(motion, local)) for motion in motions])
    start = motions + np.array([[0, 0, 0], [0.03, 0.01, -0.01], [-0.02, 0.01, 0.01]])
    refined_H, refined = refined_together(homography(local, xy[0] + 0.3), start, local, xy)
    assert refined == pytest.approx(motions, abs=1e-5) and refined_H == pytest.approx(H, rel=1e-4, abs=1e-2)
