"""Projects and clusters that nobody can try here: how long, how many requests, what breaks first.

python -m benchmarks large_projects -- PROJECT

The jobs of a finished run (their processor time, the objects and bytes that they read and write, what they wait for) are repeated
to the size of a project and played on clusters by a simulation. What the engine costs for a job is that of engine_cost.md.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.instrument.result_page import write_page
from benchmarks.scale.recorded_layout import JOINING, MORE_EACH, Layout, enlarged, layout_of
from benchmarks.scale.simulated_cluster import Cluster, Jobs, Outcome, simulated
from orthomill.pipeline.engine.dask_runner import tasks_held
from orthomill.pipeline.engine.workers.order_batches import seconds_of_task
from orthomill.pipeline.export.file_parts import SHEET
from orthomill.pipeline.storage.depots.bucket import Bucket

DISPATCH, ENGINE = 0.0011, 0.0015
"""CPU s a job of the command with its scheduler, and of a worker beside the work: `python -m benchmarks engine_cost`"""
PLAN_BYTES = 500.0
"""of a job in the memory of the command, with its record, on the map and in the forecast: `python -m benchmarks plan_cost`"""
ADJUSTMENT_BYTES = 1.4e6
"""of a photograph in the adjustment: adjustment_growth.md"""
PHOTOGRAPH = 100.0
"""megapixels of an aerial camera"""
FATES = 5
"""runs of which what goes wrong is the mean: whether the longest job loses its worker is chance"""
PUT, GET = 5e-6, 4e-7
"""US dollars a request, the list price of the largest store"""


@dataclass(frozen=True)
class Project:
    """`megapixels` of photographs, in blocks of so many that are oriented by themselves."""

    name: str
    megapixels: float
    photographs: float
    blocks: int = 1

    @property
    def block(self) -> float:
        """Megapixels of a block."""
        return self.megapixels / self.blocks

    def jobs(self, layout: Layout, tile: int) -> Jobs:
        """Those of a block."""
        return enlarged(layout, self.block, self.photographs / self.blocks, tile)


TOWN = Project("the town of `volos_full`, six photographs of 235 Mpx", 1411.0, 6)
COUNTY = Project("a county: 1000 photographs", 1000 * PHOTOGRAPH, 1000)
CITY = Project("a city: 10 000 photographs", 10_000 * PHOTOGRAPH, 10_000)
COUNTRY = Project("a country: 40 Tpx in 40 blocks", 40e6, 40e6 / PHOTOGRAPH, 40)


def main(words: list[str]) -> None:
    """Simulates all, and writes the page."""
    if len(words) != 1:
        raise SystemExit("Which project? python -m benchmarks large_projects -- PROJECT (of this folder, with a finished run)")
    write_page("large_projects", ["--", *words], page(words[0], layout_of(words[0])))


def page(name: str, layout: Layout) -> str:
    """The page."""
    lines = [
        "# Large projects on clusters, simulated",
        "",
        f"Jobs of `{name}` ({layout.megapixels:.0f} Mpx, {len(layout.once)} jobs, {layout.core_seconds:.1f} core-s per Mpx on the "
        "machine above), repeated side by side; what a project has once (its adjustment, files that are exported) takes as much "
        "longer as the project is larger, but for jobs whose work has an end (samples, pictures) or goes by photograph, whatever "
        f"its pixels (the adjustment: {MORE_EACH:g} times as long for each as in a block of six). "
        "GeoTIFFs and point clouds of rasters are a "
        f"part a block, and a job that joins them, which takes {100 * JOINING:.0f} % of the parts; "
        "the largest are sheets. The scheduler is busy for "
        f"{1000 * DISPATCH:.1f} ms with every task, which is a job or several short ones, a worker for "
        f"{1000 * ENGINE:.0f} ms beside its work, a request takes 30 ms, and a worker reads and writes 100 MB/s. "
        f"{Bucket.at_once} objects are read at a time, but for files and streams. An order of "
        "magnitude, not a promise: real blocks differ by a factor of two or so.",
        "",
        "## What an office asks",
        "",
        "| project | tile, px | jobs | core-hours | stored, TB | requests, millions | their price, $ | plan in memory, GB | "
        "memory of a block's adjustment, GB |",
        "| --- | --- | --- | --- | --- | --- | --- | --- | --- |",
        *(_asked(project, layout, tile) for project, tile in SIZES),
        "",
        *_counted(layout),
        "",
        "## Strong scaling",
        "",
        "Hours from the photographs to all products, and the share of the workers' time that goes into jobs.",
        "",
        "| project | tile, px | workers | hours | efficiency, % | scheduler busy, % | longest job, min |",
        "| --- | --- | --- | --- | --- | --- | --- |",
        *(row for project, tile, numbers in CLUSTERS for row in _scaled(project, layout, tile, numbers)),
        "",
        "## Sheets",
        "",
        f"GeoTIFFs above {layout.sheets_above / 1e9:.0f} GB, not compressed, are sheets of {SHEET} px, which nobody joins. Hours "
        "with them, and with every file joined by one worker; sheets of the orthoimage.",
        "",
        "| project | tile, px | workers | sheets | hours | hours, all joined |",
        "| --- | --- | --- | --- | --- | --- |",
        *(row for project, tile, numbers in SHEETED for row in _in_sheets(project, layout, tile, numbers)),
        "",
        "## Weak scaling",
        "",
        "As much work for each worker.",
        "",
        "| Mpx | workers | tile, px | hours | efficiency, % |",
        "| --- | --- | --- | --- | --- |",
        *(_weak(layout, workers) for workers in (1, 10, 100, 300)),
        "",
        "## What goes wrong",
        "",
        f"{COUNTY.name}, tiles of 2048 px, 100 workers; means of {FATES} runs.",
        "",
        "A job that is longer than its worker lives begins anew again and again, and is given up after 20 workers; the hours are "
        "then those of a run that had its result.",
        "",
        "| circumstance | hours | longer by, % | done twice, core-hours | jobs given up |",
        "| --- | --- | --- | --- | --- |",
        *_failures(layout),
    ]
    return "\n".join(lines)


SIZES = ((TOWN, 512), (TOWN, 2048), (COUNTY, 2048), (CITY, 2048), (CITY, 4096), (COUNTRY, 4096))
CLUSTERS = (
    (TOWN, 512, (1, 16, 100)),
    (TOWN, 2048, (16, 100)),
    (COUNTY, 512, (100,)),
    (COUNTY, 2048, (16, 100, 1000)),
    (CITY, 4096, (100, 1000)),
)
SHEETED = ((COUNTY, 2048, (100, 1000)), (CITY, 4096, (1000,)))
"""projects, the sides of their tiles, and numbers of workers"""


def _counted(layout: Layout) -> list[str]:
    """Jobs beside those of real plans."""
    rows = (f"| {tile} | {planned} | {counted} |" for tile, planned, counted in layout.counts)
    return [
        "Jobs of the project above itself, by its real plan and as they are counted here:",
        "",
        "| tile, px | plan | counted |",
        "| --- | --- | --- |",
        *rows,
    ]


def _cluster(workers: int) -> Cluster:
    return Cluster(workers, DISPATCH, ENGINE, held=tasks_held(workers), together=seconds_of_task(workers))


def _asked(project: Project, layout: Layout, tile: int) -> str:
    jobs = project.jobs(layout, tile)
    count, photographs = len(jobs.seconds), project.photographs / project.blocks
    gets, puts = jobs.reads.sum() * project.blocks, jobs.writes.sum() * project.blocks
    return (
        f"| {project.name} | {tile} | {count * project.blocks:,} | {jobs.seconds.sum() * project.blocks / 3600:,.0f} | "
        f"{layout.stored * project.megapixels / 1e12:.2g} | {(gets + puts) / 1e6:.2g} | {gets * GET + puts * PUT:,.0f} | "
        f"{count * PLAN_BYTES / 1e9:.2g} | {photographs * ADJUSTMENT_BYTES / 1e9:.2g} |"
    )


def _scaled(project: Project, layout: Layout, tile: int, numbers: tuple[int, ...]) -> Iterator[str]:
    jobs = project.jobs(layout, tile)
    for workers in numbers:
        outcome = simulated(jobs, _cluster(workers))
        yield (
            f"| {project.name} | {tile} | {workers} | {outcome.clock / 3600:.2g} | {100 * outcome.efficiency(workers):.0f} | "
            f"{100 * outcome.busy:.0f} | {outcome.longest / 60:.1f} |"
        )


def _in_sheets(project: Project, layout: Layout, tile: int, numbers: tuple[int, ...]) -> Iterator[str]:
    joined = replace(layout, sheets_above=np.inf)
    sheets = max(file.sheets(project.block / layout.megapixels) for file in layout.files)
    for workers in numbers:
        hours = (simulated(project.jobs(one, tile), _cluster(workers)).clock / 3600 for one in (layout, joined))
        yield f"| {project.name} | {tile} | {workers} | {sheets} | {' | '.join(f'{one:.2f}' for one in hours)} |"


def _weak(layout: Layout, workers: int) -> str:
    size, tile = workers * TOWN.megapixels, 2048
    outcome = simulated(enlarged(layout, size, workers * TOWN.photographs, tile), _cluster(workers))
    return f"| {size:,.0f} | {workers} | {tile} | {outcome.clock / 3600:.2g} | {100 * outcome.efficiency(workers):.0f} |"


def _failures(layout: Layout) -> list[str]:
    jobs, calm = COUNTY.jobs(layout, 2048), _cluster(100)
    undisturbed = simulated(jobs, calm)
    circumstances = {
        "nothing": calm,
        "1 % of the requests fail, each repeated after a second": calm._replace(refused=0.01),
        "10 % of them": calm._replace(refused=0.1),
        "requests take 0.3 s": calm._replace(latency=0.3),
        "every worker is taken away once in 2 hours, and back after 2 minutes": calm._replace(life=7200.0),
        "once in 20 minutes": calm._replace(life=1200.0),
    }
    return [_failed(name, jobs, cluster, undisturbed) for name, cluster in circumstances.items()]


def _failed(name: str, jobs: Jobs, cluster: Cluster, undisturbed: Outcome) -> str:
    outcomes = [simulated(jobs, cluster, seed) for seed in range(FATES)]
    clock, lost, given_up = np.mean([(one.clock, one.lost, one.given_up) for one in outcomes], axis=0)
    longer = 100 * (clock / undisturbed.clock - 1)
    return f"| {name} | {clock / 3600:.2f} | {longer:.0f} | {lost / 3600:.1f} | {given_up:.1f} |"
