"""How much of a run is done, and how long it will still take, from what its jobs have cost so far and what others have cost.

Jobs of one function of one stage cost about the same. What is planned counts with the mean of the jobs that have ended, what is not
planned yet with what other runs took (`forecast/known_costs.py`), corrected by how fast this machine has been so far. Compiling is
told apart: the first job of a function on every worker may have to compile its kernels, which the first functions of a run show.

Costs are processor time. How much of it a second of the clock gives is measured as the run goes on, with the past forgotten
slowly, so that a machine that others use is known as such.
"""

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

from orthomill.pipeline.engine.graph import PlannedJob
from orthomill.pipeline.engine.runner import Finished
from orthomill.pipeline.forecast.known_costs import Expectations, Expected, Family, FunctionCost
from orthomill.pipeline.records.records import Key, Record
from orthomill.schemas.job import Export, Table
from orthomill.schemas.stage_report import report_table

PARALLEL = 0.9
"""Part of the time in which a worker of an idle machine has something to do: jobs that stand alone leave the others waiting"""
SETTLING, MEMORY = 20.0, 120.0
"""seconds for which PARALLEL is believed more than what is measured, and in which what was measured fades to 1/e"""
WEIGHT = 3.0
"""jobs that must have been measured before they tell more than what is expected"""
CONTENT = 0.4
"""standard deviation of the logarithm of a function's cost from block to block"""
MACHINES, SAME = 0.5, 0.15
"""the same of the speed of machines: of any, and of one whose runs are known"""
TELLING = 0.5
"""seconds of work from which on a function tells something of the machine"""
STILL = 0.1
"""share of what is left that is still left, however long the jobs that run have been running"""
GUESS = 5.0
"""seconds of compiling that must have been seen before they tell more than an empty cache"""
MEASURED_ERROR, EXPECTED_ERROR = 0.10, 0.30
"""Relative uncertainty of a remainder that rests on measured costs, and on expected ones: what recorded runs show when they are
replayed (benchmarks/watching/remaining_time.py)"""


@dataclass
class FamilyCost:
    """Jobs of one family: how many there are, and what those that have ended took."""

    planned: int = 0
    ended: int = 0
    """without those that were found unchanged, which are not planned either"""
    unchanged: int = 0
    first: dict[str, float] = field(default_factory=dict)
    """seconds of the first job of every worker, which may have compiled kernels"""
    later: int = 0
    seconds: float = 0.0
    """of the later ones"""

    def add(self, seconds: float, worker: str) -> None:
        """A job has been done in so many seconds of processor time."""
        if worker in self.first:
            self.later += 1
            self.seconds += seconds
        else:
            self.first[worker] = seconds

    @property
    def mean(self) -> float | None:
        """Seconds of a job that compiles nothing; None before one is known to be such."""
        return self.seconds / self.later if self.later else None

    @property
    def spent(self) -> float:
        return self.seconds + sum(self.first.values())

    @property
    def left(self) -> int:
        return max(self.planned - self.ended, 0)


@dataclass(frozen=True)
class Remaining:
    """What is left: seconds of work of the whole run, those that rest on expectations, and wall-clock seconds with their error."""

    done: float
    left: float
    expected: float
    seconds: float
    error: float

    @property
    def share(self) -> float:
        """The part of the work that is done, 0 to 1."""
        return self.done / (self.done + self.left) if self.done + self.left > 0 else 0.0


class CostModel:
    """Counts what the jobs of `stages` cost; `workers` share the work; `cold`: no kernel seems to be cached."""

    def __init__(
        self,
        stages: tuple[str, ...],
        workers: int,
        expectations: Expectations,
        cold: bool = False,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._workers, self._clock, self._looks_cold = max(workers, 1), clock, float(cold)
        self._expected = {family: one for family, one in expectations.of.items() if family[0] in stages}
        self._machines = SAME if expectations.here else MACHINES
        self._families: dict[Family, FamilyCost] = {}
        self._family_of: dict[Key, Family] = {}
        self._closed: set[str] = set()
        self._heard: dict[str, float] = {}
        """when a worker ended its last job"""
        self._pace = _Pace(clock())

    def planned(self, planned: PlannedJob) -> None:
        """A job has been planned."""
        job = planned.job
        function = f"export {job.format}" if isinstance(job, Export) else job.function.__name__
        # The report reads what all others write, so a stage that plans it has planned everything that costs time.
        closes = not isinstance(job, Export) and any(
            isinstance(region, Table) and region.path == report_table(job.stage).path for region in job.writes.values()
        )
        self._family_of[planned.key] = (job.stage, function)
        self.count((job.stage, function), closes)

    def count(self, family: Family, closes: bool = False) -> None:
        """There is one more job of a family; `closes`: it is the last one of its stage."""
        self._families.setdefault(family, FamilyCost()).planned += 1
        if closes:
            self._closed.add(family[0])

    def skipped(self, key: Key) -> None:
        """A job is unchanged since an earlier run and costs nothing."""
        cost = self._families[self._family_of[key]]
        cost.planned -= 1
        cost.unchanged += 1

    def finished(self, finished: Finished, record: Record | None) -> None:
        """A job has ended. What failed or was never tried says nothing of what its kind costs."""
        done = record if finished.status == "done" else None
        self.took(self._family_of[finished.key], done.cpu_seconds if done else None, done.worker if done else "")

    def took(self, family: Family, seconds: float | None, worker: str) -> None:
        """A job of a family has ended and took so much processor time; None: it was not done."""
        cost = self._families[family]
        cost.ended += 1
        if seconds is not None:
            cost.add(seconds, worker)
            self._pace.add(seconds, self._clock())
            self._heard[worker] = self._clock()

    def remaining(self) -> Remaining | None:
        """What is left; None before anything is known of what a job costs."""
        done = sum(cost.spent for cost in self._families.values())
        if not done:
            return None
        speed = self._speed()
        left = expected = 0.0
        for family in self._families.keys() | self._expected.keys():
            jobs, by_expectation = self._jobs_left(family)
            seconds = jobs * self._job_seconds(family, speed)
            left += seconds
            expected += seconds * by_expectation
        compiling = self._compiling_left(speed)
        left, expected = left + compiling, expected + compiling
        under_way = min(self._under_way(), left)
        pace = self._workers * self._pace.of_a_worker(self._clock(), self._workers, under_way)
        kept = max(1.0 - under_way / left, STILL) if left else 1.0
        done, left, expected = done + (1.0 - kept) * left, kept * left, kept * expected
        error = (MEASURED_ERROR * (left - expected) + EXPECTED_ERROR * expected) / pace
        return Remaining(done, left, expected, left / pace, error)

    def costs(self) -> dict[str, dict[str, FunctionCost]]:
        """What is to be kept for the next run: families all of whose jobs are done, by stage and function."""
        cold, kept = self._cold(self._speed()), dict[str, dict[str, FunctionCost]]()
        for (stage, function), cost in self._families.items():
            if cost.first and not cost.left:
                kept.setdefault(stage, {})[function] = self._kept((stage, function), cost, cold)
        return kept

    def _kept(self, family: Family, cost: FamilyCost, cold: float) -> FunctionCost:
        jobs = cost.planned + cost.unchanged
        if cost.mean is not None:
            return FunctionCost(jobs, round(cost.mean * jobs, 3))
        compiled = cold * len(cost.first) * (self._expected[family].compiling if family in self._expected else 0.0)
        return FunctionCost(jobs, round(max(cost.spent - compiled, cost.spent / 10) / len(cost.first) * jobs, 3))

    def _under_way(self) -> float:
        """Seconds that workers have spent on jobs that have not ended: compiling takes as long as all jobs of a function."""
        now, last = self._clock(), sorted(self._heard.values())[-self._workers :]
        # A worker that has not ended any job yet may still be loading its libraries.
        silent = sum(now - heard for heard in last)
        waiting = sum(cost.left for cost in self._families.values())
        return PARALLEL * silent * min(waiting / self._workers, 1.0)

    def _jobs_left(self, family: Family) -> tuple[float, float]:
        """(jobs left, share of their cost that is expected and not measured)."""
        cost = self._families.get(family)
        if cost and (cost.planned or cost.unchanged):
            return cost.left, WEIGHT / (WEIGHT + cost.later)
        # A stage that is planned to its end has no more functions than those that are planned.
        return (0.0, 1.0) if family[0] in self._closed else (self._expected[family].jobs, 1.0)

    def _job_seconds(self, family: Family, speed: float) -> float:
        """Seconds of a job: as expected before any is measured, and ever more as measured."""
        cost, known = self._families.get(family, FamilyCost()), self._expected.get(family)
        if known:
            return (WEIGHT * known.seconds * speed + cost.seconds) / (WEIGHT + cost.later)
        if cost.mean is not None:
            return cost.mean
        return self._usual(family[0])

    def _usual(self, stage: str) -> float:
        """Seconds of a job of which nothing is known: as those of its stage, or else as all."""
        of_stage = [cost for (name, _), cost in self._families.items() if name == stage and cost.ended]
        measured = of_stage or [cost for cost in self._families.values() if cost.ended]
        return sum(cost.spent for cost in measured) / sum(cost.ended for cost in measured)

    def _told(self) -> Iterator[tuple[FamilyCost, Expected]]:
        """Families that are measured and expected."""
        yield from ((cost, self._expected[family]) for family, cost in self._families.items() if family in self._expected)

    def _speed(self) -> float:
        """How many times as long as expected jobs take here: the mean of functions, each as good as a block is like another."""
        logarithms = [
            math.log(cost.mean / known.seconds)
            for cost, known in self._told()
            if cost.mean and known.seconds and cost.seconds >= TELLING
        ]
        return math.exp(sum(logarithms) / (len(logarithms) + (CONTENT / self._machines) ** 2))

    def _cold(self, speed: float) -> float:
        """How much of what compiling takes was taken by functions that have begun: 1 with no kernel in the cache, 0 with all."""
        found, possible = self._looks_cold * GUESS, GUESS
        for cost, known in self._told():
            if known.compiling:
                usual = cost.mean if cost.mean is not None else known.seconds * speed
                found += sum(cost.first.values()) - len(cost.first) * usual
                possible += len(cost.first) * known.compiling
        return min(max(found / possible, 0.0), 1.0)

    def _compiling_left(self, speed: float) -> float:
        cold, left = self._cold(speed), 0.0
        for family, known in self._expected.items():
            if known.compiling and (jobs := self._jobs_left(family)[0]):
                begun = len(self._families[family].first) if family in self._families else 0
                left += known.compiling * max(min(self._workers, jobs + begun) - begun, 0)
        return cold * left


class _Pace:
    """Processor time that a worker gives in a second of the clock; what is long ago counts less and less."""

    def __init__(self, now: float) -> None:
        self._now, self._work, self._time, self._believed = now, 0.0, 0.0, SETTLING

    def add(self, seconds: float, now: float) -> None:
        """So much work has been done."""
        self._fade(now)
        self._work += seconds

    def of_a_worker(self, now: float, workers: int, under_way: float) -> float:
        """`under_way`: seconds of work that have not been told yet."""
        self._fade(now)
        return ((self._work + under_way) / workers + PARALLEL * self._believed) / (self._time + self._believed)

    def _fade(self, now: float) -> None:
        passed = max(now - self._now, 0.0)
        kept = math.exp(-passed / MEMORY)
        self._work *= kept
        self._believed *= kept
        # The integral of what fades: time is forgotten as the work in it is.
        self._time = self._time * kept + MEMORY * (1 - kept)
        self._now = now
