"""Cameras from EXIF, as typed, from files; fitted to reduced and turned photographs."""

import json
import math
from types import SimpleNamespace

import numpy as np
import pytest
from pydantic import ValidationError

from orthomill.schemas.camera import INTERIOR, BrownLens, Camera, Cameras, FisheyeLens
from orthomill.schemas.errors import PhotoError, WorkflowError
from orthomill.schemas.photo import Header, Photo, Photos
from orthomill.schemas.project import CameraFromChessboards, CameraGiven
from orthomill.tasks.calibration.cameras.camera_assignment import fitted
from orthomill.tasks.calibration.cameras.nominal_cameras import cameras_from_file
from orthomill.tasks.calibration.chessboards import index_board_photos
from orthomill.tasks.calibration.report.known_cameras import as_given, from_exif, from_file
from orthomill.tasks.calibration.stage import CalibrationStage
from orthomill.tasks.geometry.camera_change import scaled, turned
from orthomill.tasks.geometry.distortion import image_to_pixel

CAMERA = Camera(
    name="t",
    width=800,
    height=600,
    c=700,
    x0=9.0,
    y0=-6.0,
    k1=-0.1,
    k2=0.02,
    p1=0.004,
    p2=-0.003,
    pixel_um=4.0,
    covariance=tuple(map(tuple, np.diag([4.0, 1.0, 2.0, 1e-6, 1e-6, 0.0, 3e-8, 5e-8]).tolist())),
)


def photo(name: str = "a", **changes) -> Photo:
    facts = {"name": name, "path": f"{name}.jpg", "width": 800, "height": 600, "bands": 3, "dtype": "uint8", "camera": "cam"}
    return Photo(**{**facts, **changes})


def photos(*many: Photo) -> Photos:
    return Photos(photos=many)


def upright_pixel(pixel: np.ndarray, orientation: int, width: int, height: int) -> np.ndarray:
    """Where a pixel of the file lands, by marking it in an array."""
    from orthomill.tasks.imagery.upright import upright

    marks = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1).astype(float)
    shown = upright(marks, orientation)
    row, col = np.argwhere((shown == pixel).all(axis=2))[0]
    return np.array([col, row], dtype=float)


@pytest.mark.parametrize("orientation", range(1, 9))
def test_a_turned_camera_images_every_direction_at_the_turned_pixel(orientation):
    own = turned(CAMERA, orientation)
    directions = np.array([[150.0, 80.0], [-200.0, 120.0], [60.0, -170.0]])
    before = image_to_pixel(CAMERA, directions)
    corners = np.array([[0, 0], [799, 0], [0, 599]])
    moved = np.array([upright_pixel(corner, orientation, 800, 600) for corner in corners])
    origin, along_col, along_row = moved[0], (moved[1] - moved[0]) / 799, (moved[2] - moved[0]) / 599
    expected = origin + before[:, :1] * along_col + before[:, 1:] * along_row
    turn = np.array([[along_col[0], -along_row[0]], [-along_col[1], along_row[1]]])
    assert image_to_pixel(own, directions @ turn.T) == pytest.approx(expected, abs=1e-9)


def test_a_turned_covariance_moves_with_its_parameters():
    own = np.array(turned(CAMERA, 6).covariance)
    assert np.diag(own) == pytest.approx([4.0, 2.0, 1.0, 1e-6, 1e-6, 0.0, 5e-8, 3e-8, *[0.0] * 9])


def test_a_reduced_photograph_has_a_reduced_camera():
    half = scaled(CAMERA, (400, 300))
    assert (half.c, half.x0, half.y0, half.lens.k1, half.pixel_um) == (350, 4.5, -3.0, -0.1, 8.0)
    assert np.array(half.covariance)[0, 0] == pytest.approx(1.0)
    direction = np.array([[0.2, -0.1]])
    full, small = image_to_pixel(CAMERA, 700 * direction), image_to_pixel(half, 350 * direction)
    assert (small + 0.5) * 2 - 0.5 == pytest.approx(full)
    assert fitted(CAMERA, photo(width=600, height=800, exif_orientation=6)).width == 600


def test_exif_gives_a_nominal_camera_with_wide_sigmas():
    outcome = from_exif(photos(photo(focal_mm=4.0, pixel_um=2.0), photo("b", camera="other", focal_35mm=27.0)))
    cameras = outcome.cameras
    assert cameras.of("a").c == pytest.approx(2000) and cameras.of("a").source == "exif"
    # 27 mm on the diagonal of 35 mm film, 43.27 mm, is that of 800 x 600 px.
    assert cameras.of("b").c == pytest.approx(27.0 * 1000.0 / 43.27)
    sigma = [np.sqrt(cameras.of(name).covariance[0][0]) for name in "ab"]
    assert sigma == pytest.approx([40.0, 0.04 * cameras.of("b").c])
    assert any("nominal" in warning for warning in outcome.report.warnings)


def test_contradicting_exif_tags_are_reported():
    report = from_exif(photos(photo(focal_mm=4.0, pixel_um=2.0, focal_35mm=28.0))).report
    assert any("contradict" in warning for warning in report.warnings)


def test_without_exif_a_camera_is_guessed_and_said():
    outcome = from_exif(photos(photo("b"), photo("c", focal_mm=8.0)))
    camera = outcome.cameras.of("b")
    assert camera.c == 800 and np.sqrt(camera.covariance[0][0]) == pytest.approx(200)
    (said,) = [text for text in outcome.report.warnings if "guessed" in text]
    assert "b, c" in said and "kind: given" in said


def test_a_photograph_that_lost_its_tags_takes_the_camera_of_the_others_of_its_size():
    block = (photo("a", focal_mm=4.0, pixel_um=2.0, camera="cam"), photo("b", camera="800 x 600"))
    outcome = from_exif(photos(*block))
    assert outcome.cameras.of_photo == {"a": "cam", "b": "cam"} and list(outcome.cameras.cameras) == ["cam"]
    assert any("focal length of b; taken as photographs of cam" in text for text in outcome.report.warnings)


def test_a_photograph_of_another_size_without_tags_gets_a_guess_that_says_so():
    outcome = from_exif(photos(photo(focal_mm=4.0, pixel_um=2.0), photo("b", camera="900 x 900", width=900, height=900)))
    camera = outcome.cameras.of("b")
    assert camera.c == 900 and np.sqrt(camera.covariance[0][0]) == pytest.approx(225) and camera.source == "exif"
    assert any("focal length of b" in text and "900 px was guessed" in text for text in outcome.report.warnings)


def test_given_cameras_keep_their_numbers_and_sigma():
    cameras = as_given(photos(photo()), CameraGiven(kind="given", c=900, x0=3, k1=0.01, sigma_c=5)).cameras
    assert cameras.of("a").interior == (900, 3, 0, 0.01, *[0] * 13)
    assert cameras.of("a").covariance[0][0] == 25
    assert as_given(photos(photo()), CameraGiven(kind="given", c=900)).cameras.of("a").covariance is None


def test_photographs_of_another_shape_are_named():
    with pytest.raises(PhotoError, match=r"b \(800 x 800\)"):
        as_given(photos(photo(), photo("b", height=800)), CameraGiven(kind="given", c=900))


def test_a_calibrated_camera_serves_its_own_photographs_and_exif_the_others():
    nominal = {"focal_mm": 4.0, "pixel_um": 2.0}
    outcome = from_file(photos(photo(), photo("b", height=700, camera="B", **nominal)), CAMERA.model_dump_json(), "c.json", "a*")
    assert outcome.cameras.of("a").c == 700 and outcome.cameras.of("b").c == 2000
    assert outcome.cameras.of("b").source == "exif"
    same = as_given(photos(photo(), photo("b", **nominal)), CameraGiven(kind="given", c=900, serves="a.*")).cameras
    assert same.of("a").c == 900 and same.of("b").c == 2000, "two cameras that EXIF gives one name"
    with pytest.raises(WorkflowError, match=r"No photograph matches 'DSC\*'"):
        as_given(photos(photo()), CameraGiven(kind="given", c=900, serves="DSC*"))


def test_files_hold_one_camera_or_those_of_an_earlier_run():
    single = from_file(photos(photo(width=400, height=300)), CAMERA.model_dump_json(), "camera.json")
    assert single.cameras.of("a").c == 350
    assert any("scaled" in warning for warning in single.report.warnings)
    table = Cameras(cameras={"cam": CAMERA, "x": CAMERA.model_copy(update={"c": 900.0})}, of_photo={})
    assert from_file(photos(photo()), table.model_dump_json(), "cameras.json").cameras.of("a").c == 700
    block = table.model_dump_json()[:-1] + ', "crs": "EPSG:2100", "photos": []}'
    assert from_file(photos(photo()), block, "cameras.json").cameras.of("a").c == 700
    with pytest.raises(WorkflowError, match="none called unknown"):
        from_file(photos(photo(camera="unknown")), table.model_dump_json(), "cameras.json")


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("{", "not JSON"),
        (json.dumps({"name": "x", "width": 10}), "height"),
        ("[1]", "the whole"),
        (json.dumps({"name": "x", "width": 10, "height": 10, "c": -5}), "greater than 0"),
        (json.dumps(CAMERA.model_dump() | {"x0": math.nan}), "not a number"),
        (CAMERA.model_copy(update={"c": 4.7}).model_dump_json(), "in pixels and not in millimetres"),
        (CAMERA.model_copy(update={"x0": 9e4}).model_dump_json(), "outside of the photograph"),
        (CAMERA.changed(k1=1e300).model_dump_json(), "times the radius in the corners"),
        (CAMERA.model_copy(update={"pixel_um": -3.0}).model_dump_json(), "pixels of -3 micrometres"),
        (CAMERA.model_copy(update={"covariance": ((1.0, 2.0),)}).model_dump_json(), "not 17 x 17"),
        (CAMERA.model_copy(update={"covariance": ((-1.0,) * 8,) * 8}).model_dump_json(), "negative variances"),
        ("[" * 100_000, "cannot be read as JSON"),
        ('{"width": ' + "9" * 5000 + "}", "cannot be read as JSON"),
    ],
)
def test_a_wrong_camera_file_says_where(text, part):
    with pytest.raises(WorkflowError, match=part):
        from_file(photos(photo()), text, "camera.json")


def test_chessboard_photographs_of_two_sizes_are_refused():
    headers = tuple(Header(path=f"{n}.jpg", width=w, height=600, bands=1, dtype="uint8") for n, w in (("a", 800), ("b", 810)))
    with pytest.raises(PhotoError, match=r"b\.jpg"):
        index_board_photos(headers)


@pytest.mark.parametrize("corners", [(7, 2), (2, 5)])
def test_boards_with_too_few_corners_are_refused_before_anything_runs(corners):
    source = {"kind": "chessboards", "photographs": {"kind": "simulated"}, "corners": corners, "square": 0.1}
    project = SimpleNamespace(cameras=CameraFromChessboards.model_validate(source))
    with pytest.raises(WorkflowError, match="inner corners"):
        list(CalibrationStage().plan(SimpleNamespace(project=project)))


def test_interior_order_is_the_one_of_every_covariance():
    assert INTERIOR[:8] == ("c", "x0", "y0", "k1", "k2", "k3", "p1", "p2"), "that of earlier versions"
    assert INTERIOR[8:] == ("affinity", "skew", "k4", "k5", "k6", "s1", "s2", "s3", "s4")


def test_the_camera_of_turned_photographs_in_a_file_is_that_of_their_sensor():
    upright = turned(CAMERA, 6).model_copy(update={"name": "body turned 6"})
    text = Cameras(cameras={upright.name: upright}, of_photo={}).model_dump_json()
    found = cameras_from_file(text, "cameras.json", Photos(photos=(photo(camera="body"),)))
    assert np.allclose(found["body"].interior, CAMERA.interior) and found["body"].width == CAMERA.width


def test_a_given_camera_may_have_any_lens_and_pixels_that_are_not_square():
    given = CameraGiven(kind="given", c=900, lens="fisheye", k1=0.02, k4=0.001, affinity=0.002, skew=-0.001)
    own = as_given(photos(photo()), given).cameras.of("a")
    assert own.lens == FisheyeLens(k1=0.02, k4=0.001) and (own.affinity, own.skew) == (0.002, -0.001)
    rational = CameraGiven(kind="given", c=900, lens="thin_prism", k5=0.1, k6=0.2, s1=1e-3, s2=2e-3, s3=3e-3, s4=4e-3)
    assert as_given(photos(photo()), rational).cameras.of("a").interior[11:] == (0.1, 0.2, 1e-3, 2e-3, 3e-3, 4e-3)


def test_a_coefficient_that_the_lens_lacks_is_refused_with_those_that_it_has():
    with pytest.raises(ValidationError, match="a lens of kind fisheye has no p1; it has c, x0, y0, k1, k2, k3, affinity, skew, k4"):
        CameraGiven(kind="given", c=900, lens="fisheye", p1=0.001)
    with pytest.raises(PhotoError, match="skew"):
        turned(CAMERA.changed(skew=0.01), 6)


def test_camera_files_of_earlier_versions_are_brown_lenses():
    text = '{"name": "old", "width": 800, "height": 600, "c": 700.0, "k1": -0.1, "p2": 0.001, "covariance": %s}'
    old = Camera.model_validate_json(text % [[float(i == j) for j in range(8)] for i in range(8)])
    assert old.lens == BrownLens(k1=-0.1, p2=0.001)
    assert np.array(old.covariance).shape == (17, 17) and np.diag(old.covariance).tolist() == [1.0] * 8 + [0.0] * 9
    assert Camera.model_validate_json(old.model_dump_json()) == old


def test_a_quarter_turn_exchanges_the_constants_of_both_axes():
    upright = turned(CAMERA.changed(affinity=0.25), 6)
    assert upright.c == pytest.approx(1.25 * CAMERA.c) and upright.c * (1.0 + upright.affinity) == pytest.approx(CAMERA.c)
    again = turned(upright, 8)
    assert again.interior == pytest.approx(CAMERA.changed(affinity=0.25).interior)
