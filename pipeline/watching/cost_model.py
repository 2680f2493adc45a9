"""How much of a run is done, and how long it will still take, from what its jobs have cost so far.

Jobs of one function of one stage cost about the same: their number times the mean of those that have ended is what they will cost.
The slowest ones are left out of the mean, one for each worker, because the first job of a worker loads or compiles its kernels.
Stages that are not planned yet, or have nothing measured, count with their usual share of a run: the stages that are known say how
many seconds a share is worth on this machine and this project.
"""

import heapq
from collections.abc import Mapping
from dataclasses import dataclass, field

from orthomill.pipeline.engine.graph import PlannedJob
from orthomill.pipeline.engine.runner import Finished
from orthomill.pipeline.records.records import Key
from orthomill.schemas.job import Export, Table
from orthomill.schemas.stage_report import report_table

PARALLEL = 0.9
"""Part of the time in which a worker has something to do: stages end one job after another, and some jobs stand alone"""
MOSTLY = 0.8
"""Share of a stage's jobs whose cost must be measured before it tells what the others cost"""
MEASURED_ERROR, USUAL_ERROR = 0.15, 0.5
"""Relative uncertainty of a remainder that rests on measured costs, and on usual shares: the largest seen when recorded runs were
replayed (benchmarks/remaining_time.py)"""

Family = tuple[str, str]
"""(stage, function) of jobs that cost about the same"""


@dataclass
class FamilyCost:
    """Jobs of one family: how many, and what those that have ended took."""

    planned: int = 0
    ended: int = 0
    measured: int = 0
    seconds: float = 0.0
    slowest: list[float] = field(default_factory=list)
    """heap of the largest times, as many as there are workers"""

    def add(self, seconds: float, workers: int) -> None:
        """A job has been done in so many seconds."""
        self.measured += 1
        self.seconds += seconds
        if len(self.slowest) < workers:
            heapq.heappush(self.slowest, seconds)
        else:
            heapq.heappushpop(self.slowest, seconds)

    @property
    def mean(self) -> float | None:
        """Seconds of a job without the slowest; None before one is left: the first jobs of workers may compile kernels."""
        usual = self.measured - len(self.slowest)
        return (self.seconds - sum(self.slowest)) / usual if usual > 0 else None

    @property
    def usual(self) -> float:
        """What the jobs that have ended would have taken with all kernels compiled, s."""
        return self.seconds if self.mean is None else self.measured * self.mean

    @property
    def left(self) -> int:
        return max(self.planned - self.ended, 0)


@dataclass(frozen=True)
class Remaining:
    """What is left: seconds of work of the whole run, those that rest on usual shares, and wall-clock seconds with their error."""

    done: float
    left: float
    by_share: float
    seconds: float
    error: float

    @property
    def share(self) -> float:
        """The part of the work that is done, 0 to 1."""
        return self.done / (self.done + self.left) if self.done + self.left > 0 else 0.0


class CostModel:
    """Counts what jobs cost. `usual` is every stage's usual share of a run, in any unit; `workers` share the work."""

    def __init__(self, usual: Mapping[str, float], workers: int) -> None:
        self.usual, self.workers = dict(usual), max(workers, 1)
        self._families: dict[Family, FamilyCost] = {}
        self._family_of: dict[Key, Family] = {}
        self._closed: set[str] = set()
        self._unchanged: set[str] = set()

    def planned(self, planned: PlannedJob) -> None:
        """A job has been planned."""
        job = planned.job
        function = f"export {job.format}" if isinstance(job, Export) else job.function.__name__
        family = (job.stage, function)
        self._family_of[planned.key] = family
        self._families.setdefault(family, FamilyCost()).planned += 1
        # The report reads what all others write, so a stage that plans it has planned everything that costs time.
        if not isinstance(job, Export) and any(
            isinstance(region, Table) and region.path == report_table(job.stage).path for region in job.writes.values()
        ):
            self._closed.add(job.stage)

    def skipped(self, key: Key) -> None:
        """A job is unchanged since an earlier run and costs nothing."""
        family = self._family_of[key]
        self._families[family].planned -= 1
        self._unchanged.add(family[0])

    def finished(self, finished: Finished, seconds: float) -> None:
        """A job has ended. What failed or was never tried says nothing of what its kind costs."""
        cost = self._families[self._family_of[finished.key]]
        cost.ended += 1
        if finished.status == "done":
            cost.add(seconds, self.workers)

    def remaining(self) -> Remaining | None:
        """What is left; None before anything is known of what a job costs."""
        stages = {kind: self._stage(kind) for kind in self.usual}
        worth = self._worth(stages)
        if worth is None:
            return None
        left = by_share = 0.0
        for kind, stage in stages.items():
            if stage.known:
                left += stage.left
                continue
            # What is measured of a stage is a lower bound of it, and its usual share tells the rest.
            guessed = max(self.usual[kind] * worth - stage.done, stage.left) if kind not in self._unchanged else stage.left
            left += guessed
            by_share += guessed - stage.left
        speed = max(PARALLEL * self.workers, 1.0)
        error = (MEASURED_ERROR * (left - by_share) + USUAL_ERROR * by_share) / speed
        return Remaining(sum(stage.done for stage in stages.values()), left, by_share, left / speed, error)

    def _worth(self, stages: Mapping[str, "_StageCost"]) -> float | None:
        """Seconds of work for a unit of the usual shares; None before anything is measured."""
        begun = [kind for kind, stage in stages.items() if stage.done and kind not in self._unchanged]
        # Before any stage is known as a whole, one of which most kinds of jobs are measured stands for it.
        mostly = [kind for kind in begun if stages[kind].left and stages[kind].measured >= MOSTLY]
        known = [kind for kind in begun if stages[kind].known] or mostly
        usual = sum(self.usual[kind] for kind in known)
        return sum(stages[kind].whole for kind in known) / usual if usual > 0 else None

    def _stage(self, kind: str) -> "_StageCost":
        families = [cost for (stage, _), cost in self._families.items() if stage == kind]
        unmeasured = [cost for cost in families if cost.left and cost.mean is None]
        done = sum(cost.usual for cost in families)
        left = sum(cost.left * (cost.mean or 0.0) for cost in families)
        planned = sum(cost.planned for cost in families)
        measured = 1.0 - sum(cost.left for cost in unmeasured) / planned if planned else 0.0
        return _StageCost(done, left, measured, known=bool(families) and kind in self._closed and not unmeasured)


@dataclass(frozen=True)
class _StageCost:
    done: float
    left: float
    measured: float
    """share of its planned jobs whose kind is measured"""
    known: bool
    """whether all its jobs are planned, and the cost of all of their kinds is measured"""

    @property
    def whole(self) -> float:
        return self.done + self.left
