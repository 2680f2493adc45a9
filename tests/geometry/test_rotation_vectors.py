"""Rotation vectors and quaternions: there and back, their limits at 0 and at pi, SciPy as an oracle, angles carried over."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from orthomill.tasks.geometry.rotation import angles, rotation_matrix
from orthomill.tasks.geometry.rotation_quaternion import quaternion, rotation_of_quaternion
from orthomill.tasks.geometry.rotation_vector import (
    angles_from_vector,
    rotation_of_vector,
    skew,
    vector_of_rotation,
    vectors_of_rotations,
)

SETTINGS = settings(deadline=None, max_examples=60)
PART = st.floats(-1.8, 1.8)
VECTOR = st.tuples(PART, PART, PART).map(np.array)


@given(VECTOR, VECTOR)
@SETTINGS
def test_skew_is_the_vector_product(v, x):
    np.testing.assert_allclose(skew(v) @ x, np.cross(v, x), atol=1e-14)


@given(VECTOR)
@SETTINGS
def test_a_vector_is_the_rotation_that_scipy_makes_of_it(w):
    np.testing.assert_allclose(rotation_of_vector(w), Rotation.from_rotvec(w).as_matrix(), atol=1e-12)


@given(VECTOR)
@SETTINGS
def test_a_vector_shorter_than_pi_comes_back(w):
    assume(np.linalg.norm(w) < np.pi - 1e-6)
    np.testing.assert_allclose(vector_of_rotation(rotation_of_vector(w)), w, atol=1e-9)


@pytest.mark.parametrize("length", [0.0, 1e-12, 9.9e-7, 1.01e-6, 1e-4])
def test_small_vectors_lose_no_digits(length):
    """Both sides of the switch to the series agree with the exact sine and cosine, and the length survives the way back."""
    w = length * np.array([0.6, 0.0, -0.8])
    R = rotation_of_vector(w)
    np.testing.assert_allclose(R - R.T, 2 * np.sin(length) * skew(np.array([0.6, 0.0, -0.8])), atol=1e-22, rtol=1e-9)
    np.testing.assert_allclose(vector_of_rotation(R), w, atol=1e-16, rtol=1e-9)


@given(VECTOR)
@SETTINGS
def test_half_a_turn_has_an_axis_of_either_sign(w):
    assume(np.linalg.norm(w) > 0.1)
    axis = w / np.linalg.norm(w)
    R = 2 * np.outer(axis, axis) - np.eye(3)
    found = vector_of_rotation(R)
    assert np.linalg.norm(found) == pytest.approx(np.pi)
    assert abs(found @ axis) == pytest.approx(np.pi)


def test_many_rotations_have_the_vectors_that_each_has_alone():
    vectors = np.vstack([np.zeros(3), [1e-12, 0, 0], [0, np.pi, 0], np.random.default_rng(1).normal(0, 1, (20, 3))])
    R = np.array([rotation_of_vector(w) for w in vectors])
    R[2] = np.diag([-1.0, 1.0, -1.0])  # half a turn, of which the antisymmetric part vanishes
    np.testing.assert_allclose(vectors_of_rotations(R), [vector_of_rotation(one) for one in R], rtol=1e-13, atol=1e-16)
    assert vectors_of_rotations(R[:0]).shape == (0, 3)


@given(VECTOR, VECTOR)
@SETTINGS
def test_angles_follow_small_rotations(w, small):
    """omega, phi, kappa of exp([dw]x) R differ from those of R by the matrix times dw."""
    R = rotation_of_vector(w)
    assume(abs(R[2, 0]) < 0.99)
    step = 1e-7 * small
    moved = np.array(angles(rotation_of_vector(step) @ R)) - angles(rotation_of_vector(-step) @ R)
    moved = (moved + np.pi) % (2 * np.pi) - np.pi
    np.testing.assert_allclose(angles_from_vector(R) @ (2 * step), moved, atol=1e-11)


def test_angles_of_a_vertical_photograph_are_the_negative_rotation_vector():
    """R turns the world into the image: a rotation of the image by +w is one of the world by -w."""
    np.testing.assert_allclose(angles_from_vector(np.eye(3)), -np.eye(3), atol=1e-15)


def test_at_gimbal_lock_the_undefined_part_is_left_out():
    """omega and kappa turn about one axis: they share what is told of it, and nothing becomes infinite."""
    J = angles_from_vector(rotation_matrix(0.3, np.pi / 2, 0.0))
    assert np.abs(J).max() <= 1.0 + 1e-12
    assert np.linalg.matrix_rank(J, tol=1e-6) == 2


@given(VECTOR)
@SETTINGS
def test_quaternions_come_back_with_positive_scalar(w):
    R = rotation_of_vector(w)
    q = quaternion(R)
    assert q[0] >= 0 and np.linalg.norm(q) == pytest.approx(1.0)
    np.testing.assert_allclose(rotation_of_quaternion(q), R, atol=1e-12)
    np.testing.assert_allclose(rotation_of_quaternion(-3.0 * q), R, atol=1e-12)


def test_a_quaternion_is_half_the_angle_about_its_axis():
    """COLMAP's order: the scalar first."""
    q = quaternion(rotation_of_vector(np.array([0.0, 0.0, np.pi / 2])))
    np.testing.assert_allclose(q, [np.sqrt(0.5), 0, 0, np.sqrt(0.5)], atol=1e-15)
    np.testing.assert_allclose(rotation_of_quaternion(q) @ [1, 0, 0], [0, 1, 0], atol=1e-15)
