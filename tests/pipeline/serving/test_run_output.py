"""What a run tells becomes lines for people: progress in steps, findings, errors; no addresses, no tracebacks, no noise."""

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from orthomill.pipeline.serving.queue.run_output import RunOutput


def told(run: RunOutput, *lines: str | dict) -> list[str]:
    return [said for line in lines for said in run.take(line if isinstance(line, str) else json.dumps(line))]


def progress(share: float | None, done: int, planned: int = 100, left: float | None = None) -> dict:
    stages = {"photos": {"planned": 3, "done": 3}, "texture": {"planned": planned, "done": done}}
    return {"event": "progress", "seconds": 7.4, "share": share, "left_seconds": left, "stages": stages}


def test_progress_is_told_in_steps_and_as_it_is():
    run = RunOutput()
    lines = told(
        run,
        progress(None, 0),
        progress(0.1, 10, left=600.0),
        progress(0.11, 11),
        progress(0.05, 12),
        progress(0.5, 50),
        progress(0.4, 60),
        progress(0.7, 70),
    )
    assert lines == [
        "[7 s] 10 % of the work, about 10 min left; texture: 10 of 100 jobs",
        "[7 s] 53 % of the work; texture: 50 of 100 jobs",
        "[7 s] 77 % of the work; texture: 70 of 100 jobs",
    ]
    assert run.progress.share == pytest.approx(0.7658, abs=1e-3) and run.progress.stage == "texture"


@given(st.lists(st.floats(0.0, 1.0), min_size=1, max_size=30))
def test_a_share_that_was_shown_never_falls_and_the_end_is_reached(shares):
    run = RunOutput()
    shown = []
    for share in [*shares, 1.0]:
        run.take(json.dumps(progress(share, 1)))
        shown.append(run.progress.share)
    assert shown == sorted(shown) and shown[-1] == pytest.approx(1.0) and max(shown) <= 1.0
    if shares == sorted(shares):
        assert shown[:-1] == pytest.approx(shares)


def test_addresses_and_advice_for_the_terminal_are_for_nobody_elsewhere():
    run = RunOutput()
    note = {"event": "note", "text": "dashboard: http://127.0.0.1:8787/secret/status"}
    init = "/srv/tasks/x/workflows/task.yaml is written; read it, then: orthomill run task"
    assert told(run, note, "map: http://localhost:1/x", init, "", "{not json") == ["{not json"]


def test_the_end_has_verdict_reasons_and_warnings():
    end = {"event": "end", "complete": False, "verdict": "Partial.", "reasons": ["Two tiles failed."]}
    end |= {"warnings": [{"stage": "texture", "cost": "doubt", "sentence": "dark"}]}
    end |= {"failed": [{"tile": "texture/a/0/0", "sentence": "no light"}], "products": []}
    run = RunOutput()
    assert told(run, end) == ["Verdict: Partial.", "  Two tiles failed.", "texture: dark", "failed texture/a/0/0: no light"]
    assert run.error == "texture/a/0/0: no light" and run.verdict == "Partial."


def test_a_traceback_is_for_whoever_runs_the_node():
    run = RunOutput()
    lines = ["Traceback (most recent call last):", '  File "x.py", line 1, in <module>', "    f()", "KeyError: 'x'", "error: later"]
    assert told(run, "\x1b[31merror:\x1b[0m photo.jpg is broken", *lines[:4]) == ["error: photo.jpg is broken"]
    assert run.error.startswith("This is a defect of orthomill (KeyError: 'x')") and len(run.traced) == 4
    assert told(run, lines[4]) == ["error: later"] and run.error == "later"
