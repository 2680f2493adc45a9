"""What the report shows of cameras: precision in digits that it supports, sources, curves and warnings."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from orthomill.schemas.camera import BrownLens, Camera, Cameras
from orthomill.schemas.photo import FactoryCamera, Photo, Photos
from orthomill.tasks.calibration.cameras.camera_sharing import SharedCameras
from orthomill.tasks.calibration.cameras.untagged_photographs import Substitute, UntaggedPhotos
from orthomill.tasks.calibration.report.cameras_report import _with_sigma, cameras_report, untagged_sentence

SIGMA = (0.5, 0.2, 0.3, 1e-4, 2e-5, 0.0, 1e-6, 2e-6)
CAMERA = Camera(
    name="cam",
    width=800,
    height=600,
    c=700.0,
    x0=1.5,
    k1=-0.1,
    k2=0.02,
    p1=0.001,
    pixel_um=4.0,
    source="chessboards",
    covariance=tuple(map(tuple, np.diag(np.square(SIGMA)).tolist())),
)


def photo(name: str = "a", **changes) -> Photo:
    facts = {"name": name, "path": f"{name}.jpg", "width": 800, "height": 600, "bands": 3, "dtype": "uint8", "camera": "cam"}
    return Photo(**{**facts, **changes})


def report(*cameras: Camera, photos: tuple[Photo, ...] = (), sources: dict[str, Camera] | None = None, untagged=()):
    own = Cameras(cameras={camera.name: camera for camera in cameras}, of_photo={photo.name: photo.camera for photo in photos})
    return cameras_report(own, SharedCameras(Photos(photos=photos), sources or own.cameras, untagged))


@pytest.mark.parametrize(
    ("value", "sigma", "words"),
    [
        (700.123456, 0.5, ("700.12", "0.50")),
        (700.123456, 12.0, ("700", "12")),
        (-0.1000123, 0.00012, ("-0.10001", "0.00012")),
        (1.23456e-9, 4.5e-11, ("1.23456e-09", "4.5e-11")),
        (3.0, 0.0, ("3", "fixed")),
        (3.25, None, ("3.25", "not known")),
    ],
)
def test_a_parameter_has_the_digits_that_its_standard_error_supports(value, sigma, words):
    assert _with_sigma(value, sigma) == words


@settings(deadline=None, max_examples=50)
@given(value=st.floats(-1e4, 1e4), sigma=st.floats(1e-6, 1e3))
def test_rounding_is_small_compared_with_the_standard_error(value, sigma):
    printed, error = _with_sigma(value, sigma)
    assert abs(float(printed) - value) <= max(0.051 * sigma, 0.501 * (sigma > 10)) and float(error) == pytest.approx(
        sigma, rel=0.06
    )


def test_one_camera_has_its_constant_as_a_figure_and_several_have_not():
    one = {figure.name: figure for figure in report(CAMERA).figures}
    assert one["c"].value == 700.0 and one["sigma_c"].value == 0.5 and one["source"].value == "from chessboards"
    assert one["c"].headline and one["cameras"].value == 1
    two = report(CAMERA, CAMERA.model_copy(update={"name": "other"}))
    assert [figure.name for figure in two.figures] == ["cameras"] and two.figures[0].value == 2


@pytest.mark.parametrize("source", ["exif", "file", "given", "block", "truth"])
def test_only_a_calibration_is_a_headline(source):
    figures = report(CAMERA.model_copy(update={"source": source})).figures
    assert not any(figure.headline for figure in figures) and figures[-1].value


def test_the_table_of_a_camera_shows_fixed_parameters_literature_units_and_millimetres():
    (grid,) = report(CAMERA, photos=(photo(), photo("b"))).grids
    rows = {(row[0], row[3]): row for row in grid.rows}
    assert rows["c", "px"][1:3] == ("700.00", "0.50") and rows["k3", ""][2] == "fixed"
    assert float(rows["k1, calibration literature", "px^-2"][1]) == pytest.approx(-0.1 / 700.0**2, rel=1e-3)
    assert rows["c", "mm"][1] == "2.8" and "2 photographs" in grid.note


def test_without_a_covariance_nothing_is_claimed():
    (grid,) = report(CAMERA.model_copy(update={"covariance": None, "pixel_um": None})).grids
    assert {row[2] for row in grid.rows} == {"not known"} and not any(row[3] == "mm" for row in grid.rows)


def test_the_distortion_curve_is_that_of_the_radial_polynomial():
    (chart,) = report(CAMERA).charts
    r = np.array(chart.x)
    expected = r * (-0.1 * (r / 700) ** 2 + 0.02 * (r / 700) ** 4)
    assert np.array(chart.series["cam"]) == pytest.approx(expected, abs=1e-3) and r[-1] == pytest.approx(500.0)


def test_a_scaled_camera_is_reported():
    half = CAMERA.model_copy(update={"width": 400, "height": 300})
    (warning,) = report(half, sources={"cam": CAMERA}).warnings
    assert "800 x 600 pixels and was scaled to the 400 x 300" in warning and report(CAMERA).warnings == ()
    turned = CAMERA.model_copy(update={"name": "cam turned 6", "width": 600, "height": 800})
    assert report(turned, sources={"cam": CAMERA}).warnings == (), "turned, not scaled"


def test_nominal_cameras_and_contradicting_tags_are_reported():
    exif = CAMERA.model_copy(update={"source": "exif", "lens": BrownLens()})
    fair = photo(focal_mm=4.0, pixel_um=2.0, focal_35mm=90.0)
    assert len(report(exif, photos=(fair,)).warnings) == 1 and "nominal" in report(exif, photos=(fair,)).warnings[0]
    wrong = report(exif, photos=(fair.model_copy(update={"focal_35mm": 28.0}),)).warnings
    assert "2000 px by focal length and pixel size, but 647 px by the 35 mm equivalent" in wrong[1]
    once = report(exif, photos=tuple(fair.model_copy(update={"name": n, "focal_35mm": 28.0}) for n in "ab")).warnings
    assert len(once) == 2, "once per camera, not per photograph"


@pytest.mark.parametrize(
    ("kind", "dewarped", "words", "level"),
    [
        ("calibrated", True, "calibrated by the maker, whose distortion the camera has removed", "good"),
        ("design", False, "the maker's drawings of the lens", "fair"),
    ],
)
def test_a_constant_of_the_maker_is_not_called_nominal(kind, dewarped, words, level):
    factory = FactoryCamera(kind=kind, c=700.0)
    shown = CAMERA.model_copy(update={"source": "exif", "lens": BrownLens(), "covariance": None})
    found = report(shown, photos=(photo(factory=factory, dewarped=dewarped),))
    assert words in found.grids[0].note and found.verdict.level == level
    assert any("nominal" in sentence for sentence in found.warnings) == (kind == "design")


def test_photographs_without_tags_come_first_and_name_their_substitute():
    same = UntaggedPhotos(Substitute.SAME_SIZE, ("a", "b"), camera="cam")
    guessed = UntaggedPhotos(Substitute.GUESSED, ("c", "d"), constants=(900.0, 4000.4))
    warnings = report(CAMERA, untagged=(same, guessed)).warnings
    assert warnings == (untagged_sentence(same), untagged_sentence(guessed))
    assert "no focal length of a, b; taken as photographs of cam" in warnings[0]
    assert "of c, d," in warnings[1] and "4000 px, 900 px was guessed, with a standard error of 25 %" in warnings[1]
