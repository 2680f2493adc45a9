"""`orthomill init`: a workflow from EXIF that a newcomer can read; what the photographs do not tell is asked for."""

import pytest
from front_door import CATALOGUE, photograph

from orthomill.pipeline.storage.photographs.file_kinds import readable_suffixes
from orthomill.pipeline.workflow.camera_tags import camera_name, focal_mm, longitude_latitude
from orthomill.pipeline.workflow.found_lines import found_lines
from orthomill.pipeline.workflow.starting_workflow import write_starting_workflow
from orthomill.pipeline.workflow.workflow_file import load_workflow
from orthomill.schemas.errors import PhotoError, WorkflowError
from orthomill.schemas.findings.flight_findings import FirstLook
from orthomill.schemas.maps.map_scale import utm_zone
from orthomill.schemas.photo import Header

VOLOS = (22.94, 39.36)


@pytest.fixture
def root(tmp_path):
    for number in range(3):
        photograph(tmp_path / "photos" / f"DJI_{number}.JPG", "DJI FC300S", gps=VOLOS, focal=3.61)
    return tmp_path


def test_photographs_that_tell_everything_give_a_workflow_that_loads(root):
    start = write_starting_workflow("site", root / "photos", root, CATALOGUE)
    text = start.path.read_text()
    assert start.path == root / "workflows" / "site.yaml"
    for words in (
        "from the EXIF tags of 3 photographs",
        "DJI FC300S, 64 x 48 px (3 photographs)",
        "focal length: 3.61 mm",
        "3 of 3",
        "# size: 21  # Side of the window. [px]",
        "- kind: matching  # matches points",
    ):
        assert words in text
    loaded = load_workflow(start.path, CATALOGUE)
    assert loaded.project.crs == "EPSG:32634"
    assert loaded.project.cameras.kind == loaded.project.positions.kind == "exif"
    assert [stage.kind for stage in loaded.stages] == ["matching", "painting"]
    assert start.notes == ()


def test_a_crs_that_is_given_is_taken(root):
    start = write_starting_workflow("site", root / "photos", root, CATALOGUE, "EPSG:2100+5773")
    assert load_workflow(start.path, CATALOGUE).project.crs == "EPSG:2100+5773"


def test_heights_above_the_ellipsoid_are_part_of_the_system(root):
    def look(headers, crs, beside=None):
        return FirstLook(findings=(), used=tuple(header.path for header in headers), ellipsoidal=True)

    start = write_starting_workflow("site", root / "photos", root, CATALOGUE, look=look)
    assert load_workflow(start.path, CATALOGUE).project.crs == "EPSG:32634+4979"
    # Whose heights control has nobody knows yet, and a system that is given is the user's.
    (root / "photos" / "gcp_list.txt").write_text("EPSG:32634\n500000 4350000 12.3 20 20 DJI_0.JPG p1\n")
    with_control = write_starting_workflow("control", root / "photos", root, CATALOGUE, look=look)
    assert load_workflow(with_control.path, CATALOGUE).project.crs == "EPSG:32634"
    given = write_starting_workflow("given", root / "photos", root, CATALOGUE, "EPSG:2100", look=look)
    assert load_workflow(given.path, CATALOGUE).project.crs == "EPSG:2100"


def test_the_band_that_was_chosen_is_written(root):
    def look(headers, crs, beside=None):
        return FirstLook(findings=(), used=tuple(header.path for header in headers), band="Green")

    start = write_starting_workflow("site", root / "photos", root, CATALOGUE, look=look)
    assert load_workflow(start.path, CATALOGUE).project.photographs.band == "Green"


def test_every_setting_that_is_commented_out_is_its_default(root):
    start = write_starting_workflow("site", root / "photos", root, CATALOGUE)
    before = load_workflow(start.path, CATALOGUE)
    lines = [line.replace("# ", "", 1) if line.startswith("    # ") else line for line in start.path.read_text().splitlines()]
    start.path.write_text("\n".join(lines))
    assert load_workflow(start.path, CATALOGUE).stages == before.stages


def test_photographs_without_exif_get_a_guessed_camera_and_no_blank(root):
    for name in ("a.png", "b.png"):
        photograph(root / "scans" / name)
    start = write_starting_workflow("scans", root / "scans", root, CATALOGUE)
    assert "kind: given" in start.path.read_text() and "kind: none  # no photograph has GPS tags" in start.path.read_text()
    assert len(start.notes) == 2 and "guessed" in start.notes[0] and "local system" in start.notes[1]
    assert load_workflow(start.path, CATALOGUE).project.cameras.kind == "exif"


def test_nothing_is_overwritten(root):
    start = write_starting_workflow("site", root / "photos", root, CATALOGUE)
    start.path.write_text("mine")
    with pytest.raises(WorkflowError, match=r"site\.yaml exists already and is not overwritten"):
        write_starting_workflow("site", root / "photos", root, CATALOGUE)
    assert start.path.read_text() == "mine"


def test_photographs_outside_the_project_are_linked_into_it(root, tmp_path_factory):
    outside = tmp_path_factory.mktemp("card")
    for name in ("a.jpg", "b.jpg"):
        photograph(outside / name)
    start = write_starting_workflow("site", outside, root, CATALOGUE)
    link = root / "photographs" / outside.name
    assert link.is_symlink() and link.resolve() == outside and start.survey.linked == outside
    assert f"path: photographs/{outside.name}\n" in start.path.read_text()
    assert load_workflow(start.path, CATALOGUE).project.photographs.path == f"photographs/{outside.name}"
    assert any(f"is now a link to {outside}" in line for line in found_lines(start.survey, start.look))
    assert "photographs/card0_2" not in write_starting_workflow("again", outside, root, CATALOGUE).path.read_text()


def test_a_link_of_that_name_to_elsewhere_is_left_alone(root, tmp_path_factory):
    for number in range(2):
        outside = tmp_path_factory.mktemp("disk") / "card"
        for name in ("a.jpg", "b.jpg"):
            photograph(outside / name)
        write_starting_workflow(f"site{number}", outside, root, CATALOGUE)
    assert sorted(path.name for path in (root / "photographs").iterdir()) == ["card", "card_2"]
    (root / "card").symlink_to(root / "photos")
    assert "path: card\n" in write_starting_workflow("own", root / "card", root, CATALOGUE).path.read_text()


def test_the_folders_of_a_card_are_looked_into_and_others_are_named(root):
    for name in ("100MEDIA/DJI_0001.JPG", "101MEDIA/DJI_0001.JPG", "rejected/DJI_0002.JPG"):
        photograph(root / "card" / "DCIM" / name)
    start = write_starting_workflow("site", root / "card", root, CATALOGUE)
    assert [header.path for header in start.survey.headers] == [
        "card/DCIM/100MEDIA/DJI_0001.JPG",
        "card/DCIM/101MEDIA/DJI_0001.JPG",
    ]
    assert load_workflow(start.path, CATALOGUE).project.photographs.folders == "card"
    lines = list(found_lines(start.survey, start.look))
    assert lines[0].endswith("in DCIM/100MEDIA (1), DCIM/101MEDIA (1).") and lines[0].startswith("Photographs: 2 JPEG of 64 x 48")
    assert lines[1].startswith("Left out: 1 photograph in folders below (DCIM/rejected/DJI_0002.JPG); set 'folders: all'")


def test_folders_of_any_name_are_looked_into_where_nothing_else_holds_photographs(root):
    photograph(root / "flights" / "monday" / "a.jpg")
    photograph(root / "flights" / "tuesday" / "a.jpg")
    assert "  folders: all" in write_starting_workflow("site", root / "flights", root, CATALOGUE).path.read_text()


def test_whatever_is_left_out_is_said(root, monkeypatch):
    monkeypatch.setattr("orthomill.pipeline.storage.photographs.file_kinds.find_spec", lambda name: None)
    readable_suffixes.cache_clear()
    folder = root / "photos"
    for name in ("a.HEIC", "b.dng", "c.mp4", "d.gif", "._DJI_0.JPG", "e.lrf", "notes.txt", "f.MRK"):
        (folder / name).write_bytes(b"x")
    (folder / "gone.jpg").symlink_to(root / "nowhere.jpg")
    (folder / "as_text.jpg").write_text("../annex/as_text.jpg")  # a link where git could not make one
    (folder / "pointer.tif").write_text("version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 9\n")
    (folder / "100MEDIA").symlink_to(folder)
    start = write_starting_workflow("site", folder, root, CATALOGUE)
    lines = list(start.survey.left_out)
    readable_suffixes.cache_clear()
    for words in ("1 HEIC photograph (a.HEIC)", "1 raw photograph (b.dng)", "1 video (c.mp4)", "1 image of another format (d.gif)"):
        assert sum(line.startswith(f"Left out: {words}; ") for line in lines) == 1, words
    for words in (
        "3 broken links (as_text.jpg, gone.jpg, pointer.tif)",
        "hidden file named like a photograph (._DJI_0.JPG)",
        "preview",
        "link to a folder",
    ):
        assert sum(words in line for line in lines) == 1, words
    assert len(lines) == 8 and "orthomill[formats]" in lines[0] and len(start.survey.headers) == 3


def test_folders_and_names_that_will_not_do(root):
    with pytest.raises(WorkflowError, match="is not a possible project name; it must be made of lower-case letters"):
        write_starting_workflow("My Site", root / "photos", root, CATALOGUE)
    with pytest.raises(WorkflowError, match="does not exist"):
        write_starting_workflow("site", root / "nowhere", root, CATALOGUE)
    (root / "empty").mkdir()
    with pytest.raises(WorkflowError, match="contains no JPEG, TIFF or PNG images"):
        write_starting_workflow("site", root / "empty", root, CATALOGUE)
    photograph(root / "one" / "a.jpg")
    with pytest.raises(WorkflowError, match="is the only photograph"):
        write_starting_workflow("site", root / "one", root, CATALOGUE)
    assert not (root / "workflows").exists()


def test_files_that_are_no_photographs_are_set_aside_and_named_where_nothing_is_left(root):
    (root / "photos" / "notes.jpg").write_text("notes")
    (root / "photos" / "empty.jpg").touch()
    start = write_starting_workflow("site", root / "photos", root, CATALOGUE)
    assert "Photographs: 3 JPEG of 64 x 48 px (RGB, 8 bits); 2 more set aside." in found_lines(start.survey, start.look)
    assert "3 photographs" in start.path.read_text()
    for broken in sorted((root / "photos").glob("DJI*"))[:2]:
        broken.write_bytes(broken.read_bytes()[:-500])
    with pytest.raises(WorkflowError) as caught:
        write_starting_workflow("other", root / "photos", root, CATALOGUE)
    first, second, *_, last = str(caught.value).splitlines()
    assert "DJI_2.JPG is the only photograph" in first and "DJI_0.JPG is truncated" in second and "notes.jpg is not a JPEG" in last
    (root / "photos" / "DJI_2.JPG").unlink()
    with pytest.raises(PhotoError, match="is truncated"):
        write_starting_workflow("other", root / "photos", root, CATALOGUE)


def test_mixed_cameras_and_missing_positions_are_remarked_upon(root):
    photograph(root / "photos" / "PHONE.JPG", "Apple iPhone", focal=4.2)
    notes = " ".join(write_starting_workflow("site", root / "photos", root, CATALOGUE).notes)
    assert "1 of 4 photographs have no GPS position" in notes and "2 cameras or image sizes" in notes


@pytest.mark.parametrize(
    ("place", "zone"),
    [
        ((22.94, 39.36), "EPSG:32634"),
        ((-91.99, 46.84), "EPSG:32615"),
        ((151.2, -33.9), "EPSG:32756"),
        ((180.0, 10.0), "EPSG:32660"),
        ((-180.0, 10.0), "EPSG:32601"),
        ((5.3, 60.4), "EPSG:32632"),
        ((15.6, 78.2), "EPSG:32633"),
        ((8.9, 78.2), "EPSG:32631"),
    ],
)
def test_utm_zones(place, zone):
    assert utm_zone(*place) == zone


def test_tags_as_cameras_write_them():
    tags = {"GPSLatitude": "(33) (51) (30)", "GPSLatitudeRef": "S", "GPSLongitude": "(151.2)", "GPSLongitudeRef": "E"}
    assert longitude_latitude(tags) == pytest.approx((151.2, -(33 + 51 / 60 + 30 / 3600)))
    assert longitude_latitude({**tags, "GPSLatitude": ""}) is None
    assert longitude_latitude({name: "0" if "Ref" not in name else value for name, value in tags.items()}) is None
    assert focal_mm({"FocalLength": "(0)"}) is None and focal_mm({"FocalLength": "(24)"}) == 24.0
    header = Header(path="a", width=4, height=3, bands=3, dtype="uint8", tags={"Make": "Canon ", "Model": "Canon EOS 550D"})
    assert camera_name(header) == "Canon EOS 550D, 4 x 3 px"
