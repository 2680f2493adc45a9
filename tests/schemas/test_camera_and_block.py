"""Cameras, photographs and the block: what is asked of them by name, and what survives being stored."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from orthomill.schemas.camera import CAMERAS, INTERIOR, Camera, Cameras
from orthomill.schemas.epipolar import EpipolarPair, epipolar_raster, grey_table
from orthomill.schemas.observations import Control, ControlPoint
from orthomill.schemas.orientation import (
    BLOCK,
    Block,
    ExteriorOrientation,
    GroundResidual,
    GroundResiduals,
    JointCovariance,
    RelativeOrientation,
    Unoriented,
)
from orthomill.schemas.photo import Header, Photo, PhotoRemark, PhotoRemarkCode, Photos, photo_raster, tag_text

FINITE = st.floats(-1e6, 1e6)
POSITIVE = st.floats(1e-3, 1e6)
VECTOR = st.tuples(FINITE, FINITE, FINITE)


def camera(name: str = "nikon", **more) -> Camera:
    return Camera(name=name, width=4000, height=3000, c=3500.0, **more)


@settings(max_examples=60, deadline=None)
@given(values=st.tuples(POSITIVE, *[FINITE] * 7))
def test_interior_parameters_come_in_their_fixed_order(values):
    """Covariances and kernels count on this order."""
    said = Camera(name="a", width=4, height=3, **dict(zip(INTERIOR[:8], values, strict=True)))
    assert said.interior == (*values, *[0.0] * 9)
    assert Camera.model_validate_json(said.model_dump_json()) == said


@pytest.mark.parametrize("wrong", [{"c": 0}, {"c": -1}, {"width": 0}, {"height": 0}, {"k4": 0.1}, {"source": "guess"}])
def test_a_camera_that_cannot_be_is_refused(wrong):
    with pytest.raises(ValidationError):
        Camera.model_validate({"name": "a", "width": 4, "height": 3, "c": 5.0} | wrong)


def test_cameras_are_found_by_photograph():
    cameras = Cameras(cameras={"n": camera("n"), "z": camera("z", k1=0.5)}, of_photo={"a": "n", "b": "z"})
    assert cameras.of("b").lens.k1 == 0.5 and cameras.of("a").name == "n"
    changed = cameras.with_k1({"n": -0.1})
    assert changed.of("a").lens.k1 == -0.1 and changed.of("b") == cameras.of("b") and cameras.of("a").lens.k1 == 0.0
    assert changed.of_photo == cameras.of_photo


ORIENTATIONS = st.builds(
    ExteriorOrientation,
    photo=st.just("a"),
    centre=VECTOR,
    omega_phi_kappa=VECTOR,
    covariance=st.none() | st.just(tuple(tuple(float(i == j) for j in range(6)) for i in range(6))),
    observations=st.integers(0, 10**6),
    residual_px=st.none() | POSITIVE,
)


@settings(max_examples=60, deadline=None)
@given(one=ORIENTATIONS)
def test_an_orientation_survives_being_stored_to_the_last_bit(one):
    assert ExteriorOrientation.model_validate_json(one.model_dump_json()) == one


def block(*names: str, **more) -> Block:
    photos = tuple(ExteriorOrientation(photo=name, centre=(i, 0, 0), omega_phi_kappa=(0, 0, 0)) for i, name in enumerate(names))
    facts = {"crs": "EPSG:2100", "cameras": {"n": camera("n")}, "of_photo": dict.fromkeys(names, "n"), "photos": photos}
    facts |= {"datum": "free", "sigma0_px": 0.3, "redundancy": 100, "iterations": 5, "ground_low": 0.0, "ground_high": 9.0}
    return Block(**(facts | more))


def test_photographs_and_cameras_of_a_block_are_found_by_name():
    one = block("a", "b", unoriented=(Unoriented(photo="c", reason="too few tie points"),))
    assert one.names == ("a", "b") and one.of("b").centre == (1, 0, 0) and one.camera_of("a").name == "n"
    with pytest.raises(StopIteration):
        one.of("c")
    assert Block.model_validate_json(one.model_dump_json()) == one and BLOCK.type is Block


@pytest.mark.parametrize(("outcome", "oriented"), [("oriented", True), ("the rays do not intersect", False), ("", False)])
def test_a_pair_is_oriented_or_says_why_not(outcome, oriented):
    assert RelativeOrientation(left="a", right="b", matches=9, kept=8, outcome=outcome).oriented is oriented


def photo(name: str = "a", **more) -> Photo:
    return Photo(
        **({"name": name, "path": f"{name}.jpg", "width": 40, "height": 30, "bands": 3, "dtype": "uint8", "camera": "n"} | more)
    )


def test_photographs_are_found_by_name_in_the_order_of_the_workflow():
    photos = Photos(photos=(photo("b"), photo("a")))
    assert photos.names == ("b", "a") and photos["a"].path == "a.jpg"
    with pytest.raises(StopIteration):
        photos["c"]


@pytest.mark.parametrize(
    ("col", "row", "inside"),
    [(0, 0, True), (39, 29, True), (-0.5, -0.5, True), (39.5, 29.5, True), (-0.51, 0, False), (39.51, 0, False), (0, 29.51, False)],
)
def test_a_photograph_reaches_to_the_outer_edge_of_its_border_pixels(col, row, inside):
    assert photo().holds(col, row) is inside


@settings(max_examples=80, deadline=None)
@given(turn=st.floats(-3.1, 3.1), scale=st.floats(0.1, 10), shift=st.tuples(FINITE, FINITE), place=st.tuples(FINITE, FINITE))
def test_a_scan_is_transformed_into_its_frame(turn, scale, shift, place):
    """A similarity as scan coefficients, against complex multiplication."""
    a, b = scale * math.cos(turn), scale * math.sin(turn)
    scanned = photo(scan=(shift[0], a, -b, shift[1], b, a))
    expected = complex(*shift) + scale * complex(math.cos(turn), math.sin(turn)) * complex(*place)
    assert complex(*scanned.from_file(*place)) == pytest.approx(expected, rel=1e-9, abs=1e-6)
    assert photo().from_file(*place) == place


def test_a_photograph_stored_turned_by_a_program_is_as_the_sensor_saw_it():
    assert photo(exif_orientation=6).sensor_orientation == 6
    assert photo(exif_orientation=6, as_taken=True).sensor_orientation == 1


@pytest.mark.parametrize(
    ("tags", "text"),
    [
        ({"Model": "D5\0 "}, "D5"),
        ({"EXIF_Model": "D6"}, "D6"),
        ({"Model": "D5", "EXIF_Model": "D6"}, "D5"),
        ({}, ""),
        ({"Model": ""}, ""),
    ],
)
def test_tags_under_either_name_and_without_padding(tags, text):
    assert tag_text(tags, "Model") == text


def test_rasters_and_tables_are_named_after_their_photograph_or_pair():
    assert photo_raster("DJI_0030") == "photos/DJI_0030/0" and photo_raster("DJI_0030", 3) == "photos/DJI_0030/3"
    assert epipolar_raster("a-b", "left") == "epipolar/a-b/left" and grey_table("a").path == "epipolar/grey/a.json"
    assert CAMERAS.path == "calibration/cameras.json"


def test_headers_and_control_keep_what_they_were_given():
    header = Header(path="a.jpg", width=4, height=3, bands=1, dtype="uint16", tags={"Make": "DJI"})
    assert header.model_copy(update={"path": "b.jpg"}).tags == header.tags
    point = ControlPoint(name="p", role="check", xyz=(1, 2, 3), sigma=(0.1, 0.1, 0.2), measurements={"a": (5, 6, 0.5)})
    control = Control(points=(point,))
    assert Control.model_validate_json(control.model_dump_json()) == control and control.distances == ()


@settings(max_examples=60, deadline=None)
@given(base=POSITIVE, c=POSITIVE, depth=POSITIVE, x=FINITE)
def test_parallax_gives_the_point_as_the_docstring_says(base, c, depth, x):
    """(x_left, y, -c) base / p is the point whose images have the parallax p = c base / depth."""
    parallax = c * base / depth
    x_left = c * x / depth
    x_right = c * (x - base) / depth
    assert x_left - x_right == pytest.approx(parallax, rel=1e-6, abs=1e-6 * (abs(x_left) + abs(x_right)))
    point = [value * base / parallax for value in (x_left, -c)]
    assert point == pytest.approx([x, -depth], rel=1e-9, abs=1e-9)
    assert "base / p" in EpipolarPair.__doc__


def test_a_new_k1_keeps_everything_else_of_a_camera():
    covariance = tuple(tuple(float(i == j) for j in range(17)) for i in range(17))
    cameras = Cameras(cameras={"n": camera("n", k2=0.2, covariance=covariance, sigma0=0.4)}, of_photo={"a": "n"})
    changed = cameras.with_k1({"n": -0.1}).of("a")
    assert changed.changed(k1=0.0) == cameras.of("a") and changed.covariance == covariance
    assert cameras.with_k1({}) == cameras


def test_unknown_photographs_and_cameras_are_not_guessed():
    cameras = Cameras(cameras={"n": camera("n")}, of_photo={"a": "n"})
    for question in (lambda: cameras.of("b"), lambda: cameras.with_k1({"z": 0.1}), lambda: block("a").camera_of("b")):
        with pytest.raises(KeyError):
            question()


@pytest.mark.parametrize("wrong", [{"f": 35.0}, {"K1": 0.1}, {"distortion": []}])
def test_a_misspelt_parameter_of_a_camera_file_is_refused(wrong):
    with pytest.raises(ValidationError, match="Extra inputs are not permitted"):
        Camera.model_validate(camera().model_dump() | wrong)


@settings(max_examples=40, deadline=None)
@given(names=st.lists(st.text("abc", min_size=1, max_size=3), max_size=8, unique=True))
def test_a_block_lists_its_photographs_as_stored(names):
    one = block(*names)
    assert one.names == tuple(names) and [one.of(name).photo for name in names] == names
    assert [one.of(name).centre[0] for name in names] == list(range(len(names)))


def test_covariances_between_photographs_and_cameras_are_stored_with_the_block():
    between = JointCovariance(first="a", second="b", covariance=tuple(tuple(i + 10.0 * j for j in range(6)) for i in range(6)))
    one = block("a", "b", joint=(between,), groups=(("a", "b"),))
    again = Block.model_validate_json(one.model_dump_json())
    assert again.joint == (between,) and again.groups == (("a", "b"),) and again.joint_cameras == ()


def test_residuals_are_found_by_role_in_their_order():
    roles = {"P1": "control", "C1": "check", "P2": "control", "a": "position"}
    points = [GroundResidual(name=n, role=role, difference=(0, 0, 1), predicted=(1, 1, 1), photos=2) for n, role in roles.items()]
    residuals = GroundResiduals(points=points)
    assert [point.name for point in residuals.of_role("control")] == ["P1", "P2"]
    assert [point.name for point in residuals.of_role("position")] == ["a"] and residuals.of_role("tie") == ()


@settings(max_examples=80, deadline=None)
@given(width=st.integers(1, 200), height=st.integers(1, 200), col=st.floats(-3, 203), row=st.floats(-3, 203))
def test_a_position_is_on_the_photograph_where_a_pixel_is(width, height, col, row):
    """Rounded to the nearest pixel, away from the ties."""
    one = photo(width=width, height=height)
    if abs(col % 1 - 0.5) > 1e-6 and abs(row % 1 - 0.5) > 1e-6:
        assert one.holds(col, row) == (0 <= round(col) < width and 0 <= round(row) < height)


@pytest.mark.parametrize("orientation", range(1, 9))
def test_the_orientation_of_the_sensor_is_that_of_the_flag_unless_a_program_turned_the_pixels(orientation):
    assert photo(exif_orientation=orientation).sensor_orientation == orientation
    assert photo(exif_orientation=orientation, as_taken=True).sensor_orientation == 1


@pytest.mark.parametrize("code", ["duplicate_name", "stray_position", "rotated_without_flag"])
def test_remarks_about_photographs_are_stored_by_their_words(code):
    photos = Photos(photos=(photo(),), remarks=(PhotoRemark(code=code, photos=("a",)),))
    assert f'"code":"{code}"' in photos.model_dump_json()
    assert Photos.model_validate_json(photos.model_dump_json()).remarks[0].code is PhotoRemarkCode(code)
