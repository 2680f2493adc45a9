"""Workers of a cluster that are killed with -9 again and again: does the run end whole, with the same bytes?

python -m benchmarks killed_workers [SECONDS [PROJECT [WORKERS]]]

Every so many seconds a worker process, by lot, is killed; the nanny beside it starts another. Where it is killed while it starts,
Dask's nanny ends, or stays without a worker: then the nanny is started anew, as Kubernetes or a batch system does with a node that
failed. The run's command is that of a user.
"""

import json
import random
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from threading import Event, Thread

import psutil

from benchmarks.instrument.result_page import write_page
from benchmarks.measured_run import orthomill, project_root
from benchmarks.same_everywhere import digests

STARTS = 60.0
"""seconds that the scheduler may take to start"""
MEMORY = "2GiB"


class Node:
    """A nanny with its worker, as `start` starts them. `revived`: how often it had no worker and was started anew."""

    def __init__(self, start: Callable[[], psutil.Process]) -> None:
        self._start, self.revived = start, 0
        self._nanny = start()

    def workers(self) -> list[psutil.Process]:
        """The worker; none where it was killed while it started."""
        with suppress(psutil.NoSuchProcess):
            return [one for one in self._nanny.children(recursive=True) if "spawn_main" in " ".join(one.cmdline())]
        return []

    def kill_worker(self) -> bool:
        """With -9; whether there was one."""
        found = self.workers()
        for worker in found:
            with suppress(psutil.NoSuchProcess):
                worker.kill()
        return bool(found)

    def warn(self) -> None:
        """Ask the nanny to end, as a machine does that is taken away."""
        with suppress(psutil.NoSuchProcess):
            self._nanny.terminate()

    def keep_up(self) -> None:
        """Start anew what has no worker."""
        if not self.workers():
            self.end()
            self._nanny, self.revived = self._start(), self.revived + 1

    def replace(self) -> None:
        """Start another where the nanny has ended by itself."""
        if self._nanny.poll() is not None:
            self._nanny, self.revived = self._start(), self.revived + 1

    def end(self) -> None:
        """Nanny and worker."""
        end(self._nanny)


@contextmanager
def cluster(folder: Path, workers: int) -> Iterator[tuple[str, list[Node]]]:
    """The address of a scheduler of its own, and its workers."""
    with scheduler(folder) as address, ExitStack() as stack:
        words = (address, "--nthreads", "1", "--memory-limit", MEMORY)
        nodes = [Node(lambda: _started(folder, "dask_worker", *words)) for _ in range(workers)]
        for node in nodes:
            stack.callback(node.end)
        yield address, nodes


@contextmanager
def scheduler(folder: Path) -> Iterator[str]:
    """The address of a scheduler."""
    file = folder / "scheduler.json"
    process = _started(folder, "dask_scheduler", "--host", "127.0.0.1", "--port", "0", "--scheduler-file", str(file))
    try:
        until = time.monotonic() + STARTS
        while not (file.exists() and file.read_text().rstrip().endswith("}")) and time.monotonic() < until:
            time.sleep(0.1)
        yield json.loads(file.read_text())["address"]
    finally:
        end(process)


def _started(folder: Path, program: str, *words: str) -> psutil.Process:
    silent = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    return psutil.Popen([sys.executable, "-m", f"distributed.cli.{program}", "--no-dashboard", *words], cwd=folder, **silent)


def end(process: psutil.Process) -> None:
    """A process and all that it started."""
    with suppress(psutil.NoSuchProcess):
        for one in (*process.children(recursive=True), process):
            with suppress(psutil.NoSuchProcess):
                one.kill()
    process.wait(30)


def kill_by_lot(nodes: list[Node], seconds: float, enough: Event, seed: int = 42) -> int:
    """Kill one worker every so many seconds until it is enough; how many were killed."""
    chance, kills = random.Random(seed), 0
    while not enough.wait(seconds):
        for node in nodes:
            node.keep_up()
        kills += chance.choice(nodes).kill_worker()
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
        with cluster(Path(scratch), workers) as (address, nodes):
            killer = Thread(target=lambda: kills.append(kill_by_lot(nodes, seconds, enough)), daemon=True)
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
| of them while they started, and their nannies with them | {sum(node.revived for node in nodes)} |
| the command ended with | {after.code} |
| rasters, tables and products of the undisturbed run | {len(expected)} |
| the same in the storm, byte for byte | {same} |
| others in the storm | {len(set(found) - set(expected))} |
""",
    )
