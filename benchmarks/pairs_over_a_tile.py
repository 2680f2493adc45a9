"""Does the job of a surface tile need more memory with more pairs over it? `python -m benchmarks pairs_over_a_tile RUN`.

The tile of a finished run that most pairs show, with these pairs again and again until there are 10, 40 and 100: every number of
pairs in a process of its own, whose largest memory the system reports. What a run of so many photographs takes in all its stages
is the business of `memory_growth`.
"""

import resource
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from itertools import cycle, islice
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from benchmarks.instrument.result_page import write_page
from benchmarks.measured_run import run_folders
from orthomill.pipeline.storage.store import Store
from orthomill.schemas.epipolar import PAIRS
from orthomill.schemas.job import Job, Raster, Stream
from orthomill.tasks.densification.stage import DensificationStage

NUMBERS = (1, 10, 40, 100)
"""pairs over the tile; the first is what everything but pairs takes"""
TILE = 512


def busiest_job(store: Store) -> Job:
    """The job of the surface tile that most pairs show."""
    view = SimpleNamespace(table=store.table, raster=store.spec, project=SimpleNamespace(tile=TILE), has_stage=lambda kind: True)
    jobs = [one for one in DensificationStage().plan(view) if isinstance(one, Job) and one.item == "surface"]
    return max(jobs, key=lambda job: len(job.params["tile"].pieces))


def run_with(store: Store, job: Job, number: int) -> float:
    """Runs the job with `number` pairs; returns its CPU-seconds."""
    tile, stream = job.params["tile"], job.reads["nodes"]
    assert isinstance(stream, Stream)
    chosen = list(islice(cycle(range(len(tile.pieces))), number))
    params = job.params | {"tile": replace(tile, pieces=tuple(tile.pieces[k] for k in chosen))}
    started = time.process_time()
    given = {name: _read(store, one) for name, one in job.reads.items() if name != "nodes"}
    job.function(**given, **params, nodes=_one_by_one(store, [stream.regions[k] for k in chosen]))
    return time.process_time() - started


def _read(store: Store, region: Any) -> np.ndarray:
    return store.read(region.name, region.window)


def _one_by_one(store: Store, regions: list[Raster]) -> Iterator[np.ndarray]:
    return (_read(store, region) for region in regions)


def measured(run: Path, number: int) -> tuple[float, float]:
    """(largest memory MiB, CPU-seconds) of the job with so many pairs, in a process of its own."""
    words = [sys.executable, "-m", __spec__.name, str(run), str(number)]
    printed = subprocess.run(words, capture_output=True, text=True, check=True).stdout.split()
    return float(printed[-2]), float(printed[-1])


def main(words: list[str]) -> None:
    """The page of all numbers of pairs."""
    (run,) = run_folders(words, "volos")
    found = [(number, *measured(run, number)) for number in NUMBERS]
    own = len(Store(run).table(PAIRS).pairs)
    lines = [
        "# Memory of a surface tile under more and more pairs",
        "",
        f"One tile of {TILE} x {TILE} cells of {run.name}, whose pairs ({own} in the block) are read again and again; every row",
        "is a process of its own, planning of the stage included.",
        "",
        "| pairs over the tile | largest memory (MiB) | CPU-s of the job |",
        "| --- | --- | --- |",
        *(f"| {number} | {memory:.0f} | {seconds:.1f} |" for number, memory, seconds in found),
        "",
    ]
    write_page("pairs_over_a_tile", words, "\n".join(lines))


if __name__ == "__main__":
    # Of a process of its own: the folder of the run and the number of pairs.
    finished = Store(Path(sys.argv[1]))
    spent = run_with(finished, busiest_job(finished), int(sys.argv[2]))
    print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024, spent)
