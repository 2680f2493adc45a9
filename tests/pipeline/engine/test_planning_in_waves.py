"""While jobs are planned the first of them are at work already; what is done and told is the same."""

import pytest
from toy_stages import MEMORY, SmoothStage, SourceStage, SumStage, pixels, run_in, session_in

from orthomill.pipeline.engine import session as sessions
from orthomill.pipeline.engine.runner import SequentialRunner
from orthomill.pipeline.engine.session import Unwatched

STAGES = (SourceStage(rows=500, cols=500), SmoothStage(), SumStage())


class EagerRunner(SequentialRunner):
    """Has done a job as soon as somebody asks."""

    def __init__(self) -> None:
        super().__init__(MEMORY)
        self.planned: list[int] = []
        self.graph = None

    @property
    def has_ended(self) -> bool:
        return self.busy

    def next(self):
        self.planned.append(len(self.graph.jobs))
        return super().next()


class Told(Unwatched):
    """What a watcher was told, in that order."""

    def __init__(self) -> None:
        self.words: list[tuple] = []

    def planned(self, planned) -> None:
        self.words.append(("planned", planned.key))

    def skipped(self, key) -> None:
        self.words.append(("skipped", key))

    def finished(self, finished, record) -> None:
        self.words.append((finished.status, finished.key))


@pytest.fixture
def run_eagerly(tmp_path, monkeypatch):
    def run(*stages):
        monkeypatch.setattr(sessions, "WAVE", 3)
        session, runner, told = session_in(tmp_path / "waves", *stages), EagerRunner(), Told()
        runner.graph = session.graph
        session.run(runner, told)
        return session, runner, told.words

    return run


def test_the_first_jobs_are_done_while_the_last_are_planned(tmp_path, run_eagerly):
    session, runner, told = run_eagerly(*STAGES)
    whole = run_in(tmp_path / "whole", *STAGES)
    assert list(session.graph.jobs) == list(whole.graph.jobs) and session.done == whole.done and not session.pending
    assert pixels(tmp_path / "waves").tobytes() == pixels(tmp_path / "whole").tobytes()
    assert len([number for number in runner.planned if 1 < number < len(session.graph.jobs)]) > 10
    assert sorted(key for word, key in told if word == "done") == sorted(session.graph.jobs)


def test_who_watches_hears_of_all_jobs_of_a_planning_before_any_of_them_has_ended(run_eagerly):
    session, _, told = run_eagerly(*STAGES)
    count = len(session.graph.jobs)
    assert [word for word, _ in told] == count * ["planned"] + count * ["done"]
    assert [key for word, key in told if word == "planned"] == list(session.graph.jobs)


def test_a_second_run_skips_all_and_a_failure_blocks_what_follows(run_eagerly):
    first, _, _ = run_eagerly(SourceStage(rows=500, cols=500, poison=(0, 128)), SmoothStage(), SumStage())
    assert list(first.failures) == [("source", "tile", 0, 1)] and first.blocked and not first.pending
    second, _, told = run_eagerly(SourceStage(rows=500, cols=500, poison=(0, 128)), SmoothStage(), SumStage())
    assert second.skipped == first.done and second.blocked == first.blocked and not second.done
    assert {key for word, key in told if word == "skipped"} == second.skipped
