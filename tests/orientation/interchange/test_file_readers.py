"""Readers of other programs' files: what they take from the text, and what they refuse."""

import json

import numpy as np
import pytest
from tiny_block import block

from orthomill.schemas.camera import Camera
from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.photo import Photo, Photos
from orthomill.schemas.survey_files.photograph_names import photo_stem
from orthomill.tasks.geometry.topocentric import Reference, Topocentric
from orthomill.tasks.orientation.interchange.angles_csv import read_angles
from orthomill.tasks.orientation.interchange.cameras_json import read_block
from orthomill.tasks.orientation.interchange.colmap import read_colmap, write_colmap
from orthomill.tasks.orientation.interchange.foreign_block import ForeignBlock, ForeignPose, upright_block
from orthomill.tasks.orientation.interchange.opensfm import read_opensfm

CRS = "EPSG:32634"
PLACE = {"latitude": 39.36, "longitude": 22.94, "altitude": 10.0}
SHOT = {"camera": "v", "rotation": [0.1, 0.2, 0.3], "translation": [1.0, 2.0, 30.0]}
LENS = {"projection_type": "simple_radial", "width": 640, "height": 480, "focal_x": 0.8, "focal_y": 0.8, "k1": -0.1}
POINTS = np.zeros((0, 3))


def reconstruction(shots=("a.jpg",), **more):
    return {"cameras": {"v": LENS}, "shots": dict.fromkeys(shots, SHOT)} | more


def test_the_reference_point_may_come_from_a_file_of_its_own():
    inside = read_opensfm(json.dumps([reconstruction(reference_lla=PLACE)]), CRS)
    outside = read_opensfm(json.dumps([reconstruction()]), CRS, json.dumps(PLACE))
    np.testing.assert_array_equal(inside.poses["a"].centre, outside.poses["a"].centre)
    moved = read_opensfm(json.dumps([reconstruction(reference_lla=PLACE)]), CRS, json.dumps(PLACE | {"altitude": 110.0}))
    assert moved.poses["a"].centre[2] - inside.poses["a"].centre[2] == pytest.approx(100.0, abs=1e-6), "the named file wins"


def test_without_a_reference_point_it_is_asked_for():
    with pytest.raises(WorkflowError, match=r"holds no reference point .* reference_lla\.json"):
        read_opensfm(json.dumps([reconstruction()]), CRS)


def test_of_several_reconstructions_the_largest_is_read():
    parts = [reconstruction(("z.jpg",), reference_lla=PLACE), reconstruction(("a.jpg", "b.jpg"), reference_lla=PLACE)]
    block = read_opensfm(json.dumps(parts), CRS)
    assert sorted(block.poses) == ["a", "b"]
    assert [(f.code, f.count, f.photos) for f in block.findings] == [("largest_reconstruction", 2, 2)]


def test_points_of_a_reconstruction_are_on_the_map():
    points = {"1": {"coordinates": [3.0, 4.0, 5.0]}}
    block = read_opensfm(json.dumps([reconstruction(points=points, reference_lla=PLACE)]), CRS)
    expected = Topocentric(Reference(39.36, 22.94, 10.0), CRS).to_map(np.array([[3.0, 4.0, 5.0]]))
    np.testing.assert_allclose(block.points, expected)


def test_two_camera_constants_are_an_affinity():
    text = json.dumps([reconstruction(reference_lla=PLACE)]).replace('"focal_y": 0.8', '"focal_y": 0.82')
    block = read_opensfm(text, CRS)
    camera = block.cameras["a"]
    assert camera.c == pytest.approx(0.82 * 640) and camera.c * (1.0 + camera.affinity) == pytest.approx(0.8 * 640)


def test_standard_errors_of_angles_are_read_in_degrees_or_not_at_all():
    head = "photo,x,y,z,omega,phi,kappa,sigma_x,sigma_y,sigma_z,sigma_omega,sigma_phi,sigma_kappa\n"
    block = read_angles(head + "a,1,2,3,0,0,0,0.1,0.2,0.3,1,2,3\nb,1,2,3,0,0,0,0.1,,,,,\n")
    np.testing.assert_allclose(block.poses["a"].sigma, [0.1, 0.2, 0.3, *np.radians([1, 2, 3])])
    assert block.poses["b"].sigma is None
    with pytest.raises(WorkflowError, match="Line 2"):
        read_angles(head + "a,1,2,3,0,0,0,0.1,0.2,0.3,1,2,-3\n")


@pytest.mark.parametrize("separator", [",", ";", "\t", " "])
def test_any_separator_and_other_names_of_columns(separator):
    text = "Label,Easting,Northing,Altitude,Omega,Phi,Kappa\nimg.tif,1,2,3,0,0,90\n".replace(",", separator)
    (pose,) = read_angles(text).poses.values()
    np.testing.assert_allclose(pose.centre, [1, 2, 3])
    np.testing.assert_allclose(pose.rotation[0], [0, 1, 0], atol=1e-15)


def test_colmap_coordinates_come_back_through_their_origin():
    """Map coordinates of millions of metres are written less an origin, which the reader adds again."""
    camera = Camera(name="c", width=640, height=480, c=500.0, x0=2.0, y0=-3.0, k1=-0.1, k3=0.01, p2=1e-3)
    pose = ForeignPose(np.eye(3), np.array([407123.456, 4357123.789, 180.5]))
    points = np.array([[407100.25, 4357100.5, 12.125]])
    texts = write_colmap(
        ForeignBlock({"a": pose}, {"a": camera}, points), {"a": "sub/a b.jpg"}, np.array([407000.0, 4357000.0, 0.0]), CRS
    )
    assert "123.456" in texts["images.txt"].replace("-", "") and "4357123" not in texts["images.txt"].splitlines()[1]
    block = read_colmap(texts["cameras.txt"], texts["images.txt"], texts["points3D.txt"])
    np.testing.assert_allclose(block.poses["a b"].centre, pose.centre, atol=1e-9)
    np.testing.assert_allclose(block.points, points, atol=1e-4)
    assert block.cameras["a b"].interior == pytest.approx(camera.interior) and block.error_px is None


@pytest.mark.parametrize(
    ("cameras", "images", "sentence"),
    [
        ("1 PINHOLE 640 480 500 500 320\n", "", "is of the model PINHOLE; models that can be read"),
        ("1 SIMPLE_PINHOLE 640 480 500 320 240\n", "1 1 0 0 0 0 0 0 7 a\n", r"not an image of COLMAP's text model"),
        ("1 SIMPLE_PINHOLE 640 480 500 320 240\n", "1 1 0 0 0 0 0\n", r"must hold IMAGE_ID, QW QX QY QZ"),
    ],
)
def test_a_wrong_colmap_model_is_told(cameras, images, sentence):
    with pytest.raises(WorkflowError, match=sentence):
        read_colmap(cameras, images)


@pytest.mark.parametrize(
    ("word", "name"),
    [("a.JPG", "a"), ("C:\\photos\\b.tif", "b"), ("x/y/2009.05.17", "2009.05.17"), (" c.dng ", "c"), ("d.e.png", "d.e")],
)
def test_names_of_photographs_lose_folder_and_extension(word, name):
    assert photo_stem(word) == name


def photos(*names, size=(640, 480)):
    return Photos(
        photos=tuple(Photo(name=n, path=n, width=size[0], height=size[1], bands=3, dtype="uint8", camera="c") for n in names)
    )


def foreign(*names, camera=None):
    pose = ForeignPose(np.eye(3), np.zeros(3))
    return ForeignBlock(dict.fromkeys(names, pose), dict.fromkeys(names, camera) if camera else {}, POINTS)


def test_names_that_differ_in_capitals_only_are_joined():
    assert list(upright_block(foreign("IMG_1"), photos("img_1")).poses) == ["img_1"]
    assert list(upright_block(foreign("A"), photos("a", "A")).poses) == ["A"], "capitals distinguish two photographs here"


def test_cameras_are_scaled_to_the_photographs_and_other_shapes_refused():
    full = Camera(name="c", width=1280, height=960, c=1000.0, x0=8.0)
    camera = upright_block(foreign("a", camera=full), photos("a")).cameras["a"]
    assert (camera.width, camera.c, camera.x0) == (640, 500.0, 4.0)
    with pytest.raises(WorkflowError, match="has 1280 x 800 pixels, but a has 640 x 480"):
        upright_block(foreign("a", camera=full.model_copy(update={"height": 800})), photos("a"))


def test_photographs_that_the_project_does_not_have_are_reported():
    (found,) = upright_block(foreign("a", "y", "z"), photos("a")).findings
    assert found.code == "photos_unknown" and found.photos == ("y", "z")


def test_cameras_json_of_another_project_gives_the_same_block():
    found = read_block(block().model_dump_json(), "EPSG:2100")
    assert found.upright and set(found.poses) == set(block().names)
    np.testing.assert_allclose(found.poses["a1"].centre, block().of("a1").centre)
    assert found.poses["a1"].sigma[0] == pytest.approx(0.02)
    low, high = found.points[:, 2].min(), found.points[:, 2].max()
    assert (low, high) == pytest.approx((block().ground_low, block().ground_high))
    with pytest.raises(WorkflowError, match="same reference system"):
        read_block(block().model_dump_json(), "EPSG:32634")
    with pytest.raises(WorkflowError, match=r"no cameras\.json"):
        read_block("{}", "EPSG:2100")
