"""How much of a run is done, and how long it will still take, from what its jobs have cost so far and what others have cost.

Jobs of one function of one stage cost about the same for the same data, which their effort tells. What is planned counts with the
mean of the jobs that have ended, what is not planned yet with what other runs took (`forecast/known_costs.py`), corrected by how
fast this machine has been so far and, as soon as a stage has announced its rasters, by how large they are. Compiling is told
apart: the first job of a function on every worker may have to compile its kernels, which the first functions of a run show.

Costs are processor time. How much of it a second of the clock gives is measured as the run goes on, with the past forgotten
slowly, so that a machine that others use is known as such.
"""

import math
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import islice
from types import MappingProxyType

from orthomill.pipeline.engine.planned.planned_jobs import PlannedJob
from orthomill.pipeline.engine.runner import Finished
from orthomill.pipeline.forecast.known_costs import (
    MARGIN,
    Expectations,
    Expected,
    Family,
    FunctionCost,
    effort_of,
    family_of,
    largest_grids,
)
from orthomill.pipeline.records.numbered_names import Key
from orthomill.pipeline.records.records import Record
from orthomill.pipeline.watching.job_efforts import JobEfforts
from orthomill.schemas.job import Export, Table
from orthomill.schemas.raster import RasterSpec
from orthomill.schemas.stage_report import report_table

NO_RASTERS: Mapping[str, RasterSpec] = MappingProxyType({})
PARALLEL = 0.9
"""Part of the time in which a worker of an idle machine has something to do: jobs that stand alone leave the others waiting"""
SETTLING, MEMORY = 20.0, 120.0
"""seconds for which PARALLEL is believed more than what is measured, and in which what was measured fades to 1/e"""
WEIGHT = 3.0
"""jobs that must have been measured before they tell more than what is expected"""
CONTENT = 1.0
"""standard deviation of the logarithm of a function's cost from block to block; more than that of one function alone (0.4), for all
functions of a block with rich texture or large overlap take longer together"""
MACHINES, SAME = 0.5, 0.15
"""the same of the speed of machines: of any, and of one whose runs are known"""
TELLING = 0.5
"""seconds of work from which on a function tells something of the machine"""
STILL = 0.1
"""share of what is left that is still left, however long the jobs that run have been running"""
GUESS = 5.0
"""seconds of compiling that must have been seen before they tell more than an empty cache"""
MEASURED_ERROR, EXPECTED_ERROR, UNPLANNED_ERROR = 0.12, 0.40, MARGIN - 1.0
"""Relative uncertainty of a remainder that rests on measured costs, on expected ones of jobs or rasters that are known, and on what
other blocks took: what recorded runs show when they are replayed (benchmarks/watching/remaining_time.py); the last is that of
`orthomill plan`"""


@dataclass
class FamilyCost:
    """Jobs of one family: how many there are with their effort, and what those that have ended took."""

    planned: int = 0
    ended: int = 0
    """without those that were found unchanged, which are not planned either"""
    unchanged: int = 0
    planned_effort: float = 0.0
    ended_effort: float = 0.0
    unchanged_effort: float = 0.0
    first: dict[str, tuple[float, float]] = field(default_factory=dict)
    """(seconds, effort) of the first job of every worker, which may have compiled kernels"""
    later: int = 0
    seconds: float = 0.0
    effort: float = 0.0
    """of the later ones"""

    def add(self, seconds: float, worker: str, effort: float = 1.0) -> None:
        """A job has been done in so many seconds of processor time."""
        if worker in self.first:
            self.later += 1
            self.seconds += seconds
            self.effort += effort
        else:
            self.first[worker] = seconds, effort

    @property
    def mean(self) -> float | None:
        """Seconds of a unit of effort in jobs that compile nothing; None before one is known to be such."""
        return self.seconds / self.effort if self.later else None

    @property
    def spent(self) -> float:
        """Processor time of the jobs that were done, s."""
        return self.seconds + self.spent_first

    @property
    def spent_first(self) -> float:
        """Processor time of the workers' first jobs, s."""
        return sum(seconds for seconds, _ in self.first.values())

    @property
    def first_effort(self) -> float:
        """Effort of the workers' first jobs."""
        return sum(effort for _, effort in self.first.values())

    @property
    def left(self) -> int:
        """Planned jobs that have not ended."""
        return max(self.planned - self.ended, 0)

    @property
    def effort_left(self) -> float:
        """Effort of the planned jobs that have not ended."""
        # Sums of the same numbers in another order differ in their last digits.
        return max(self.planned_effort - self.ended_effort, 0.0) if self.left else 0.0

    @property
    def usual_effort(self) -> float:
        """Of a job."""
        jobs = self.planned + self.unchanged
        return (self.planned_effort + self.unchanged_effort) / jobs if jobs else 1.0


@dataclass(frozen=True)
class Remaining:
    """What is left: seconds of work of the whole run, those that rest on expectations, and wall-clock seconds with their error."""

    done: float
    left: float
    expected: float
    seconds: float
    error: float
    told: float = 0.0
    """share that was shown before"""

    @property
    def share(self) -> float:
        """The part of the work that is surely done, 0 to 1: what is left counts with its error, and no share that was shown falls.

        Where a stage turns out larger than was foreseen the time grows and the share waits.
        """
        left = self.left * (1.0 + (self.error / self.seconds if self.seconds else 0.0))
        return max(self.done / (self.done + left) if self.done + left > 0 else 0.0, self.told)

    @property
    def range(self) -> tuple[float, float]:
        """Seconds from and to: as many times less as more, for nothing takes less than no time."""
        return self.seconds**2 / (self.seconds + self.error) if self.seconds else 0.0, self.seconds + self.error


class CostModel:
    """Counts what the jobs of `stages` cost; `workers` share the work; `cold`: no kernel seems to be cached; `specs`: the rasters
    that have been announced, as a mapping that grows."""

    def __init__(
        self,
        stages: tuple[str, ...],
        workers: int,
        expectations: Expectations,
        cold: bool = False,
        clock: Callable[[], float] = time.monotonic,
        specs: Mapping[str, RasterSpec] = NO_RASTERS,
    ) -> None:
        self._workers, self._clock, self._looks_cold = max(workers, 1), clock, float(cold)
        self._expected = {family: one for family, one in expectations.of.items() if family[0] in stages}
        self._machines = SAME if expectations.here else MACHINES
        self._families: dict[Family, FamilyCost] = {}
        self._known = JobEfforts()
        self._specs, self._seen = specs, 0
        """rasters that have been announced, and how many of them have been looked at"""
        self._grids: dict[str, float] = {}
        self._expected_grids = expectations.grids
        self._closed: set[str] = set()
        self._heard: dict[str, float] = {}
        """when a worker ended its last job"""
        self._least = 0.0
        self._pace = _Pace(clock())

    def planned(self, planned: PlannedJob) -> None:
        """A job has been planned."""
        job = planned.job
        # The report reads what all others write, so a stage that plans it has planned everything that costs time.
        closes = not isinstance(job, Export) and any(
            isinstance(region, Table) and region.path == report_table(job.stage).path for region in job.writes.values()
        )
        family, effort = family_of(planned), effort_of(planned)
        self._known.add(planned.key, family, effort)
        self.count(family, effort, closes)
        if len(self._specs) > self._seen:
            for stage, grid in largest_grids(islice(self._specs.values(), self._seen, None)).items():
                self.laid_out(stage, grid)
            self._seen = len(self._specs)

    def laid_out(self, stage: str, megapixels: float) -> None:
        """A stage has announced a raster."""
        self._grids[stage] = max(self._grids.get(stage, 0.0), megapixels)

    def count(self, family: Family, effort: float = 1.0, closes: bool = False) -> None:
        """There is one more job of a family; `closes`: it is the last one of its stage."""
        cost = self._families.setdefault(family, FamilyCost())
        cost.planned += 1
        cost.planned_effort += effort
        if closes:
            self._closed.add(family[0])

    def skipped(self, key: Key) -> None:
        """A job is unchanged since an earlier run and costs nothing."""
        family, effort = self._known[key]
        cost = self._families[family]
        cost.planned -= 1
        cost.unchanged += 1
        cost.planned_effort -= effort
        cost.unchanged_effort += effort

    def finished(self, finished: Finished, record: Record | None) -> None:
        """A job has ended. What failed or was never tried says nothing of what its kind costs."""
        done = record if finished.status == "done" else None
        family, effort = self._known[finished.key]
        if done:
            self.took(family, done.cpu_seconds, done.worker, effort, done.seconds)
        else:
            self.took(family, None, "", effort)

    def took(self, family: Family, seconds: float | None, worker: str, effort: float = 1.0, wall: float | None = None) -> None:
        """A job of a family has ended and took so much processor time (None: it was not done) in so many seconds of the clock, as
        many where they are not known."""
        cost = self._families[family]
        cost.ended += 1
        cost.ended_effort += effort
        if seconds is not None:
            cost.add(seconds, worker, effort)
            self._pace.add(seconds, seconds if wall is None else wall, self._clock())
            self._heard[worker] = self._clock()

    def remaining(self) -> Remaining | None:
        """What is left; None before anything is known of what a job costs."""
        done = sum(cost.spent for cost in self._families.values())
        if not done:
            return None
        speed = self._speed()
        left = expected = error = 0.0
        for family in self._families.keys() | self._expected.keys():
            effort, by_expectation, uncertain = self._effort_left(family)
            seconds = effort * self._unit_seconds(family, speed)
            left += seconds
            expected += seconds * by_expectation
            error += seconds * (MEASURED_ERROR * (1.0 - by_expectation) + uncertain * by_expectation)
        compiling = self._compiling_left(speed)
        left, expected, error = left + compiling, expected + compiling, error + EXPECTED_ERROR * compiling
        under_way = min(self._under_way(), left)
        pace = self._workers * self._pace.of_a_worker()
        kept = max(1.0 - under_way / left, STILL) if left else 1.0
        return Remaining(
            done + (1.0 - kept) * left, kept * left, kept * expected, kept * left / pace, kept * error / pace, self._least
        )

    def shown(self) -> Remaining | None:
        """What is left, for people: from now on no share is below this one."""
        left = self.remaining()
        if left:
            self._least = left.share
        return left

    def costs(self) -> dict[str, dict[str, FunctionCost]]:
        """What is to be kept for the next run: families all of whose jobs are done, by stage and function."""
        cold, kept = self._cold(self._speed()), dict[str, dict[str, FunctionCost]]()
        for (stage, function), cost in self._families.items():
            if cost.first and not cost.left:
                kept.setdefault(stage, {})[function] = self._kept((stage, function), cost, cold)
        return kept

    @property
    def grids(self) -> dict[str, float]:
        """Megapixels of the largest raster of every stage, to be kept with them."""
        return {stage: round(grid, 3) for stage, grid in self._grids.items()}

    def _kept(self, family: Family, cost: FamilyCost, cold: float) -> FunctionCost:
        jobs, effort = cost.planned + cost.unchanged, cost.planned_effort + cost.unchanged_effort
        if cost.mean is not None:
            return FunctionCost(jobs, round(cost.mean * effort, 3), round(effort, 3))
        compiled = cold * len(cost.first) * (self._expected[family].compiling if family in self._expected else 0.0)
        seconds = max(cost.spent - compiled, cost.spent / 10) / cost.first_effort * effort
        return FunctionCost(jobs, round(seconds, 3), round(effort, 3))

    def _under_way(self) -> float:
        """Seconds that workers have spent on jobs that have not ended: compiling takes as long as all jobs of a function."""
        now, last = self._clock(), sorted(self._heard.values())[-self._workers :]
        # A worker that has not ended any job yet may still be loading its libraries.
        silent = sum(now - heard for heard in last)
        waiting = sum(cost.left for cost in self._families.values())
        return PARALLEL * silent * min(waiting / self._workers, 1.0)

    def _effort_left(self, family: Family) -> tuple[float, float, float]:
        """(effort left, share of its cost that is expected and not measured, relative uncertainty of that share)."""
        cost = self._families.get(family)
        if cost and (cost.planned or cost.unchanged):
            return cost.effort_left, WEIGHT / (WEIGHT + cost.later), EXPECTED_ERROR
        # A stage that is planned to its end has no more functions than those that are planned.
        if family[0] in self._closed:
            return 0.0, 1.0, 0.0
        known = self._expected[family].effort
        if family[0] in self._grids and self._expected_grids.get(family[0]):
            return known * self._grids[family[0]] / self._expected_grids[family[0]], 1.0, EXPECTED_ERROR
        return known, 1.0, UNPLANNED_ERROR

    def _jobs_to_come(self, family: Family) -> float:
        """Jobs left, known or expected."""
        cost = self._families.get(family)
        if cost and (cost.planned or cost.unchanged):
            return cost.left
        return 0.0 if family[0] in self._closed else self._expected[family].jobs

    def _unit_seconds(self, family: Family, speed: float) -> float:
        """Seconds of a unit of effort: as expected before any is measured, and ever more as measured."""
        cost, known = self._families.get(family, FamilyCost()), self._expected.get(family)
        if known:
            believed = WEIGHT * cost.usual_effort
            return (believed * known.seconds * speed + cost.seconds) / (believed + cost.effort)
        if cost.mean is not None:
            return cost.mean
        return self._usual(family[0]) / cost.usual_effort

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
                found += cost.spent_first - cost.first_effort * usual
                possible += len(cost.first) * known.compiling
        return min(max(found / possible, 0.0), 1.0)

    def _compiling_left(self, speed: float) -> float:
        cold, left = self._cold(speed), 0.0
        for family, known in self._expected.items():
            if known.compiling and (jobs := self._jobs_to_come(family)):
                begun = len(self._families[family].first) if family in self._families else 0
                left += known.compiling * max(min(self._workers, jobs + begun) - begun, 0)
        return cold * left


class _Pace:
    """Processor time that a worker gets in a second of the clock while it works; what is long ago counts less and less."""

    def __init__(self, now: float) -> None:
        self._now, self._work, self._time, self._believed = now, 0.0, 0.0, SETTLING

    def add(self, seconds: float, took: float, now: float) -> None:
        """So many seconds of processor time have been given in so many of the clock."""
        kept = math.exp(-max(now - self._now, 0.0) / MEMORY)
        self._work, self._time, self._believed = self._work * kept + seconds, self._time * kept + took, self._believed * kept
        self._now = now

    def of_a_worker(self) -> float:
        """As long as nothing is known, that of an idle machine."""
        return PARALLEL * (self._work + self._believed) / (self._time + self._believed)
