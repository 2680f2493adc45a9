"""Cameras of resized and rotated photographs: the pixels of a ray follow the pixels of the picture."""

import numpy as np
import pytest

from orthomill.schemas.camera import INTERIOR, Camera
from orthomill.schemas.photo import Photo
from orthomill.tasks.geometry.camera_change import (
    QUARTER_TURNS,
    TURN,
    file_size,
    interior_turn,
    scaled,
    sensor_name,
    sensor_size,
    turned,
    upright_name,
)
from orthomill.tasks.geometry.distortion import image_to_pixel

SHOWN = {
    1: lambda a: a,
    2: np.fliplr,
    3: lambda a: a[::-1, ::-1],
    4: np.flipud,
    5: np.transpose,
    6: lambda a: np.rot90(a, -1),
    7: lambda a: a[::-1, ::-1].T,
    8: lambda a: np.rot90(a, 1),
}
"""What the EXIF standard says is done to an array of pixels to show it upright."""

CAMERA = Camera(name="cam", width=60, height=40, c=55.0, x0=2.0, y0=-3.0, k1=-0.1, k2=0.03, k3=0.002, p1=4e-3, p2=-2e-3)
COVARIANCE = tuple(map(tuple, (np.diag(np.arange(1.0, 18.0)) + 0.1 * np.ones((17, 17))).tolist()))


def photo(flag=1, as_taken=False, size=(40, 60)):
    return Photo(
        name="a",
        path="a.jpg",
        width=size[0],
        height=size[1],
        bands=3,
        dtype="uint8",
        camera="cam",
        exif_orientation=flag,
        as_taken=as_taken,
    )


@pytest.mark.parametrize("flag", range(1, 9))
def test_a_pixel_of_the_file_shows_up_where_exif_puts_it(flag):
    """The distorted pixel of a ray in the file, moved with the picture, is its pixel under the camera of the upright photograph."""
    rng = np.random.default_rng(flag)
    xy = rng.uniform(-15, 15, (8, 2))
    in_file = image_to_pixel(CAMERA, xy)
    upright = turned(CAMERA, flag)
    found = image_to_pixel(upright, xy @ np.array(TURN[flag], float).T)
    col, row = np.meshgrid(np.arange(60.0), np.arange(40.0))
    shown_col, shown_row = SHOWN[flag](col), SHOWN[flag](row)
    assert (upright.height, upright.width) == shown_col.shape
    for (u, v), (x, y) in zip(found, in_file, strict=True):
        # The picture's own coordinates are linear in the shown pixels: read them at the found place.
        i, j = int(v), int(u)
        at_col = (
            shown_col[i, j] + (v - i) * (shown_col[i + 1, j] - shown_col[i, j]) + (u - j) * (shown_col[i, j + 1] - shown_col[i, j])
        )
        at_row = (
            shown_row[i, j] + (v - i) * (shown_row[i + 1, j] - shown_row[i, j]) + (u - j) * (shown_row[i, j + 1] - shown_row[i, j])
        )
        assert (at_col, at_row) == pytest.approx((x, y), abs=1e-9)


@pytest.mark.parametrize(("flag", "back"), QUARTER_TURNS.items())
def test_quarter_turns_undo_each_other(flag, back):
    again = turned(turned(CAMERA, flag), back)
    assert again.interior == pytest.approx(CAMERA.interior)
    assert (again.width, again.height) == (60, 40)
    np.testing.assert_allclose(interior_turn(back) @ interior_turn(flag), np.eye(17), atol=1e-15)


@pytest.mark.parametrize("flag", range(2, 9))
def test_the_covariance_follows_the_interior_orientation(flag):
    upright = turned(CAMERA.model_copy(update={"covariance": COVARIANCE}), flag)
    values = np.array(CAMERA.interior)
    np.testing.assert_allclose(interior_turn(flag) @ values, upright.interior, atol=1e-15)
    expected = interior_turn(flag) @ np.array(COVARIANCE) @ interior_turn(flag).T
    np.testing.assert_allclose(upright.covariance, expected, atol=1e-15)
    assert upright.covariance[0][0] == pytest.approx(1.1), "c keeps its variance"


def test_a_quarter_turn_exchanges_the_variances_of_the_principal_point():
    upright = turned(CAMERA.model_copy(update={"covariance": COVARIANCE}), 6)
    at = {name: i for i, name in enumerate(INTERIOR)}
    assert upright.covariance[at["x0"]][at["x0"]] == pytest.approx(COVARIANCE[at["y0"]][at["y0"]])
    assert upright.covariance[at["p1"]][at["p1"]] == pytest.approx(COVARIANCE[at["p2"]][at["p2"]])


def test_a_reduced_photograph_shows_a_ray_where_its_pixels_were_averaged():
    """Pixel u of the full photograph lies at (u + 1/2) f - 1/2 of the reduced one: centres of pixels are whole numbers in both."""
    xy = np.random.default_rng(1).uniform(-18, 18, (20, 2))
    small = scaled(CAMERA, (30, 20))
    np.testing.assert_allclose(image_to_pixel(small, 0.5 * xy), (image_to_pixel(CAMERA, xy) + 0.5) * 0.5 - 0.5, atol=1e-12)


def test_scaling_carries_pixel_size_and_covariance():
    own = CAMERA.model_copy(update={"covariance": COVARIANCE, "pixel_um": 4.0})
    small = scaled(own, (15, 10))
    assert small.pixel_um == pytest.approx(16.0) and (small.c, small.lens.k1) == (55.0 / 4, -0.1)
    covariance = np.array(small.covariance)
    assert covariance[0, 0] == pytest.approx(COVARIANCE[0][0] / 16)
    assert covariance[0, 3] == pytest.approx(COVARIANCE[0][3] / 4)
    assert covariance[3, 3] == pytest.approx(COVARIANCE[3][3])


def test_the_same_size_and_the_same_orientation_change_nothing():
    assert scaled(CAMERA, (60, 40)) is CAMERA and turned(CAMERA, 1) is CAMERA
    assert scaled(CAMERA, (30, 20)).covariance is None and turned(CAMERA, 3).covariance is None


@pytest.mark.parametrize(("flag", "size"), [(1, (40, 60)), (3, (40, 60)), (6, (60, 40)), (8, (60, 40))])
def test_sizes_of_file_and_sensor(flag, size):
    assert file_size(photo(flag)) == size and sensor_size(photo(flag)) == size
    assert sensor_size(photo(flag, as_taken=True)) == (40, 60), "its pixels were turned in the file already"


@pytest.mark.parametrize(("flag", "name"), [(1, "cam"), (6, "cam turned 6"), (3, "cam turned 3"), (2, "cam")])
def test_names_of_upright_cameras_lead_back_to_their_sensor(flag, name):
    assert upright_name(photo(flag)) == name
    assert sensor_name(name) == "cam"


def test_a_camera_whose_own_name_ends_like_a_turn_is_no_turned_camera():
    assert sensor_name("lens turned inside") == "lens turned inside"
    assert sensor_name("cam turned 2") == "cam turned 2", "mirrored photographs have no sensor frame"
