"""What is known of a run: what counts as complete, what as work, and what still describes the results."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from orthomill.pipeline.engine.run_facts import FACTS, Failure, RunFacts, StageRun, read_facts, write_facts

COUNTS = st.integers(0, 50)


def facts(*stages: StageRun, **more) -> RunFacts:
    return RunFacts("volos", "EPSG:2100", "0.1.0", "2026-11-21T10:00:00", **({"finished": "t", "stages": stages} | more))


DONE = StageRun("photos", jobs=4, done=1, skipped=3, seconds=2.5, peak_bytes=10)


@settings(max_examples=100, deadline=None)
@given(jobs=COUNTS, done=COUNTS, skipped=COUNTS, failed=COUNTS)
def test_jobs_are_accounted_for(jobs, done, skipped, failed):
    stage = StageRun("a", jobs, done, skipped, failed)
    assert stage.waiting == max(jobs - done - skipped - failed, 0)
    assert stage.complete == (jobs > 0 and failed == 0 and done + skipped >= jobs)


def test_a_run_did_work_when_a_job_was_done_or_failed():
    assert facts(DONE).worked
    assert facts(StageRun("photos", 4, failed=1)).worked
    assert not facts(StageRun("photos", 4, skipped=4)).worked
    assert not facts().worked


def test_runs_and_their_time_add_up():
    unchanged = facts(StageRun("photos", 4, skipped=4), earlier=(10.0, 20.0), seconds=1.0)
    assert unchanged.runs == 2
    changed = facts(DONE, earlier=(10.0, 20.0), seconds=5.0)
    assert changed.runs == 3 and changed.whole_seconds == 35.0


def test_a_stage_that_was_not_planned_has_an_empty_record():
    assert facts(DONE).stage("texture") == StageRun("texture")
    assert facts(DONE).stage("photos") is DONE


@pytest.mark.parametrize(
    ("later", "describes"),
    [
        ({}, True),
        ({"workflow": "tile: 256"}, False),
        ({"stages": (StageRun("texture", 2, skipped=2),)}, False),
        ({"stages": (StageRun("photos", 4, skipped=4),)}, True),
    ],
)
def test_facts_describe_a_later_run_of_the_same_workflow_and_stages(later, describes):
    assert facts(DONE).describes(facts(DONE, **later)) is describes


def test_facts_of_an_incomplete_run_describe_nothing():
    assert not facts(DONE, finished=None).describes(facts(DONE))
    assert not facts(DONE, failures=(Failure("photos", "photos/a/0/0", "no."),)).describes(facts(DONE))


def test_facts_come_back_as_they_were(tmp_path):
    kept = facts(
        DONE,
        failures=(Failure("photos", "photos/a/0/0", "The file is truncated."),),
        machine=(("cores", "2"),),
        earlier=(1.5,),
        workflow="project: volos\n",
        peak_bytes=2**40,
    )
    write_facts(tmp_path, kept)
    assert read_facts(tmp_path) == kept


@pytest.mark.parametrize("content", ["", "{", "[]", '{"project": "volos"}'])
def test_facts_that_cannot_be_read_are_none(tmp_path, content):
    assert read_facts(tmp_path) is None
    (tmp_path / "jobs").mkdir()
    (tmp_path / FACTS).write_text(content)
    assert read_facts(tmp_path) is None
