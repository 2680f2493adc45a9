"""Runs jobs on Dask: worker processes of this machine, or any existing cluster. One of the four files that import Dask.

Dask's keys are the jobs' own keys, so that its dashboard groups progress by stage. A worker has one thread and does one job at a
time, so that its memory is that of a job; one that has too little for a job does not get it. A job that needs more than a worker's
share, but no more than all workers of this machine have together, waits until nothing else runs, and runs alone. The scheduler
holds a limited number of tasks at a time: with tens of thousands it is busy with itself, on a loaded machine for so long that it
loses its workers. A task is a job, or several short ones; it is named after the first.
"""

import time
import uuid
from collections import Counter, deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any, cast

from distributed import Client, Future, KilledWorker, get_worker, performance_report
from distributed.comm import CommClosedError
from distributed.protocol.pickle import dumps, loads

from orthomill.pipeline.engine.dask_cluster import LOST, allow_memory
from orthomill.pipeline.engine.execute import JobFailed, JobOrder, execute
from orthomill.pipeline.engine.interruption import stop_if_asked
from orthomill.pipeline.engine.runner import ATTEMPTS, End, Finished
from orthomill.pipeline.engine.workers.order_batches import MOST, Batch, BatchFailed, Durations, Order, next_batch
from orthomill.pipeline.engine.workers.worker_terms import Declined, Terms, objection
from orthomill.pipeline.engine.workers.workforce import DESERTED, NOBODY, Workforce
from orthomill.pipeline.records.numbered_names import Key

WAVE, EACH = 2000, 20
"""Tasks that the scheduler holds at most, and for each worker; the rest waits here. Some wait for others of them: with 20 for each
of 1000 workers a county is done a tenth sooner than with 2 (simulated)."""
PATIENCE = 0.5
"""seconds after which waiting for a job looks whether the user wants to stop"""
LIVES = 5
"""Times that a job whose workers died is handed out where workers come and go; each time Dask itself allows for several deaths. It
counts every job that waited at a worker which died, and most of them it had not begun: each time such a job comes sooner."""
DECLINED = 1.0
"""seconds that a worker which may do no job waits until it says so: it would be given all that wait, one after the other"""
SOON = 0.01
"""seconds until it is asked again what became of a failed task"""
_ACCEPTED: set[Terms] = set()
"""of the process of a worker: the runs for which it may do jobs"""


def execute_sent(key: Key, content: bytes, terms: Terms | None, memory: int, *dependencies: object) -> Key:
    """Do a job that came as bytes and needs so many bytes; returns its key. Raises JobFailed, Declined where it may not be done."""
    if terms:
        _accept(terms, memory)
    return execute(_loaded(key, content), *dependencies)


def execute_batch(keys: tuple[Key, ...], content: bytes, terms: Terms | None, memory: int, *dependencies: object) -> None:
    """Do several jobs that came as bytes, with what each waits for. Raises BatchFailed at their end, JobFailed, Declined."""
    if terms:
        _accept(terms, memory)
    failed: dict[Key, str] = {}
    untried: list[Key] = []
    for work, before in _loaded(keys[0], content):
        if not failed.keys().isdisjoint(before) or not set(untried).isdisjoint(before):
            untried.append(work.job.key)
            continue
        try:
            execute(work)
        except JobFailed as failure:
            failed[failure.key] = failure.sentence
    if failed:
        raise BatchFailed(failed, tuple(untried))


def _loaded(key: Key, content: bytes) -> Any:
    # What Dask itself cannot load breaks the connection of the worker, without a word to anybody.
    try:
        return loads(content)
    except Exception as error:  # importing a changed program raises anything
        sentence = f"its worker cannot load it ({type(error).__name__}: {error}); if the program was changed meanwhile, run again"
        raise JobFailed(key, sentence) from None


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
        self._durations = Durations()
        self._batches: dict[Key, Batch] = {}
        """those that the scheduler holds, by their first job"""
        self._for_some: dict[Key, list[str]] = {}
        """by first job, the workers that have enough memory for a batch, where not all have"""
        self._futures: dict[Key, Future] = {}
        """of all jobs that the scheduler holds"""
        self._ended: SimpleQueue[tuple[Batch, Future]] = SimpleQueue()
        self._started = 0
        """tasks so far"""
        self._killed: Counter[Key] = Counter()
        """how often Dask gave up a job because its workers died"""
        self._shared = False
        """whether any task was several jobs"""
        self._alone: Key | None = None
        """the job that has all memory for itself"""
        self._unusable: set[Key] = set()
        self._told: deque[Finished] = deque()
        """ends that nobody has asked for yet"""
        self._last: dict[Key, Order] = {}
        """jobs that were done, until it is known how long they took"""
        self._session = uuid.uuid4().hex[:8]
        """Last part of every Dask key: a cluster may hold the same jobs of another run."""

    def submit(self, work: JobOrder, dependencies: tuple[Key, ...], memory: int) -> None:
        self._unusable.discard(work.job.key)
        self._waiting.append(Order(work, dependencies, memory))
        self._fill(more_come=True)

    def _fill(self, more_come: bool = False) -> None:
        """Hand over waiting jobs, in their order, until the scheduler has enough."""
        while self._waiting and self._has_room and self._alone is None:
            order = self._waiting[0]
            large = order.memory > self.memory_limit
            if large and self._futures:
                return
            if self._unusable.intersection(order.dependencies):
                self._end(Finished(self._waiting.popleft().key, "blocked"))
                continue
            batch = next_batch(self._waiting, self._durations, self.workforce.number, self._fits, more_come)
            if batch is None:
                return
            if large:
                self._alone = order.key
                allow_memory(self.client, self.room)
            self._start(batch)

    @property
    def _has_room(self) -> bool:
        """Whether the scheduler is to get more."""
        workers = self.workforce.number
        return len(self._batches) < tasks_held(workers) and len(self._futures) < jobs_held(workers)

    def jobs_of(self, key: Key) -> tuple[Key, ...]:
        """The jobs of the task that has the name of this one. Any thread may ask."""
        batch = self._batches.get(key)
        return batch.keys if batch else (key,)

    def _fits(self, order: Order) -> bool:
        """Whether a job may be one of several."""
        return order.memory <= self.memory_limit and not self._unusable.intersection(order.dependencies)

    def _start(self, batch: Batch) -> None:
        # Jobs that are done, in this run or before, have no future: their results are on disk.
        before = list(dict.fromkeys(self._futures[key] for key in batch.before if key in self._futures))
        # What is submitted again is another task to Dask, which may still hold the first.
        self._started += 1
        name = (*batch.key, f"{self._session}-{self._started}")
        memory = self._need(batch)
        some = self.workforce.suited(memory)
        sooner = self._killed[batch.key]
        # pure=False: Dask must not take two jobs with equal arguments for one, since what counts is what they write.
        options: dict[str, Any] = {"key": name, "retries": ATTEMPTS - 1, "workers": some, "priority": sooner, "pure": False}
        self._shared |= len(batch.orders) > 1
        # Before it is submitted: whoever observes the scheduler asks for it at once.
        self._batches[batch.key] = batch
        future = self.client.submit(*_sent(batch), self._terms, memory, *before, **options)
        self._futures.update(dict.fromkeys(batch.keys, future))
        if some is None:
            self._for_some.pop(batch.key, None)
        else:
            self._for_some[batch.key] = some
        self._await(batch, future)

    def _await(self, batch: Batch, future: Future) -> None:
        future.add_done_callback(lambda ended: self._ended.put((batch, ended)))

    @property
    def busy(self) -> bool:
        return bool(self._futures or self._waiting or self._told)

    @property
    def has_ended(self) -> bool:
        return bool(self._told) or not self._ended.empty()

    @property
    def wants_more(self) -> bool:
        # Enough for two tasks of the most jobs: one of fewer is made only where there are no more.
        return len(self._waiting) < 2 * MOST

    def next(self) -> Finished:
        self._fill()
        while not self._told:
            batch, future = self._next_ended()
            if future.status == "error" and self._handed_out_again(batch, future.exception()):
                continue
            if future.cancelled():
                # Nobody here cancels a future that is still waited for: the client does so when it loses its scheduler.
                raise CommClosedError("the scheduler was lost, and all submitted jobs with it")
            self._forget(batch)
            for order, finished in zip(batch.orders, _ends(batch, future), strict=True):
                if finished.status == "done":
                    self._last[order.key] = order
                self._end(finished)
            self._fill()
        return self._told.popleft()

    def _forget(self, batch: Batch) -> None:
        # Nobody needs the result any more; the scheduler forgets the task when those that wait for it are done.
        del self._batches[batch.key]
        self._for_some.pop(batch.key, None)
        for key in batch.keys:
            del self._futures[key]
        if batch.key == self._alone:
            self._alone = None
            allow_memory(self.client, self.memory_limit)

    def _end(self, finished: Finished) -> None:
        if finished.status != "done":
            self._unusable.add(finished.key)
        self._told.append(finished)

    def learn(self, key: Key, seconds: float) -> None:
        """A job that has ended took so long."""
        if order := self._last.pop(key, None):
            self._durations.learn(order, seconds)

    def _handed_out_again(self, batch: Batch, error: BaseException) -> bool:
        """Hand jobs out again where the reason is their worker, or another job than those that they wait for; otherwise False."""
        if isinstance(error, Declined):
            self._look_at(error)
            self._start(batch)
            return True
        own = _is_own(batch, error)
        if own and len(batch.orders) > 1:
            return not isinstance(error, BatchFailed) and self._start_one_by_one(batch)
        if isinstance(error, KilledWorker) and self._spared(batch.key, error):
            self._start(batch)
            return True
        # Where no job shares its task, what Dask says of a task holds for the job.
        return not own and self._shared and self._start_what_may_be_done(batch)

    def _start_one_by_one(self, batch: Batch) -> bool:
        """Hand out the jobs of a batch whose workers died: whose fault it was shows when each is alone."""
        self._forget(batch)
        for order in batch.orders:
            self._start(Batch((order,)))
        return True

    def _start_what_may_be_done(self, batch: Batch) -> bool:
        """Hand out again what waited for a batch of which other jobs failed, or was to be done with a job that is blocked."""
        if any(self._futures[key].status == "error" for key in batch.before if key in self._futures):
            # First it must be seen what becomes of those.
            time.sleep(SOON)
            self._ended.put((batch, self._futures[batch.key]))
            return True
        self._forget(batch)
        useful = []
        for order in batch.orders:
            if self._unusable.intersection(order.dependencies):
                self._end(Finished(order.key, "blocked"))
            else:
                useful.append(order)
        if useful:
            self._start(Batch(tuple(useful)))
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

    def _next_ended(self) -> tuple[Batch, Future]:
        """The next future that has ended and is still in that state: Dask revokes results of workers that died since."""
        while True:
            stop_if_asked()
            self._look_after_workers()
            try:
                batch, future = self._ended.get(timeout=PATIENCE)
            except Empty:
                continue
            if future is not self._futures.get(batch.key):  # it was handed out again since
                continue
            self.workforce.ended()
            if future.status in ("finished", "error", "cancelled"):
                return batch, future
            self._await(batch, future)

    def _look_after_workers(self) -> None:
        """Hand jobs out again that nobody would do. Raises ResourceError when nobody has done anything for long."""
        if not self._futures or not self.workforce.due:
            return
        all_again = self.workforce.look(max(map(self._need, self._batches.values())))
        # Neither does the scheduler look again when all have gone to whom a job was restricted.
        stranded = {key for key, some in self._for_some.items() if not self.workforce.there(some)}
        for key, batch in list(self._batches.items()):
            again = all_again or (key in stranded and self.workforce.suited(self._need(batch)) != [NOBODY])
            if again and self._futures[key].status == "pending":
                self._start(batch)

    def _need(self, batch: Batch) -> int:
        """Bytes that a worker must have: a job that runs alone is done with the memory of the others."""
        return min(batch.memory, self.memory_limit)

    def close(self) -> None:
        self._waiting.clear()
        # After Ctrl-C the scheduler would otherwise go on with the queued jobs; a client without scheduler would wait for one.
        if self._futures and self.client.status == "running":
            with suppress(*LOST):
                self.client.cancel(list(dict.fromkeys(self._futures.values())), force=True)
        self._futures.clear()
        self._batches.clear()


def tasks_held(workers: int) -> int:
    """How many tasks the scheduler of so many workers gets at most."""
    return max(WAVE, EACH * workers)


def jobs_held(workers: int) -> int:
    """How many jobs these are at most: each takes 5 kB of the command, and tasks of many need no more than one that waits."""
    return max(4 * WAVE, 2 * MOST * workers)


def _sent(batch: Batch) -> tuple[Callable, Key | tuple[Key, ...], bytes]:
    """What a worker calls, and its first two arguments."""
    if len(batch.orders) == 1:
        return execute_sent, batch.key, dumps(batch.orders[0].work)
    own = set(batch.keys)
    return execute_batch, batch.keys, dumps([(order.work, own.intersection(order.dependencies)) for order in batch.orders])


def _is_own(batch: Batch, error: BaseException) -> bool:
    """Whether an error is of one of these jobs; Dask hands it on to all tasks that depend on it."""
    if isinstance(error, BatchFailed):
        return not error.failed.keys().isdisjoint(batch.keys)
    if isinstance(error, JobFailed):
        return error.key in batch.keys
    return not isinstance(error, KilledWorker) or cast(tuple, error.task)[:-1] == batch.key


def _ends(batch: Batch, future: Future) -> list[Finished]:
    """The end of each job of a batch, in their order."""
    if len(batch.orders) == 1:
        return [_finished(batch.key, future)]
    error = future.exception() if future.status == "error" else BatchFailed({}, ())
    assert isinstance(error, BatchFailed), error
    ends = dict.fromkeys(batch.keys, "done") | dict.fromkeys(error.untried, "blocked") | dict.fromkeys(error.failed, "failed")
    return [Finished(key, cast(End, ends[key]), error.failed.get(key, "")) for key in batch.keys]


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
