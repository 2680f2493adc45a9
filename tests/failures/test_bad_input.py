"""What goes wrong with real people's input: one clear sentence, an exit code that is not zero, and nothing lost."""

import os
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import yaml
from PIL import Image
from typer.testing import CliRunner

from pipeline.cli import app
from pipeline.lock import only_run

SHIPPED = Path(__file__).parents[2] / "workflows" / "photographs" / "brighton"
WORKFLOW = {
    "project": "site", "crs": "EPSG:32615", "photographs": {"kind": "folder", "path": "photos"}, "tile": 256,
    "stages": ["photos", "calibration", "tie_points", "orientation"],
}


@pytest.fixture
def site(tmp_path, monkeypatch):
    """A project of three small real photographs; the current folder is its root."""
    (tmp_path / "photos").mkdir()
    (tmp_path / "workflows").mkdir()
    for source in sorted(SHIPPED.glob("*.JPG"))[:3]:
        with Image.open(source) as image:
            image.resize((640, 360)).save(tmp_path / "photos" / source.name, quality=90, exif=image.getexif())
    monkeypatch.chdir(tmp_path)
    write(tmp_path)
    return tmp_path


def write(site: Path, **changes) -> None:
    (site / "workflows" / "site.yaml").write_text(yaml.safe_dump({**WORKFLOW, **changes}, sort_keys=False))


def command(*words: str, code: int = 2) -> str:
    """Run `orthomill` in this process; returns all it said. Fails when the exit code differs or a traceback is shown."""
    result = CliRunner().invoke(app, list(words))
    said = " ".join((result.output + result.stderr).split())
    assert result.exit_code == code, said
    assert "Traceback" not in said
    return said


def run_site(code: int = 2) -> str:
    return command("run", "site", "--sequential", code=code)


def photographs(site: Path) -> list[Path]:
    return sorted((site / "photos").iterdir())


def test_an_unknown_stage_or_setting_comes_with_a_suggestion(site):
    write(site, stages=["fotos", {"kind": "tie_points", "max_featurs": 3}])
    said = run_site()
    assert "workflows/site.yaml:" in said
    assert "did you mean 'photos'" in said and "did you mean 'max_features'" in said


def test_a_wrong_unit_or_bound_says_what_is_allowed(site):
    write(site, tile="512 px")
    assert "tile" in run_site()
    write(site, tile=10)
    said = run_site()
    assert "10" in said and "128" in said


def test_a_missing_photo_is_named(site):
    write(site, photographs={"kind": "list", "paths": [f"photos/{photographs(site)[0].name}", "photos/DJI_9999.JPG"]})
    assert "photos/DJI_9999.JPG" in run_site()


def test_a_truncated_jpeg_is_named(site):
    photo = photographs(site)[1]
    photo.write_bytes(photo.read_bytes()[:20000])
    assert photo.name in run_site(code=1)


def test_a_text_file_called_jpg_is_named(site):
    (site / "photos" / "notes.jpg").write_text("bring a longer pole next time")
    assert "notes.jpg" in run_site(code=1)


def test_no_exif_and_no_camera_says_what_to_add(site):
    for photo in photographs(site):
        with Image.open(photo) as image:
            image.load()
        image.save(photo, quality=90)
    write(site, positions={"kind": "none"})
    said = run_site(code=1)
    assert "cameras" in said and "focal" in said.lower()


def test_a_single_photo_is_not_a_project(site):
    for photo in photographs(site)[1:]:
        photo.unlink()
    assert "photo" in run_site(code=1)


def test_photographs_without_overlap_are_told(site):
    size = (640, 360)
    for number, photo in enumerate(photographs(site)):
        with Image.open(photo) as image:
            exif = image.getexif()
        noise = Image.effect_noise(size, 60).rotate(90 * number, expand=False)
        noise.convert("RGB").save(photo, quality=90, exif=exif)
    assert "overlap" in run_site(code=1)


def test_a_control_point_outside_all_photographs_is_named(site):
    (site / "points.csv").write_text("name,role,x,y,z,sigma_x,sigma_y,sigma_z\nP1,control,1,2,3,0.1,0.1,0.1\n")
    name = photographs(site)[0].stem
    (site / "measured.csv").write_text(f"name,photo,col,row,sigma\nP1,{name},99999,10,0.5\n")
    write(site, control={"kind": "files", "points": "points.csv", "measurements": "measured.csv"})
    assert "P1" in run_site(code=1)


def test_a_crs_in_degrees_is_refused_with_a_proposal(site):
    write(site, crs="EPSG:4326")
    said = run_site()
    assert "EPSG:4326" in said and "degree" in said and "metre" in said


def test_a_path_that_leaves_the_project_is_refused(site):
    write(site, photographs={"kind": "folder", "path": "../elsewhere"})
    assert "../elsewhere" in run_site()
    write(site, photographs={"kind": "folder", "path": "/etc"})
    assert "/etc" in run_site()


def test_a_folder_that_cannot_be_written_is_told(site):
    (site / "runs").write_text("a file where a folder should be")
    assert "cannot be written" in run_site()


def test_a_full_disk_is_told_before_anything_runs(site, monkeypatch):
    monkeypatch.setattr("shutil.disk_usage", lambda path: type("Usage", (), {"free": 1000})())
    assert "make room" in run_site()


def test_a_disk_that_fills_up_on_the_way_loses_nothing(site):
    script = "import sys; sys.argv = ['orthomill', 'run', 'site', '--sequential', '--until', 'photos']; from pipeline.cli import main; main()"
    limit = lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (60_000, 60_000))  # noqa: E731
    ended = subprocess.run([sys.executable, "-c", script], cwd=site, preexec_fn=limit, capture_output=True, text=True)
    assert ended.returncode in (1, 2) and "Traceback" not in ended.stderr
    assert "cannot be written" in " ".join((ended.stderr + ended.stdout).split())
    said = command("run", "site", "--sequential", "--until", "photos", code=0)
    assert "0 failed" in said


def test_a_second_run_at_the_same_time_is_refused(site):
    with only_run(site / "runs" / "site"):
        assert "being run already" in run_site()


def test_an_unknown_project_names_the_ones_there_are(site):
    assert "did you mean 'site'" in command("run", "sites")


def test_from_an_unknown_stage_names_the_ones_there_are(site):
    assert "photos" in command("run", "site", "--from", "potatoes")


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGKILL])
def test_an_interrupted_run_goes_on_and_ends_like_an_undisturbed_one(site, how):
    def start():
        words = ["run", "site", "--workers", "2", "--until", "photos"]
        script = f"import sys; sys.argv = ['orthomill'] + {words}; from pipeline.cli import main; main()"
        return subprocess.Popen([sys.executable, "-c", script], cwd=site, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)

    process = start()
    records = site / "runs" / "site" / "jobs" / "photos"
    deadline = time.monotonic() + 90
    while len(list(records.glob("*.json"))) < 3 and process.poll() is None and time.monotonic() < deadline:
        time.sleep(0.02)
    process.send_signal(how)
    _, errors = process.communicate(timeout=60)
    if how is signal.SIGINT and process.returncode != 0:
        assert process.returncode == 130 and "run the same command again" in errors and "Traceback" not in errors
    resumed = start()
    _, errors = resumed.communicate(timeout=120)
    assert resumed.returncode == 0, errors
    disturbed = pixels_of(site)
    command("clean", "site", code=0)
    command("run", "site", "--sequential", "--until", "photos", code=0)
    assert pixels_of(site) == disturbed


def pixels_of(site: Path) -> dict[str, bytes]:
    """The bytes of all raster chunks, without the birth marks."""
    folder = site / "runs" / "site" / "rasters.zarr"
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file() and path.name != "zarr.json"}


def test_a_damaged_store_is_told_and_mended_by_running_again(site):
    command("run", "site", "--sequential", "--until", "photos", code=0)
    (site / "runs" / "site" / "tables" / "photos" / "photos.json").unlink()
    assert "0 failed" in command("run", "site", "--sequential", "--until", "photos", code=0)


def test_nothing_was_written_outside_the_project(site):
    command("run", "site", "--sequential", "--until", "photos", code=0)
    assert {path.name for path in site.iterdir()} == {"photos", "workflows", "runs"}
    assert os.path.exists(site / "runs" / "site" / "report.html")
