"""What a plan costs: processor time and memory of the command for so many jobs, before any of them is done and when all are.

python -m benchmarks plan_cost [JOBS ...]

The jobs of `engine_cost`, handed to a runner that does nothing but record them as done, as workers do. Each size is measured in a
process of its own, whose largest memory counts with the program itself.
"""

import resource
import tempfile
import time
from collections import deque
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from math import isqrt
from multiprocessing import get_context
from pathlib import Path

from pydantic import BaseModel

from benchmarks.instrument.result_page import write_page
from benchmarks.scale.engine_cost import CHUNK, MEMORY, PROJECT, Tiles
from orthomill.pipeline.engine.execute import JobOrder, execute
from orthomill.pipeline.engine.runner import Finished
from orthomill.pipeline.engine.session import Session, Unwatched
from orthomill.pipeline.records.numbered_names import Key
from orthomill.pipeline.records.records import Record, Records
from orthomill.pipeline.storage.store import Store
from orthomill.schemas.job import Job, Raster, Table
from orthomill.schemas.raster import RasterSpec
from orthomill.schemas.stage_contract import ProjectView

HELD = 2000
"""jobs that the runner holds"""
SIZES = (10_000, 100_000, 1_000_000)


@dataclass(frozen=True)
class PlanCost:
    """Of a plan of so many jobs: CPU s, bytes of the process at most, s until the first tile was handed over."""

    jobs: int
    program: int
    plan: float
    plan_peak: int
    run: float
    run_peak: int
    first: float
    again: float
    again_peak: int


class Gate(BaseModel):
    """What the tiles wait for."""


def opened() -> Gate:
    """The table."""
    return Gate()


GATE = Job(stage="tiles", item="gate", function=opened, reads={}, writes={"gate": Table("tiles/gate.json", Gate)})


class GatedTiles(Tiles):
    """Tiles that are planned when a table is there, as those of all stages are."""

    def plan(self, view: ProjectView) -> Iterator[RasterSpec | Job]:
        """The table, then the tiles."""
        yield GATE
        view.table(GATE.writes["gate"])
        yield from super().plan(view)


class RecordingRunner:
    """Records jobs as done, and does none of them."""

    memory_limit = room = MEMORY
    description, dashboard = "nothing is done", ""

    def __init__(self, folder: Path) -> None:
        self.opened, self.first = 0.0, 0.0
        """when the table was there for which the tiles wait, and when the first of them was handed over"""
        self._folder, self._waiting = folder, deque[Key]()
        self._store, self._records = Store(folder), Records(folder, 1)
        self._births: dict[str, str] = {}

    def submit(self, work: JobOrder, dependencies: tuple[Key, ...], memory: int) -> None:
        """Record it at once."""
        if work.job.item == GATE.item:
            execute(work)
            self.opened = time.monotonic()
        else:
            self.first = self.first or time.monotonic()
            self._record(work)
        self._waiting.append(work.job.key)

    def _record(self, work: JobOrder) -> None:
        births = {region.name: self._birth(region.name) for region in work.job.writes.values() if isinstance(region, Raster)}
        stage, item, row, col = work.job.key
        self._records.put(
            Record(
                stage=stage,
                item=item,
                row=row,
                col=col,
                status="done",
                fingerprint=work.fingerprint,
                reason=work.reason,
                run=work.run,
                births=births,
                started=time.time(),
                seconds=0.25,
                cpu_seconds=0.25,
                worker="1",
                peak_bytes=MEMORY // 2,
            )
        )

    def _birth(self, raster: str) -> str:
        if raster not in self._births:
            self._births[raster] = self._store.birth(raster)
        return self._births[raster]

    @property
    def busy(self) -> bool:
        return bool(self._waiting)

    @property
    def has_ended(self) -> bool:
        return self.busy

    @property
    def wants_more(self) -> bool:
        return len(self._waiting) < HELD

    def next(self) -> Finished:
        """The next in the order in which they came."""
        return Finished(self._waiting.popleft(), "done")

    def learn(self, key: Key, seconds: float) -> None:
        """There is nothing to choose."""

    def close(self) -> None:
        """There is nothing to free."""


def measured(jobs: int) -> PlanCost:
    """The cost of a plan of about so many jobs; in a process that has measured nothing else."""
    across = isqrt(jobs // 2)
    project = PROJECT.model_copy(update={"tile": CHUNK})
    with tempfile.TemporaryDirectory() as root:

        def session(stage: Tiles) -> Session:
            return Session(project, (stage,), Path(root), lambda source: ())

        program, begun = _peak(), time.process_time()
        session(Tiles(across=across)).plan()
        planned, plan_peak = time.process_time(), _peak()
        first = session(GatedTiles(across=across))
        runner = RecordingRunner(first.folder)
        first.run(runner, Unwatched())
        first.stage_runs()
        ran, run_peak = time.process_time(), _peak()
        if len(first.done) != 2 * across**2 + 1:
            raise RuntimeError(f"{len(first.done)} jobs were done.")
        del first
        second = session(GatedTiles(across=across))
        second.plan()
        second.stage_runs()
        second.earlier_runs()
        again = time.process_time()
        if second.pending:
            raise RuntimeError(f"{len(second.pending)} jobs would run again.")
    return PlanCost(
        jobs=2 * across**2,
        program=program,
        plan=planned - begun,
        plan_peak=plan_peak,
        run=ran - planned,
        run_peak=run_peak,
        first=runner.first - runner.opened,
        again=again - ran,
        again_peak=_peak(),
    )


def _peak() -> int:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


def main(words: list[str]) -> None:
    """Measures plans of JOBS jobs each, and writes the page."""
    with ProcessPoolExecutor(1, mp_context=get_context("spawn"), max_tasks_per_child=1) as processes:
        found = list(processes.map(measured, map(int, words) if words else SIZES))
    write_page("plan_cost", words, page(found))


def page(found: list[PlanCost]) -> str:
    """The page."""
    lines = [
        "# What a plan costs",
        "",
        f"Jobs that write or read a chunk of {CHUNK} px with its halo, planned and handed to a runner that does nothing but record "
        "them as done; then planned once more, with nothing left to do. CPU of the command, and the memory of its process at most, "
        f"of which the program itself takes {found[0].program / 2**20:.0f} MiB. *run* is planning, what the session does for a job "
        "beside the messages to workers, and the writing of its record, which workers do; the first tile is handed over so long "
        "after the table is there that all wait for. Memory is that of all steps until then.",
        "",
        "| jobs | planning, CPU s | MiB | first tile after, s | run, CPU s | MiB | second run, CPU s | MiB |",
        "| --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    lines += [
        f"| {one.jobs:,} | {one.plan:.1f} | {one.plan_peak / 2**20:.0f} | {one.first:.2f} | {one.run:.1f} | "
        f"{one.run_peak / 2**20:.0f} | {one.again:.1f} | {one.again_peak / 2**20:.0f} |"
        for one in found
    ]
    return "\n".join(lines)
