"""What the terminal says during a run: one total, no time before it is known, no stage that looks done before it begins."""

import io
import json

import pytest
from rich.console import Console
from toy_stages import SourceStage, run_in

from orthomill.pipeline.cli.progress import progress_lines
from orthomill.pipeline.cli.progress.progress_lines import ProgressLines, StageCount, about, state_text
from orthomill.pipeline.engine.runner import Finished
from orthomill.pipeline.forecast.known_costs import Expectations, Expected
from orthomill.pipeline.records.records import Fingerprint, Record
from orthomill.pipeline.watching.cost_model import CostModel, Remaining
from orthomill.pipeline.watching.run_watch import Watchers


def lines(as_json=False):
    model = CostModel(("source", "later"), 1, Expectations({("later", "work"): Expected(10.0, 1.0)}, here=False))
    console = Console(file=io.StringIO())
    return model, ProgressLines({"source": "Source", "later": "Later"}, model, console, as_json)


def record_of(key):
    """A job that took a second of processor time."""
    stage, item, row, col = key
    digests = Fingerprint(settings="", code="", inputs="")
    return Record(
        stage=stage, item=item, row=row, col=col, status="done", fingerprint=digests, reason="", cpu_seconds=1.0, worker="1"
    )


def whole_run(root, as_json=False):
    """Tell of all jobs of a source; every one takes a second."""
    model, shown = lines(as_json)
    watchers = Watchers((model, shown))
    jobs = run_in(root, SourceStage(rows=64, cols=64), tile=16).graph.jobs
    for planned in jobs.values():
        watchers.planned(planned)
    for key in jobs:
        watchers.finished(Finished(key, "done"), record_of(key))
    return shown


def test_no_time_is_told_in_the_first_seconds(tmp_path, capsys):
    assert whole_run(tmp_path).remaining() is None
    assert "remaining time not known yet" in capsys.readouterr().err


def test_a_log_tells_the_whole_run_and_the_end_of_a_stage(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(progress_lines, "SETTLED", 0.0)
    whole_run(tmp_path)
    told = capsys.readouterr().err.splitlines()
    assert any("% of the work, about" in line for line in told)
    assert "source 17/17 jobs" in told[-1] and len(told) <= progress_lines.STEPS


def test_a_log_is_never_silent_for_long(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(progress_lines, "STEPS", 0)
    monkeypatch.setattr(progress_lines, "SILENT", float("inf"))
    whole_run(tmp_path / "quiet")
    few = capsys.readouterr().err.splitlines()
    monkeypatch.setattr(progress_lines, "SILENT", 0.0)
    whole_run(tmp_path / "told")
    assert len(few) == 2 and len(capsys.readouterr().err.splitlines()) == 17


def test_json_is_one_object_a_line(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(progress_lines, "SETTLED", 0.0)
    whole_run(tmp_path, as_json=True)
    told = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert (
        told[-1]["event"] == "progress"
        and told[-1]["stages"]["source"]["done"] == 17
        and told[-1]["stages"]["later"]["planned"] == 0
    )
    assert [one["share"] for one in told if one["share"]] == sorted(one["share"] for one in told if one["share"])


def test_a_stage_whose_jobs_have_not_begun_has_no_bar():
    assert not StageCount(planned=1).began and StageCount(planned=1, skipped=1).began
    assert state_text(StageCount(planned=4, done=1, failed=1, blocked=2)) == "4/4 jobs, 1 failed, 2 blocked"


@pytest.mark.parametrize(
    ("seconds", "error", "text"),
    [
        (1.5, 0.7, "under 5 s of known work"),
        (42.0, 8.0, "about 40 s (35 to 50)"),
        (300.0, 60.0, "about 5 min (4 to 6)"),
        (7200.0, 1800.0, "about 2.0 h (1.6 to 2.5)"),
    ],
)
def test_a_duration_has_no_more_digits_than_it_deserves(seconds, error, text):
    assert about(Remaining(1.0, 1.0, 0.0, seconds, error)) == text
