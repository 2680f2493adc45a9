"""A Dask cluster for studies: a scheduler and its workers, processes of this machine that can be ended at any moment."""

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

import psutil

from benchmarks.instrument.result_page import ROOT

STARTS = 60.0
"""seconds that the scheduler may take to start"""
MEMORY = "2GiB"


class Node:
    """A nanny with its worker, or a worker alone, as `start` starts them. `revived`: how often it had no worker and was started
    anew."""

    def __init__(self, start: Callable[[], psutil.Popen]) -> None:
        self._start, self.revived = start, 0
        self._process = start()

    @property
    def pid(self) -> int:
        """Of the nanny, or of the worker that is alone."""
        return self._process.pid

    def workers(self) -> list[psutil.Process]:
        """The worker of a nanny; none where it was killed while it started."""
        with suppress(psutil.NoSuchProcess):
            return [one for one in self._process.children(recursive=True) if "spawn_main" in " ".join(one.cmdline())]
        return []

    def kill_worker(self) -> bool:
        """That of a nanny, with -9; whether there was one."""
        found = self.workers()
        for worker in found:
            with suppress(psutil.NoSuchProcess):
                worker.kill()
        return bool(found)

    def warn(self) -> None:
        """Ask it to end, as a machine does that is taken away."""
        with suppress(psutil.NoSuchProcess):
            self._process.terminate()

    def keep_up(self) -> None:
        """Start anew what has no worker."""
        if not self.workers():
            self.end()
            self._begin_anew()

    def replace(self) -> None:
        """Start another where it has ended by itself."""
        if self._process.poll() is not None:
            self._begin_anew()

    def _begin_anew(self) -> None:
        self._process, self.revived = self._start(), self.revived + 1

    def end(self) -> None:
        """With -9, and all that it started."""
        _end(self._process)


@dataclass(frozen=True)
class Apart:
    """A machine of its own, as far as that goes here: home, temporary and scratch folder below `own`, and `hidden` folders in whose
    place it sees empty ones (a mount of its own, by `unshare`)."""

    own: Path
    hidden: tuple[Path, ...]

    def started(self, command: list[str]) -> psutil.Popen:
        """A program that runs there; what it says is in own/log."""
        places = {name: self.own / place for name, place in (("HOME", "home"), ("TMPDIR", "tmp"), ("ORTHOMILL_SCRATCH", "scratch"))}
        for place in places.values():
            place.mkdir(parents=True, exist_ok=True)
        mounts = " && ".join(f"mount -t tmpfs none '{folder}'" for folder in self.hidden)
        words = ["unshare", "--mount", "--map-root-user", "sh", "-c", f'{mounts} && exec "$@"', "sh", *command]
        with (self.own / "log").open("ab") as log:
            return psutil.Popen(words, cwd=places["TMPDIR"], env=_environment(**places), stdout=log, stderr=log)


class Cluster:
    """A scheduler at an `address`, and the nodes that have joined it, in their order."""

    def __init__(self, folder: Path, address: str, stack: ExitStack) -> None:
        self._folder, self._stack = folder, stack
        self.address = address
        self.nodes: list[Node] = []

    def join(self, *words: str, apart: Apart | None = None) -> Node:
        """A node more, a nanny with a worker unless `words` of the worker's command say otherwise; with MEMORY where they name
        none."""
        memory = () if "--memory-limit" in words else ("--memory-limit", MEMORY)
        command = _program("dask_worker", self.address, "--nthreads", "1", *memory, *words)
        node = Node(lambda: apart.started(command) if apart else _silent(command, self._folder))
        self._stack.callback(node.end)
        self.nodes.append(node)
        return node


@contextmanager
def cluster(folder: Path) -> Iterator[Cluster]:
    """A scheduler without workers; whatever joins it ends with it."""
    file = folder / "scheduler.json"
    words = ("--host", "127.0.0.1", "--port", "0", "--scheduler-file", str(file))
    process = _silent(_program("dask_scheduler", *words), folder)
    with ExitStack() as stack:
        stack.callback(_end, process)
        until = time.monotonic() + STARTS
        while not (file.exists() and file.read_text().rstrip().endswith("}")) and time.monotonic() < until:
            time.sleep(0.1)
        yield Cluster(folder, json.loads(file.read_text())["address"], stack)


def _program(name: str, *words: str) -> list[str]:
    return [sys.executable, "-m", f"distributed.cli.{name}", "--no-dashboard", *words]


def _silent(command: list[str], folder: Path) -> psutil.Popen:
    return psutil.Popen(command, cwd=folder, env=_environment(), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def _environment(**more: Path) -> dict[str, str]:
    """Workers find the studies, of which some have stages of their own."""
    return os.environ | {"PYTHONPATH": str(ROOT)} | {name: str(place) for name, place in more.items()}


def _end(process: psutil.Popen) -> None:
    with suppress(psutil.NoSuchProcess):
        for one in (*process.children(recursive=True), process):
            with suppress(psutil.NoSuchProcess):
                one.kill()
    process.wait(30)
