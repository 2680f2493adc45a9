"""Rotation matrices of omega, phi, kappa: the definition, the way back, gimbal lock, derivatives."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from orthomill.tasks.geometry.rotation import angles, rotation_derivatives, rotation_matrix

TURN = st.floats(-np.pi, np.pi)
TILT = st.floats(-1.5, 1.5)
SETTINGS = settings(deadline=None, max_examples=60)


def elementary(omega, phi, kappa):
    """R1, R2, R3 as docs/conventions.md writes them."""
    R1 = np.array([[1, 0, 0], [0, np.cos(omega), np.sin(omega)], [0, -np.sin(omega), np.cos(omega)]])
    R2 = np.array([[np.cos(phi), 0, -np.sin(phi)], [0, 1, 0], [np.sin(phi), 0, np.cos(phi)]])
    R3 = np.array([[np.cos(kappa), np.sin(kappa), 0], [-np.sin(kappa), np.cos(kappa), 0], [0, 0, 1]])
    return R1, R2, R3


@SETTINGS
@given(TURN, TURN, TURN)
def test_the_matrix_is_the_product_of_three_elementary_rotations(omega, phi, kappa):
    R1, R2, R3 = elementary(omega, phi, kappa)
    R = rotation_matrix(omega, phi, kappa)
    np.testing.assert_allclose(R, R3 @ R2 @ R1, atol=1e-15)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-14)


@SETTINGS
@given(TURN, TILT, TURN)
def test_angles_come_back_where_phi_is_below_ninety_degrees(omega, phi, kappa):
    found = np.array(angles(rotation_matrix(omega, phi, kappa)))
    difference = (found - [omega, phi, kappa] + np.pi) % (2 * np.pi) - np.pi
    np.testing.assert_allclose(difference, 0, atol=1e-12)


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize(("omega", "kappa"), [(0.4, 0.9), (-2.0, 3.0), (0.0, 0.0)])
def test_at_gimbal_lock_kappa_is_zero_and_the_rotation_is_the_same(sign, omega, kappa):
    R = rotation_matrix(omega, sign * np.pi / 2, kappa)
    found = angles(R)
    assert found[2] == 0.0 and found[1] == pytest.approx(sign * np.pi / 2, abs=1e-7)
    np.testing.assert_allclose(rotation_matrix(*found), R, atol=1e-12)


@SETTINGS
@given(TURN, st.floats(-1e-5, 1e-5), TURN)
def test_next_to_gimbal_lock_the_rotation_is_kept_to_the_sine_of_phi(omega, off, kappa):
    """phi is read from its sine, whose rounding of 1e-16 is an angle of 1e-8 there."""
    R = rotation_matrix(omega, np.pi / 2 + off, kappa)
    np.testing.assert_allclose(rotation_matrix(*angles(R)), R, atol=5e-6)


def test_rounding_above_one_does_not_make_angles_nan():
    R = rotation_matrix(0.3, np.pi / 2, 0.0)
    R[2, 0] += 3e-16
    assert np.isfinite(angles(R)).all()


@SETTINGS
@given(TURN, TURN, TURN)
def test_derivatives_equal_central_differences(omega, phi, kappa):
    at, step = np.array([omega, phi, kappa]), 1e-6
    for own, analytic in zip(np.eye(3), rotation_derivatives(*at), strict=True):
        numeric = (rotation_matrix(*(at + step * own)) - rotation_matrix(*(at - step * own))) / (2 * step)
        np.testing.assert_allclose(analytic, numeric, atol=1e-9)


def test_positive_kappa_turns_the_camera_anticlockwise_seen_from_above():
    """With kappa = 90 degrees the x axis of the image points north."""
    x_axis = rotation_matrix(0.0, 0.0, np.pi / 2)[0]
    np.testing.assert_allclose(x_axis, [0, 1, 0], atol=1e-15)


def test_positive_omega_and_phi_tilt_the_camera_the_documented_way():
    """The axis from the ground to the camera is the third row: omega tilts it to the south, phi to the east."""
    assert rotation_matrix(0.1, 0.0, 0.0)[2] == pytest.approx([0, -np.sin(0.1), np.cos(0.1)])
    assert rotation_matrix(0.0, 0.1, 0.0)[2] == pytest.approx([np.sin(0.1), 0, np.cos(0.1)])
