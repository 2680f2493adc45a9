"""Where an exterior orientation is read from: files in their order, and settings that would be ignored."""

import json

import pytest
from pydantic import TypeAdapter, ValidationError

from orthomill.tasks.orientation.exterior.sources import read_foreign
from orthomill.tasks.orientation.orientation_settings import ExteriorSource, FromAngles, FromColmap, FromOpensfm

CRS = "EPSG:2100"
CSV, COLMAP, OPENSFM = (
    {"kind": "csv", "path": "ori.csv"},
    {"kind": "colmap", "cameras_path": "c.txt", "images_path": "i.txt"},
    {"kind": "opensfm", "path": "r.json"},
)


def source(**settings):
    return TypeAdapter(ExteriorSource).validate_python(settings)


@pytest.mark.parametrize(
    ("settings", "files", "described"),
    [
        (CSV, ("ori.csv",), "ori.csv"),
        (COLMAP, ("c.txt", "i.txt"), "i.txt"),
        (COLMAP | {"points_path": "p.txt"}, ("c.txt", "i.txt", "p.txt"), "i.txt"),
        (OPENSFM, ("r.json",), "r.json"),
        (OPENSFM | {"reference_path": "lla.json"}, ("r.json", "lla.json"), "r.json"),
    ],
)
def test_files_come_in_the_order_in_which_they_are_read(settings, files, described):
    found = source(**settings)
    assert found.files == files and found.described == described


@pytest.mark.parametrize(("settings", "placed"), [(CSV, "project"), (COLMAP, "positions"), (OPENSFM, "project")])
def test_a_file_fixes_the_orientation_unless_it_is_said_to_be_a_start(settings, placed):
    found = source(**settings)
    assert found.use == "fixed" and found.placed == placed and found.ground is None


@pytest.mark.parametrize("settings", [CSV, COLMAP, OPENSFM], ids=lambda settings: settings["kind"])
def test_a_start_refuses_the_height_of_the_ground(settings):
    with pytest.raises(ValidationError, match=r"ground is set, but has no effect with `use: start`.*leave ground out"):
        source(**settings, use="start", ground=(0.0, 10.0))
    assert source(**settings, use="fixed", ground=(0.0, 10.0)).ground == (0.0, 10.0)


def test_a_start_refuses_the_points_of_colmap():
    with pytest.raises(ValidationError, match=r"points_path is set, but has no effect with `use: start`"):
        source(**COLMAP, use="start", points_path="p.txt")


def test_a_block_cannot_be_held_any_more():
    with pytest.raises(ValidationError, match="fixed"):
        source(**CSV, use="held")


def test_angles_need_no_reference_system():
    block = read_foreign(("a 1 2 3 0 0 0\n",), FromAngles(**CSV), CRS)
    assert tuple(block.poses["a"].centre) == (1.0, 2.0, 3.0)


def test_colmaps_points_are_read_where_the_workflow_names_them():
    cameras, images = "1 SIMPLE_PINHOLE 640 480 500 320 240\n", "1 1 0 0 0 0 0 0 1 a.jpg\n\n"
    points = "1 1.0 2.0 3.0 0 0 0 0.5\n2 4.0 5.0 6.0 0 0 0 1.5\n"
    without = read_foreign((cameras, images), FromColmap(**COLMAP), CRS)
    found = read_foreign((cameras, images, points), FromColmap(**COLMAP, points_path="p.txt"), CRS)
    assert len(without.points) == 0 and without.error_px is None
    assert found.points.tolist() == [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]] and found.error_px == 1.0


def test_a_reference_of_its_own_file_places_an_opensfm_block():
    camera = {"projection_type": "perspective", "width": 640, "height": 480, "focal": 0.8}
    shot = {"camera": "v", "rotation": [0, 0, 0], "translation": [0, 0, 0]}
    place = {"latitude": 39.36, "longitude": 22.94, "altitude": 10.0}
    text = json.dumps([{"cameras": {"v": camera}, "shots": {"a.jpg": shot}, "reference_lla": place}])
    own = FromOpensfm(**OPENSFM)
    there = FromOpensfm(**OPENSFM, reference_path="lla.json")
    one = read_foreign((text,), own, CRS).poses["a"].centre
    other = read_foreign((text, json.dumps(place | {"altitude": 60.0})), there, CRS).poses["a"].centre
    assert other[2] - one[2] == pytest.approx(50.0, abs=1e-3)
