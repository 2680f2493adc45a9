"""A run on Kubernetes whose workers are deleted by lot, and files of clusters with a mistake in each.

python -m benchmarks deleted_pods CLUSTER.yaml s3://BUCKET/PREFIX [SECONDS [PROJECT]]

For whoever has a cluster with the Dask operator: the file, which `orthomill cluster template kubernetes` begins, names an image of
this commit and a secret with the keys of the store; the environment has the same keys, and KUBECONFIG as kubectl takes it. Every so
many seconds the pod of a worker, by lot, is deleted; the operator starts another.
"""

import json
import os
import random
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from textwrap import shorten
from threading import Event, Thread
from unittest.mock import patch

import yaml

from benchmarks.instrument.result_page import write_page
from benchmarks.measured_run import orthomill, project_root
from benchmarks.trust.kept_results import kept
from orthomill.pipeline.engine.clusters.cluster_file import KubernetesCluster, read_cluster
from orthomill.pipeline.storage.depots.bucket import bucket_of
from orthomill.pipeline.storage.depots.folder import Folder

LOOKED = 2.0
"""seconds after which pods are counted again"""
ENDED = 120.0
"""seconds in which the pods of a run that has ended must have gone"""
AWAY = "https://127.0.0.1:1"
"""address of no API server"""


def kubectl(*words: str, namespace: str = "default") -> str:
    """What it says; nothing where it fails."""
    return subprocess.run(["kubectl", "--namespace", namespace, *words], capture_output=True, text=True, timeout=60).stdout


@dataclass
class Pods:
    """The workers of all clusters of this name, and what became of them."""

    asked: KubernetesCluster
    counts: list[int] = field(default_factory=list)
    """of workers that run, at every look"""
    deleted: int = 0

    def found(self, role: str) -> dict[str, bool]:
        """Those of a role by their names, and whether they run and are to go on."""
        answer = kubectl(
            "get", "pods", "--selector", f"dask.org/component={role}", "--output", "json", namespace=self.asked.namespace
        )
        pods = {pod["metadata"]["name"]: pod for pod in json.loads(answer or "{}").get("items", ())}
        return {
            name: pod["status"].get("phase") == "Running" and "deletionTimestamp" not in pod["metadata"]
            for name, pod in pods.items()
            if name.startswith(f"{self.asked.name}-")
        }

    def look(self) -> list[str]:
        """Those of workers that run."""
        running = [name for name, runs in self.found("worker").items() if runs]
        self.counts.append(len(running))
        return running

    def delete_one(self, chance: random.Random) -> None:
        """The pod of a worker, if there is one."""
        if running := self.look():
            kubectl("delete", "pod", chance.choice(running), "--wait=false", namespace=self.asked.namespace)
            self.deleted += 1

    def left(self) -> int:
        """Those that are there when all should have gone."""
        until = time.monotonic() + ENDED
        while (there := {**self.found("worker"), **self.found("scheduler")}) and time.monotonic() < until:
            time.sleep(LOOKED)
        return len(there)


@contextmanager
def storm(asked: KubernetesCluster, seconds: float, seed: int = 42) -> Iterator[Pods]:
    """While this context lasts, pods are counted, and one is deleted every so many seconds."""
    enough, pods, chance = Event(), Pods(asked), random.Random(seed)

    def rage() -> None:
        last = time.monotonic()
        while not enough.wait(LOOKED):
            if time.monotonic() - last < seconds:
                pods.look()
            else:
                last = time.monotonic()
                pods.delete_one(chance)

    thread = Thread(target=rage, daemon=True)
    thread.start()
    yield pods
    enough.set()
    thread.join()


def mistakes(folder: Path) -> Iterator[tuple[str, dict[str, object], dict[str, str]]]:
    """What is wrong, what the file then says, and the environment."""
    away = folder / "kubeconfig"
    named = {"clusters": [{"name": "k", "cluster": {"server": AWAY}}], "users": [{"name": "u", "user": {"token": "t"}}]}
    context = {"contexts": [{"name": "c", "context": {"cluster": "k", "user": "u"}}], "current-context": "c"}
    away.write_text(json.dumps({"apiVersion": "v1", "kind": "Config", **named, **context}))
    yield "no kubeconfig", {}, {"KUBECONFIG": str(folder / "absent")}
    yield "an API server that is away", {}, {"KUBECONFIG": str(away)}
    yield "a namespace that is not there", {"namespace": "absent"}, {}
    yield "an image that is not there", {"image": "registry.invalid/orthomill:1"}, {}
    yield "a secret that is not there", {"secret": "absent"}, {}
    yield "workers that no node has room for, waited for a minute and a half", {"memory": 1000, "patience": 0.025}, {}


def refused(root: Path, project: str, file: Path, store: str) -> Iterator[str]:
    """A line of the table for each mistake."""
    right = yaml.safe_load(file.read_text())
    for what, changes, environment in mistakes(root):
        wrong = root / "wrong.yaml"
        wrong.write_text(yaml.safe_dump(right | changes))
        with patch.dict(os.environ, environment):
            run = orthomill(root, "run", project, "--cluster", str(wrong), "--store", store)
        told = shorten(run.output.strip().splitlines()[-1].replace("|", "/"), 220, placeholder=" ...")
        yield f"| {what} | {told} | {run.code} | {run.seconds:.0f} s | {'yes' if 'Traceback' in run.output else 'no'} |"


def main(words: list[str]) -> None:
    """Runs the project undisturbed in a folder and in the storm on the cluster, compares the two, and writes the page."""
    if len(words) < 2:
        raise SystemExit("python -m benchmarks deleted_pods CLUSTER.yaml s3://BUCKET/PREFIX [SECONDS [PROJECT]]")
    file, store = Path(words[0]).resolve(), words[1]
    seconds = float(words[2]) if words[2:] else 30.0
    project = words[3] if words[3:] else "volos_small"
    asked = read_cluster(file)
    if not isinstance(asked, KubernetesCluster):
        raise SystemExit(f"{file.name} names no cluster of the kind kubernetes.")
    with tempfile.TemporaryDirectory() as scratch:
        calm, stormy = project_root(Path(scratch) / "calm", project), project_root(Path(scratch) / "storm", project)
        lines = list(refused(project_root(Path(scratch) / "refused", project), project, file, f"{store}/refused"))
        before = orthomill(calm, "run", project, "--workers", "2")
        if before.code:
            raise SystemExit(before.output)
        with storm(asked, seconds) as pods:
            after = orthomill(stormy, "run", project, "--cluster", str(file), "--store", store)
        if after.code:
            print(after.output)
        left = pods.left()
        expected, found = kept(Folder(calm / "runs" / project)), kept(bucket_of(f"{store}/{project}"))
        orthomill(stormy, "clean", project)
    same = sum(found.get(name) == digest for name, digest in expected.items())
    table, version = "\n".join(lines), json.loads(kubectl("version", "--output", "json"))["serverVersion"]["gitVersion"]
    write_page(
        "deleted_pods",
        words,
        f"""# Pods that are deleted, and files of clusters with a mistake

Project `{project}` on Kubernetes {version} with the Dask operator, {asked.least} to {asked.workers} workers with
nothing in common but an object store. The pod of one worker, by lot, is deleted every {seconds:g} s.

| what | figure |
| --- | --- |
| workers that ran at once, at most | {max(pods.counts)} |
| pods deleted | {pods.deleted} |
| the command ended with | {after.code} |
| rasters, tables and products of the undisturbed run in a folder | {len(expected)} |
| the same in the store, byte for byte | {same} |
| others in the store | {len(set(found) - set(expected))} |
| pods left two minutes after the end | {left} |
| the command took | {after.seconds:.0f} s; in a folder, with two workers, {before.seconds:.0f} s |

| what is wrong | what the command says | ended with | after | a traceback |
| --- | --- | --- | --- | --- |
{table}
""",
    )
