"""What the jobs of other runs have cost, function by function, and what those of a project may therefore be expected to cost.

Processor time, not time of day: what a run tells the next one must not depend on who else used the machine. Every run leaves its
costs in its folder. A project expects what its own last run took; before that what other runs of this machine and the blocks
measured at release took, for as many pixels.
"""

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cache
from math import inf, sqrt
from pathlib import Path
from statistics import fmean, geometric_mean

from pydantic import TypeAdapter, ValidationError

from orthomill.pipeline.engine.planned.planned_jobs import PlannedJob
from orthomill.pipeline.storage.whole_files import write_whole
from orthomill.schemas.job import Export
from orthomill.schemas.raster import RasterSpec

COSTS = "jobs/costs.json"
"""in the folder of a run"""
MARGIN = 2.2
"""How much more than the most demanding block known another one may take: so that each of four blocks lies within the bound from
the other three."""
ANOTHER = 2.0
"""Ratio of their rasters from which a run is of another area."""
EXPORT = "export "
"""how the name of a function begins that writes a file"""
LEAST = 1e-4
"""s: what takes no time that could be measured"""
FEW = 2
"""Functions with no more jobs than this work on the whole block: their time grows with its pixels, their number does not."""

Family = tuple[str, str]
"""(stage, function) of jobs that cost about the same for the same data"""


@dataclass(frozen=True)
class FunctionCost:
    """How many jobs a function had in a run, their processor time in all, s, with its kernels compiled before, and their effort."""

    jobs: int
    seconds: float
    effort: float


@dataclass(frozen=True)
class RunCosts:
    """What one run took, by stage and function, for so many `megapixels` of photographs in tiles of `tile` px.

    `grids`: megapixels of the largest raster of every stage.
    """

    megapixels: float
    tile: int
    stages: dict[str, dict[str, FunctionCost]]
    grids: dict[str, float]


@dataclass(frozen=True)
class Expected:
    """What is expected of a function: the effort of all its jobs, seconds of a unit of it, seconds that a worker compiles before
    its first job, and jobs."""

    effort: float
    seconds: float
    compiling: float = 0.0
    jobs: float = inf


@dataclass(frozen=True)
class Expectations:
    """By function; `here`: whether they rest on runs of this machine, so that its speed is known; `grids`: as in `RunCosts`."""

    of: Mapping[Family, Expected]
    here: bool
    grids: Mapping[str, float] = field(default_factory=dict)


def effort_of(planned: PlannedJob) -> float:
    """The effort of a job, by which jobs of one function compare: of exports the megabytes that they write. Other jobs take the
    longer the more they read and write, but less than in proportion: the root of the megabytes."""
    # Tables are not counted: a job without rasters is as good as any other of its function.
    megabytes = max(planned.data_bytes / 1e6, 1.0)
    return megabytes if isinstance(planned.job, Export) else sqrt(megabytes)


def family_of(planned: PlannedJob) -> Family:
    """What a job does. Exports by what they write: a file of heights with all that belongs to them takes longer than a picture.
    Parts and sheets of a large file compare with whole ones."""
    job = planned.job
    if isinstance(job, Export):
        return job.stage, EXPORT + " ".join((job.format.removesuffix(" part").removesuffix(" sheet"), *job.rasters))
    return job.stage, job.function.__name__


def largest_grids(specs: Iterable[RasterSpec]) -> dict[str, float]:
    """Megapixels of the largest raster of every stage."""
    grids: dict[str, float] = {}
    for spec in specs:
        # By convention the name of a raster begins with the stage that writes it.
        stage = spec.name.partition("/")[0]
        grids[stage] = max(grids.get(stage, 0.0), spec.shape[0] * spec.shape[1] / 1e6)
    return grids


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
    # A file that lies among the folders of runs is none of them.
    except (FileNotFoundError, NotADirectoryError, ValidationError):
        return None


def write_costs(folder: Path, costs: RunCosts) -> None:
    """Keep what a run took; of functions that it did not do, what an earlier one took. Raises StoreError when the disk refuses."""
    before = read_costs(folder)
    # Costs for other pixels, tiles or areas cannot stand beside these.
    if before and (before.megapixels, before.tile) == (costs.megapixels, costs.tile) and _of_one_area(before.grids, costs.grids):
        stages = {stage: before.stages.get(stage, {}) | costs.stages.get(stage, {}) for stage in before.stages | costs.stages}
        costs = RunCosts(costs.megapixels, costs.tile, stages, before.grids | costs.grids)
    write_whole(folder / COSTS, _RUN.dump_json(costs, indent=1))


def _of_one_area(before: Mapping[str, float], after: Mapping[str, float]) -> bool:
    """Whether two runs made rasters of about the same sizes: one of them may have tried a small part of the ground."""
    return all(
        grid <= ANOTHER * before[stage] and before[stage] <= ANOTHER * grid for stage, grid in after.items() if stage in before
    )


def expectations(folder: Path, megapixels: float, tile: int) -> Expectations:
    """What a project whose results are in `folder` may expect, from its last run, or else from all others that are known."""
    own = read_costs(folder)
    others = [costs for other in sorted(folder.parent.glob("*")) if other != folder and (costs := read_costs(other))]
    released, compiling = measured_at_release()
    return expected_from(own, [*others, *released.values()], compiling, megapixels, tile, here=bool(own or others))


def expected_from(
    own: RunCosts | None, others: Iterable[RunCosts], compiling: Mapping[Family, float], megapixels: float, tile: int, here: bool
) -> Expectations:
    """From what a project's last run took, and of functions that it did not get to, from other runs."""
    known = tuple(others)
    found, grids = expected_costs(known, compiling, megapixels, tile), expected_grids(known, megapixels)
    if own:
        found |= expected_costs([own], compiling, megapixels, tile)
        grids |= expected_grids([own], megapixels)
    return Expectations(found, here, grids)


def expected_grids(runs: Iterable[RunCosts], megapixels: float) -> dict[str, float]:
    """The largest raster of every stage, in megapixels, for photographs of so many: the mean of runs."""
    found: dict[str, list[float]] = {}
    for run in runs:
        for stage, grid in run.grids.items():
            found.setdefault(stage, []).append(grid * _ratio(run, megapixels))
    return {stage: fmean(grids) for stage, grids in found.items()}


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


def _ratio(run: RunCosts, megapixels: float) -> float:
    return megapixels / run.megapixels if megapixels else 1.0


def _mean(runs: list[RunCosts], family: Family, megapixels: float, tile: int, compiling: float) -> Expected:
    stage, name = family
    had = [(run, cost) for run in runs if (cost := run.stages[stage].get(name)) and cost.jobs]
    whole = all(cost.jobs <= FEW for _, cost in had)
    reduced = _of_files if name.startswith(EXPORT) else _of_the_whole if whole else _of_tiles
    here = [reduced(cost, _ratio(run, megapixels), (tile / run.tile) ** 2) for run, cost in had]
    # A function that a run did not have had no jobs there; it does not tell what a job costs.
    jobs, effort = (sum(row[place] for row in here) / len(runs) for place in (0, 2))
    return Expected(effort, geometric_mean([max(seconds, LEAST) / done for _, seconds, done in here]), compiling, jobs)


# What a function would take for so many times the pixels, in tiles of so many times the area: (jobs, seconds, effort).


def _of_tiles(cost: FunctionCost, pixels: float, area: float) -> tuple[float, float, float]:
    # A tile of four times the area has four times the data, and twice the effort.
    return cost.jobs * pixels / area, cost.seconds * pixels, cost.effort * pixels / sqrt(area)


def _of_the_whole(cost: FunctionCost, pixels: float, area: float) -> tuple[float, float, float]:
    return cost.jobs, cost.seconds * pixels, cost.effort * sqrt(pixels)


def _of_files(cost: FunctionCost, pixels: float, area: float) -> tuple[float, float, float]:
    return cost.jobs, cost.seconds * pixels, cost.effort * pixels
