"""Mistakes in real input: one clear sentence, a non-zero exit code, and nothing lost."""

import re

import pytest
from PIL import Image
from small_site import command, copy_of_finished_site, counts, cut, make_site, photographs, write_workflow

from orthomill.pipeline.records.lock import only_run


@pytest.fixture
def site(tmp_path, monkeypatch):
    """A project of three small real photographs; the current folder is its root."""
    monkeypatch.chdir(make_site(tmp_path))
    return tmp_path


@pytest.fixture
def finished(tmp_path, monkeypatch):
    """The same project after a whole run; the current folder is its root."""
    monkeypatch.chdir(copy_of_finished_site(tmp_path / "site"))
    return tmp_path / "site"


def run_site(code: int = 2) -> str:
    return command("run", "site", "--sequential", code=code)


def test_an_unknown_stage_or_setting_comes_with_a_suggestion(site):
    write_workflow(site, stages=["fotos", {"kind": "tie_points", "max_featurs": 3}])
    said = run_site()
    assert "workflows/site.yaml:8: stages > fotos" in said and "workflows/site.yaml:10: stages > tie_points" in said
    assert "did you mean 'photos'" in said and "did you mean 'max_features'" in said


@pytest.mark.parametrize(
    ("tile", "answer"),
    [
        (
            "512 px",
            "is '512 px'; must be a whole number (px), from 128 to 8192, a multiple of 64. Write the number alone, in px: 512.",
        ),
        (10, "is 10 px; must be a whole number (px), from 128 to 8192, a multiple of 64."),
        (9984, "is 9984 px; must be at most 8192 px."),
    ],
)
def test_a_wrong_unit_or_bound_says_what_is_allowed(site, tile, answer):
    write_workflow(site, tile=tile)
    assert f"workflows/site.yaml:6: tile: {answer}" in run_site()


def test_a_missing_photo_is_named(site):
    write_workflow(site, photographs={"kind": "list", "paths": [f"photos/{photographs(site)[0].name}", "photos/DJI_9999.JPG"]})
    assert "the photograph 'photos/DJI_9999.JPG' does not exist" in run_site()


def test_a_folder_without_photographs_is_reported(site):
    for photo in photographs(site):
        photo.rename(photo.with_suffix(".raw"))
    assert "photos" in run_site() and "JPEG, TIFF or PNG" in run_site()


def test_what_is_no_photograph_is_set_aside_and_named(site):
    photo = photographs(site)[1]
    photo.write_bytes(photo.read_bytes()[:20000])
    (site / "photos" / "notes.jpg").write_text("bring a longer pole next time")
    said = command("run", "site", "--sequential", "--until", "photos")
    assert f"2 files set aside: photos/{photo.name} is truncated (20000 bytes" in said
    assert "photos/notes.jpg is not a JPEG, TIFF or PNG image but plain text" in said
    for other in photographs(site):
        other.write_bytes(b"")
    assert "No file is a photograph that can be used. 4 files set aside" in run_site()


def test_a_single_photo_is_not_a_project(site):
    for photo in photographs(site)[1:]:
        photo.unlink()
    assert "is the only photograph; heights come from overlap" in run_site()


def test_photographs_without_overlap_are_reported(site):
    for number, photo in enumerate(photographs(site)):
        with Image.open(photo) as image:
            exif = image.getexif()
        noise = Image.effect_noise((640, 360), 60).rotate(90 * number, expand=False)
        noise.convert("RGB").save(photo, quality=90, exif=exif)
    assert "None of the 3 pairs of the 3 photographs shows common ground" in run_site(code=1)


def test_a_control_point_outside_all_photographs_is_named(site):
    (site / "points.csv").write_text("name,role,x,y,z,sigma_x,sigma_y,sigma_z\nP1,control,1,2,3,0.1,0.1,0.1\n")
    name = photographs(site)[0].stem
    (site / "measured.csv").write_text(f"name,photo,col,row,sigma\nP1,{name},99999,10,0.5\n")
    write_workflow(site, control={"kind": "files", "points": "points.csv", "measurements": "measured.csv"})
    said = run_site()
    assert f"line 2, point P1 is measured at col 99999, row 10, outside of {name}" in said and "correct the line" in said


def test_what_does_not_depend_on_a_mistake_is_done_and_kept(site):
    test_photographs_without_overlap_are_reported(site)
    ran, unchanged, failed = counts(run_site(code=1))
    assert (ran, failed) == (0, 1) and unchanged > 20


def test_a_crs_in_degrees_is_refused_with_a_proposal(site):
    write_workflow(site, crs="EPSG:4326")
    said = run_site()
    assert "EPSG:4326 (WGS 84) is in degrees" in said and "suggest EPSG:32615" in said


def test_the_crs_of_another_place_is_reported(site):
    write_workflow(site, crs="EPSG:32630")
    said = run_site()
    assert "EPSG:32630 (WGS 84 / UTM zone 30N) is for longitudes -6 to 0" in said and "longitude -91.99" in said


@pytest.mark.parametrize("path", ["../elsewhere", "/etc"])
def test_a_path_that_leaves_the_project_is_refused(site, path):
    write_workflow(site, photographs={"kind": "folder", "path": path})
    assert f"'{path}' is outside the project's folder" in run_site()


def test_an_export_that_leaves_the_run_is_refused(finished):
    raster = f"photos/{photographs(finished)[0].stem}/0"
    assert "is outside the run's folder" in command("export", "site", raster, "../../outside.tif", code=2)
    assert not (finished / "outside.tif").exists()


def test_a_folder_that_cannot_be_written_is_reported(site):
    (site / "runs").write_text("a file where a folder should be")
    assert "runs/site cannot be written (Not a directory)" in run_site()


def test_a_full_disk_is_reported_before_anything_runs(site, monkeypatch):
    monkeypatch.setattr("shutil.disk_usage", lambda path: type("Usage", (), {"free": 1000})())
    assert "0 MiB free, but about 200 MiB are needed; make room" in run_site()
    assert not (site / "runs" / "site" / "tables").exists()


@pytest.mark.parametrize("words", [("run", "site", "--sequential"), ("clean", "site"), ("export", "site"), ("report", "site")])
def test_a_second_command_at_the_same_time_is_refused(finished, words):
    with only_run(finished / "runs" / "site"):
        assert "site is already running (process" in command(*words, code=2)


def test_an_unknown_project_names_the_ones_there_are(site):
    assert "did you mean 'site'? Workflows here: site." in command("run", "sites", code=2)


@pytest.mark.parametrize("words", [("run", "site", "--from"), ("plan", "site", "--until"), ("clean", "site", "--stage")])
def test_an_unknown_stage_in_an_option_is_answered_with_the_ones_there_are(site, words):
    said = command(*words, "orientatoin", code=2)
    assert "no stage 'orientatoin' in site.yaml; did you mean 'orientation'?" in said and "calibration, tie_points" in said


def test_a_stage_to_clean_cannot_lead_out_of_the_run(finished):
    assert "no stage '../../../photos'" in command("clean", "site", "--stage", "../../../photos", code=2)
    assert len(photographs(finished)) == 3


def test_from_behind_until_is_refused(site):
    assert "comes after --until photos" in command("run", "site", "--from", "orientation", "--until", "photos", code=2)


def test_a_lost_table_is_restored_by_running_again(site):
    command("run", "site", "--sequential", "--until", "photos")
    (site / "runs" / "site" / "tables" / "photos" / "photos.json").unlink()
    assert "1 jobs run, 16 unchanged, 0 failed" in command("run", "site", "--sequential", "--until", "photos")


def test_a_damaged_photograph_is_set_aside_before_any_pixel_is_stored_and_the_others_go_on(site):
    broken, *sound = photographs(site)
    cut(broken)
    assert "0 failed" in (said := command("run", "site", "--sequential", "--until", "photos"))
    assert re.search(rf"1 file set aside: photos/{broken.name} is damaged at \d+ % of its height or before: it holds", said)
    stored = {path.name for path in (site / "runs" / "site" / "rasters.zarr" / "photos").iterdir() if path.is_dir()}
    assert stored == {path.stem for path in sound}


def test_where_all_photographs_are_damaged_each_is_named(site):
    for photo in photographs(site):
        cut(photo)
    said = command("run", "site", "--sequential", "--until", "photos", code=1)
    assert all(f"photos/{photo.name} is damaged at" in said for photo in photographs(site))


def test_nothing_is_written_outside_of_the_run(site):
    before = {path: path.read_bytes() for path in site.rglob("*") if path.is_file()}
    command("run", "site", "--sequential")
    runs = site / "runs"
    assert {path: path.read_bytes() for path in site.rglob("*") if path.is_file() and runs not in path.parents} == before
    assert (runs / "site" / "report.html").exists()
