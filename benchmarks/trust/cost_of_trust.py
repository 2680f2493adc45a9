"""What checksums, encryption and protection against power cuts cost: `python -m benchmarks cost_of_trust [ROUNDS] [PROJECT]`.

A simulated project (volos) runs with and without them in turn, on two workers, from nothing each time. Without: no checksum of
chunks or files, the local cluster without TLS, nothing forced to the disk. Processor time of all processes, for the clock tells of
the machine.
"""

import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from statistics import median
from typing import NamedTuple

from benchmarks.instrument.result_page import write_page
from benchmarks.measured_run import project_root

SMALL, PROJECT = "volos_small", "volos"
"""the project whose runs compile the kernels, and the one that is measured"""


class Cost(NamedTuple):
    """Of one run, s."""

    cpu: float
    clock: float


def dask_setup(worker: object) -> None:
    """Called by Dask in every worker that is started without what is measured: the files of jobs get no checksum."""
    from orthomill.pipeline.storage.depots import kept_files

    kept_files._checksum = lambda path: 0


def run_without(project: str) -> None:
    """Run the project in the present folder without what is measured."""
    from orthomill.pipeline.cli.environment import main as command
    from orthomill.pipeline.engine import dask_cluster
    from orthomill.pipeline.records import power_cut
    from orthomill.pipeline.storage import store

    class OpenCluster(dask_cluster.SpecCluster):
        def __init__(self, **options) -> None:
            plain = {"protocol": "tcp://", "security": None}
            options["scheduler"]["options"] |= plain
            for worker in options["workers"].values():
                worker["options"] |= plain | {"preload": ["benchmarks.trust.cost_of_trust"]}
            super().__init__(**(options | {"security": None}))

    def unsealed(group: Path, **options):
        if "compressors" in options:
            options["compressors"] = options["compressors"][:1]
        return create(group, **options)

    create = store.zarr.create_array
    dask_cluster.SpecCluster, store.zarr.create_array = OpenCluster, unsealed
    power_cut._flush = lambda folder: None
    sys.argv = ["orthomill", *_run_words(project)]
    sys.exit(command())


def _run_words(project: str) -> list[str]:
    return ["run", project, "--workers", "2"]


def measured(project: str, bare: bool) -> Cost:
    """One run from nothing in a folder of its own; `bare`: without what is measured."""
    open_run = [sys.executable, "-m", "benchmarks.trust.cost_of_trust", project]
    with tempfile.TemporaryDirectory() as scratch:
        root = project_root(Path(scratch), project)
        before, started = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic()
        program = open_run if bare else [_command(), *_run_words(project)]
        done = subprocess.run(program, cwd=root, capture_output=True, text=True, env=_environment())
        clock = time.monotonic() - started
    if done.returncode != 0:
        raise SystemExit(done.stdout + done.stderr)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    used = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return Cost(used, clock)


def _command() -> Path:
    return Path(sys.executable).parent / "orthomill"


def _environment() -> dict[str, str]:
    return {**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])}


def page(project: str, runs: list[tuple[Cost, Cost]]) -> str:
    """The page of results."""
    lines = [
        "# What trust costs",
        "",
        f"Project `{project}`, two workers, from nothing. Processor time of all processes; in turn, so that the load is alike.",
        "",
    ]
    lines += ["| run | without, CPU-s | with, CPU-s | ratio | ratio by the clock |", "| --- | --- | --- | --- | --- |"]
    for number, (bare, whole) in enumerate(runs, 1):
        row = f"| {number} | {bare.cpu:.1f} | {whole.cpu:.1f} | {whole.cpu / bare.cpu:.3f} | {whole.clock / bare.clock:.3f} |"
        lines.append(row)
    # Other programs only ever add: the run that they disturbed least tells most.
    least = min(whole.cpu for _, whole in runs) / min(bare.cpu for bare, _ in runs)
    ratio = median(whole.cpu for _, whole in runs) / median(bare.cpu for bare, _ in runs)
    return "\n".join([*lines, "", f"Ratio of the medians: {ratio:.3f}, of the least: {least:.3f} (1.03 is allowed).", ""])


def main(words: list[str]) -> None:
    """Measure so many rounds, and write the page."""
    rounds, project = int(words[0]) if words else 3, words[1] if words[1:] else PROJECT
    runs = []
    for number in range(rounds + 1):
        costs = {}
        # In turn first and second: a machine that warms up is slower for whichever comes later.
        for bare in (True, False) if number % 2 else (False, True):
            # The first round compiles the kernels.
            costs[bare] = measured(project if number else SMALL, bare)
        if number:
            runs.append((costs[True], costs[False]))
            print(runs[-1], flush=True)
    write_page("cost_of_trust", words, page(project, runs))


if __name__ == "__main__":
    main(sys.argv[1:])


if __name__ == "__main__":
    # Of a process of its own.
    run_without(sys.argv[1])
