"""Workers of a cluster that are killed with -9 again and again: does the run end whole, with the same bytes?

python -m benchmarks killed_workers [SECONDS [PROJECT [WORKERS]]]

Every so many seconds a worker process, by lot, is killed; the nanny beside it starts another. The run's command is that of a user.
"""

import json
import random
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from threading import Event, Thread

import psutil

from benchmarks.instrument.result_page import write_page
from benchmarks.measured_run import orthomill, project_root
from benchmarks.same_everywhere import digests

STARTS = 60.0
"""seconds that the scheduler may take to start"""
MEMORY = "2GiB"


@contextmanager
def cluster(folder: Path, workers: int) -> Iterator[tuple[str, list[psutil.Process]]]:
    """The address of a scheduler of its own, and the nannies of its workers."""
    file = folder / "scheduler.json"
    with ExitStack() as processes:
        processes.callback(
            _end, _started(folder, "dask_scheduler", "--host", "127.0.0.1", "--port", "0", "--scheduler-file", str(file))
        )
        until = time.monotonic() + STARTS
        while not file.exists() and time.monotonic() < until:
            time.sleep(0.1)
        address = json.loads(file.read_text())["address"]
        nannies = [_started(folder, "dask_worker", address, "--nthreads", "1", "--memory-limit", MEMORY) for _ in range(workers)]
        for nanny in nannies:
            processes.callback(_end, nanny)
        yield address, nannies


def _started(folder: Path, program: str, *words: str) -> psutil.Process:
    silent = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    return psutil.Popen([sys.executable, "-m", f"distributed.cli.{program}", "--no-dashboard", *words], cwd=folder, **silent)


def _end(process: psutil.Process) -> None:
    for one in (*process.children(recursive=True), process):
        one.kill()
    process.wait(30)


def kill_by_lot(nannies: list[psutil.Process], seconds: float, enough: Event, seed: int = 42) -> int:
    """Kill one worker every so many seconds until it is enough; how many were killed."""
    chance, kills = random.Random(seed), 0
    while not enough.wait(seconds):
        found = [one for one in chance.choice(nannies).children(recursive=True) if "spawn_main" in " ".join(one.cmdline())]
        for worker in found:
            worker.kill()
        kills += bool(found)
    return kills


def main(words: list[str]) -> None:
    """Runs the project undisturbed and in a storm, compares the two, and writes the page."""
    seconds = float(words[0]) if words else 10.0
    project = words[1] if words[1:] else "volos_small"
    workers = int(words[2]) if words[2:] else 2
    with tempfile.TemporaryDirectory() as scratch:
        calm, storm = project_root(Path(scratch) / "calm", project), project_root(Path(scratch) / "storm", project)
        before = orthomill(calm, "run", project, "--workers", str(workers))
        enough, kills = Event(), []
        with cluster(Path(scratch), workers) as (address, nannies):
            killer = Thread(target=lambda: kills.append(kill_by_lot(nannies, seconds, enough)), daemon=True)
            killer.start()
            after = orthomill(storm, "run", project, "--scheduler", address)
            enough.set()
            killer.join()
        if before.code:
            raise SystemExit(before.output)
        if after.code:
            print(after.output)
        expected, found = digests(calm / "runs" / project), digests(storm / "runs" / project)
    same = sum(found.get(name) == digest for name, digest in expected.items())
    write_page(
        "killed_workers",
        words,
        f"""# Workers that are killed

Project `{project}` on {workers} workers of a Dask cluster; one of them, by lot, is killed with -9 every {seconds:g} s.

| what | figure |
| --- | --- |
| workers killed | {kills[0]} |
| the command ended with | {after.code} |
| rasters, tables and products of the undisturbed run | {len(expected)} |
| the same in the storm, byte for byte | {same} |
| others in the storm | {len(set(found) - set(expected))} |
""",
    )
