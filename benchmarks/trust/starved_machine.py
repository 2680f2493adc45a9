"""Thousands of jobs on a machine that has no time for them: `python -m benchmarks starved_machine [JOBS] [BUSY]`.

BUSY processes that do nothing but use the processor run beside the two workers of a local cluster. Every job must be done, nothing
may be printed but the figures, and the results must be whole. Half of the jobs write a tile, the others wait for one and smooth it.
"""

import math
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import ClassVar, Literal

import numpy as np

from benchmarks.instrument.result_page import write_page
from orthomill.pipeline.engine.dask_cluster import local_client
from orthomill.pipeline.engine.dask_runner import DaskRunner
from orthomill.pipeline.engine.session import Session, Unwatched
from orthomill.schemas.job import Job, Raster
from orthomill.schemas.project import Project
from orthomill.schemas.raster import RasterSpec, Window, tiles_of
from orthomill.schemas.stage_contract import Stage

JOBS, BUSY, WORKERS = 10_000, 20, 2
MEMORY = 2**30
"""bytes of a worker"""
TILE = 128
"""px, the smallest"""
MARGIN = 1
"""px around a tile that smoothing reads"""


def made(window: Window) -> np.ndarray:
    """Numbers that differ from pixel to pixel."""
    rows, cols = np.mgrid[window.slices]
    return ((7 * rows + 13 * cols) % 1000).astype(np.float32)


def smoothed(values: np.ndarray, read: Window, window: Window) -> np.ndarray:
    """The mean of every pixel and the one to its right."""
    top, left = window.row - read.row, window.col - read.col
    mean = (values + np.roll(values, -1, axis=1)) / np.float32(2)
    return mean[top : top + window.height, left : left + window.width]


class ManyTiles(Stage):
    """As many tiles as are asked for, twice."""

    title: ClassVar[str] = "many tiles"
    kind: Literal["tiles"] = "tiles"
    side: int = 1

    def plan(self, view) -> Iterator[Job | RasterSpec]:
        first, second = (
            RasterSpec(name=f"tiles/{name}", shape=(self.side * TILE, self.side * TILE), dtype="float32", chunk=TILE)
            for name in ("made", "smoothed")
        )
        yield from (first, second)
        for tile in tiles_of(first.shape, TILE):
            writes = {"values": Raster(first.name, tile.window)}
            yield Job(
                stage="tiles",
                item="made",
                function=made,
                reads={},
                writes=writes,
                params={"window": tile.window},
                row=tile.row,
                col=tile.col,
            )
        for tile in tiles_of(first.shape, TILE):
            read, window = tile.window.grown(MARGIN).clipped(first.shape), tile.window
            reads, writes = {"values": Raster(first.name, read)}, {"mean": Raster(second.name, window)}
            yield Job(
                stage="tiles",
                item="smoothed",
                function=smoothed,
                reads=reads,
                writes=writes,
                params={"read": read, "window": window},
                row=tile.row,
                col=tile.col,
            )


@contextmanager
def starved(processes: int) -> Iterator[None]:
    """Inside, so many processes use all the processor time that they get."""
    busy = [subprocess.Popen([sys.executable, "-S", "-c", "while True: pass"]) for _ in range(processes)]
    try:
        yield
    finally:
        for process in busy:
            process.kill()
            process.wait()


def run(folder: Path, jobs: int) -> Session:
    """Run so many jobs, or a few more."""
    project = Project.model_validate({"project": "many", "crs": "EPSG:2100", "photographs": {"kind": "folder", "path": "p"}})
    stage = ManyTiles(side=math.ceil(math.sqrt(jobs / 2)))
    session = Session(project.model_copy(update={"tile": TILE}), (stage,), folder, lambda source: ())
    with local_client(WORKERS, MEMORY, 0) as client:
        runner = DaskRunner(client, MEMORY, "this machine")
        session.run(runner, Unwatched())
        runner.close()
    return session


def main(words: list[str]) -> None:
    """Measure, and write the page."""
    jobs, busy = (int(word) for word in (*words, *map(str, (JOBS, BUSY)[len(words) :])))
    with tempfile.TemporaryDirectory() as scratch, starved(busy):
        begun = time.monotonic()
        session = run(Path(scratch), jobs)
        seconds = time.monotonic() - begun
        values = session.store.read("tiles/smoothed", session.store.spec("tiles/smoothed").full)
    if session.failures or session.blocked or not (values[:, :-1] > 0).any():
        raise SystemExit(
            f"{len(session.failures)} failed, {len(session.blocked)} blocked: {next(iter(session.failures.values()), '')}"
        )
    said = f"{len(session.done)} jobs done, none failed, in {seconds:.0f} s"
    done = f"{said}, on {WORKERS} workers beside {busy} busy processes; no traceback."
    write_page("starved_machine", words, f"# A starved machine\n\n{done}")
