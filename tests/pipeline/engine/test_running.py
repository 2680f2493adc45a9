"""A run from start to finish without the command line: what is handed in is used, and what is left behind is what was asked for."""

from contextlib import contextmanager
from dataclasses import replace
from itertools import count
from pathlib import Path

import numpy as np
import pytest
from toy_stages import CATALOGUE, PROJECT, TOTAL, SmoothStage, SourceStage, SumStage, pixels

from orthomill.pipeline.engine import running
from orthomill.pipeline.engine.run_facts import DASHBOARD, read_facts
from orthomill.pipeline.engine.runner import SchedulerLost, SequentialRunner
from orthomill.pipeline.engine.running import LOST, Options, check_stage_names, run_workflow, session_of
from orthomill.pipeline.engine.session import Unwatched
from orthomill.pipeline.records.lock import is_running, only_run
from orthomill.pipeline.report.results import REPORT, SUMMARY, rewrite_results, run_with_report
from orthomill.pipeline.storage.store import Store
from orthomill.pipeline.workflow.workflow_file import LoadedWorkflow
from orthomill.schemas.errors import ResourceError, StoreError, WorkflowError
from orthomill.schemas.memory import MIB
from orthomill.schemas.project import Tolerances

SEQUENTIAL = Options(sequential=True)
KINDS = ("source", "smooth", "sum")


def loaded_in(root: Path, *stages, name: str = "toy.yaml") -> LoadedWorkflow:
    return LoadedWorkflow(PROJECT, stages or tuple(stage() for stage in CATALOGUE), root / name, root, "")


class Written:
    """Remembers what was to be written."""

    def __init__(self) -> None:
        self.calls: list = []

    def __call__(self, store, folder, stages, facts) -> None:
        assert is_running(folder), "results are written under the lock"
        self.calls.append((stages, facts))


def test_a_run_reports_to_those_that_were_handed_in(tmp_path):
    written, seen = Written(), []

    class Counting(Unwatched):
        def finished(self, finished, seconds):
            seen.append(finished.key[0])

    @contextmanager
    def watch(session, runner, workers):
        seen.append(({stage.kind: stage.title for stage in session.stages}, runner.description, workers))
        yield Counting()

    facts = run_workflow(loaded_in(tmp_path), Options(sequential=True, workers=3), written, watch)
    assert facts.complete and facts.scheduler == "one job after another in this process"
    assert seen[0] == ({"source": "making numbers", "smooth": "smoothing", "sum": "adding up"}, facts.scheduler, 3)
    assert set(seen[1:]) == set(KINDS) and len(seen) == 1 + sum(stage.done for stage in facts.stages)
    ((stages, given),) = written.calls
    assert given == facts and [kind for kind, _ in stages] == list(KINDS)


def test_what_the_survey_allows_is_known_to_the_report(tmp_path):
    loaded = loaded_in(tmp_path)
    allowed = Tolerances(plan=0.05, height=0.08)
    project = loaded.project.model_copy(update={"tolerances": allowed})
    facts = run_with_report(replace(loaded, project=project), SEQUENTIAL)
    assert facts.tolerances == allowed == read_facts(tmp_path / "runs" / "toy").tolerances


def test_a_notebook_runs_a_workflow_with_one_call(tmp_path, capfd):
    facts = run_with_report(loaded_in(tmp_path), SEQUENTIAL)
    folder = tmp_path / "runs" / "toy"
    assert facts.complete and capfd.readouterr() == ("", "")
    assert Store(folder).table(TOTAL).total == pytest.approx(float(pixels(tmp_path).astype(float).sum()))
    assert (folder / REPORT).exists() and (folder / SUMMARY).exists() and not is_running(folder)


def test_a_run_without_work_keeps_the_pages_and_one_with_work_renews_them(tmp_path):
    run_with_report(loaded_in(tmp_path), SEQUENTIAL)
    pages = [tmp_path / "runs" / "toy" / name for name in (REPORT, SUMMARY)]
    before = [page.stat().st_mtime_ns for page in pages]
    assert not run_with_report(loaded_in(tmp_path), SEQUENTIAL).worked
    assert [page.stat().st_mtime_ns for page in pages] == before
    assert run_with_report(loaded_in(tmp_path), Options(sequential=True, from_stage="sum")).worked
    assert all(page.stat().st_mtime_ns > time for page, time in zip(pages, before, strict=True))


def test_a_run_until_a_stage_reports_that_part_only(tmp_path):
    facts = run_with_report(loaded_in(tmp_path), Options(sequential=True, until="smooth"))
    assert [stage.kind for stage in facts.stages] == ["source", "smooth"]
    page = (tmp_path / "runs" / "toy" / REPORT).read_text()
    assert "Part of a run" in page and page.count("This run was not asked for this stage.") == 1


def test_pages_are_written_again_from_what_is_stored(tmp_path):
    with pytest.raises(StoreError, match="toy has not been run yet; run it first: orthomill run toy"):
        rewrite_results(loaded_in(tmp_path))
    run_with_report(loaded_in(tmp_path), SEQUENTIAL)
    page = tmp_path / "runs" / "toy" / REPORT
    before = page.read_text()
    page.unlink()
    assert rewrite_results(loaded_in(tmp_path)) == page and page.read_text() == before


def test_a_run_that_fails_has_its_facts_and_a_list_of_failures(tmp_path):
    facts = run_with_report(loaded_in(tmp_path, SourceStage(poison=(0, 0)), SmoothStage(), SumStage()), SEQUENTIAL)
    assert not facts.complete and facts.worked
    assert [failure.key for failure in facts.failures] == ["source/tile/0/0"]
    assert "source/tile/0/0: this tile is poisoned" in (tmp_path / "runs" / "toy" / REPORT).read_text()


def test_an_interrupted_run_leaves_its_facts_and_no_lock(tmp_path):
    class Impatient(Unwatched):
        def finished(self, finished, seconds):
            if finished.key[0] == "smooth":
                raise KeyboardInterrupt

    @contextmanager
    def watch(session, runner, workers):
        yield Impatient()

    with pytest.raises(KeyboardInterrupt):
        run_workflow(loaded_in(tmp_path), SEQUENTIAL, Written(), watch)
    folder = tmp_path / "runs" / "toy"
    facts = read_facts(folder)
    assert facts is not None and facts.finished is None and facts.stage("source").done == 2
    assert not is_running(folder)


def lost_after(monkeypatch, *lives):
    """Runners of this machine that are lost after so many jobs each; those after them live on."""
    left = iter(lives)

    @contextmanager
    def runner_of(folder, options, announce):
        runner, life = SequentialRunner(1500 * MIB), next(left, 1000)
        ended = count(1)

        def next_of():
            if next(ended) > life:
                raise SchedulerLost("The Dask scheduler of this machine was lost.")
            return SequentialRunner.next(runner)

        runner.next = next_of
        yield runner

    monkeypatch.setattr(running, "_on_dask", runner_of)


def test_a_run_whose_scheduler_is_lost_goes_on_with_another(tmp_path, monkeypatch):
    lost_after(monkeypatch, 2, 1)
    said, shown = [], []

    @contextmanager
    def watch(session, runner, workers):
        class Counting(Unwatched):
            planned = staticmethod(lambda job: shown[-1].add(job.key))
            skipped = staticmethod(lambda key: shown[-1].discard(key))
            finished = staticmethod(lambda job, record: shown[-1].discard(job.key))

        shown.append(set())
        yield Counting()

    facts = run_workflow(loaded_in(tmp_path), Options(), Written(), watch, said.append)
    assert facts.complete and [line for line in said if "lost" in line] == [LOST.format(2), LOST.format(3)]
    assert len(shown) == 3 and shown[0] and not shown[-1], "the last display knows every job and its end"
    run_workflow(loaded_in(tmp_path / "whole"), SEQUENTIAL, Written())
    assert np.array_equal(pixels(tmp_path), pixels(tmp_path / "whole"))


def test_a_scheduler_that_is_lost_before_any_job_ends_is_not_replaced(tmp_path, monkeypatch):
    lost_after(monkeypatch, 2, 0)
    with pytest.raises(SchedulerLost):
        run_workflow(loaded_in(tmp_path), Options(), Written())
    facts = read_facts(tmp_path / "runs" / "toy")
    assert facts is not None and sum(stage.done for stage in facts.stages) == 2


def test_a_run_sweeps_away_what_a_killed_one_left(tmp_path):
    folder = tmp_path / "runs" / "toy"
    (folder / "jobs").mkdir(parents=True)
    (folder / "jobs" / ".half.part").write_text("half")
    scratch = folder / "products" / "deep" / ".dsm.tif.abc.part"
    scratch.mkdir(parents=True)
    (scratch / "dsm.tif").write_text("half")
    (folder / DASHBOARD).write_text("http://127.0.0.1:8787/status")
    run_workflow(loaded_in(tmp_path), SEQUENTIAL, Written())
    assert not (folder / "jobs" / ".half.part").exists() and not (folder / DASHBOARD).exists() and not scratch.exists()


def test_two_runs_at_the_same_time_are_refused(tmp_path):
    with only_run(tmp_path / "runs" / "toy"), pytest.raises(ResourceError, match="already running"):
        run_workflow(loaded_in(tmp_path), SEQUENTIAL, Written())


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (Options(workers=100_000), "--workers 100000 is too many for the"),
        (Options(sequential=True, memory=100 * MIB), "give workers more memory with --memory"),
    ],
)
def test_what_this_machine_cannot_do_is_refused_before_anything_starts(tmp_path, options, sentence):
    written = Written()
    with pytest.raises(ResourceError, match=sentence):
        run_workflow(loaded_in(tmp_path), options, written)
    assert not written.calls


def test_a_full_disk_is_refused_before_anything_starts(tmp_path, monkeypatch):
    monkeypatch.setattr("shutil.disk_usage", lambda path: type("Usage", (), {"free": 1000})())
    with pytest.raises(ResourceError, match="0 MiB free, but about 200 MiB are needed"):
        run_workflow(loaded_in(tmp_path), SEQUENTIAL, Written())


@pytest.mark.parametrize(
    ("first", "last", "stages", "forced"),
    [
        (None, None, KINDS, set()),
        ("smooth", None, KINDS, {"smooth", "sum"}),
        (None, "smooth", ("source", "smooth"), set()),
        ("smooth", "smooth", ("source", "smooth"), {"smooth"}),
    ],
)
def test_from_and_until_choose_stages(tmp_path, first, last, stages, forced):
    session = session_of(loaded_in(tmp_path), first, last)
    assert tuple(stage.kind for stage in session.stages) == stages and session.forced == forced


def test_from_after_until_and_unknown_stages_are_refused(tmp_path):
    loaded = loaded_in(tmp_path)
    with pytest.raises(WorkflowError, match="--from sum comes after --until source, so nothing would run"):
        session_of(loaded, "sum", "source")
    with pytest.raises(WorkflowError, match=r"There is no stage 'smoth' in toy\.yaml; did you mean 'smooth'\?"):
        session_of(loaded, "smoth")
    with pytest.raises(WorkflowError, match="Its stages are source, smooth, sum"):
        check_stage_names(loaded, ("sum", "texture"))
