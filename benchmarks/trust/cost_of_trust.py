"""What checksums, encryption and the protection against power cuts cost: `python -m benchmarks.trust.cost_of_trust [ROUNDS]`.

The small simulated project runs with and without them in turn, on two workers, from nothing each time. Without: no checksum of
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

from benchmarks.measured_run import machine, project_root, write_result

PROJECT = "volos_small"
WITHOUT = "without"


class Cost(NamedTuple):
    """Of one run, s."""

    cpu: float
    clock: float


def dask_setup(worker: object) -> None:
    """Called by Dask in every worker that is started without what is measured: the files of jobs get no checksum."""
    from orthomill.pipeline.storage import kept_files

    kept_files._checksum = lambda path: 0


def run_without() -> None:
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
    sys.argv = ["orthomill", *words()]
    sys.exit(command())


def words() -> list[str]:
    return ["run", PROJECT, "--workers", "2"]


def measured(root: Path, bare: bool) -> Cost:
    """One run from nothing in a folder of its own; `bare`: without what is measured."""
    program = [sys.executable, "-m", "benchmarks.trust.cost_of_trust", WITHOUT] if bare else [_command(), *words()]
    before, started = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic()
    done = subprocess.run(program, cwd=root, capture_output=True, text=True, env=_environment())
    if done.returncode != 0:
        raise SystemExit(done.stdout + done.stderr)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    used = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return Cost(used, time.monotonic() - started)


def _command() -> Path:
    return Path(sys.executable).parent / "orthomill"


def _environment() -> dict[str, str]:
    return {**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])}


def page(runs: list[tuple[Cost, Cost]]) -> str:
    """The page of results."""
    lines = ["# What trust costs", "", f"`python -m benchmarks.trust.cost_of_trust {len(runs)}`; {machine()}.", ""]
    lines += [
        f"Project `{PROJECT}`, two workers, from nothing. Processor time of all processes; in turn, so that the load is alike.",
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


def main(arguments: list[str]) -> None:
    """Measure so many rounds, and write the page."""
    if arguments == [WITHOUT]:
        run_without()
    rounds, runs = int(arguments[0]) if arguments else 3, []
    for number in range(rounds + 1):
        costs = {}
        # In turn first and second: a machine that warms up is slower for whichever comes later.
        for bare in (True, False) if number % 2 else (False, True):
            with tempfile.TemporaryDirectory() as scratch:
                costs[bare] = measured(project_root(Path(scratch), PROJECT), bare)
        # The first round compiles the kernels.
        if number:
            runs.append((costs[True], costs[False]))
            print(runs[-1], flush=True)
    write_result("cost_of_trust", page(runs))


if __name__ == "__main__":
    main(sys.argv[1:])
