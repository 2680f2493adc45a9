"""The collinearity equations both ways: their formula, rays, heights, the camera's back, and the kernel against its NumPy twin."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numba import njit

from orthomill.schemas.camera import Camera
from orthomill.schemas.orientation import ExteriorOrientation
from orthomill.tasks.geometry.rotation import rotation_matrix
from orthomill.tasks.geometry.view import View, project_point, view_of

IDEAL = Camera(name="ideal", width=2001, height=1501, c=1500.0)
REAL = IDEAL.changed(x0=8.0, y0=-5.0, k1=-0.08, k2=0.03, p1=3e-4, p2=-2e-4)
ATTITUDE = st.tuples(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5), st.floats(-3.1, 3.1))
CENTRE = np.array([4.1e5, 4.3e6, 900.0])
SETTINGS = settings(deadline=None, max_examples=40)


def looking(attitude, camera=REAL):
    return View("v", camera, rotation_matrix(*attitude), CENTRE)


def ground(count=40, seed=2):
    rng = np.random.default_rng(seed)
    return CENTRE + np.column_stack([rng.uniform(-400, 400, count), rng.uniform(-300, 300, count), rng.uniform(-900, -700, count)])


@SETTINGS
@given(ATTITUDE)
def test_an_ideal_camera_follows_the_written_equations(attitude):
    view, points = looking(attitude, IDEAL), ground()
    R, d = rotation_matrix(*attitude), points - CENTRE
    w = d @ R[2]
    expected = np.column_stack([1000 - 1500 * (d @ R[0]) / w, 750 + 1500 * (d @ R[1]) / w])
    expected[w >= 0] = np.nan
    np.testing.assert_allclose(view.project(points), expected, atol=1e-7)


def test_a_vertical_photograph_has_the_scale_of_c_over_flying_height():
    view = looking((0, 0, 0), IDEAL)
    east, north = view.project(CENTRE + np.array([[60.0, 0, -900.0], [0, 60.0, -900.0]]))
    np.testing.assert_allclose(east, [1000 + 100, 750], atol=1e-7)
    np.testing.assert_allclose(north, [1000, 750 - 100], atol=1e-7)


@SETTINGS
@given(ATTITUDE)
def test_rays_go_back_to_their_points(attitude):
    view = looking(attitude)
    pixels = np.random.default_rng(4).uniform([0, 0], [2000, 1500], (40, 2))
    rays = view.rays(pixels)
    np.testing.assert_allclose(np.linalg.norm(rays, axis=1), 1, atol=1e-14)
    np.testing.assert_allclose(view.project(CENTRE + 500 * rays), pixels, atol=1e-6)


@SETTINGS
@given(ATTITUDE, st.floats(-50, 600))
def test_ground_at_a_height_projects_back_to_its_pixel(attitude, z):
    view = looking(attitude)
    pixels = np.random.default_rng(5).uniform([200, 200], [1800, 1300], (30, 2))
    points = view.at_height(pixels, z)
    seen = np.isfinite(points).all(axis=1)
    np.testing.assert_allclose(points[seen, 2], z, atol=1e-9)
    np.testing.assert_allclose(view.project(points[seen]), pixels[seen], atol=1e-6)


def test_a_ray_above_the_horizon_reaches_no_ground():
    level = looking((np.pi / 2, 0, 0))
    sky, field = level.at_height(np.array([[1000.0, 300.0], [1000.0, 1300.0]]), 0.0)
    assert np.isnan(sky).all() and np.isfinite(field).all()


def test_heights_may_differ_from_pixel_to_pixel():
    points = looking((0.1, 0.0, 0.3)).at_height(np.array([[500.0, 500.0], [500.0, 500.0]]), np.array([10.0, 200.0]))
    np.testing.assert_allclose(points[:, 2], [10.0, 200.0])


def test_points_behind_the_camera_are_not_mirrored_into_the_photograph():
    view = looking((0, 0, 0))
    assert np.isnan(view.project(CENTRE + np.array([[1.0, 1.0, 300.0], [1.0, 1.0, 0.0]]))).all()


def test_a_photograph_contains_its_border_and_not_nan():
    view = looking((0, 0, 0))
    corner, outside = [2000.0, 1500.0], [2000.01, 3.0]
    assert view.contains(np.array([corner, outside, [np.nan, 5.0], [0.0, 0.0]])).tolist() == [True, False, False, True]
    assert view.contains(np.array([corner, [1995.0, 1495.0]]), margin=5).tolist() == [False, True]


@njit
def project_all(n, points, out):
    for i in range(points.shape[0]):
        out[i, 0], out[i, 1], out[i, 2] = project_point(n, points[i, 0], points[i, 1], points[i, 2])


@settings(deadline=None, max_examples=15)
@given(ATTITUDE)
def test_the_kernel_agrees_with_its_numpy_twin(attitude):
    view, points = looking(attitude), np.vstack([ground(), CENTRE + np.array([3.0, 4.0, 50.0])])
    out = np.empty((len(points), 3))
    project_all(view.numbers, points, out)
    np.testing.assert_allclose(out[:, :2], view.project(points), atol=1e-7)
    np.testing.assert_allclose(out[:, 2], -(points - CENTRE) @ view.rotation[2], atol=1e-9)


def test_a_view_for_kernels_names_its_numbers():
    n = looking((0.1, 0.2, 0.3)).numbers
    R = rotation_matrix(0.1, 0.2, 0.3)
    assert (n.r11, n.r13, n.r31, n.r33) == (R[0, 0], R[0, 2], R[2, 0], R[2, 2])
    assert (n.xc, n.yc, n.zc) == tuple(CENTRE)
    assert (n.col0, n.row0, n.width, n.height) == (1008.0, 755.0, 2001.0, 1501.0)
    assert (n.lens.k1, n.lens.p2) == (-0.08, -2e-4)


def test_a_stored_orientation_is_in_degrees():
    stored = ExteriorOrientation(photo="a", centre=tuple(CENTRE), omega_phi_kappa=(1.0, -2.0, 90.0))
    view = view_of(stored, REAL)
    assert view.name == "a" and view.camera is REAL
    np.testing.assert_allclose(view.rotation, rotation_matrix(*np.radians([1.0, -2.0, 90.0])), atol=1e-15)
    assert view.centre == pytest.approx(CENTRE)
