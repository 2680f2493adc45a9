"""Several short jobs as one task: what is told of each, and what becomes of the others when one fails or its worker dies."""

from collections import deque
from pathlib import Path
from types import SimpleNamespace

import pytest
from distributed import KilledWorker
from toy_stages import MEMORY, SIZE, SmoothStage, SourceStage, SumStage, make_size, make_tile, pixels, run_in

from orthomill.pipeline.engine.dask_observer import EachJob
from orthomill.pipeline.engine.dask_runner import DaskRunner
from orthomill.pipeline.engine.execute import JobFailed, JobOrder
from orthomill.pipeline.engine.workers.order_batches import LONGEST, MOST, BatchFailed, Durations, Order, next_batch
from orthomill.pipeline.records.records import Fingerprint
from orthomill.pipeline.storage.store import Store
from orthomill.schemas.job import Job

STAGES = (SourceStage(rows=500, cols=500), SmoothStage(), SumStage())
PRINT = Fingerprint(settings="s", code="c", inputs="i")


def order(item: str, function=make_size, memory: int = 7) -> Order:
    job = Job(stage="a", item=item, function=function, reads={}, writes={"size": SIZE})
    return Order(JobOrder(job, Path("root"), Path("root/runs/toy"), PRINT, ""), (), memory)


def taken(seconds: float | None, number: int = 100, workers: int = 2, more_come: bool = False, **others) -> int:
    """How many of so many jobs are one task."""
    durations = Durations()
    if seconds is not None:
        durations.learn(order("before"), seconds)
    waiting = deque(order(f"{k}", **others.get(f"of_{k}", {})) for k in range(number))
    found = next_batch(waiting, durations, workers, lambda one: one.memory < 100, more_come)
    assert len(waiting) + (len(found.orders) if found else 0) == number
    return len(found.orders) if found else 0


def test_a_task_is_longer_the_more_workers_there_are():
    assert taken(None) == taken(0.1) == 1, "until it is known, and where the scheduler has time"
    assert taken(0.01) == 10 and taken(0.1, workers=50) == 25
    assert taken(1.0, workers=10_000) == LONGEST and taken(0.0, workers=10_000) == MOST


def test_only_jobs_of_a_kind_that_fit_with_others_are_one_task():
    assert taken(0.02, of_2={"function": make_tile}) == 2 and taken(0.02, of_3={"memory": 100}) == 3
    assert taken(0.01, of_0={"memory": 100}) == 1


def test_it_is_waited_for_those_that_are_about_to_come():
    assert taken(0.02, 3, more_come=True) == 0 and taken(0.02, 3) == 3 and taken(0.02, 5, more_come=True) == 5
    assert taken(0.02, 3, more_come=True, of_2={"function": make_tile}) == 2


def test_later_jobs_count_more_than_the_first_that_compiles():
    durations = Durations()
    for seconds in (10.0, *[0.1] * 20):
        durations.learn(order("one"), seconds)
    assert durations.of(order("other")) == pytest.approx(0.1, rel=0.1)


@pytest.fixture(scope="module")
def client():
    from orthomill.pipeline.engine.dask_cluster import local_client

    with local_client(2, MEMORY, 0) as found:
        yield found


@pytest.fixture
def runner(client, monkeypatch):
    """A runner to which all jobs are short."""
    monkeypatch.setattr(Durations, "of", lambda self, order: 0.015)
    return DaskRunner(client, MEMORY, "two processes")


@pytest.fixture
def sent(client, monkeypatch):
    """Numbers of jobs of the tasks that were submitted."""
    numbers, submit = [], client.submit

    def noted(function, keys, *words, **options):
        numbers.append(1 if isinstance(keys[0], str) else len(keys))
        return submit(function, keys, *words, **options)

    monkeypatch.setattr(client, "submit", noted)
    return numbers


def test_the_results_are_those_of_single_jobs_and_each_has_its_record(tmp_path, runner, sent):
    run_in(tmp_path / "one", *STAGES)
    session = run_in(tmp_path / "two", *STAGES, runner=runner)
    assert pixels(tmp_path / "one").tobytes() == pixels(tmp_path / "two").tobytes()
    assert max(sent) >= 3 and sum(sent) == len(session.done) == len(session.graph.jobs)
    assert all(session.records.afresh(key).status == "done" for key in session.graph.jobs)


def test_a_failed_job_of_a_task_blocks_only_what_needs_it(tmp_path, runner, sent):
    stages = (SourceStage(rows=500, cols=500, poison=(0, 128)), SmoothStage(), SumStage())
    one, two = run_in(tmp_path / "one", *stages), run_in(tmp_path / "two", *stages, runner=runner)
    assert max(sent) > 1 and one.failures == two.failures and list(two.failures) == [("source", "tile", 0, 1)]
    assert one.blocked == two.blocked and one.done == two.done
    stores = [Store(tmp_path / which / "runs/toy") for which in ("one", "two")]
    found, expected = (store.read("smooth/numbers", store.spec("smooth/numbers").full) for store in stores)
    assert found.tobytes() == expected.tobytes()


def test_a_worker_killed_in_the_middle_costs_only_a_retry(tmp_path, runner, sent):
    lure = tmp_path / "lure"
    lure.touch()
    stages = (SourceStage(rows=500, cols=500, lure=str(lure)), SmoothStage(), SumStage())
    session = run_in(tmp_path, *stages, runner=runner)
    assert max(sent) > 1 and not lure.exists(), "the worker was to die once"
    assert not session.failures and len(session.done) == len(session.graph.jobs)


class Task:
    """A future that ends when it is told to."""

    def __init__(self, key: tuple, names: str, before: tuple, options: dict) -> None:
        self.key, self.names, self.before, self.options = key, names, before, options
        self.status, self._error, self._call = "pending", None, None

    def add_done_callback(self, call) -> None:
        self._call = call

    def end(self, error: Exception | None = None) -> None:
        self.status, self._error = "error" if error else "finished", error
        self._call(self)

    def cancelled(self) -> bool:
        return False

    def exception(self) -> Exception | None:
        return self._error


class Client:
    """Remembers its tasks."""

    status, dashboard_link = "running", ""

    def __init__(self) -> None:
        self.tasks: list[Task] = []

    def submit(self, function, keys, content, terms, memory, *before, key, **options):
        names = keys[1] if isinstance(keys[0], str) else "".join(one[1] for one in keys)
        self.tasks.append(Task(key, names, before, options))
        return self.tasks[-1]

    def named(self, names: str) -> Task:
        """The last of these jobs."""
        return [task for task in self.tasks if task.names == names][-1]


@pytest.fixture
def of_jobs(monkeypatch):
    """A runner of jobs a, b, c ... in tasks of three, each with the jobs that it waits for."""
    monkeypatch.setattr(Durations, "of", lambda self, order: 0.015)

    def build(**jobs: str) -> DaskRunner:
        runner = DaskRunner(Client(), 2**30, "a test")
        for item, before in jobs.items():
            runner.submit(order(item).work, tuple(("a", name, 0, 0) for name in before), 7)
        runner._fill()
        return runner

    return build


def key(item: str) -> tuple:
    return ("a", item, 0, 0)


def ends(runner: DaskRunner, number: int) -> dict[str, str]:
    return {finished.key[1]: finished.status for finished in (runner.next() for _ in range(number))}


def test_a_task_waits_once_for_each_task_before_it(of_jobs):
    runner = of_jobs(a="", b="", c="", d="ab", e="c", f="de")
    assert [task.names for task in runner.client.tasks] == ["abc", "def"]
    assert runner.client.tasks[1].before == (runner.client.tasks[0],) and runner.client.tasks[0].key[:4] == key("a")


def test_who_observes_tasks_is_told_of_each_job(of_jobs):
    told = []
    board = SimpleNamespace(started=lambda *words: told.append(words), came_back=lambda *words: told.append(words))
    each = EachJob(board, of_jobs(a="", b="", c="", d="").jobs_of)
    each.started(key("a"), "one")
    each.came_back(key("d"), True)
    assert told == [*((key(item), "one") for item in "abc"), (key("d"), True)]


def test_of_a_task_whose_workers_died_each_job_is_handed_out_alone(of_jobs):
    runner = of_jobs(a="", b="", c="", d="b")
    first, second = runner.client.tasks
    second.end(KilledWorker(first.key, None, 3))  # told before that of its cause
    first.end(KilledWorker(first.key, None, 3))
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr("orthomill.pipeline.engine.dask_runner.PATIENCE", 0.001)
        patched.setattr("orthomill.pipeline.engine.dask_runner.stop_if_asked", lambda: all_submitted(runner, 6))
        with pytest.raises(Submitted):
            runner.next()
    assert [task.names for task in runner.client.tasks[2:]] == ["a", "b", "c", "d"]
    a, b, c, d = runner.client.tasks[2:]
    assert d.before == (b,)
    a.end(KilledWorker(a.key, None, 3))
    for task in (b, c, d):
        task.end()
    assert ends(runner, 4) == {"a": "failed", "b": "done", "c": "done", "d": "done"} and not runner.busy


class Submitted(Exception):
    """So many tasks were submitted."""


def all_submitted(runner: DaskRunner, number: int) -> None:
    if len(runner.client.tasks) >= number:
        raise Submitted


def test_what_only_shared_a_task_with_a_failed_job_is_handed_out_again(of_jobs):
    runner = of_jobs(a="", b="", c="b", d="a", e="b", f="e", g="d")
    first, second, third = runner.client.tasks
    failed = BatchFailed({key("b"): "The rays do not intersect."}, (key("c"),))
    for task in (third, second, first):
        task.end(failed)
    assert ends(runner, 5) == {"a": "done", "b": "failed", "c": "blocked", "e": "blocked", "f": "blocked"}
    runner.client.named("d").end()
    assert ends(runner, 1) == {"d": "done"}
    runner.client.named("g").end()
    assert ends(runner, 1) == {"g": "done"} and not runner.busy and len(runner.client.tasks) == 5


def test_a_job_that_waited_beside_one_that_is_blocked_is_handed_out_again(of_jobs):
    runner = of_jobs(a="", b="", c="")
    (first,) = runner.client.tasks
    first.end(JobFailed(key("a"), "cannot load it"))
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr("orthomill.pipeline.engine.dask_runner.stop_if_asked", lambda: all_submitted(runner, 4))
        with pytest.raises(Submitted):
            runner.next()
    assert [task.names for task in runner.client.tasks[1:]] == ["a", "b", "c"]
