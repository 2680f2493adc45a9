"""Lens models beyond Brown's: against OpenCV's own functions, their inverses and their derivatives."""

import cv2
import numpy as np
import pytest

from orthomill.schemas.camera import INTERIOR, LENSES, Camera, lens_parameters
from orthomill.tasks.geometry.distortion import (
    LENS,
    distort_point,
    distorted,
    distortion_derivatives,
    distortion_slopes,
    image_to_pixel,
    lens_numbers,
    lens_of,
    lens_partials,
    pixel_to_image,
    undistort_point,
    undistorted,
)

VALUES = {
    "brown": {"k1": -0.1, "k2": 0.02, "k3": -0.003, "p1": 1e-3, "p2": -2e-3},
    "rational": {"k1": 0.9, "k2": 0.3, "k3": 0.01, "p1": 1e-3, "p2": -2e-3, "k4": 1.3, "k5": 0.6, "k6": 0.05},
    "thin_prism": {"k1": 0.9, "k2": 0.3, "k4": 1.3, "k5": 0.6, "p1": 1e-3, "s1": 2e-3, "s2": -1e-3, "s3": -3e-3, "s4": 1e-3},
    "fisheye": {"k1": 0.03, "k2": -0.01, "k3": 0.004, "k4": -0.001},
    "division": {"k1": -0.3},
}
KINDS = pytest.mark.parametrize("kind", tuple(VALUES))


def camera(kind: str, **more: float) -> Camera:
    plain = Camera(name="c", width=1500, height=1000, c=500.0, x0=12.5, y0=-7.25, lens=LENSES[kind]())
    return plain.changed(**VALUES[kind], **more)


def ideal(count: int = 40, reach: float = 1.0) -> np.ndarray:
    return np.random.default_rng(2).uniform(-reach, reach, (count, 2))


def opencv_pixels(own: Camera, xy: np.ndarray) -> np.ndarray:
    """The pixels of ideal coordinates (N, 2) in units of c by OpenCV."""
    K = np.array([[own.c, 0, (own.width - 1) / 2 + own.x0], [0, own.c, (own.height - 1) / 2 - own.y0], [0, 0, 1.0]])
    points = np.column_stack([xy[:, 0], -xy[:, 1], np.ones(len(xy))]).reshape(-1, 1, 3)
    value = own.value
    if own.lens.kind == "fisheye":
        lens = np.array([*map(value, ["k1", "k2", "k3", "k4"])])
        out, _ = cv2.fisheye.projectPoints(points, np.zeros((3, 1)), np.zeros((3, 1)), K, lens)
        return out.reshape(-1, 2)
    names = ["k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4"]
    return cv2.projectPoints(points, np.zeros(3), np.zeros(3), K, np.array([*map(value, names)]))[0].reshape(-1, 2)


@pytest.mark.parametrize("kind", [kind for kind in VALUES if kind != "division"])
def test_pixels_are_those_of_opencv(kind):
    own = camera(kind)
    np.testing.assert_allclose(image_to_pixel(own, own.c * ideal()), opencv_pixels(own, ideal()), atol=1e-8)


def test_the_division_model_is_that_of_its_inverse():
    xy = ideal()
    observed = distorted(xy, lens_of(camera("division")))
    np.testing.assert_allclose(observed / (1.0 - 0.3 * (observed**2).sum(axis=1, keepdims=True)), xy, atol=1e-12)


@KINDS
def test_the_inverse_brings_every_point_back(kind):
    own = camera(kind, affinity=0.01, skew=-0.003)
    pixels = image_to_pixel(own, own.c * ideal(reach=0.7))
    np.testing.assert_allclose(image_to_pixel(own, pixel_to_image(own, pixels)), pixels, atol=1e-7)
    np.testing.assert_allclose(pixel_to_image(own, pixels) / own.c, ideal(reach=0.7), atol=1e-9)


def test_a_fisheye_sees_to_the_side_and_no_farther():
    lens = lens_of(Camera(name="e", width=100, height=100, c=50.0, lens=LENSES["fisheye"]()))
    tangent = np.tan(np.radians(89.0))
    assert distorted(np.array([[tangent, 0.0]]), lens)[0, 0] == pytest.approx(np.radians(89.0))
    assert undistorted(np.array([[np.radians(89.0), 0.0]]), lens)[0, 0] == pytest.approx(tangent, rel=1e-9)
    assert np.isnan(undistorted(np.array([[np.radians(95.0), 0.0]]), lens)).all()


@KINDS
def test_derivatives_are_those_of_finite_differences(kind):
    own = camera(kind, affinity=0.02, skew=-0.01)
    interior, xy, step = np.array(own.interior), ideal(12), 1e-6
    slopes, partials = distortion_derivatives(xy, lens_of(own))
    for axis in range(2):
        move = step * np.eye(2)[axis]
        numeric = (distorted(xy + move, lens_of(own)) - distorted(xy - move, lens_of(own))) / (2 * step)
        np.testing.assert_allclose(slopes[:, :, axis], numeric, atol=1e-7)
    for k, name in enumerate(LENS):
        if name not in lens_parameters("thin_prism" if kind == "rational" else kind):
            assert not partials[:, :, k].any(), "a parameter that the lens lacks"
            continue
        move = step * np.eye(len(INTERIOR))[3 + k]
        more, less = (distorted(xy, lens_numbers(interior + sign * move, kind)) for sign in (1, -1))
        np.testing.assert_allclose(partials[:, :, k], (more - less) / (2 * step), atol=1e-7, err_msg=name)


@KINDS
def test_kernels_agree_with_the_same_in_plain_python(kind):
    lens = lens_of(camera(kind, affinity=0.02))
    out, twin = np.empty((2, 14)), np.empty((2, 14))
    for x, y in (*ideal(5), (0.0, 0.0), (1e-8, 0.0)):
        assert distort_point.py_func(x, y, lens) == pytest.approx(distorted(np.array([[x, y]]), lens)[0], abs=1e-14)
        assert distortion_slopes.py_func(x, y, lens) == pytest.approx(
            distortion_derivatives(np.array([[x, y]]), lens)[0][0].ravel(), abs=1e-12
        )
        lens_partials(x, y, lens, out)
        lens_partials.py_func(x, y, lens, twin)
        assert out == pytest.approx(twin, abs=1e-14)
        xd, yd = distort_point.py_func(x, y, lens)
        assert undistort_point.py_func(xd, yd, lens) == pytest.approx((x, y), abs=1e-10)
