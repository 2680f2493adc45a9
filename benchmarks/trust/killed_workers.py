"""Workers of a cluster that are killed with -9 again and again: does the run end whole, with the same bytes?

python -m benchmarks killed_workers [SECONDS [PROJECT [WORKERS]]]

Every so many seconds a worker process, by lot, is killed; the nanny beside it starts another. Where it is killed while it starts,
Dask's nanny ends, or stays without a worker: then the nanny is started anew, as Kubernetes or a batch system does with a node that
failed. The run's command is that of a user.
"""

import random
import tempfile
from pathlib import Path
from threading import Event, Thread

from benchmarks.instrument.result_page import write_page
from benchmarks.measured_run import orthomill, project_root
from benchmarks.same_everywhere import digests
from benchmarks.trust.cluster_nodes import Node, cluster


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
        with cluster(Path(scratch)) as office:
            nodes = [office.join() for _ in range(workers)]
            killer = Thread(target=lambda: kills.append(kill_by_lot(nodes, seconds, enough)), daemon=True)
            killer.start()
            after = orthomill(storm, "run", project, "--scheduler", office.address)
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
