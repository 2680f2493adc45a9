"""Which jobs are handed to a worker together.

A scheduler is busy for some milliseconds with every task, however short: two workers that do hundredths of a second keep it at
work, and a hundred that do tenths more than it can. So jobs of one kind that follow each other become one task as soon as it is
known how long they take, the longer the more workers there are. Where the scheduler has time, nothing waits for a whole batch.
"""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from orthomill.pipeline.engine.execute import JobOrder
from orthomill.pipeline.records.numbered_names import Key
from orthomill.schemas.job import Export

EACH = 0.05
"""seconds of a task for every worker: the scheduler, 5 ms a task, is at work for a tenth of the time"""
LONGEST = 5.0
"""seconds of a task at most: what is lost with a worker, and what all wait for behind the last one"""
MOST = 64
"""jobs of a task at most"""
Kind = tuple[str, object]
"""stage, and what a job calls or writes"""


@dataclass(frozen=True)
class Order:
    """A job as it is handed to a worker: what it is, what it waits for, and the bytes that it needs."""

    work: JobOrder
    dependencies: tuple[Key, ...]
    memory: int

    @property
    def key(self) -> Key:
        return self.work.job.key

    @property
    def kind(self) -> Kind:
        """Jobs of a kind take about as long as each other."""
        job = self.work.job
        return job.stage, (job.format if isinstance(job, Export) else job.function)


@dataclass(frozen=True)
class Batch:
    """Jobs that a worker does one after the other, in this order; often a single one."""

    orders: tuple[Order, ...]

    @property
    def key(self) -> Key:
        """That of the first."""
        return self.orders[0].key

    @property
    def keys(self) -> tuple[Key, ...]:
        return tuple(order.key for order in self.orders)

    @property
    def memory(self) -> int:
        """Of the greatest: memory is given back between them."""
        return max(order.memory for order in self.orders)

    @property
    def before(self) -> tuple[Key, ...]:
        """What it waits for: jobs that are not in it."""
        own = set(self.keys)
        return tuple(dict.fromkeys(key for order in self.orders for key in order.dependencies if key not in own))

    def alone(self) -> list["Batch"]:
        """Its jobs one by one."""
        return [Batch((order,)) for order in self.orders]


class BatchFailed(Exception):
    """Some jobs of a batch could not be done: sentences by key, and those that were not tried as they wait for others of it."""

    def __init__(self, failed: dict[Key, str], untried: tuple[Key, ...]) -> None:
        super().__init__(failed, untried)
        self.failed, self.untried = failed, untried


class Durations:
    """How long jobs of each kind take, learnt from those that have ended."""

    def __init__(self) -> None:
        self._mean: dict[Kind, float] = {}

    def learn(self, order: Order, seconds: float) -> None:
        """The later ones count more: the first load libraries and compile."""
        before = self._mean.get(order.kind, seconds)
        self._mean[order.kind] = 0.7 * before + 0.3 * seconds

    def of(self, order: Order) -> float | None:
        """Seconds, None where nothing is known."""
        return self._mean.get(order.kind)


def seconds_of_task(workers: int) -> float:
    """What short jobs of a task should take together."""
    return min(workers * EACH, LONGEST)


def next_batch(
    waiting: deque[Order], durations: Durations, workers: int, fits: Callable[[Order], bool], more_come: bool
) -> Batch | None:
    """Takes the first orders of `waiting` that one task is to do; those that do not fit with others stay alone.

    None where more of the kind may still come: then the batch would be larger.
    """
    first = waiting[0]
    seconds = durations.of(first)
    if seconds is None or not fits(first):
        return Batch((waiting.popleft(),))
    number = max(1, min(MOST, int(seconds_of_task(workers) / max(seconds, 1e-3))))
    if more_come and len(waiting) < number and all(order.kind == first.kind for order in waiting):
        return None
    taken = [waiting.popleft()]
    while waiting and len(taken) < number and waiting[0].kind == first.kind and fits(waiting[0]):
        taken.append(waiting.popleft())
    return Batch(tuple(taken))
