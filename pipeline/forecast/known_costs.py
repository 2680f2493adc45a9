"""What the jobs of other runs have cost, function by function, and what those of a project may therefore be expected to cost.

Processor time, not time of day: what a run tells the next one must not depend on who else used the machine. Every run leaves its
costs in its folder. A project expects what its own last run took; before that what other runs of this machine and the blocks
measured at release took, for as many pixels.
"""

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from statistics import fmean

from pydantic import TypeAdapter, ValidationError

from orthomill.pipeline.storage.table_files import write_whole

COSTS = "jobs/costs.json"
"""in the folder of a run"""
FEW = 2
"""Functions with no more jobs than this work on the whole block: their time grows with its pixels, their number does not."""

Family = tuple[str, str]
"""(stage, function) of jobs that cost about the same"""


@dataclass(frozen=True)
class FunctionCost:
    """How many jobs a function had in a run, and their processor time in all, s, with its kernels compiled before."""

    jobs: int
    seconds: float


@dataclass(frozen=True)
class RunCosts:
    """What one run took, by stage and function, for so many `megapixels` of photographs in tiles of `tile` px."""

    megapixels: float
    tile: int
    stages: dict[str, dict[str, FunctionCost]]


@dataclass(frozen=True)
class Expected:
    """What is expected of a function: jobs, seconds of one of them, and seconds that a worker compiles before its first one."""

    jobs: float
    seconds: float
    compiling: float = 0.0


@dataclass(frozen=True)
class Expectations:
    """By function; `here`: whether they rest on runs of this machine, so that its speed is known."""

    of: Mapping[Family, Expected]
    here: bool


_RUN = TypeAdapter(RunCosts)


@cache
def measured_at_release() -> tuple[dict[str, RunCosts], dict[Family, float]]:
    """Costs of the blocks measured at release by name, and the seconds that a worker compiles, by function."""
    shipped = json.loads((Path(__file__).parent / "costs.json").read_text())
    runs = {name: _RUN.validate_python(run) for name, run in shipped["runs"].items()}
    return runs, {(stage, name): s for stage, names in shipped["compiling"].items() for name, s in names.items()}


def read_costs(folder: Path) -> RunCosts | None:
    """What a run has left; None when it has left nothing that this version can read."""
    try:
        return _RUN.validate_json((folder / COSTS).read_bytes())
    except (FileNotFoundError, ValidationError):
        return None


def write_costs(folder: Path, costs: RunCosts) -> None:
    """Keep what a run took; of functions that it did not do, what an earlier one took. Raises StoreError when the disk refuses."""
    before = read_costs(folder)
    # Costs for other pixels or tiles cannot stand beside these.
    if before and (before.megapixels, before.tile) == (costs.megapixels, costs.tile):
        stages = {stage: before.stages.get(stage, {}) | costs.stages.get(stage, {}) for stage in before.stages | costs.stages}
        costs = RunCosts(costs.megapixels, costs.tile, stages)
    write_whole(folder / COSTS, _RUN.dump_json(costs, indent=1))


def expectations(folder: Path, megapixels: float, tile: int) -> Expectations:
    """What a project whose results are in `folder` may expect, from its last run, or else from all others that are known."""
    own = read_costs(folder)
    others = [costs for other in sorted(folder.parent.glob("*")) if other != folder and (costs := read_costs(other))]
    released, compiling = measured_at_release()
    expected = expected_costs([*others, *released.values()], compiling, megapixels, tile)
    if own:
        # Functions that its last run did not get to are expected as if there had been none.
        expected |= expected_costs([own], compiling, megapixels, tile)
    return Expectations(expected, here=bool(own or others))


def expected_costs(
    runs: Iterable[RunCosts], compiling: Mapping[Family, float], megapixels: float, tile: int
) -> dict[Family, Expected]:
    """The mean of runs, each reduced to these pixels and tiles; of every stage only the runs that had it."""
    known = tuple(runs)
    families = {(stage, name) for run in known for stage, names in run.stages.items() for name in names}
    return {
        family: _mean([run for run in known if family[0] in run.stages], family, megapixels, tile, compiling.get(family, 0.0))
        for family in sorted(families)
    }


def _mean(runs: list[RunCosts], family: Family, megapixels: float, tile: int, compiling: float) -> Expected:
    stage, name = family
    # A function that a run did not have had no jobs there; it does not tell what a job costs.
    costs = [(run, run.stages[stage].get(name, FunctionCost(0, 0.0))) for run in runs]
    had = [(run, cost) for run, cost in costs if cost.jobs]
    pixels = {id(run): megapixels / run.megapixels if megapixels else 1.0 for run in runs}
    if all(cost.jobs <= FEW for _, cost in had):
        seconds = fmean(cost.seconds / cost.jobs * pixels[id(run)] for run, cost in had)
        return Expected(fmean(cost.jobs for _, cost in costs), seconds, compiling)
    area = {id(run): (tile / run.tile) ** 2 for run in runs}
    jobs = fmean(cost.jobs * pixels[id(run)] / area[id(run)] for run, cost in costs)
    return Expected(jobs, fmean(cost.seconds / cost.jobs * area[id(run)] for run, cost in had), compiling)
