"""Runs jobs on Dask: worker processes of this machine, or any existing cluster. One of the two files that import Dask.

Dask's keys are the jobs' own keys, so that its dashboard groups progress by stage. Memory is a resource of each worker: the
scheduler assigns no more jobs to a worker than its memory allows.
"""

import uuid
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path

from distributed import Client, Future, KilledWorker, as_completed, performance_report
from distributed.comm import CommClosedError

from orthomill.pipeline.engine.dask_cluster import MEMORY
from orthomill.pipeline.engine.execute import JobFailed, JobOrder, execute
from orthomill.pipeline.engine.records import Key
from orthomill.pipeline.engine.runner import ATTEMPTS, Finished


class DaskRunner:
    """Submits jobs to a Dask client as futures that depend on each other."""

    def __init__(self, client: Client, memory_limit: int, description: str) -> None:
        self.memory_limit = memory_limit
        self.description = description
        self._client = client
        self._futures: dict[Key, Future] = {}
        self._key_of: dict[object, Key] = {}
        self._ended = as_completed()
        self._running = 0
        self._session = uuid.uuid4().hex[:8]
        """Last part of every Dask key: a cluster may hold the same jobs of another run."""

    def submit(self, work: JobOrder, dependencies: tuple[Key, ...], memory: int) -> None:
        # Jobs skipped by this run have no future: their results are on disk already.
        before = [self._futures[key] for key in dependencies if key in self._futures]
        name = (*work.job.key, self._session)
        # pure=False: Dask must not take two jobs with equal arguments for one, since what counts is what they write.
        future = self._client.submit(execute, work, *before, key=name, retries=ATTEMPTS - 1, resources={MEMORY: memory}, pure=False)
        self._futures[work.job.key] = future
        self._key_of[name] = work.job.key
        self._ended.add(future)
        self._running += 1

    @property
    def busy(self) -> bool:
        return self._running > 0

    def next(self) -> Finished:
        future = self._next_ended()
        if future.cancelled():
            # Nobody here cancels a future that is still waited for: the client does so when it loses its scheduler.
            raise CommClosedError("the scheduler was lost, and all submitted jobs with it")
        self._running -= 1
        key = self._key_of[future.key]
        if future.status == "finished":
            return Finished(key, "done")
        error = future.exception()
        # Dask hands the exception of a job on to all that depend on it; only the job itself is reported as failed.
        if isinstance(error, JobFailed):
            return Finished(key, "failed", error.sentence) if error.key == key else Finished(key, "blocked")
        if isinstance(error, KilledWorker):
            sentence = "its worker died at every attempt; it may need more memory than --memory allows"
            return Finished(key, "failed", sentence) if error.task == future.key else Finished(key, "blocked")
        return Finished(key, "failed", f"Dask could not run it ({type(error).__name__}: {error})")

    def _next_ended(self) -> Future:
        """The next future that has ended and is still in that state: Dask revokes results of workers that died since."""
        while True:
            future = next(self._ended)
            if future.status in ("finished", "error", "cancelled"):
                return future
            self._ended.add(future)

    def close(self) -> None:
        # After Ctrl-C the scheduler would otherwise go on with the queued jobs; a client without scheduler would wait for one.
        if self._client.status == "running":
            self._client.cancel(list(self._futures.values()), force=True)
        self._futures.clear()


@contextmanager
def kept_report(runner: object, path: Path) -> Iterator[None]:
    """Keep Dask's own performance report of what runs inside, as one self-contained page; does nothing for other runners."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with performance_report(str(path), mode="inline") if isinstance(runner, DaskRunner) else nullcontext():
        yield
