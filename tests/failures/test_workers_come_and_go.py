"""Workers of a cluster that are killed and started again, join late with another program, or may do no job."""

import json
import os
import signal
import subprocess
import sys
import time
from contextlib import ExitStack
from pathlib import Path
from threading import Thread
from types import SimpleNamespace

import psutil
import pytest
from held_stage import HeldStage
from toy_stages import MEMORY, session_in

from orthomill.pipeline.engine.dask_cluster import remote_client
from orthomill.pipeline.engine.dask_runner import DaskRunner
from orthomill.pipeline.engine.session import Unwatched
from orthomill.pipeline.engine.workers import worker_terms
from orthomill.pipeline.engine.workers.worker_terms import objection, shown
from orthomill.pipeline.engine.workers.workforce import Workforce
from orthomill.schemas.errors import ResourceError

OTHER = "import orthomill.pipeline.engine.workers.worker_terms as terms\nterms.__version__ = '0.0.1'\n"


class Cluster:
    """A scheduler and workers, each a process of its own, until this context ends."""

    def __init__(self, folder: Path) -> None:
        self._folder, self._file, self._processes = folder, folder / "scheduler.json", ExitStack()
        self._start("dask_scheduler", "--host", "127.0.0.1", "--port", "0")
        self.address = json.loads(wait_for(lambda: self._file.exists() and self._file.read_text()))["address"]

    def _start(self, program: str, *words: str) -> psutil.Process:
        common = ["--no-dashboard", "--scheduler-file", str(self._file)]
        silent = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        support = str(Path(__file__).parents[1] / "support" / "engine")
        started = psutil.Popen(
            [sys.executable, "-m", f"distributed.cli.{program}", *common, *words],
            cwd=self._folder,
            env={**os.environ, "PYTHONPATH": support},
            **silent,
        )
        self._processes.callback(end, started)
        return started

    def worker(self, *words: str) -> psutil.Process:
        return self._start("dask_worker", "--nthreads", "1", "--memory-limit", "2GiB", *words)

    def __enter__(self):
        return self

    def __exit__(self, *reason):
        self._processes.close()


def end(process: psutil.Process) -> None:
    for one in (*process.children(recursive=True), process):
        one.kill()
    process.wait(30)


def wait_for(what, patience: float = 120.0):
    deadline = time.monotonic() + patience
    while not (found := what()):
        assert time.monotonic() < deadline
        time.sleep(0.05)
    return found


@pytest.mark.slow
def test_a_killed_worker_is_replaced_and_one_with_another_program_is_named(tmp_path):
    gate, said = tmp_path / "gate", []
    session = session_in(tmp_path, HeldStage(gate=str(gate)))
    preload = tmp_path / "other.py"
    preload.write_text(OTHER)

    def events():
        wait_for(lambda: len(session.records.of_stage("held")) == 2)
        cluster.worker("--preload", str(preload))
        wait_for(lambda: any("0.0.1" in line for line in said))
        (process,) = [one for one in first.children(recursive=True) if "spawn_main" in " ".join(one.cmdline())]
        process.send_signal(signal.SIGKILL)
        gate.touch()

    with Cluster(tmp_path) as cluster:
        first = cluster.worker()
        happening = Thread(target=events, daemon=True)
        with remote_client(cluster.address) as client, shown(session.folder, session.mark) as terms:
            runner = DaskRunner(client, MEMORY, "elsewhere", MEMORY, terms, said.append)
            runner.workforce.muster(terms)
            happening.start()
            session.run(runner, Unwatched())
    assert not session.failures and len(session.done) == 6
    workers = [record.worker for record in session.records.of_stage("held")]
    assert len(set(workers)) == 2 and workers.count(workers[0]) == 2, "a new process did what the killed one had not done"
    (named,) = [line for line in said if "0.0.1" in line]
    assert "has orthomill 0.0.1 (" in named and named.endswith("and start it again. It gets no jobs.")
    assert not list((session.folder / "jobs").glob(".shown*"))


@pytest.fixture
def terms(tmp_path):
    with shown(tmp_path / "run", "mark") as found:
        yield found


def test_a_worker_like_the_command_may_do_jobs(terms):
    assert objection(terms, 1) is None


def test_what_is_wrong_with_a_worker_is_said(terms, tmp_path, monkeypatch):
    monkeypatch.setattr(worker_terms, "APPEARS", 0.0)
    assert objection(terms, 4).startswith("has 4 threads, and memory is counted per process; start it with --nthreads 1")
    elsewhere = worker_terms.Terms(tmp_path / "unmounted", terms.mark, terms.program)
    assert objection(elsewhere, 1).startswith(f"does not see {tmp_path / 'unmounted'}; ")
    # A folder of the same name on another disk does not hold the file of this run.
    assert objection(worker_terms.Terms(terms.place, "other", terms.program), 1).startswith("does not see ")
    monkeypatch.setattr(worker_terms, "__version__", "0.0.1")
    assert objection(terms, 1).startswith("has orthomill 0.0.1 (")


class Mustered:
    """A client of workers with these objections."""

    def __init__(self, **objections: str | None) -> None:
        self.objections, self.retired = objections, []

    scheduler = SimpleNamespace(identity=None)

    def sync(self, identity, n_workers):
        return {"workers": {worker: {"memory_limit": 0} for worker in self.objections}}

    def run(self, function, *words, workers=None, **options):
        if function.__name__ == "resolve_name":
            return {worker: function(*words) for worker in self.objections}
        return {worker: self.objections[worker] for worker in workers}

    def retire_workers(self, workers, close_workers):
        self.retired += workers


def test_a_cluster_without_any_worker_that_may_do_jobs_is_refused_before_the_first(terms):
    with pytest.raises(ResourceError, match=r"The worker one does not see it; mount it\. The other 1 may do no job either"):
        Workforce(Mustered(one="does not see it; mount it", two="has 4 threads")).muster(terms)


def test_among_several_workers_those_that_may_do_no_job_are_named_before_the_first(terms):
    said = []
    Workforce(client := Mustered(one="does not see it", two=None), said.append).muster(terms)
    assert said == ["The worker one does not see it. It gets no jobs."] and client.retired == ["one"]


def test_a_cluster_may_get_its_workers_later(terms):
    said = []
    Workforce(Mustered(), said.append).muster(terms)
    assert said == ["The cluster has no workers yet; this run waits 10 minutes for those that join."]
