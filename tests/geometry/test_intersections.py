"""Forward intersection in space and by least squares in the image, against closed forms."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from orthomill.schemas.camera import Camera
from orthomill.tasks.geometry.fixed_intersection import Measured, intersect_fixed
from orthomill.tasks.geometry.intersection import intersect_rays
from orthomill.tasks.geometry.rotation import rotation_matrix
from orthomill.tasks.geometry.view import View

CAMERA = Camera(name="c", width=2000, height=1500, c=1600.0, x0=5.0, y0=-4.0, k1=-0.05, p1=2e-4)
COORDINATE = st.floats(-50, 50)
POINT = st.tuples(COORDINATE, COORDINATE, COORDINATE).map(np.array)


def unit(v):
    return np.asarray(v, float) / np.linalg.norm(v)


@settings(deadline=None, max_examples=60)
@given(POINT, st.lists(POINT, min_size=2, max_size=5))
def test_rays_through_one_point_meet_there(point, directions):
    directions = np.array([unit(d + np.array([200.0 * (k % 2), 0, 300.0])) for k, d in enumerate(directions)])
    centres = point - 70.0 * directions
    found, distance = intersect_rays(centres[:, None], directions[:, None])
    np.testing.assert_allclose(found[0], point, atol=1e-8)
    assert distance[0] < 1e-8


def test_skew_rays_meet_in_the_middle_of_their_common_perpendicular():
    centres = np.array([[[0.0, 0.0, 0.0]], [[5.0, 0.0, 2.0]]])
    directions = np.array([[[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]]])
    found, distance = intersect_rays(centres, directions)
    np.testing.assert_allclose(found, [[5.0, 0.0, 1.0]], atol=1e-12)
    assert distance[0] == pytest.approx(1.0), "half of the gap of 2"


def test_parallel_rays_give_no_point_and_spoil_no_other():
    centres = np.zeros((2, 2, 3))
    centres[1] = [10.0, 0.0, 0.0]
    directions = np.array([[[0, 0, -1.0], unit([1, 0, -1])], [[0, 0, -1.0], unit([-1, 0, -1])]])
    found, distance = intersect_rays(centres, directions)
    assert np.isnan(found[0]).all() and np.isnan(distance[0])
    np.testing.assert_allclose(found[1], [5, 0, -5], atol=1e-12)


def strip(count, base=60.0, height=240.0, tilt=0.02):
    rng = np.random.default_rng(count)
    return [
        View(f"v{i}", CAMERA, rotation_matrix(*rng.normal(0, tilt, 2), 0.1 * i), np.array([4e5 + base * i, 4.3e6, height]))
        for i in range(count)
    ]


def measured(views, points, noise=0.0, sigma=1.0, seed=0):
    rng, rows = np.random.default_rng(seed), []
    for number, view in enumerate(views):
        pixels = view.project(points)
        rows += [(i, number, *pixels[i]) for i in np.flatnonzero(view.contains(pixels))]
    table = np.array(rows)
    pixels = table[:, 2:] + noise * rng.standard_normal((len(table), 2))
    return Measured(table[:, 0].astype(int), table[:, 1].astype(int), pixels, np.full(len(table), sigma))


def ground(count, seed=1):
    rng = np.random.default_rng(seed)
    return np.column_stack([4e5 + rng.uniform(-20, 140, count), 4.3e6 + rng.uniform(-80, 80, count), rng.uniform(0, 40, count)])


def test_exact_measurements_give_the_exact_points_and_no_residuals():
    views, points = strip(3), ground(40)
    found = intersect_fixed(views, measured(views, points), len(points))
    np.testing.assert_allclose(found.points, points, atol=1e-6)
    assert np.abs(found.residual).max() < 1e-6


def test_height_precision_of_the_normal_case_is_the_textbook_formula():
    """sigma_Z = (H / B) (H / c) sigma_p with sigma_p = sqrt(2) sigma, for a point on the base line
    (sources/epipolar.md#results-expected)."""
    ideal = Camera(name="c", width=2000, height=1500, c=1600.0)
    views = [View(n, ideal, np.eye(3), np.array([x, 0.0, 240.0])) for n, x in (("l", 0.0), ("r", 60.0))]
    own = measured(views, np.array([[30.0, 0.0, 0.0]]), sigma=0.4)
    sigma = np.sqrt(np.diag(intersect_fixed(views, own, 1).covariance[0]))
    assert sigma[2] == pytest.approx(240 / 60 * 240 / 1600 * np.sqrt(2) * 0.4, rel=1e-9)
    assert sigma[1] == pytest.approx(240 / 1600 * 0.4 / np.sqrt(2), rel=1e-9), "the mean of two"


def test_errors_are_as_large_as_the_covariance_says():
    views, points = strip(4), ground(400)
    found = intersect_fixed(views, measured(views, points, noise=0.5, sigma=0.5), len(points))
    seen = np.isfinite(found.points).all(axis=1)
    error = found.points[seen] - points[seen]
    size = np.einsum("ni,nij,nj->n", error, np.linalg.inv(found.covariance[seen]), error)
    assert seen.sum() > 150 and np.mean(size) == pytest.approx(3.0, rel=0.15), "chi-square of three degrees of freedom"


def test_the_more_accurate_ray_draws_the_point_to_itself():
    views, points = strip(3), ground(1)
    own = measured(views, points)
    shifted = own.pixels.copy()
    shifted[0] += [0.0, 2.0]
    residuals = []
    for sigma in (0.1, 10.0):
        weights = np.where(np.arange(3) == 0, sigma, 1.0)
        residuals.append(np.abs(intersect_fixed(views, Measured(own.point, own.photo, shifted, weights), 1).residual[0]).max())
    assert residuals[0] < 0.1 < 1.5 < residuals[1]


def test_residuals_are_computed_minus_observed_in_columns_and_rows():
    ideal = CAMERA.changed(k1=0.0, p1=0.0)
    views, points = [View(v.name, ideal, v.rotation, v.centre) for v in strip(3)], ground(1)
    own = measured(views, points)
    off = own.pixels + np.array([[0, 0], [0, 0], [0, 1e-3]])
    found = intersect_fixed(views, Measured(own.point, own.photo, off, own.sigma), 1)
    computed = np.vstack([view.project(found.points)[0] for view in views])
    np.testing.assert_allclose(found.residual, computed - off, atol=1e-6)


def test_a_single_ray_and_rays_that_diverge_give_no_point_and_spoil_no_other():
    views, points = strip(2, tilt=0.0), ground(3)
    views = [View(v.name, CAMERA, np.eye(3), v.centre) for v in views]
    own = measured(views, points)
    own = own.take(~((own.point == 0) & (own.photo == 1)))
    crossed = own.pixels.copy()
    pair = np.flatnonzero(own.point == 1)
    crossed[pair] = crossed[pair[::-1]]
    found = intersect_fixed(views, Measured(own.point, own.photo, crossed, own.sigma), 3)
    assert np.isnan(found.points[0]).all(), "one ray"
    assert np.isnan(found.points[1]).all(), "with left and right exchanged the rays meet above the cameras"
    np.testing.assert_allclose(found.points[2], points[2], atol=1e-6)
