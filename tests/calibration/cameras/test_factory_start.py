"""Nominal cameras by what the tags hold: a calibration, drawings, focal lengths, zoom."""

import numpy as np
import pytest

from orthomill.schemas.camera import INTERIOR
from orthomill.schemas.photo import FactoryCamera, Photo
from orthomill.tasks.calibration.cameras.nominal_cameras import nominal_camera, nominal_constant

YARD = FactoryCamera(
    kind="calibrated", c=1955.65, affinity=0.0089, x0=-19.0, y0=11.4, k1=-0.42, k2=0.37, k3=-0.26, p1=0.004, p2=0.004
)


def photo(**facts) -> Photo:
    known = {"name": "a", "path": "a.jpg", "width": 1600, "height": 1300, "bands": 3, "dtype": "uint8", "camera": "cam"}
    return Photo(**{**known, **facts})


def sigma(camera, name: str) -> float:
    return float(np.sqrt(camera.covariance[INTERIOR.index(name)][INTERIOR.index(name)]))


def test_a_calibration_is_a_weighted_start():
    camera = nominal_camera(photo(focal_mm=5.74, focal_35mm=40.0, factory=YARD))
    assert (camera.c, camera.x0, camera.y0, camera.affinity) == (1955.65, -19.0, 11.4, 0.0089)
    assert (camera.lens.k1, camera.lens.k3, camera.lens.p1, camera.source) == (-0.42, -0.26, 0.004, "exif")
    assert 0.01 <= sigma(camera, "c") / camera.c <= 0.02 and sigma(camera, "x0") == pytest.approx(16.0)
    assert [sigma(camera, name) for name in ("k1", "k2", "k3", "p1", "affinity")] == pytest.approx([0.05, 0.1, 0.1, 0.003, 0.005])


def test_without_a_calibration_there_is_no_distortion():
    camera = nominal_camera(photo(focal_mm=5.74, focal_35mm=40.0))
    # 40 mm on the diagonal of 43.27 mm: 2.5 % below the factory's constant, where the width gave 9 %.
    assert camera.c == pytest.approx(1905.8, abs=0.2) and sigma(camera, "k3") == 0.0 and camera.lens.k1 == 0.0


def test_a_calibration_of_something_else_is_not_believed():
    assert nominal_constant(photo(focal_mm=5.74, focal_35mm=40.0, factory=YARD.model_copy(update={"c": 3900.0})))[0] < 1950
    assert nominal_constant(photo(factory=YARD))[0] == 1955.65, "nothing contradicts it"


def test_the_drawings_of_a_lens_give_its_constant_only():
    design = FactoryCamera(kind="design", c=1913.33, k1=9.0)
    camera = nominal_camera(photo(focal_mm=5.74, focal_35mm=40.0, factory=design))
    assert camera.c == 1913.33 and sigma(camera, "c") == pytest.approx(0.03 * 1913.33) and camera.lens.k1 == 0.0
    by_pixel = nominal_constant(photo(focal_mm=5.74, pixel_um=3.0, factory=design))
    assert by_pixel[0] == pytest.approx(5740 / 3.0), "focal length and pixel size are as good"


def test_a_dewarped_picture_has_hardly_any_distortion():
    camera = nominal_camera(
        photo(focal_mm=5.74, focal_35mm=40.0, dewarped=True, factory=FactoryCamera(kind="calibrated", c=1955.65))
    )
    assert (camera.c, camera.x0, camera.lens.k1) == (1955.65, 0.0, 0.0) and 0 < sigma(camera, "k1") <= 0.01


def test_digital_zoom_enlarges_the_constant():
    assert nominal_constant(photo(focal_mm=5.74, pixel_um=3.0, zoom=1.5))[0] == pytest.approx(1.5 * 5740 / 3.0)
    zoomed = nominal_camera(photo(focal_mm=5.74, pixel_um=3.0, zoom=1.5, factory=YARD))
    assert (zoomed.c, zoomed.x0, zoomed.lens.k1) == pytest.approx((1.5 * 1955.65, -28.5, -0.42))


@pytest.mark.parametrize(
    ("size", "equivalent", "c", "share"),
    [
        # Constants by calibration or adjustment, where they are known (FC6360, FC300S, iPhone 7).
        ((1600, 1300), 40.0, 1955.65, 0.04),
        ((800, 600), 20.0, 464.5, 0.04),
        ((4032, 3024), 28.0, 3270.0, 0.04),
        # Of 3:2 width and diagonal say the same; 16:9 is cut from another frame, the FC220's from 4:3.
        ((6000, 4000), 36.0, 6000.0, 0.04),
        ((4000, 2250), 26.0, 3051.6, 0.10),
    ],
)
def test_the_35_mm_equivalent_is_that_of_the_diagonal(size, equivalent, c, share):
    found, error = nominal_constant(photo(width=size[0], height=size[1], focal_35mm=equivalent))
    assert found == pytest.approx(c, rel=1.5 * share) and error == pytest.approx(share * found)
    upright = nominal_constant(photo(width=size[1], height=size[0], focal_35mm=equivalent))
    assert upright == pytest.approx((found, error))
