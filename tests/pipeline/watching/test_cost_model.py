"""The remaining time: jobs count by their kind, compiling counts once, and unplanned stages by their usual share."""

import pytest
from toy_stages import SmoothStage, SourceStage, run_in

from orthomill.pipeline.engine.runner import Finished
from orthomill.pipeline.watching.cost_model import MEASURED_ERROR, PARALLEL, USUAL_ERROR, CostModel, FamilyCost


def planned_model(root, usual, workers=1):
    """The sixteen tiles of the source, planned, and a model of them."""
    session = run_in(root, SourceStage(rows=64, cols=64), tile=16)
    model = CostModel(usual, workers)
    tiles = [planned for planned in session.graph.jobs.values() if planned.job.item == "tile"]
    for planned in tiles:
        model.planned(planned)
    return [planned.key for planned in tiles], model


def test_nothing_is_said_before_anything_is_measured(tmp_path):
    assert planned_model(tmp_path, {"source": 1.0})[1].remaining() is None


def test_the_first_job_of_a_worker_does_not_spoil_the_mean():
    cost = FamilyCost(planned=100)
    for seconds in (90.0, 91.0, 1.0, 1.0, 1.0):
        cost.add(seconds, workers=2)
    assert cost.mean == pytest.approx(1.0) and cost.usual == pytest.approx(5.0)


def test_no_mean_is_told_while_every_job_may_have_compiled():
    cost = FamilyCost(planned=100)
    cost.add(90.0, workers=2)
    cost.add(91.0, workers=2)
    assert cost.mean is None


def test_stages_that_are_not_planned_count_with_their_usual_share(tmp_path):
    keys, model = planned_model(tmp_path, {"source": 1.0, "later": 3.0})
    assert len(keys) == 16
    model.finished(Finished(keys[0], "done"), 50.0)
    for key in keys[1:4]:
        model.finished(Finished(key, "done"), 2.0)
    left = model.remaining()
    # The first one compiled: the source costs 16 times 2 s, and the later stage three times as much.
    assert left.done == pytest.approx(8.0) and left.by_share == pytest.approx(96.0) and left.left == pytest.approx(24.0 + 96.0)
    assert left.seconds == pytest.approx(120.0) and left.share == pytest.approx(8.0 / 128.0)
    assert left.error == pytest.approx(MEASURED_ERROR * 24.0 + USUAL_ERROR * 96.0)


def test_the_work_is_divided_among_the_workers(tmp_path):
    keys, model = planned_model(tmp_path, {"source": 1.0}, workers=4)
    for key in keys[:8]:
        model.finished(Finished(key, "done"), 2.0)
    assert model.remaining().seconds == pytest.approx(8 * 2.0 / (PARALLEL * 4))


def test_jobs_that_failed_or_are_unchanged_leave_nothing_behind(tmp_path):
    keys, model = planned_model(tmp_path, {"source": 1.0})
    for key in keys[1:]:
        model.skipped(key)
    model.finished(Finished(keys[0], "failed"), 0.0)
    assert model.remaining() is None or model.remaining().left == 0.0


def test_one_cheap_kind_of_job_does_not_speak_for_a_stage(tmp_path):
    session = run_in(tmp_path, SourceStage(rows=64, cols=64), SmoothStage(), tile=16)
    model = CostModel({"source": 1.0, "smooth": 1.0}, 1)
    for planned in session.graph.jobs.values():
        model.planned(planned)
    smoothed = [key for key in session.graph.jobs if key[0] == "smooth"]
    model.finished(Finished(("source", "size", 0, 0), "done"), 0.01)
    assert model.remaining() is None, "the sixteen tiles of the source are not measured"
    for key in smoothed[:5]:
        model.finished(Finished(key, "done"), 2.0)
    assert model.remaining().left > 20.0
