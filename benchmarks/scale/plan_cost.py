"""What a plan costs: processor time and memory of the command for so many jobs, before any of them is done and when all are.

python -m benchmarks plan_cost [JOBS ...]

The jobs of `engine_cost`, handed to a runner that does nothing but record them as done, as workers do. Each size is measured in a
process of its own, whose largest memory counts with the program itself.
"""

import resource
import tempfile
import time
from collections import deque
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from math import isqrt
from multiprocessing import get_context
from pathlib import Path

from benchmarks.instrument.result_page import write_page
from benchmarks.scale.engine_cost import CHUNK, MEMORY, PROJECT, Tiles
from orthomill.pipeline.engine.execute import JobOrder
from orthomill.pipeline.engine.runner import Finished
from orthomill.pipeline.engine.session import Session, Unwatched
from orthomill.pipeline.records.numbered_names import Key
from orthomill.pipeline.records.records import Record, Records
from orthomill.pipeline.storage.store import Store
from orthomill.schemas.job import Raster

HELD = 2000
"""jobs that the runner holds"""
SIZES = (10_000, 100_000, 1_000_000)


@dataclass(frozen=True)
class PlanCost:
    """Of a plan of so many jobs: CPU s, bytes of the process at most, s until the first job was handed over."""

    jobs: int
    program: int
    plan: float
    plan_peak: int
    run: float
    run_peak: int
    first: float
    again: float
    again_peak: int


class RecordingRunner:
    """Records jobs as done, and does none of them."""

    memory_limit = room = MEMORY
    description, dashboard = "nothing is done", ""

    def __init__(self, folder: Path) -> None:
        self.first: float | None = None
        self._folder, self._waiting = folder, deque[Key]()
        self._store, self._records = Store(folder), Records(folder, 1)
        self._births: dict[str, str] = {}

    def submit(self, work: JobOrder, dependencies: tuple[Key, ...], memory: int) -> None:
        """Record it at once."""
        self.first = self.first or time.monotonic()
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
        self._waiting.append(work.job.key)

    def _birth(self, raster: str) -> str:
        if raster not in self._births:
            self._births[raster] = self._store.birth(raster)
        return self._births[raster]

    @property
    def busy(self) -> bool:
        return bool(self._waiting)

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
    stage = Tiles(across=isqrt(jobs // 2))

    def session(root: str) -> Session:
        return Session(PROJECT.model_copy(update={"tile": CHUNK}), (stage,), Path(root), lambda source: ())

    with tempfile.TemporaryDirectory() as root:
        program, begun, clock = _peak(), time.process_time(), time.monotonic()
        first = session(root)
        first.plan()
        planned, plan_peak = time.process_time(), _peak()
        runner = RecordingRunner(first.folder)
        first.run(runner, Unwatched())
        first.stage_runs()
        ran, run_peak = time.process_time(), _peak()
        assert len(first.done) == 2 * stage.across**2 and runner.first
        del first
        second = session(root)
        second.plan()
        second.stage_runs(), second.earlier_runs()
        again = time.process_time()
        assert not second.pending
    number = 2 * stage.across**2
    return PlanCost(
        number, program, planned - begun, plan_peak, ran - planned, run_peak, runner.first - clock, again - ran, _peak()
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
        f"of which the program itself takes {found[0].program / 2**20:.0f} MiB. *run* is what the session does for a job beside "
        "the messages to workers, with the writing of its record, which workers do. Memory is that of all steps until then.",
        "",
        "| jobs | planning, CPU s | MiB | first job after, s | run, CPU s | MiB | second run, CPU s | MiB |",
        "| --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    lines += [
        f"| {one.jobs:,} | {one.plan:.1f} | {one.plan_peak / 2**20:.0f} | {one.first:.1f} | {one.run:.1f} | "
        f"{one.run_peak / 2**20:.0f} | {one.again:.1f} | {one.again_peak / 2**20:.0f} |"
        for one in found
    ]
    return "\n".join(lines)
