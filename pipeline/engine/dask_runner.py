"""Runs jobs on Dask: worker processes of this machine, or any existing cluster. One of the four files that import Dask.

Dask's keys are the jobs' own keys, so that its dashboard groups progress by stage. A worker has one thread and does one job at a
time, so that its memory is that of a job; one that has too little for a job does not get it. A job that needs more than a worker's
share, but no more than all workers of this machine have together, waits until nothing else runs, and runs alone. The scheduler
holds a limited number of jobs at a time: with tens of thousands it is busy with itself, on a loaded machine for so long that it
loses its workers.
"""

import time
import uuid
from collections import Counter, deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import cast

from distributed import Client, Future, KilledWorker, get_worker, performance_report
from distributed.comm import CommClosedError
from distributed.protocol.pickle import dumps, loads

from orthomill.pipeline.engine.dask_cluster import LOST, allow_memory
from orthomill.pipeline.engine.execute import JobFailed, JobOrder, execute
from orthomill.pipeline.engine.interruption import stop_if_asked
from orthomill.pipeline.engine.runner import ATTEMPTS, Finished
from orthomill.pipeline.engine.worker_terms import Declined, Terms, objection
from orthomill.pipeline.engine.workforce import DESERTED, NOBODY, Workforce
from orthomill.pipeline.records.records import Key

WAVE = 2000
"""Jobs that the scheduler holds at most; the rest waits here. Enough for hundreds of workers."""
PATIENCE = 0.5
"""seconds after which waiting for a job looks whether the user wants to stop"""
LIVES = 5
"""Times that a job whose workers died is handed out where workers come and go; each time Dask itself allows for several deaths. It
counts every job that waited at a worker which died, and most of them it had not begun: each time such a job comes sooner."""
DECLINED = 1.0
"""seconds that a worker which may do no job waits until it says so: it would be given all that wait, one after the other"""
_ACCEPTED: set[Terms] = set()
"""of the process of a worker: the runs for which it may do jobs"""


@dataclass(frozen=True)
class Order:
    """A job as it is handed to a worker: what it is, what it waits for, and the bytes that it needs."""

    work: JobOrder
    dependencies: tuple[Key, ...]
    memory: int

    @property
    def key(self) -> Key:
        return self.work.job.key


def execute_sent(key: Key, content: bytes, terms: Terms | None, memory: int, *dependencies: object) -> Key:
    """Do a job that came as bytes and needs so many bytes; returns its key. Raises JobFailed, Declined where it may not be done."""
    if terms:
        _accept(terms, memory)
    # What Dask itself cannot load breaks the connection of the worker, without a word to anybody.
    try:
        work = loads(content)
    except Exception as error:  # importing a changed program raises anything
        sentence = f"its worker cannot load it ({type(error).__name__}: {error}); if the program was changed meanwhile, run again"
        raise JobFailed(key, sentence) from None
    return execute(work, *dependencies)


def _accept(terms: Terms, memory: int) -> None:
    """Raises Declined where this worker does not fulfil the terms of a run, or has less memory than a job needs."""
    worker = get_worker()
    if terms not in _ACCEPTED:
        if why := objection(terms, worker.state.nthreads):
            time.sleep(DECLINED)
            raise Declined(worker.address, why)
        _ACCEPTED.add(terms)
    room = worker.memory_manager.memory_limit
    if room and room < memory:
        raise Declined(worker.address, "", room)


class DaskRunner:
    """Submits jobs to a Dask client as futures that depend on each other. Without `terms` its workers are not asked for any."""

    def __init__(
        self,
        client: Client,
        memory_limit: int,
        description: str,
        room: int = 0,
        terms: Terms | None = None,
        say: Callable[[str], None] = lambda line: None,
        patience: float = DESERTED,
    ) -> None:
        self.memory_limit = memory_limit
        self.room = max(memory_limit, room)
        self.description = description
        self.dashboard = client.dashboard_link
        self.client = client
        self.workforce = Workforce(client, say, patience)
        self._terms = terms
        self._waiting: deque[Order] = deque()
        self._orders: dict[Key, Order] = {}
        """of the jobs that the scheduler holds"""
        self._for_some: dict[Key, list[str]] = {}
        """the workers that have enough memory for a job, where not all have"""
        self._futures: dict[Key, Future] = {}
        """those that the scheduler holds"""
        self._ended: SimpleQueue[tuple[Key, Future]] = SimpleQueue()
        self._started: Counter[Key] = Counter()
        self._killed: Counter[Key] = Counter()
        """how often Dask gave up a job because its workers died"""
        self._alone: Key | None = None
        """the job that has all memory for itself"""
        self._unusable: set[Key] = set()
        self._blocked: deque[Key] = deque()
        self._session = uuid.uuid4().hex[:8]
        """Last part of every Dask key: a cluster may hold the same jobs of another run."""

    def submit(self, work: JobOrder, dependencies: tuple[Key, ...], memory: int) -> None:
        self._unusable.discard(work.job.key)
        self._waiting.append(Order(work, dependencies, memory))
        self._fill()

    def _fill(self) -> None:
        """Hand over waiting jobs, in their order, until the scheduler has enough."""
        while self._waiting and len(self._futures) < WAVE and self._alone is None:
            order = self._waiting[0]
            large = order.memory > self.memory_limit
            if large and self._futures:
                return
            self._waiting.popleft()
            if self._unusable.intersection(order.dependencies):
                self._unusable.add(order.key)
                self._blocked.append(order.key)
                continue
            if large:
                self._alone = order.key
                allow_memory(self.client, self.room)
            self._start(order)

    def _start(self, order: Order) -> None:
        # Jobs that are done, in this run or before, have no future: their results are on disk.
        before = [self._futures[key] for key in order.dependencies if key in self._futures]
        # A job that is submitted again is another one to Dask, which may still hold the first.
        self._started[order.key] += 1
        name = (*order.key, f"{self._session}-{self._started[order.key]}")
        memory = self._need(order)
        some = self.workforce.suited(memory)
        # pure=False: Dask must not take two jobs with equal arguments for one, since what counts is what they write.
        sent = (execute_sent, order.key, dumps(order.work), self._terms, memory)
        sooner = self._killed[order.key]
        future = self.client.submit(*sent, *before, key=name, retries=ATTEMPTS - 1, workers=some, priority=sooner, pure=False)
        self._orders[order.key], self._futures[order.key] = order, future
        if some is None:
            self._for_some.pop(order.key, None)
        else:
            self._for_some[order.key] = some
        self._await(order.key, future)

    def _await(self, key: Key, future: Future) -> None:
        future.add_done_callback(lambda ended: self._ended.put((key, ended)))

    @property
    def busy(self) -> bool:
        return bool(self._futures or self._waiting or self._blocked)

    def next(self) -> Finished:
        if self._blocked:
            return Finished(self._blocked.popleft(), "blocked")
        key, future = self._next_ended()
        while future.status == "error" and self._handed_out_again(key, future.exception()):
            key, future = self._next_ended()
        if future.cancelled():
            # Nobody here cancels a future that is still waited for: the client does so when it loses its scheduler.
            raise CommClosedError("the scheduler was lost, and all submitted jobs with it")
        finished = _finished(key, future)
        if finished.status != "done":
            self._unusable.add(key)
        # Nobody needs the result any more, which is a key; the scheduler forgets the job when those that wait for it are done.
        del self._futures[key], self._orders[key]
        self._for_some.pop(key, None)
        if key == self._alone:
            self._alone = None
            allow_memory(self.client, self.memory_limit)
        self._fill()
        return finished

    def _handed_out_again(self, key: Key, error: BaseException) -> bool:
        """Hand a job out again where the reason is the worker, its own or that of a job before it; otherwise False."""
        if isinstance(error, Declined):
            self._look_at(error)
        elif not isinstance(error, KilledWorker) or not self._spared(key, error):
            return False
        self._start(self._orders[key])
        return True

    def _look_at(self, error: Declined) -> None:
        if error.why:
            self.workforce.dismiss(error.worker, error.why)
        else:
            self.workforce.has_only(error.worker, error.room)

    def _spared(self, key: Key, error: KilledWorker) -> bool:
        """Whether the job whose workers died, this one or one before it, gets others. Workers of this machine die of their jobs."""
        if self._terms is None or not isinstance(error.task, tuple):
            return False
        died = cast(Key, error.task[:-1])
        if died == key:
            self._killed[key] += 1
        return died not in self._unusable and self._killed[died] < LIVES

    def _next_ended(self) -> tuple[Key, Future]:
        """The next future that has ended and is still in that state: Dask revokes results of workers that died since."""
        while True:
            stop_if_asked()
            self._look_after_workers()
            try:
                key, future = self._ended.get(timeout=PATIENCE)
            except Empty:
                continue
            if future is not self._futures.get(key):  # it was handed out again since
                continue
            self.workforce.ended()
            if future.status in ("finished", "error", "cancelled"):
                return key, future
            self._await(key, future)

    def _look_after_workers(self) -> None:
        """Hand jobs out again that nobody would do. Raises ResourceError when nobody has done anything for long."""
        if not self._futures or not self.workforce.due:
            return
        all_again = self.workforce.look(max(map(self._need, self._orders.values())))
        # Neither does the scheduler look again when all have gone to whom a job was restricted.
        stranded = {key for key, some in self._for_some.items() if not self.workforce.there(some)}
        for key, future in list(self._futures.items()):
            if future.status == "pending" and (all_again or (key in stranded and self._may_be_done(key))):
                self._start(self._orders[key])

    def _need(self, order: Order) -> int:
        """Bytes that a worker must have for a job: one that runs alone is done with the memory of the others."""
        return min(order.memory, self.memory_limit)

    def _may_be_done(self, key: Key) -> bool:
        return self.workforce.suited(self._need(self._orders[key])) != [NOBODY]

    def close(self) -> None:
        self._waiting.clear()
        # After Ctrl-C the scheduler would otherwise go on with the queued jobs; a client without scheduler would wait for one.
        if self._futures and self.client.status == "running":
            with suppress(*LOST):
                self.client.cancel(list(self._futures.values()), force=True)
        self._futures.clear()
        self._orders.clear()


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
