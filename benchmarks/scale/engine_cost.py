"""What the engine itself costs for a job: planning, records, messages, and the chunk of a raster, without any photogrammetry.

python -m benchmarks engine_cost [JOBS [WORKERS]]

Half of the jobs write a chunk of 64 px, the other half read it with a halo from up to nine and write another, as tiles of real
stages do. They run on worker processes of this machine, then are planned once more with nothing left to do.
"""

import os
import resource
import tempfile
import time
import tracemalloc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from math import isqrt
from pathlib import Path
from typing import ClassVar, Literal

import numpy as np
import psutil

from benchmarks.instrument.result_page import write_page
from orthomill.pipeline.engine.dask_cluster import local_client
from orthomill.pipeline.engine.dask_runner import DaskRunner
from orthomill.pipeline.engine.session import Session, Unwatched
from orthomill.schemas.job import Job, Raster
from orthomill.schemas.memory import MIB
from orthomill.schemas.project import Project
from orthomill.schemas.raster import RasterSpec, Tile, Window, tiles_of
from orthomill.schemas.stage_contract import ProjectView, Stage

CHUNK = 64
MEMORY = 1500 * MIB
PROJECT = Project.model_validate({"project": "engine", "crs": "EPSG:2100", "photographs": {"kind": "folder", "path": "photos"}})


def constant(window: Window) -> np.ndarray:
    """(H, W) of ones."""
    return np.ones(window.shape, np.float32)


def inner(values: np.ndarray, read: Window, window: Window) -> np.ndarray:
    """The part of what was read that lies in `window`."""
    return values[window.within(read).slices]


class Tiles(Stage):
    """Two rasters, the second read from the first with a halo of one cell."""

    title: ClassVar[str] = "tiles that cost nothing"
    kind: Literal["tiles"] = "tiles"
    across: int

    def plan(self, view: ProjectView) -> Iterator[RasterSpec | Job]:
        """The chunks of the one, then of the other."""
        shape = (self.across * CHUNK,) * 2
        first, second = (
            RasterSpec(name=f"tiles/{name}", shape=shape, dtype="float32", chunk=CHUNK) for name in ("first", "second")
        )
        yield first
        yield second
        tiles = list(tiles_of(shape, CHUNK))
        for tile in tiles:
            writes = {"values": Raster(first.name, tile.window)}
            yield self._job("first", constant, tile, {}, writes, {"window": tile.window})
        for tile in tiles:
            read = tile.window.grown(1).clipped(shape)
            reads, writes = {"values": Raster(first.name, read)}, {"inner": Raster(second.name, tile.window)}
            yield self._job("second", inner, tile, reads, writes, {"read": read, "window": tile.window})

    def _job(self, item: str, function: Callable, tile: Tile, reads: dict, writes: dict, params: dict) -> Job:
        return Job(
            stage=self.kind, item=item, function=function, reads=reads, writes=writes, params=params, row=tile.row, col=tile.col
        )


@dataclass
class Cost:
    """CPU seconds of the command and of its workers, and seconds."""

    own: float = 0.0
    workers: float = 0.0
    clock: float = 0.0


@dataclass
class Costs:
    """Of one project of so many jobs, whose plan takes `plan_bytes`."""

    jobs: int
    plan_bytes: int = 0
    parts: dict[str, Cost] = field(default_factory=dict)

    @contextmanager
    def part(self, name: str, pids: list[int]) -> Iterator[None]:
        """What happens inside counts for this part."""
        own, others, clock = time.process_time(), _cpu(pids), time.monotonic()
        yield
        self.parts[name] = Cost(time.process_time() - own, _cpu(pids) - others, time.monotonic() - clock)


def _cpu(pids: list[int]) -> float:
    times = [psutil.Process(pid).cpu_times() for pid in pids]
    return sum(one.user + one.system for one in times)


def plan_bytes(session: Session) -> int:
    """What the plan of a session takes, as Python counts it: what the process has of the system depends on what it held before."""
    tracemalloc.start()
    session.plan()
    held, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    return held


def measured(root: Path, jobs: int, workers: int) -> Costs:
    """The costs of a project with about so many jobs."""
    stage = Tiles(across=isqrt(jobs // 2))
    costs = Costs(2 * stage.across**2)

    def session() -> Session:
        return Session(PROJECT.model_copy(update={"tile": CHUNK}), (stage,), root, lambda source: ())

    costs.plan_bytes = plan_bytes(session())
    first = session()
    with costs.part("plan", []):
        first.plan()
    with local_client(workers, MEMORY, 0) as client:
        pids = list(client.run(os.getpid).values())
        runner = DaskRunner(client, MEMORY, "here")
        with costs.part("run", pids):
            first.run(runner, Unwatched())
        runner.close()
    if first.failures or len(first.done) != costs.jobs:
        raise SystemExit(f"{len(first.failures)} of {costs.jobs} jobs failed: {next(iter(first.failures.values()), '')}")
    second = session()
    with costs.part("plan again", []):
        second.plan()
    if second.pending:
        raise SystemExit(f"{len(second.pending)} jobs would run again, though nothing changed.")
    return costs


def main(words: list[str]) -> None:
    """Measures a project of JOBS jobs and one of a tenth of them, and writes the page."""
    jobs = int(words[0]) if words else 10_000
    workers = int(words[1]) if words[1:] else 2
    with tempfile.TemporaryDirectory() as scratch:
        found = [measured(Path(scratch) / str(size), size, workers) for size in (jobs // 10, jobs)]
    write_page("engine_cost", words, page(found, workers))


def page(found: list[Costs], workers: int) -> str:
    """The page."""
    lines = [
        "# What the engine costs for a job",
        "",
        f"Jobs that do nothing but write a chunk of {CHUNK} px or read one with its halo, on {workers} worker processes. CPU "
        "milliseconds a job; *command*: the process that plans, keeps the records and holds Dask's scheduler.",
        "",
        "| jobs | planning | command, running | workers, running | planning again | plan in memory, KiB a job | jobs a second |",
        "| --- | --- | --- | --- | --- | --- | --- |",
    ]
    lines += [_line(one) for one in found]
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    lines += ["", f"Largest memory of the command: {peak:.0f} MiB."]
    return "\n".join(lines)


def _line(costs: Costs) -> str:
    plan, run, again = (costs.parts[name] for name in ("plan", "run", "plan again"))
    each = 1000 / costs.jobs
    return (
        f"| {costs.jobs} | {plan.own * each:.2f} | {run.own * each:.2f} | {run.workers * each:.2f} | {again.own * each:.2f} | "
        f"{costs.plan_bytes / 1024 / costs.jobs:.1f} | {costs.jobs / run.clock:.0f} |"
    )
