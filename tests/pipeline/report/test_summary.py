import json

from memory_store import MemoryStore

from orthomill.pipeline.engine.run_facts import Failure, RunFacts, StageRun
from orthomill.pipeline.report.summary import summary, summary_markdown, write_summary
from orthomill.schemas.stage_report import Figure, StageReport, report_table

STAGES = (("photos", "Photographs"), ("orientation", "Orientation"), ("texture", "Texture"))
RUN = RunFacts(
    "volos",
    "EPSG:2100",
    "0.1.0",
    "2026-11-21T10:00:00",
    finished="2026-11-21T10:05:00",
    seconds=300.0,
    peak_bytes=2**30,
    stages=(StageRun("photos", 4, 4, 0, 0, 3.5, 2**28, 3.0), StageRun("orientation", 6, 4, 1, 1, 9.0, cpu_seconds=4.5)),
    failures=(Failure("orientation", "orientation/pair/0/1", "Too few points."),),
)


def store():
    figures = (
        Figure(name="sigma0", value=0.3, unit="px", sentence="Standard error of unit weight."),
        Figure(name="bias", value=float("nan"), unit="m"),
        Figure(name="sigma0", value=0.4, unit="px"),
    )
    photos = StageReport(figures=(Figure(name="photos", value=6, sentence="Photographs | read."),))
    orientation = StageReport(figures=figures)
    return MemoryStore().put_table(report_table("orientation"), orientation).put_table(report_table("photos"), photos)


RUN_NAMES = (
    "complete",
    "crs",
    "failed_tiles",
    "finished",
    "jobs",
    "jobs_done",
    "jobs_failed",
    "jobs_skipped",
    "jobs_waiting",
    "machine",
    "peak_memory",
    "project",
    "runs",
    "scheduler",
    "started",
    "version",
    "wall_seconds",
    "work_seconds",
    "cpu_seconds",
)
STAGE_NAMES = (
    "complete",
    "cpu_seconds",
    "jobs",
    "jobs_done",
    "jobs_failed",
    "jobs_skipped",
    "jobs_waiting",
    "peak_memory",
    "work_seconds",
)


def test_the_names_are_stable_and_sorted():
    """Other programs rely on these names: a change here is a change for them."""
    names = [f"run.{name}" for name in RUN_NAMES]
    names += [f"run.{stage}.{name}" for stage, _ in STAGES for name in STAGE_NAMES]
    names += ["orientation.sigma0", "orientation.sigma0_2", "orientation.bias", "photos.photos"]
    assert list(summary(store(), STAGES, RUN)) == sorted(names)


def test_every_entry_has_value_unit_and_sentence():
    entries = summary(store(), STAGES, RUN)
    assert entries["orientation.sigma0"] == {"value": 0.3, "unit": "px", "sentence": "Standard error of unit weight."}
    assert entries["orientation.sigma0_2"]["value"] == 0.4
    assert entries["run.complete"]["value"] is False and entries["run.photos.complete"]["value"] is True
    assert entries["run.jobs"]["value"] == 10 and entries["run.work_seconds"]["value"] == 12.5
    assert entries["run.cpu_seconds"]["value"] == 7.5 and entries["run.photos.cpu_seconds"]["value"] == 3.0
    assert entries["run.peak_memory"] == {"value": 1024.0, "unit": "MiB", "sentence": "Largest memory of one worker."}
    assert entries["run.failed_tiles"]["value"] == "orientation/pair/0/1"
    assert entries["run.texture.jobs"]["value"] == 0


def test_the_file_is_strict_json_and_the_same_every_time(tmp_path):
    write_summary(store(), STAGES, RUN, tmp_path / "summary.json")
    write_summary(store(), tuple(reversed(STAGES)), RUN, tmp_path / "again.json")
    text = (tmp_path / "summary.json").read_text()
    assert text == (tmp_path / "again.json").read_text() and "NaN" not in text
    assert json.loads(text)["orientation.bias"]["value"] is None


def test_a_run_is_complete_only_when_every_stage_is():
    done = StageRun("photos", 4, 1, 3)
    assert RunFacts("p", "c", "0", "t", finished="t", stages=(done,)).complete
    assert not RunFacts("p", "c", "0", "t", stages=(done,)).complete
    assert not RunFacts("p", "c", "0", "t", finished="t", stages=(done, StageRun("texture", 4, 3))).complete
    assert not RunFacts("p", "c", "0", "t", finished="t").complete


def test_the_page_of_names_lists_every_name_once():
    text = summary_markdown(summary(store(), STAGES, RUN))
    assert "| `orientation.sigma0` | px | Standard error of unit weight. |" in text
    assert "Photographs \\| read." in text
    assert text.count("`run.<stage>.jobs_done`") == 1 and "`run.photos" not in text
    assert "0.3 |" not in text
