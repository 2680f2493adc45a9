"""What files tell before the first job is told by `plan` and `run` at once, and nothing is computed for nothing."""

import pytest
from PIL import Image
from small_site import command, make_site, photographs, write_workflow

POINTS = "name,role,x,y,z,sigma_x,sigma_y,sigma_z\nP1,control,576000,5188000,300,0.1,0.1,0.1\n"
CONTROL = {"kind": "files", "points": "points.csv", "measurements": "measured.csv"}
POSITIONS = "photo,x,y,z,sigma_x,sigma_y,sigma_z\n"


@pytest.fixture
def site(tmp_path, monkeypatch):
    monkeypatch.chdir(make_site(tmp_path))
    return tmp_path


def refused(*words: str) -> str:
    """The sentence of `plan`, which `run` must say as well, with no job done."""
    said = command("plan", "site", code=2)
    assert command("run", "site", "--sequential", code=2) == said
    return said


def control_of(site, *lines: str) -> None:
    (site / "points.csv").write_text(POINTS)
    (site / "measured.csv").write_text("\n".join(("name,photo,col,row,sigma", *lines)))


def no_job(site) -> bool:
    return not list((site / "runs").rglob("jobs/*/*"))


def test_control_in_dropped_photographs_is_a_note_and_in_strict_projects_a_refusal(site):
    control_of(site, f"P1,{photographs(site)[0].stem},10,10,1", "P1,DJI_9999.JPG,10,10,1")
    write_workflow(site, control=CONTROL)
    note = "note: 1 measurement of control points was skipped, as the project does not have the photographs DJI_9999.JPG."
    assert note in command("plan", "site")
    assert note in command("run", "site", "--sequential", "--until", "orientation")
    write_workflow(site, control={**CONTROL, "absent": "refuse"})
    assert "line 3, point P1 is measured in the photograph 'DJI_9999.JPG', which the project does not have" in refused()


def test_all_damaged_photographs_are_named_together(site):
    for photo in photographs(site)[:2]:
        photo.write_bytes(photo.read_bytes()[:20000])
    said = refused()
    assert said.count("is truncated") == 2 and no_job(site)


def test_mistakes_of_several_stages_are_told_together(site):
    control_of(site, f"P1,{photographs(site)[0].stem},10,10,-1")
    (site / "camera.json").write_text("{}")
    write_workflow(site, control=CONTROL, cameras={"kind": "file", "path": "camera.json"})
    said = refused()
    assert "camera.json" in said and "sigma is '-1', which must be a positive number" in said and no_job(site)
    assert "points.csv, measured.csv: Control measurements file, line 2" in said


def test_positions_of_other_photographs_are_refused(site):
    (site / "positions.csv").write_text(POSITIONS + "IMG_1,576000,5188000,400,1,1,1\n")
    write_workflow(site, positions={"kind": "file", "path": "positions.csv"})
    assert "positions.csv: The positions file names none of the photographs: it has IMG_1, the project has DJI_0018" in refused()


def test_positions_of_two_places_are_a_note(site):
    names = [photo.stem for photo in photographs(site)]
    rows = [f"{name},576000,{5188000 + 1_000_000 * (i == 1)},400,1,1,1\n" for i, name in enumerate([*names, "IMG_1"])]
    (site / "positions.csv").write_text(POSITIONS + "".join(rows))
    write_workflow(site, positions={"kind": "file", "path": "positions.csv"})
    said = command("plan", "site")
    assert f"note: The positions of {names[1]} lie 1000 km or more from all others" in said
    assert "note: The positions file has lines for photographs that the project does not have, which are skipped: IMG_1." in said


def test_a_reference_that_is_no_map_is_refused(site):
    Image.new("L", (4, 4)).save(site / "heights.tif")
    (site / "colours.tif").write_text("no map")
    reference = {"kind": "file", "dsm": "heights.tif", "ortho": "colours.tif"}
    write_workflow(site, stages=["photos", {"kind": "evaluation", "reference": reference}])
    said = refused()
    assert "heights.tif has no coordinate reference system" in said and "colours.tif is not a GeoTIFF that can be read" in said


def test_a_distances_file_that_is_missing_is_refused(site):
    control_of(site, f"P1,{photographs(site)[0].stem},10,10,1")
    write_workflow(site, control={**CONTROL, "distances": "tape.csv"})
    assert "tape.csv' does not exist" in refused()
