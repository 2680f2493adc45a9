"""Image measurements as rays, frames of sensors, and the reach of a distortion."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from orthomill.schemas.camera import Camera, Cameras
from orthomill.schemas.observations import ControlPoint, TiePoints
from orthomill.schemas.photo import Photo, Photos
from orthomill.tasks.geometry.distortion import image_to_pixel
from orthomill.tasks.orientation.folding import folding_cameras, reach
from orthomill.tasks.orientation.measurements import centred, ground_rays, ideal, on_a_line, tie_rays, with_interior
from orthomill.tasks.orientation.sensor_frame import Upright

CAMERA = Camera(name="cam", width=401, height=301, c=300.0, x0=3.0, y0=-2.0, k1=-0.05, p1=1e-3)
CAMERAS = Cameras(cameras={"cam": CAMERA}, of_photo=dict.fromkeys("ab", "cam"))


def photo(name, flag=1):
    size = {"width": 301, "height": 401} if flag >= 5 else {"width": 401, "height": 301}
    return Photo(name=name, path=f"{name}.jpg", bands=3, dtype="uint8", camera="cam", exif_orientation=flag, **size)


PHOTOS = Photos(photos=(photo("a"), photo("b")))


def ties(*rows):
    track, number, col, row, sigma = np.array(rows, float).T
    return TiePoints(track.astype(np.int32), number.astype(np.int32), col, row, sigma.astype(np.float32))


def test_centred_coordinates_have_y_up_and_keep_the_distortion():
    np.testing.assert_allclose(centred(CAMERA, np.array([[200.0, 150.0], [210.0, 130.0]])), [[0, 0], [10, 20]])


def test_ideal_coordinates_are_those_of_the_ray_in_units_of_c():
    xy = np.random.default_rng(1).uniform(-120, 120, (20, 2))
    np.testing.assert_allclose(ideal(CAMERA, centred(CAMERA, image_to_pixel(CAMERA, xy))), xy / 300.0, atol=1e-10)


def test_points_are_numbered_without_gaps_and_sorted_by_photograph():
    rays, tracks = tie_rays(
        PHOTOS, CAMERAS, ties((9, 1, 10, 10, 0.5), (4, 0, 20, 20, 0.5), (9, 0, 30, 30, 0.5), (4, 1, 40, 40, 0.5))
    )
    assert tracks.tolist() == [4, 9] and rays.point.tolist() == [0, 0, 1, 1] and rays.photo.tolist() == [0, 1, 0, 1]
    np.testing.assert_allclose(rays.xy[:, 0] + 200, [20, 40, 30, 10])


def test_a_standard_error_of_zero_has_no_infinite_weight():
    rays, _ = tie_rays(PHOTOS, CAMERAS, ties((0, 0, 10, 10, 0.0), (0, 1, 10, 10, 0.5)))
    assert rays.sigma.tolist() == [1e-3, 0.5]


def surveyed(name, **measurements):
    return ControlPoint(name=name, role="control", xyz=(0, 0, 0), sigma=(1, 1, 1), measurements=measurements)


def test_rays_of_surveyed_points_skip_photographs_outside_of_the_block():
    points = [surveyed("P", b=(200, 150, 0.5), z=(1, 1, 1)), surveyed("Q", a=(210, 150, 0.7), b=(200, 140, 0.8))]
    rays = ground_rays(points, {"a": 0, "b": 1}, CAMERAS)
    assert rays.point.tolist() == [0, 1, 1] and rays.photo.tolist() == [1, 0, 1] and rays.sigma.tolist() == [0.5, 0.7, 0.8]
    np.testing.assert_allclose(rays.xy, [[0, 0], [10, 0], [0, 10]])
    assert len(ground_rays([surveyed("P", z=(1, 1, 1))], {"a": 0}, CAMERAS)) == 0


def test_interior_parameters_replace_those_of_a_camera():
    values = np.arange(1.0, 9.0)
    assert with_interior(CAMERA, values).interior == (*values, *[0.0] * 9) and with_interior(CAMERA, values).width == 401


@settings(deadline=None, max_examples=40)
@given(st.floats(-3, 3), st.floats(-100, 100), st.integers(0, 9))
def test_points_on_a_line_are_recognised_in_any_direction(direction, offset, wrong):
    """Up to a fifth of them may lie anywhere."""
    rng = np.random.default_rng(2)
    along = np.array([np.cos(direction), np.sin(direction)])
    xy = np.outer(rng.uniform(-500, 500, 50), along) + offset + rng.normal(0, 0.5, (50, 2))
    xy[:wrong] += rng.uniform(-60, 60, (wrong, 2))
    assert on_a_line(xy, 8.0)
    assert not on_a_line(rng.uniform(-500, 500, (50, 2)), 8.0)


@pytest.mark.parametrize("k1", [-0.3, -0.1, -0.05])
def test_the_reach_of_barrel_distortion_in_closed_form(k1):
    """r (1 + k1 r^2) is largest at r = sqrt(-1 / (3 k1)), where it is 2/3 of r."""
    own = Camera(name="c", width=4000, height=3000, c=1000.0, k1=k1)
    assert reach(own) == pytest.approx(1000 * 2 / 3 * np.sqrt(-1 / (3 * k1)))


@settings(deadline=None, max_examples=40)
@given(st.integers(-400, 400), st.integers(-100, 100), st.integers(-20, 20))
def test_the_reach_is_the_largest_observed_radius_before_the_fold(k1, k2, k3):
    k1, k2, k3 = k1 / 1000, k2 / 1000, k3 / 1000
    own = Camera(name="c", width=4000, height=3000, c=1000.0, k1=k1, k2=k2, k3=k3)
    limit = reach(own)
    r = np.linspace(0, 3, 3001)
    observed = r * (1 + r**2 * (k1 + r**2 * (k2 + r**2 * k3)))
    falling = np.flatnonzero(np.diff(observed) < 0)
    if len(falling):
        assert observed[: falling[0] + 1].max() * 1000 == pytest.approx(limit, rel=1e-5)
    elif limit < np.inf:
        assert limit > 1000 * observed[-1] - 1e-6


def test_cameras_whose_corners_fold_are_found_with_their_numbers():
    folding = Camera(name="wide", width=4000, height=3000, c=2000.0, k1=-0.3)
    fine = folding.model_copy(update={"name": "fine"}).changed(k1=-0.05)
    cameras = Cameras(cameras={"wide": folding, "fine": fine}, of_photo={})
    (found,) = folding_cameras(cameras)
    assert (found.camera, found.k1, found.c) == ("wide", -0.3, 2000.0)
    assert found.corner_px == pytest.approx(2500.0) and found.reach_px == pytest.approx(reach(folding))


def test_a_block_without_rotated_photographs_passes_unchanged():
    upright = Upright(PHOTOS, CAMERAS)
    assert not upright.anything and upright.flag("a") == 1


@pytest.mark.parametrize("flag", [3, 6, 8])
def test_tie_points_of_a_rotated_photograph_go_to_its_sensor(flag):
    """The upper left corner of the upright photograph lies in another corner of the sensor's frame."""
    upright = Upright(Photos(photos=(photo("a", flag), photo("b"))), CAMERAS)
    own = upright.sensor_ties(ties((0, 0, 0, 0, 1), (0, 1, 0, 0, 1)))
    corner = {3: (400, 300), 6: (0, 300), 8: (400, 0)}[flag]
    assert (own.col[0], own.row[0]) == pytest.approx(corner), "EXIF 6 shows the lower left corner of the sensor at the upper left"
    assert (own.col[1], own.row[1]) == (0, 0)
    back = upright.sensor_photos().photos[0]
    assert (back.width, back.height, back.exif_orientation) == (401, 301, 1)


@pytest.mark.parametrize("flag", [2, 5])
def test_a_mirrored_photograph_has_no_sensor_frame(flag):
    assert Upright(Photos(photos=(photo("a", flag),)), CAMERAS).flag("a") == 1
