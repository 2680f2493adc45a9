"""The command `orthomill`, each of its subcommands at least once, on a small real project."""

import json
import re
import shutil

import pytest
import rasterio
from rasterio.errors import NotGeoreferencedWarning
from small_site import command, copy_of_finished_site, counts, damage, finished_site, make_site, photographs, write_workflow
from typer.testing import CliRunner

from orthomill.pipeline.cli.commands.application import app
from orthomill.pipeline.cli.doctor import Finding
from orthomill.pipeline.engine.run_facts import DASHBOARD
from orthomill.pipeline.records.lock import only_run
from orthomill.pipeline.records.records import Records
from orthomill.schemas.errors import WorkflowError


@pytest.fixture(scope="module")
def jobs():
    """How many jobs a whole run of the site has."""
    number, *others = counts(finished_site()[1])
    assert number > 20 and others == [0, 0]
    return number


@pytest.fixture
def done(tmp_path, monkeypatch):
    """A copy of the finished project that a test may spoil; the current folder."""
    monkeypatch.chdir(copy_of_finished_site(tmp_path / "copy"))
    return tmp_path / "copy"


@pytest.fixture
def fresh(tmp_path, monkeypatch):
    """A project that was never run; the current folder."""
    monkeypatch.chdir(make_site(tmp_path / "fresh"))
    return tmp_path / "fresh"


def test_plan_shows_jobs_bytes_memory_and_reasons_and_writes_nothing(fresh, monkeypatch):
    before = sorted(fresh.rglob("*"))
    monkeypatch.setenv("COLUMNS", "80")
    said = command("plan", "site")
    assert "not done yet" in said and "peak MiB" in said
    # Headers tell all of the first two stages and the pairs of the third; ~ is a forecast, < its bound.
    assert re.search(r"photos 17 \(~\d+\) <3 <613 ~0 s <0 s not done yet calibration 1 ", said)
    assert re.search(r"tie_points ~\d+ ~\d+ <\d+ ~\d+ <\d+ ", said) and "2 of 4 stages wait for results of earlier stages" in said
    assert re.search(r"As a whole 1 megapixels of photographs take about \d+ MB \(at most \d+; \d+ are free\) and", said)
    assert " workers, by four blocks measured on another machine" in said
    assert sorted(fresh.rglob("*")) == before


def test_plan_of_a_finished_run_says_unchanged_and_writes_nothing(done):
    before = {path: path.stat().st_mtime_ns for path in done.rglob("*")}
    said = command("plan", "site")
    assert said.count("unchanged") == 4 and "not done yet" not in said and "?" not in said and "As a whole" not in said
    assert "A control point at " in said and "As GPX and GeoJSON for the field: orthomill mark site --where" in said
    assert {path: path.stat().st_mtime_ns for path in done.rglob("*")} == before


def test_plan_says_what_a_changed_setting_or_from_would_run(done):
    assert "asked for" in command("plan", "site", "--from", "orientation")
    write_workflow(done, stages=["photos", "calibration", "tie_points", {"kind": "orientation", "least_matches": 20}])
    said = command("plan", "site")
    assert "settings changed" in said and said.count("unchanged") == 3


def test_the_page_of_figures_names_those_of_all_given_projects(done):
    other = done / "runs" / "other"
    other.mkdir()
    (other / "summary.json").write_text('{"projection.outputs": {"value": 1, "unit": "", "sentence": "Pictures."}}')
    (done / "workflows" / "other.yaml").write_text((done / "workflows" / "site.yaml").read_text().replace(": site", ": other", 1))
    command("figures", "site", "other", "--path", "figures.md")
    text = (done / "figures.md").read_text()
    assert "| `projection.outputs` |  | Pictures. |" in text and "| `photos." in text
    shutil.rmtree(other)


def test_a_second_run_does_nothing(done, jobs):
    assert counts(command("run", "site")) == (0, jobs, 0)


def test_a_second_run_leaves_report_and_summary_with_the_figures_of_the_run_that_did_the_work(done):
    pages = [done / "runs" / "site" / name for name in ("report.html", "summary.json", "jobs/run.json")]
    before = [(page.read_bytes(), page.stat().st_mtime_ns) for page in pages]
    command("run", "site", "--sequential")
    command("run", "site", "--sequential", "--until", "photos")
    assert [(page.read_bytes(), page.stat().st_mtime_ns) for page in pages] == before


def test_a_second_run_writes_a_report_that_is_missing_or_was_made_by_other_code(done, jobs, monkeypatch):
    folder = done / "runs" / "site"
    before = (folder / "summary.json").read_text()
    (folder / "report.html").unlink()
    (folder / "summary.json").unlink()
    command("run", "site", "--sequential")
    assert (folder / "report.html").exists() and (folder / "summary.json").read_text() == before
    (folder / "report.html").write_text("drawn by an older version")
    monkeypatch.setattr("orthomill.pipeline.report.results._writers", lambda: "newer code")
    assert counts(command("run", "site", "--sequential")) == (0, jobs, 0)
    assert "older version" not in (folder / "report.html").read_text()


def test_facts_that_cannot_be_read_are_made_again_from_the_records(done, jobs):
    folder = done / "runs" / "site"
    before = json.loads((folder / "summary.json").read_text())
    (folder / "jobs" / "run.json").write_text("{")
    command("run", "site", "--sequential")
    after = json.loads((folder / "summary.json").read_text())
    assert after["run.work_seconds"] == before["run.work_seconds"] and after["run.peak_memory"] == before["run.peak_memory"]
    assert after["run.jobs_skipped"]["value"] == jobs and after["run.runs"]["value"] == 1


def test_a_run_in_two_parts_reports_the_work_of_both(done):
    folder = done / "runs" / "site"
    before = json.loads((folder / "summary.json").read_text())
    command("run", "site", "--sequential", "--from", "orientation")
    after = json.loads((folder / "summary.json").read_text())
    assert after["run.runs"]["value"] == 2 and before["run.runs"]["value"] == 1
    assert after["run.photos.work_seconds"] == before["run.photos.work_seconds"]
    assert after["run.wall_seconds"]["value"] > after["run.orientation.work_seconds"]["value"]
    assert "2 runs produced these results in" in (folder / "report.html").read_text()


def test_the_workflow_as_run_reproduces_the_run(done, jobs):
    assert counts(command("run", "runs/site/workflow.yaml")) == (0, jobs, 0)


def test_from_and_until_bound_what_runs(done, jobs):
    said = command("run", "site", "--sequential", "--from", "calibration", "--until", "calibration")
    ran, unchanged, failed = counts(said)
    assert (ran, failed) == (1, 0) and 0 < unchanged < jobs and "tie_points" not in said


def test_status_before_a_run(fresh):
    said = command("status", "site")
    assert "orientation 0 0 0.0" in said and said.endswith("not running")
    assert not (fresh / "runs").exists()


def test_status_after_a_run_and_while_another_is_in_progress(done):
    assert re.search(r"tie_points [1-9]\d* 0 ", command("status", "site"))
    with only_run(done / "runs" / "site"):
        said = command("status", "site")
        assert said.endswith("running now") and "this run" in said and "MiB" in said
        (done / "runs" / "site" / DASHBOARD).write_text("http://127.0.0.1:8787/status")
        assert command("status", "site").endswith("running now; dashboard: http://127.0.0.1:8787/status")
    said = command("status", "site")
    assert said.endswith("not running") and "this run" not in said


def test_status_shows_the_last_error(fresh):
    damage(photographs(fresh)[0])
    command("run", "site", "--sequential", code=1)
    assert "damaged" in command("status", "site")


def test_the_dashboard_is_named_while_a_run_on_dask_is_in_progress(done):
    assert command("dashboard", "site") == "site is not running; start it with: orthomill run site"
    with only_run(done / "runs" / "site"):
        assert "running without Dask" in command("dashboard", "site")
        (done / "runs" / "site" / DASHBOARD).write_text("")
        assert "site is starting, its dashboard is not there yet" in command("dashboard", "site")
        (done / "runs" / "site" / DASHBOARD).write_text("http://127.0.0.1:8787/status")
        assert command("dashboard", "site") == "http://127.0.0.1:8787/status"


def test_an_address_that_a_killed_run_left_is_not_shown(done):
    (done / "runs" / "site" / DASHBOARD).write_text("http://127.0.0.1:8787/status")
    assert "not running" in command("dashboard", "site")
    command("run", "site", "--sequential")
    assert not (done / "runs" / "site" / DASHBOARD).exists()


def test_figures_of_an_earlier_run_are_not_shown_for_a_stage_that_failed_since(done):
    summary = done / "runs" / "site" / "summary.json"
    assert any(name.startswith("orientation.") for name in json.loads(summary.read_text()))
    damage(photographs(done)[0])
    command("run", "site", "--sequential", code=1)
    figures = json.loads(summary.read_text())
    assert not any(name.startswith(("orientation.", "tie_points.")) for name in figures)
    assert figures["run.complete"]["value"] is False


def test_report_before_any_run_says_what_to_do(fresh):
    assert "site has not been run yet; run it first: orthomill run site" in command("report", "site", code=2)
    assert not (fresh / "runs").exists()


def test_report_writes_page_and_summary_again(done):
    folder = done / "runs" / "site"
    summary = (folder / "summary.json").read_text()
    (folder / "summary.json").unlink()
    (folder / "report.html").unlink()
    assert command("report", "site") == str(folder / "report.html")
    assert (folder / "summary.json").read_text() == summary and (folder / "report.html").stat().st_size > 10_000


def test_export_before_any_run_says_what_to_do(fresh):
    assert "site has no products yet; run it first" in command("export", "site", code=2)
    assert not (fresh / "runs").exists()


def test_export_writes_products_again_and_any_raster(done):
    cameras = done / "runs" / "site" / "products" / "cameras.json"
    cameras.unlink()
    assert str(cameras) in command("export", "site").split() and cameras.exists()
    name = photographs(done)[0].stem
    file = command("export", "site", f"photos/{name}/0")
    with pytest.warns(NotGeoreferencedWarning), rasterio.open(file) as picture:
        assert picture.shape == (360, 640)


def test_export_of_an_unknown_raster_is_a_sentence(done):
    assert "no raster photos/nobody" in command("export", "site", "photos/nobody", code=2)


def test_clean_removes_a_stage_or_everything_and_nothing_else(done, jobs):
    of_stage = len(Records(done / "runs" / "site").of_stage("orientation"))
    command("clean", "site", "--stage", "orientation")
    assert counts(command("run", "site", "--sequential")) == (of_stage, jobs - of_stage, 0)
    assert "everything" in command("clean", "site")
    assert not (done / "runs" / "site").exists() and len(photographs(done)) == 3
    assert "there is nothing to clean" in command("clean", "site", code=2)
    assert not (done / "runs" / "site").exists()


def test_init_writes_a_workflow_that_can_be_planned(fresh):
    said = command("init", "meadow", "--photos", "photos")
    assert said.count("run meadow") == 1 and "workflows/meadow.yaml is written; read it, then: orthomill run meadow" in said
    assert "not done yet" in command("plan", "meadow")
    before = (fresh / "workflows" / "meadow.yaml").read_text()
    assert "meadow.yaml" in command("init", "meadow", "--photos", "photos", code=2)
    assert (fresh / "workflows" / "meadow.yaml").read_text() == before
    assert "nowhere" in command("init", "hill", "--photos", "nowhere", code=2)


def test_init_takes_the_photographs_in_the_folder_of_the_projects_name(fresh):
    assert "There is no folder photographs/meadow: say where" in " ".join(command("init", "meadow", code=2).split())
    shutil.copytree(fresh / "photos", fresh / "photographs" / "meadow")
    command("init", "meadow")
    assert "path: photographs/meadow" in (fresh / "workflows" / "meadow.yaml").read_text()


@pytest.mark.parametrize(("ok", "code"), [(True, 0), (False, 1)])
def test_doctor_says_what_is_wrong(monkeypatch, ok, code):
    monkeypatch.setattr(
        "orthomill.pipeline.cli.doctor.doctor", lambda folder: [Finding("free disk", "1 GiB", ok, "" if ok else "make room")]
    )
    said = command("doctor", code=code)
    assert "free disk 1 GiB" in said and ("make room" in said) != ok


def test_reference_lists_the_settings_here_or_in_a_page(tmp_path):
    command("reference", str(tmp_path / "settings.md"))
    page = (tmp_path / "settings.md").read_text()
    assert "## photos" in page and command("reference") == " ".join(page.split())
    assert "cannot be written" in command("reference", str(tmp_path / "settings.md" / "inside.md"), code=2)


def test_debug_shows_the_traceback(fresh):
    with pytest.raises(WorkflowError):
        CliRunner().invoke(app, ["plan", "nowhere", "--debug"], catch_exceptions=False)


@pytest.mark.parametrize(
    ("words", "answer"),
    [
        (("--port", "99999999"), "65535"),
        (("--port", "0"), "'--port'"),
        (("--workers", "-1"), "'--workers'"),
        (("--workers", "100000"), "--workers 100000 is too many for the"),
        (("--memory", "10"), "256"),
        (("--memory", "300"), "photos/pictures/0/0 needs 600 MiB"),
    ],
)
def test_numbers_that_cannot_be_are_refused_before_anything_starts(fresh, words, answer):
    said = command("run", "site", *words, code=2)
    assert answer in said and "dashboard" not in said


def test_without_a_subcommand_the_command_lists_them():
    said = " ".join(CliRunner().invoke(app, []).output.split())
    assert all(word in said for word in ("run", "plan", "status", "report", "export", "clean", "dashboard", "init", "doctor"))
