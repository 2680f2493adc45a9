"""The interface of a runner, and the sequential one: no processes, no network, the reference for all others."""

from collections import deque
from dataclasses import dataclass
from typing import Literal, Protocol

from orthomill.pipeline.engine.execute import JobFailed, JobOrder, execute
from orthomill.pipeline.records.numbered_names import Key
from orthomill.schemas.errors import ResourceError

ATTEMPTS = 2
"""A failed job is tried once more: the disk may have been full for a moment, or the worker may have been killed."""


End = Literal["done", "failed", "blocked"]


class SchedulerLost(ResourceError):
    """What hands jobs to workers has gone, and with it all that had not ended; another runner can go on."""


@dataclass(frozen=True)
class Finished:
    """The end of one job. "blocked" jobs were never tried, because a job that they depend on failed."""

    key: Key
    status: End
    sentence: str = ""


class Runner(Protocol):
    """Runs jobs in any order that their dependencies allow."""

    memory_limit: int
    """bytes that one worker may use"""
    room: int
    """bytes that a job may use that runs alone"""
    description: str
    dashboard: str
    """address of its page; empty where there is none"""

    def submit(self, work: JobOrder, dependencies: tuple[Key, ...], memory: int) -> None:
        """Accept a job; `dependencies` are keys of jobs submitted before. One that has failed may be submitted again."""

    def next(self) -> Finished:
        """Wait for any job to end."""

    def learn(self, key: Key, seconds: float) -> None:
        """A job that was done took so long: what follows of its kind will take as long."""

    @property
    def busy(self) -> bool:
        """Whether submitted jobs are unfinished."""

    @property
    def has_ended(self) -> bool:
        """Whether a job has ended of which `next` has not told."""

    @property
    def wants_more(self) -> bool:
        """Whether it has a use for more jobs now. What it does not want costs less room where it is."""

    def close(self) -> None:
        """Drop what has not started and free everything."""


class SequentialRunner:
    """One job after another in this process."""

    description = "one job after another in this process"
    dashboard = ""

    def __init__(self, memory_limit: int, room: int = 0) -> None:
        self.memory_limit = memory_limit
        self.room = max(memory_limit, room)
        self._waiting: deque[tuple[JobOrder, tuple[Key, ...]]] = deque()
        self._unusable: set[Key] = set()

    def submit(self, work: JobOrder, dependencies: tuple[Key, ...], memory: int) -> None:
        self._unusable.discard(work.job.key)
        self._waiting.append((work, dependencies))

    @property
    def busy(self) -> bool:
        return bool(self._waiting)

    @property
    def has_ended(self) -> bool:
        return False

    @property
    def wants_more(self) -> bool:
        return not self._waiting

    def next(self) -> Finished:
        work, dependencies = self._waiting.popleft()
        key = work.job.key
        # Jobs are submitted in an order in which they can run, so that every dependency has been tried by now.
        if self._unusable.intersection(dependencies):
            self._unusable.add(key)
            return Finished(key, "blocked")
        # As often as on Dask, so that both runners end a run in the same state.
        for attempt in range(ATTEMPTS):
            try:
                execute(work)
                return Finished(key, "done")
            except JobFailed as failure:
                if attempt + 1 == ATTEMPTS:
                    self._unusable.add(key)
                    return Finished(key, "failed", failure.sentence)
        raise AssertionError("unreachable")

    def learn(self, key: Key, seconds: float) -> None:
        """There is nothing to choose."""

    def close(self) -> None:
        self._waiting.clear()
