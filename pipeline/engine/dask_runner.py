"""Runs jobs on Dask: worker processes of this machine, or any existing cluster. One of the two files that know Dask.

Dask's keys are the jobs' own keys, so that its dashboard groups progress by stage. Memory is a resource of each worker: the
scheduler admits no more jobs to a worker than its memory allows.
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
        self._ended = as_completed()
        self._running = 0
        self._session = uuid.uuid4().hex[:8]
        """Last part of every Dask key: a cluster may hold the same jobs of another run."""

    def submit(self, work: JobOrder, dependencies: tuple[Key, ...], memory: int) -> None:
        before = [self._futures[key] for key in dependencies if key in self._futures]
        future = self._client.submit(
            execute, work, *before, key=(*work.job.key, self._session), retries=ATTEMPTS - 1, resources={MEMORY: memory}, pure=False
        )
        self._futures[work.job.key] = future
        self._ended.add(future)
        self._running += 1

    @property
    def busy(self) -> bool:
        return self._running > 0

    def next(self) -> Finished:
        future = self._next_ended()
        if future.cancelled():
            raise CommClosedError("the scheduler was lost, and with it what it was asked for")
        self._running -= 1
        key = future.key[:-1]
        if future.status == "finished":
            return Finished(key, "done")
        error = future.exception()
        if isinstance(error, JobFailed):
            return Finished(key, "failed", error.sentence) if error.key == key else Finished(key, "blocked")
        if isinstance(error, KilledWorker):
            died_at_own = error.task == future.key
            sentence = "its worker died each time it was tried; it may need more memory than --memory allows"
            return Finished(key, "failed", sentence) if died_at_own else Finished(key, "blocked")
        return Finished(key, "failed", f"Dask could not run it ({type(error).__name__}: {error})")

    def _next_ended(self) -> Future:
        """The next future that has ended and is still so: Dask takes back what it said of jobs whose worker died since."""
        while True:
            future = next(self._ended)
            if future.status in ("finished", "error", "cancelled"):
                return future
            self._ended.add(future)

    def close(self) -> None:
        if self._client.status == "running":
            self._client.cancel(list(self._futures.values()), force=True)
        self._futures.clear()


@contextmanager
def kept_report(runner: object, path: Path) -> Iterator[None]:
    """Keep Dask's own performance report of what runs inside, as one self-contained page; does nothing for other runners."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with performance_report(str(path), mode="inline") if isinstance(runner, DaskRunner) else nullcontext():
        yield
