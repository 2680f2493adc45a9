"""How the runner interprets Dask's answers, with a client that gives prepared answers; real workers are in test_engine.py."""

import socket
from contextlib import nullcontext
from itertools import count
from pathlib import Path
from types import SimpleNamespace

import pytest
from distributed import KilledWorker
from distributed.comm import CommClosedError
from toy_stages import SIZE, make_size

from orthomill.pipeline.engine import dask_runner as runner_module
from orthomill.pipeline.engine.dask_cluster import free_port, opened
from orthomill.pipeline.engine.dask_runner import DaskRunner, execute_sent, kept_report
from orthomill.pipeline.engine.execute import JobFailed, JobOrder
from orthomill.pipeline.engine.runner import Finished, SchedulerLost
from orthomill.pipeline.engine.workers import workforce as workforce_module
from orthomill.pipeline.engine.workers.worker_terms import Declined
from orthomill.pipeline.records.records import Fingerprint
from orthomill.schemas.errors import ResourceError
from orthomill.schemas.job import Job


class Answer:
    """A future that has ended."""

    def __init__(self, key: object, status: str, error: Exception | None = None) -> None:
        self.key, self.status, self._error = key, status, error

    def add_done_callback(self, call) -> None:
        call(self)

    def cancelled(self) -> bool:
        return self.status == "cancelled"

    def exception(self) -> Exception | None:
        return self._error


class Client:
    """Remembers what is submitted; every job ends with the status and error that are planned for its item."""

    status = "running"
    dashboard_link = "http://127.0.0.1:8787/secret/status"

    def __init__(self, **planned: tuple) -> None:
        self.planned, self.submitted, self.cancelled = planned, [], []

    def submit(self, function, job, content, terms, memory, *before, key, **options):
        self.submitted.append((key, before, {**options, "memory": memory}))
        status, *error = self.planned.get(job[1], ("finished",))
        return Answer(key, status, error[0](key) if error else None)

    def cancel(self, futures, force):
        self.cancelled = futures


@pytest.fixture
def runner_of(tmp_path):
    def build(*items: str, terms: object = None, **planned: tuple) -> DaskRunner:
        runner = DaskRunner(Client(**planned), 2**30, "a test", terms=terms)
        previous: tuple = ()
        for item in items:
            work = JobOrder(
                Job(stage="a", item=item, function=make_size, reads={}, writes={"size": SIZE}), tmp_path, tmp_path, PRINT, ""
            )
            runner.submit(work, previous, 7)
            previous = (work.job.key,)
        return runner

    return build


PRINT = Fingerprint(settings="s", code="c", inputs="i")


def failed(item: str):
    return "error", lambda key: JobFailed(("a", item, 0, 0), "The rays do not intersect.")


def killed(item: str):
    return "error", lambda key: KilledWorker(("a", item, 0, 0, key[-1]), None, 3)


def test_jobs_carry_their_keys_their_memory_and_what_they_wait_for(runner_of):
    runner = runner_of("one", "two")
    (first, before, options), (second, waits_for, _) = runner.client.submitted
    assert [key[:4] for key in (first, second)] == [("a", "one", 0, 0), ("a", "two", 0, 0)]
    assert before == () and [future.key for future in waits_for] == [first]
    assert options["memory"] == 7 and options["workers"] is None and options["pure"] is False


def test_two_runs_on_one_cluster_do_not_share_keys(runner_of):
    one, other = runner_of("one"), runner_of("one")
    assert one.client.submitted[0][0] != other.client.submitted[0][0]


def test_the_scheduler_holds_no_more_jobs_than_a_wave_and_gets_the_next_when_one_ends(runner_of, monkeypatch):
    monkeypatch.setattr(runner_module, "WAVE", 3)
    monkeypatch.setattr(runner_module, "EACH", 1)
    runner = runner_of(*"abcdefg")
    assert [key[1] for key, _, _ in runner.client.submitted] == ["a", "b", "c"] and runner.busy
    ended = []
    while runner.busy:
        ended.append(runner.next().key[1])
        assert len(runner._futures) <= 3
    assert ended == list("abcdefg")
    waits = {key[1]: [before.key[1] for before in befores] for key, befores, _ in runner.client.submitted}
    assert waits["d"] == ["c"], "c was still with the scheduler"


def test_a_scheduler_of_many_workers_holds_more(runner_of, monkeypatch):
    monkeypatch.setattr(runner_module, "WAVE", 1)
    monkeypatch.setattr(runner_module, "EACH", 2)
    runner = runner_of()
    runner.workforce.has_only("tcp://one:1", 2**40)
    runner.workforce.has_only("tcp://two:1", 2**40)
    for item in "abcdefg":
        job = Job(stage="a", item=item, function=make_size, reads={}, writes={"size": SIZE})
        runner.submit(JobOrder(job, Path(), Path(), PRINT, ""), (), 7)
    assert [key[1] for key, _, _ in runner.client.submitted] == ["a", "b", "c", "d"]


def test_jobs_behind_the_wave_are_blocked_by_a_failure_in_it(runner_of, monkeypatch):
    monkeypatch.setattr(runner_module, "WAVE", 1)
    monkeypatch.setattr(runner_module, "EACH", 1)
    runner = runner_of("one", "two", "three", one=failed("one"))
    assert [(ended.key[1], ended.status) for ended in (runner.next(), runner.next(), runner.next())] == [
        ("one", "failed"),
        ("two", "blocked"),
        ("three", "blocked"),
    ]
    assert not runner.busy and len(runner.client.submitted) == 1


def test_waiting_for_a_job_can_be_stopped(runner_of, monkeypatch):
    monkeypatch.setattr(Answer, "add_done_callback", lambda self, call: None)
    runner = runner_of("endless")
    asked = iter([None, None, KeyboardInterrupt])

    def stop_if_asked():
        if error := next(asked):
            raise error

    monkeypatch.setattr(runner_module, "stop_if_asked", stop_if_asked)
    monkeypatch.setattr(runner_module, "PATIENCE", 0.01)
    with pytest.raises(KeyboardInterrupt):
        runner.next()


@pytest.mark.parametrize(
    ("answer", "status", "sentence"),
    [
        (("finished",), "done", ""),
        (failed("one"), "failed", "The rays do not intersect."),
        (failed("before"), "blocked", ""),
        (killed("one"), "failed", "its worker died at every attempt; it may need more memory than --memory allows"),
        (killed("before"), "blocked", ""),
        (("error", lambda key: RuntimeError("no pickle")), "failed", "Dask could not run it (RuntimeError: no pickle)"),
    ],
)
def test_every_end_of_a_job_has_its_status_and_sentence(runner_of, answer, status, sentence):
    runner = runner_of("one", one=answer)
    ended = runner.next()
    assert (ended.key, ended.status, ended.sentence) == (("a", "one", 0, 0), status, sentence)
    assert not runner.busy


def statuses(runner):
    ends = []
    while runner.busy:
        finished = runner.next()
        ends.append((finished.key[1], finished.status))
    return ends


def test_a_job_whose_workers_were_killed_beside_it_is_handed_out_again_and_sooner(runner_of):
    runner = runner_of("one", "two", terms="terms", one=killed("one"), two=killed("one"))
    runner.client.planned = {}
    assert statuses(runner) == [("one", "done"), ("two", "done")]
    assert [(key[1], options["priority"]) for key, _, options in runner.client.submitted[2:]] == [("one", 1), ("two", 0)]


def test_a_job_that_kills_every_worker_fails_at_last_and_what_waits_for_it_is_blocked(runner_of):
    runner = runner_of("one", "two", terms="terms", one=killed("one"), two=killed("one"))
    assert statuses(runner) == [("one", "failed"), ("two", "blocked")]
    given = [key[1] for key, _, _ in runner.client.submitted].count("one")
    assert given == runner_module.LIVES, "a limited number of times"


def test_a_worker_of_this_machine_dies_of_its_job(runner_of):
    runner = runner_of("one", one=killed("one"))
    assert statuses(runner) == [("one", "failed")] and len(runner.client.submitted) == 1


def test_a_lost_scheduler_is_not_taken_for_a_failed_job(runner_of):
    runner = runner_of("one", one=("cancelled",))
    with pytest.raises(CommClosedError, match="scheduler was lost"):
        runner.next()


def test_a_client_that_cannot_close_does_not_hide_that_the_scheduler_was_lost():
    def close(timeout):
        client.status = "closing"
        raise ValueError("IOStream is not idle; cannot convert to SSL")  # of an attempt to reconnect

    client = SimpleNamespace(status="connecting", close=close)
    with pytest.raises(SchedulerLost, match="lost in the middle"), opened(client, "at tls://a:1", "restart the cluster"):
        raise CommClosedError("the scheduler was lost")
    assert client.status == "closed"  # or it is closed again where the interpreter ends


def test_a_result_that_dask_revokes_is_waited_for_again(runner_of):
    runner = runner_of("one")
    future = runner._futures["a", "one", 0, 0]
    statuses = iter(["pending", *["finished"] * 4])
    future.__class__ = type("Revoked", (Answer,), {"status": property(lambda self: next(statuses), lambda self, value: None)})
    assert runner.next().status == "done"


def test_closing_cancels_what_is_left_if_the_client_still_lives(runner_of):
    runner = runner_of("one", "two")
    runner.close()
    assert len(runner.client.cancelled) == 2
    failing = runner_of("one")
    failing.client.cancel = lambda *more, **options: (_ for _ in ()).throw(CommClosedError("gone"))
    failing.close()
    lost = runner_of("one")
    lost.client.status = "closed"
    lost.close()
    assert lost.client.cancelled == []


def test_a_report_is_kept_of_runs_on_dask_only(tmp_path):
    with kept_report(object(), tmp_path / "run" / "dask_report.html"):
        pass
    assert (tmp_path / "run").is_dir() and not list((tmp_path / "run").iterdir())


def test_a_taken_port_gives_way_to_the_next_free_one():
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        number = taken.getsockname()[1]
        assert free_port(number) != number
    assert free_port(70_000) == 0


class Watched(Client):
    """No job ends by itself; at each look its workers are as the next description says, and at all later ones as the last."""

    def __init__(self, *looks: dict[str, dict], given: bool | tuple[str, ...] = False) -> None:
        super().__init__()
        self.looks, self.given, self.retired = list(looks), given, []

    def submit(self, *words, **options):
        ended = super().submit(*words, **options)
        ended.add_done_callback, ended.status = lambda call: None, "pending"
        return ended

    scheduler = SimpleNamespace(identity=None)

    def sync(self, identity, n_workers):
        self.there = self.looks.pop(0) if len(self.looks) > 1 else self.looks[0]
        return {"workers": self.there}

    def processing(self):
        """Of all workers: the scheduler has an error for who asks for one by name that has just gone."""
        return {worker: ("job",) if self.given is True or (self.given and worker in self.given) else () for worker in self.there}

    def retire_workers(self, workers, close_workers):
        self.retired += workers


@pytest.fixture
def waiting_for(tmp_path, monkeypatch):
    """Waits for a job of so many bytes with a client; returns what is said until the run is given up, and why it is."""
    monkeypatch.setattr(runner_module, "PATIENCE", 0.001)
    clock = count(0, 5)  # five seconds later whenever it is asked
    monkeypatch.setattr(workforce_module, "time", SimpleNamespace(monotonic=lambda: next(clock)))

    def wait(client: Watched, memory: int = 7) -> tuple[list[str], str]:
        said: list[str] = []
        runner = DaskRunner(client, 2**30, "a test", say=said.append)
        job = Job(stage="a", item="one", function=make_size, reads={}, writes={"size": SIZE})
        runner.submit(JobOrder(job, tmp_path, tmp_path, PRINT, ""), (), memory)
        with pytest.raises(ResourceError) as given_up:
            runner.next()
        return said, str(given_up.value)

    return wait


RUNNING = {"status": "running", "memory_limit": 2**30}


@pytest.mark.parametrize(
    ("client", "memory", "why"),
    [
        (Watched({}), 7, "there is none"),
        (Watched({"one": RUNNING}, {"one": RUNNING}, {}), 7, "there is none"),
        (Watched({"one": {**RUNNING, "status": "paused"}}), 7, "all workers are paused, perhaps because their memory is full"),
        (Watched({"one": RUNNING}), 2**30, "the scheduler gives 1 of them no job"),
        (Watched({"one": {**RUNNING, "memory_limit": 2**29}}), 2**30, "a job needs 1024 MiB, and the largest worker has 512 MiB"),
    ],
)
def test_a_cluster_where_nobody_does_anything_is_told_and_then_given_up(waiting_for, client, memory, why):
    said, given_up = waiting_for(client, memory)
    assert len(said) == 1 and f"No worker does anything: {why}" in said[0] and "this run waits" in said[0]
    assert f": {why}" in given_up and "finished jobs are kept" in given_up


@pytest.mark.parametrize("look", [{"one": {**RUNNING, "metrics": {"task_counts": {"executing": 1}}}}, {"one": RUNNING}])
def test_workers_that_compute_are_waited_for(waiting_for, look):
    client = Watched(*[look] * 100, {}, given=True)
    said, _ = waiting_for(client)
    assert client.looks == [{}] and len(said) == 1 and "there is none" in said[0], "given up only after they had gone"


def test_a_run_whose_workers_die_at_every_job_is_given_up(waiting_for):
    others = [{f"worker-{number}": RUNNING} for number in range(200)]
    client = Watched(*others, given=True)
    said, given_up = waiting_for(client)
    assert "No job has ended for 10 minutes" in given_up and "workers died at work since" in given_up and not said
    assert 20 < len(client.looks) < 180, "neither at once nor at the end"


def test_workers_that_die_while_another_one_computes_are_not_the_reason(waiting_for):
    # The one with the long job lives; the others had nothing to do.
    busy = {**RUNNING, "metrics": {"task_counts": {"executing": 1}}}
    client = Watched(*[{"long": busy, f"worker-{number}": RUNNING} for number in range(200)], {}, given=("long",))
    _, given_up = waiting_for(client)
    assert client.looks == [{}] and "there is none" in given_up


def test_jobs_are_handed_out_again_when_the_workers_with_memory_for_them_have_gone(waiting_for):
    small, large = {**RUNNING, "memory_limit": 2**20}, {**RUNNING, "memory_limit": 2**30}
    client = Watched({"one": small, "two": large}, {"one": small}, {"one": small, "three": large}, {})
    waiting_for(client, 2**30)
    assert [options["workers"] for _, _, options in client.submitted] == [None, ["three"], None]


def declined(worker: str, why: str, room: float = 0.0):
    return "error", lambda key: Declined(worker, why, room)


def test_a_worker_that_may_do_no_job_is_named_once_and_its_job_goes_to_another(runner_of):
    runner = runner_of(one=declined("tcp://two:2", "has 4 threads"))
    said, away = [], []
    runner.workforce._say, runner.client.retire_workers = said.append, lambda workers, close_workers: away.extend(workers)
    for number in range(2):
        runner.client.planned["one"] = declined("tcp://two:2", "has 4 threads")
        job = Job(stage="a", item="one", row=number, function=make_size, reads={}, writes={"size": SIZE})
        runner.submit(JobOrder(job, Path(), Path(), PRINT, ""), (), 7)
        runner.client.planned.clear()
        assert runner.next() == Finished(job.key, "done")
    assert said == ["The worker tcp://two:2 has 4 threads. It gets no jobs."] and away == ["tcp://two:2"]


@pytest.mark.parametrize("others", [{}, {"tcp://fit:1": RUNNING}])
def test_a_run_ends_where_all_workers_that_ever_come_may_do_no_job(others):
    client, said = Watched(others), []
    workforce = workforce_module.Workforce(client, said.append)
    numbers = range(workforce_module.UNFIT)
    for number in numbers[:-1]:
        workforce.dismiss(f"tcp://unfit:{number}", "has orthomill 0.1.0")
    with nullcontext() if others else pytest.raises(ResourceError, match=r"None of 5 workers may do a job; .* has orthomill 0.1.0"):
        workforce.dismiss(f"tcp://unfit:{numbers[-1]}", "has orthomill 0.1.0")
    assert len(said) == len(numbers)


def test_a_worker_with_too_little_memory_gets_the_smaller_jobs(runner_of):
    runner = runner_of("one", one=declined("tcp://two:2", "", 6.0))
    runner.workforce.has_only("tcp://one:1", 8.0)
    runner.client.planned.clear()
    assert runner.next().status == "done"
    assert [options["workers"] for _, _, options in runner.client.submitted] == [None, ["tcp://one:1"]]
    assert runner.workforce.suited(6) is None


def test_a_job_that_its_worker_cannot_load_fails_with_the_reason():
    with pytest.raises(JobFailed) as failure:
        execute_sent(("a", "one", 0, 0), b"corthomill.schemas.job\nNoSuchJob\n.", None, 7)
    assert failure.value.key == ("a", "one", 0, 0)
    assert failure.value.sentence.startswith("its worker cannot load it (AttributeError: ")
    assert failure.value.sentence.endswith("if the program was changed meanwhile, run again")
