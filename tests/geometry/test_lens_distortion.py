"""Brown's lens against OpenCV's own functions, its inverse, and what happens where it folds."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from orthomill.schemas.camera import Camera
from orthomill.tasks.geometry.distortion import LENS as NAMES
from orthomill.tasks.geometry.distortion import image_to_pixel, lens_of, pixel_to_image

LENS = st.fixed_dictionaries(
    {
        "k1": st.floats(-0.2, 0.2),
        "k2": st.floats(-0.05, 0.05),
        "k3": st.floats(-0.01, 0.01),
        "p1": st.floats(-0.003, 0.003),
        "p2": st.floats(-0.003, 0.003),
    }
)
SETTINGS = settings(deadline=None, max_examples=40)


def camera(**lens):
    return Camera(name="c", width=1500, height=1000, c=1400.0, x0=12.5, y0=-7.25, **lens)


def matrices(own):
    """OpenCV's camera matrix and coefficients, by docs/conventions.md."""
    K = np.array([[own.c, 0, (own.width - 1) / 2 + own.x0], [0, own.c, (own.height - 1) / 2 - own.y0], [0, 0, 1]])
    return K, np.array([own.lens.k1, own.lens.k2, own.lens.p1, own.lens.p2, own.lens.k3])


def pixels(count=60):
    return np.random.default_rng(3).uniform([0, 0], [1499, 999], (count, 2))


@SETTINGS
@given(LENS)
def test_pixels_are_those_of_opencv(lens):
    own = camera(**lens)
    xy = np.random.default_rng(1).uniform(-600, 600, (50, 2))
    points = np.column_stack([xy[:, 0], -xy[:, 1], np.full(50, own.c)])
    K, coefficients = matrices(own)
    expected = cv2.projectPoints(points, np.zeros(3), np.zeros(3), K, coefficients)[0].reshape(-1, 2)
    np.testing.assert_allclose(image_to_pixel(own, xy), expected, atol=1e-9)


@SETTINGS
@given(LENS)
def test_the_inverse_brings_every_pixel_back(lens):
    own = camera(**lens)
    np.testing.assert_allclose(image_to_pixel(own, pixel_to_image(own, pixels())), pixels(), atol=1e-8)


def test_an_ideal_lens_only_moves_the_origin_and_turns_y_up():
    own = camera()
    np.testing.assert_allclose(pixel_to_image(own, np.array([[749.5 + 12.5, 499.5 + 7.25]])), [[0, 0]], atol=1e-12)
    np.testing.assert_allclose(pixel_to_image(own, np.array([[762.0 + 10, 506.75 - 20]])), [[10, 20]], atol=1e-12)


def test_the_principal_point_is_not_distorted():
    own = camera(k1=-0.3, k2=0.1, p1=0.01, p2=-0.01)
    np.testing.assert_allclose(image_to_pixel(own, np.zeros((1, 2))), [[762.0, 506.75]], atol=1e-12)


def test_barrel_distortion_moves_points_inwards_by_the_radial_polynomial():
    own = camera(k1=-0.1, k2=0.02, k3=-0.003)
    r = 0.5
    moved = image_to_pixel(own, np.array([[r * own.c, 0.0]]))[0, 0] - 762.0
    assert moved / own.c == pytest.approx(r * (1 - 0.1 * r**2 + 0.02 * r**4 - 0.003 * r**6), rel=1e-14)
    assert moved < r * own.c


@pytest.mark.parametrize(("name", "expected"), [("p1", (-2 * 0.3 * 0.2, -(0.13 + 2 * 0.04))), ("p2", (0.13 + 2 * 0.09, 2 * 0.06))])
def test_tangential_terms_with_y_up(name, expected):
    """docs/conventions.md: -2 p1 x y and -p1 (r^2 + 2 y^2); p2 (r^2 + 2 x^2) and 2 p2 x y; at x = 0.3, y = 0.2."""
    xy = 1400.0 * np.array([[0.3, 0.2]])
    moved = image_to_pixel(camera(**{name: 1e-3}), xy) - image_to_pixel(camera(), xy)
    np.testing.assert_allclose(moved[0] * [1, -1] / 1400.0 / 1e-3, expected, atol=1e-9)


def test_a_published_coefficient_per_square_pixel_converts_by_c_squared():
    """A coefficient k1 [px^-2] = k1 / c^2 shifts a point at radius r px by k1 r^3 px."""
    own = camera(k1=-0.05)
    r = 400.0
    moved = image_to_pixel(own, np.array([[r, 0.0]]))[0, 0] - 762.0 - r
    assert moved == pytest.approx(-0.05 / 1400.0**2 * r**3, rel=1e-12)


def test_beyond_the_fold_no_ideal_point_is_made_up():
    """k1 = -0.3 reaches 2/3 c sqrt(1/0.9) = 0.7027 c; what is observed farther out belongs to no ray."""
    own = Camera(name="c", width=3000, height=3000, c=1000.0, k1=-0.3)
    assert pixel_to_image(own, np.array([[1499.5 + 700.0, 1499.5]]))[0, 0] == pytest.approx(1000, rel=0.1)
    beyond = pixel_to_image(own, np.array([[1499.5 + 760.0, 1499.5]]))
    with np.errstate(invalid="ignore", over="ignore"):
        assert not np.allclose(image_to_pixel(own, beyond), [[2259.5, 1499.5]], atol=1.0)


def test_the_lens_names_its_coefficients():
    own = lens_of(camera(k1=0.1, k2=0.2, k3=0.3, p1=0.4, p2=0.5, affinity=0.01, skew=0.02))
    assert own._fields == (*NAMES, "model")
    assert own[:7] == (0.1, 0.2, 0.3, 0.4, 0.5, 0.01, 0.02) and own[7:] == (0.0,) * 8
