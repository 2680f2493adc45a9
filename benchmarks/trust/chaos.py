"""Runs that are killed in every way a machine knows, and stores that rot: is the result the same bit for bit?

`python -m benchmarks chaos --kills 100 --damages 200 --seed 0` uses the small simulated project on two workers. A run is hit
after a random time, and the next one goes on from there, is hit in its turn, until the project is complete: then every raster and
table is compared with those of a run that nobody disturbed. After every blow no process is left and no traceback was printed.
"""

import argparse
import json
import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import psutil

from benchmarks.instrument.result_page import write_page
from benchmarks.measured_run import project_root
from benchmarks.same_everywhere import PROJECT, digests
from orthomill.pipeline.records.power_cut import NOTE

AT_ONCE = 50
"""files that are damaged before the project is mended"""
EARLIEST, LATEST = 4.0, 14.0
"""seconds after which a run is struck; on a loaded machine most of it is spent before the first job (--latest)"""
STOPPED = 3.0
"""seconds for which a run is stopped (SIGSTOP)"""
HANGS = 1800.0
"""seconds after which a run counts as hanging; on a loaded machine compiling the kernels alone takes minutes"""


class Broken(Exception):
    """Something that must not happen."""


class Run:
    """One start of `orthomill VERB` in a process group of its own; `limit`: bytes of the largest file it may write."""

    def __init__(self, root: Path, *words: str, verb: str = "run", limit: int | None = None) -> None:
        self.log = root / "said.txt"
        command = [Path(sys.executable).parent / "orthomill", verb, PROJECT, *words]
        before = None if limit is None else lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
        with self.log.open("w") as out:
            self.process = subprocess.Popen(
                command, cwd=root, stdout=out, stderr=subprocess.STDOUT, start_new_session=True, preexec_fn=before
            )

    def wait(self, seconds: float) -> bool:
        """Whether it has ended after so many seconds."""
        try:
            self.process.wait(seconds)
        except subprocess.TimeoutExpired:
            return False
        return True

    def children(self) -> list[psutil.Process]:
        try:
            return psutil.Process(self.process.pid).children(recursive=True)
        except psutil.NoSuchProcess:
            return []

    def workers(self) -> list[psutil.Process]:
        return [child for child in self.children() if "spawn_main" in " ".join(child.cmdline())]

    def said(self) -> str:
        return self.log.read_text(errors="replace")


def hit_group(run: Run) -> None:
    """The whole process group at once."""
    os.killpg(run.process.pid, signal.SIGKILL)


def hit_main(run: Run) -> None:
    """The process of the command, which is the scheduler as well; its workers have to notice."""
    run.process.kill()


def hit_worker(run: Run) -> None:
    """One worker; the run goes on without it."""
    for worker in run.workers()[:1]:
        worker.kill()


def interrupt(run: Run) -> None:
    """Ctrl-C at a terminal."""
    os.killpg(run.process.pid, signal.SIGINT)


def terminate(run: Run) -> None:
    """What batch systems do."""
    run.process.terminate()


def pause(run: Run) -> None:
    """A laptop that is closed and opened again; the run goes on."""
    os.killpg(run.process.pid, signal.SIGSTOP)
    time.sleep(STOPPED)
    os.killpg(run.process.pid, signal.SIGCONT)


BLOWS: dict[str, Callable[[Run], None]] = {
    "group": hit_group,
    "main": hit_main,
    "worker": hit_worker,
    "INT": interrupt,
    "TERM": terminate,
    "STOP/CONT": pause,
    "power cut": hit_group,
}
GOES_ON = ("worker", "STOP/CONT")
# A signal that comes while Python is still importing ends the process as the system does by default.
ENDS = (0, 130, -signal.SIGKILL, -signal.SIGTERM, -signal.SIGINT)
KINDS = (*BLOWS, "scheduler", "disk full")


def lose_unsynced(folder: Path, chance: random.Random) -> None:
    """What a power cut does: files that are younger than the last flush are lost, empty, cut or whole."""
    note = folder / NOTE
    flushed = json.loads(note.read_text()) if note.exists() else {"time": 0.0}
    for path in sorted(path for path in folder.rglob("*") if path.is_file() and path != note):
        status = path.stat()
        if status.st_mtime < flushed["time"]:
            continue
        how = chance.choice(("gone", "zeros", "short", "whole"))
        if how == "gone":
            path.unlink()
        elif how != "whole":
            path.write_bytes(bytes(status.st_size) if how == "zeros" else path.read_bytes()[: status.st_size // 2])
            os.utime(path, ns=(status.st_atime_ns, status.st_mtime_ns))
    if note.exists():
        note.write_text(json.dumps(flushed | {"boot": "another"}))


@contextmanager
def own_cluster(folder: Path) -> Iterator[tuple[subprocess.Popen, str]]:
    """A scheduler and two workers that somebody else started; the scheduler's process and its address."""
    file = folder / "scheduler.json"
    common = ["--scheduler-file", str(file), "--no-dashboard"]
    silent = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    programs = "distributed.cli.dask_scheduler", "distributed.cli.dask_worker"
    scheduler = subprocess.Popen([sys.executable, "-m", programs[0], "--host", "127.0.0.1", "--port", "0", *common], **silent)
    workers = subprocess.Popen([sys.executable, "-m", programs[1], "--nworkers", "2", "--nthreads", "1", *common], **silent)
    try:
        while not file.exists():
            time.sleep(0.1)
        time.sleep(3)
        yield scheduler, json.loads(file.read_text())["address"]
    finally:
        for process in (workers, scheduler):
            process.terminate()
            process.wait(60)
        file.unlink(missing_ok=True)


def struck(root: Path, kind: str, seconds: float, chance: random.Random) -> bool:
    """Start a run and strike after so many seconds; whether the project is complete afterwards. Raises Broken."""
    if kind == "disk full":
        run = Run(root, "--workers", "2", limit=chance.choice((4_000, 30_000, 100_000)))
        return _ended(run, (0, 1, 2))
    if kind == "scheduler":
        with own_cluster(root) as (scheduler, address):
            run = Run(root, "--scheduler", address)
            if not run.wait(seconds):
                scheduler.kill()
            return _ended(run, (0, 1, 2))
    run = Run(root, "--workers", "2")
    if run.wait(seconds):
        return _ended(run, (0,))
    children = run.children()
    BLOWS[kind](run)
    done = _ended(run, (0,) if kind in GOES_ON else ENDS)
    _, alive = psutil.wait_procs(children, timeout=60)
    if alive:
        raise Broken(f"{kind}: left {alive}")
    if kind == "power cut":
        lose_unsynced(root / "runs" / PROJECT, chance)
    return done


def _ended(run: Run, codes: tuple[int, ...]) -> bool:
    if not run.wait(HANGS):
        os.killpg(run.process.pid, signal.SIGKILL)
        raise Broken(f"hangs:\n{run.said()[-2000:]}")
    said = run.said()
    if "Traceback" in said or "unexpected" in said or run.process.returncode not in codes:
        raise Broken(f"exit code {run.process.returncode}:\n{said[-3000:]}")
    return run.process.returncode == 0


def kills(folder: Path, reference: dict[str, str], count: int, latest: float, chance: random.Random, counted: Counter[str]) -> None:
    """Strike so many runs, and count them by kind, and the projects that they completed. Raises Broken."""
    struck_runs, waiting = 0, Counter[str]()
    root = project_root(folder / "struck", PROJECT)
    order = [KINDS[i % len(KINDS)] for i in range(count)]
    chance.shuffle(order)
    while order:
        kind = order.pop()
        # A power cut that comes after the end may take what the end was believed on: the next run looks again.
        seconds = chance.uniform(EARLIEST, latest)
        done = struck(root, kind, seconds, chance) and kind != "power cut"
        struck_runs, waiting[kind] = struck_runs + 1, waiting[kind] + 1
        print(f"{struck_runs}/{count} {kind} after {seconds:.0f} s{': complete' if done else ''}", flush=True)
        if not order and not done:
            done = _ended(Run(root, "--workers", "2"), (0,))
        # Only what led to a complete project is known to have lost nothing.
        if done:
            _compare(root, reference)
            counted.update(waiting + Counter(projects=1))
            waiting.clear()
            shutil.rmtree(root / "runs")


def _compare(root: Path, reference: dict[str, str]) -> None:
    found = digests(root / "runs" / PROJECT)
    if found != reference:
        differ = sorted(name for name in found.keys() | reference.keys() if found.get(name) != reference.get(name))
        raise Broken(f"{len(differ)} results differ: {differ[:10]}")


def damage(path: Path, how: str, chance: random.Random) -> None:
    """Delete, cut or flip a file; its time of change does not tell."""
    before, content = path.stat(), bytearray(path.read_bytes())
    if how == "deleted":
        path.unlink()
        return
    if how == "cut":
        del content[chance.randrange(len(content)) :]
    else:
        content[chance.randrange(len(content))] ^= 1 << chance.randrange(8)
    path.write_bytes(content)
    os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))


def damages(root: Path, reference: dict[str, str], count: int, chance: random.Random, counted: Counter[str]) -> None:
    """Damage so many files, and count those that were found and mended by kind. Raises Broken."""
    folder = root / "runs" / PROJECT
    while sum(counted.values()) < count:
        files = sorted(path for part in ("rasters.zarr", "tables", "jobs") for path in (folder / part).rglob("*") if path.is_file())
        files = [path for path in files if path.parent.name != "jobs"]
        hit = {path: chance.choice(("deleted", "cut", "flipped")) for path in chance.sample(files, AT_ONCE)}
        for path, how in hit.items():
            damage(path, how, chance)
        _ended(Run(root, verb="verify"), (0, 1))
        _ended(Run(root, "--workers", "2"), (0,))
        _compare(root, reference)
        _ended(Run(root, verb="verify"), (0,))
        kinds = {path: {"jobs": "record", "tables": "table"}.get(path.relative_to(folder).parts[0], "chunk") for path in hit}
        counted.update(f"{kinds[path]} {how}" for path, how in hit.items())
        print(f"{sum(counted.values())}/{count} files damaged and mended", flush=True)


def page(struck_runs: Counter[str], damaged: Counter[str], latest: float) -> str:
    """The page of results."""
    projects = struck_runs.pop("projects", 0)
    lines = [
        "# Runs that are killed, and stores that rot",
        "",
        f"Project `{PROJECT}`, two workers. Every row went on to results that are those of an undisturbed run bit for bit, left no",
        "process behind and printed no traceback.",
        "",
        f"{sum(struck_runs.values())} runs were struck after {EARLIEST:.0f} to {latest:.0f} s, in the course of {projects}",
        "complete projects:",
        "",
        "| struck | times |",
        "| --- | --- |",
        *(f"| {kind} | {number} |" for kind, number in sorted(struck_runs.items())),
        "",
        f"{sum(damaged.values())} files of a finished project were damaged, {AT_ONCE} at a time, without changing their times:",
        "",
        "| file | times |",
        "| --- | --- |",
        *(f"| {kind} | {number} |" for kind, number in sorted(damaged.items())),
        "",
    ]
    return "\n".join(lines)


def main(words: list[str]) -> None:
    """Strike, damage, and write the page."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks chaos", description=__doc__)
    parser.add_argument("--kills", type=int, default=100)
    parser.add_argument("--damages", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--latest", type=float, default=LATEST)
    options = parser.parse_args(words)
    chance = random.Random(options.seed)
    struck_runs, damaged = Counter[str](), Counter[str]()
    with suppress(KeyboardInterrupt), tempfile.TemporaryDirectory(prefix="chaos-") as scratch:
        quiet = project_root(Path(scratch) / "quiet", PROJECT)
        _ended(Run(quiet, "--workers", "2"), (0,))
        reference = digests(quiet / "runs" / PROJECT)
        damages(quiet, reference, options.damages, chance, damaged)
        kills(Path(scratch), reference, options.kills, options.latest, chance, struck_runs)
    write_page("chaos", words, page(struck_runs, damaged, options.latest))
