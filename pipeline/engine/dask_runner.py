"""Runs jobs on Dask: worker processes of this machine, or any existing cluster. One of the three files that import Dask.

Dask's keys are the jobs' own keys, so that its dashboard groups progress by stage. Memory is a resource of each worker: the
scheduler assigns no more jobs to a worker than its memory allows. A job that needs more than a worker's share, but no more than
all workers of this machine have together, waits until nothing else runs, and runs alone. The scheduler holds a limited number of
jobs at a time: with tens of thousands it is busy with itself, on a loaded machine for so long that it loses its workers.
"""

import time
import uuid
from collections import Counter, deque
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from queue import Empty, SimpleQueue

from distributed import Client, Future, KilledWorker, performance_report
from distributed.comm import CommClosedError
from distributed.protocol.pickle import dumps, loads

from orthomill.pipeline.engine.dask_cluster import LOST, MEMORY, allow_memory
from orthomill.pipeline.engine.execute import JobFailed, JobOrder, execute
from orthomill.pipeline.engine.interruption import stop_if_asked
from orthomill.pipeline.engine.runner import ATTEMPTS, Finished
from orthomill.pipeline.records.records import Key
from orthomill.schemas.errors import ResourceError

WAVE = 2000
"""Jobs that the scheduler holds at most; the rest waits here. Enough for hundreds of workers."""
PATIENCE = 0.5
"""seconds after which waiting for a job looks whether the user wants to stop"""
LOOKED = 10.0
"""seconds of waiting after which it looks whether there are workers"""
DESERTED = 300.0
"""seconds after which a cluster without workers is given up; on an overloaded machine a new one takes minutes to start"""


def execute_sent(key: Key, content: bytes, *dependencies: object) -> Key:
    """Do a job that came as bytes; returns its key. Raises JobFailed."""
    # What Dask itself cannot load breaks the connection of the worker, without a word to anybody.
    try:
        work = loads(content)
    except Exception as error:  # importing a changed program raises anything
        sentence = f"its worker cannot load it ({type(error).__name__}: {error}); if the program was changed meanwhile, run again"
        raise JobFailed(key, sentence) from None
    return execute(work, *dependencies)


class DaskRunner:
    """Submits jobs to a Dask client as futures that depend on each other."""

    def __init__(self, client: Client, memory_limit: int, description: str, room: int = 0) -> None:
        self.memory_limit = memory_limit
        self.room = max(memory_limit, room)
        self.description = description
        self.dashboard = client.dashboard_link
        self.client = client
        self._waiting: deque[tuple[JobOrder, tuple[Key, ...], int]] = deque()
        self._futures: dict[Key, Future] = {}
        """those that the scheduler holds"""
        self._ended: SimpleQueue[tuple[Key, Future]] = SimpleQueue()
        self._started: Counter[Key] = Counter()
        self._quiet = time.monotonic()
        """when a job ended, or workers were seen"""
        self._looked = self._quiet
        self._alone: Key | None = None
        """the job that has all memory for itself"""
        self._unusable: set[Key] = set()
        self._blocked: deque[Key] = deque()
        self._session = uuid.uuid4().hex[:8]
        """Last part of every Dask key: a cluster may hold the same jobs of another run."""

    def submit(self, work: JobOrder, dependencies: tuple[Key, ...], memory: int) -> None:
        self._unusable.discard(work.job.key)
        self._waiting.append((work, dependencies, memory))
        self._fill()

    def _fill(self) -> None:
        """Hand over waiting jobs, in their order, until the scheduler has enough."""
        while self._waiting and len(self._futures) < WAVE and self._alone is None:
            work, dependencies, memory = self._waiting[0]
            large = memory > self.memory_limit
            if large and self._futures:
                return
            self._waiting.popleft()
            if self._unusable.intersection(dependencies):
                self._unusable.add(work.job.key)
                self._blocked.append(work.job.key)
                continue
            if large:
                self._alone = work.job.key
                allow_memory(self.client, self.room)
            self._start(work, dependencies, min(memory, self.memory_limit))

    def _start(self, work: JobOrder, dependencies: tuple[Key, ...], memory: int) -> None:
        # Jobs that are done, in this run or before, have no future: their results are on disk.
        before = [self._futures[key] for key in dependencies if key in self._futures]
        # A job that is submitted again is another one to Dask, which may still hold the first.
        self._started[work.job.key] += 1
        name = (*work.job.key, f"{self._session}-{self._started[work.job.key]}")
        # pure=False: Dask must not take two jobs with equal arguments for one, since what counts is what they write.
        sent = (execute_sent, work.job.key, dumps(work))
        future = self.client.submit(*sent, *before, key=name, retries=ATTEMPTS - 1, resources={MEMORY: memory}, pure=False)
        self._futures[work.job.key] = future
        self._await(work.job.key, future)

    def _await(self, key: Key, future: Future) -> None:
        future.add_done_callback(lambda ended: self._ended.put((key, ended)))

    @property
    def busy(self) -> bool:
        return bool(self._futures or self._waiting or self._blocked)

    def next(self) -> Finished:
        if self._blocked:
            return Finished(self._blocked.popleft(), "blocked")
        key, future = self._next_ended()
        if future.cancelled():
            # Nobody here cancels a future that is still waited for: the client does so when it loses its scheduler.
            raise CommClosedError("the scheduler was lost, and all submitted jobs with it")
        finished = _finished(key, future)
        if finished.status != "done":
            self._unusable.add(key)
        # Nobody needs the result any more, which is a key; the scheduler forgets the job when those that wait for it are done.
        del self._futures[key]
        if key == self._alone:
            self._alone = None
            allow_memory(self.client, self.memory_limit)
        self._fill()
        return finished

    def _next_ended(self) -> tuple[Key, Future]:
        """The next future that has ended and is still in that state: Dask revokes results of workers that died since."""
        while True:
            stop_if_asked()
            try:
                key, future = self._ended.get(timeout=PATIENCE)
            except Empty:
                self._look_for_workers()
                continue
            self._quiet = self._looked = time.monotonic()
            if future.status in ("finished", "error", "cancelled"):
                return key, future
            self._await(key, future)

    def _look_for_workers(self) -> None:
        """Raises ResourceError when all workers have been gone for long: nobody would ever do what is waited for."""
        now = time.monotonic()
        if now - self._looked < LOOKED:
            return
        self._looked = now
        # When the scheduler is lost, all futures are cancelled, and that is what the run ends with.
        with suppress(*LOST):
            if self.client.scheduler_info(n_workers=-1).get("workers"):
                self._quiet = now
        if now - self._quiet > DESERTED:
            raise ResourceError(
                "All workers have ended, and none has come back; finished jobs are kept. If nobody ended them, look for memory and "
                "disk ('orthomill doctor'), then run the same command again."
            )

    def close(self) -> None:
        self._waiting.clear()
        # After Ctrl-C the scheduler would otherwise go on with the queued jobs; a client without scheduler would wait for one.
        if self._futures and self.client.status == "running":
            with suppress(*LOST):
                self.client.cancel(list(self._futures.values()), force=True)
        self._futures.clear()


def _finished(key: Key, future: Future) -> Finished:
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


@contextmanager
def kept_report(runner: object, path: Path) -> Iterator[None]:
    """Keep Dask's own performance report of what runs inside, as one self-contained page; does nothing for other runners."""
    path.parent.mkdir(parents=True, exist_ok=True)
    report = performance_report(str(path), mode="inline") if isinstance(runner, DaskRunner) else None
    if report:
        report.__enter__()
    yield
    # Of a run that was interrupted or lost its scheduler there is no report: asking for one would hide why it ended.
    if report:
        with suppress(*LOST):
            report.__exit__(None, None, None)
