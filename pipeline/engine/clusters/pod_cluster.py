"""What the Dask operator is asked for: a pod with the scheduler, pods with a worker each, and how many of these there may be."""

from dataclasses import dataclass
from secrets import token_hex
from typing import Any

from orthomill.pipeline.engine.clusters.cluster_file import KubernetesCluster

KIND = "kubernetes.dask.org"
"""group of the operator's kinds"""
FORSAKEN = 3600
"""seconds without any work after which the operator ends a cluster: that of a command which was killed"""
COMM, PAGES = 8786, 8787
"""ports of the scheduler, for jobs and for its web pages"""
ORDINARY = ("ContainerCreating", "PodInitializing")
"""what a container waits for that is about to start"""


def new_name(asked: KubernetesCluster) -> str:
    """A name of its own for each run: a second run in the namespace would share the first one's workers, and end with them."""
    return f"{asked.name}-{token_hex(3)}"


def pod_cluster(asked: KubernetesCluster, name: str) -> dict[str, Any]:
    """The DaskCluster of this name."""
    # The commands of Dask as the image knows them: dask-scheduler and dask-worker, which the library would start, are gone.
    worker = ["dask", "worker", "--nthreads", "1", "--memory-limit", f"{asked.memory:.3f}GiB", "--name", "$(DASK_WORKER_NAME)"]
    scheduler = _pod(asked, "scheduler", ["dask", "scheduler", "--host", "0.0.0.0"])  # noqa: S104 (of its pod)
    alive = {"httpGet": {"port": "http-dashboard", "path": "/health"}}
    scheduler["containers"][0] |= {
        "ports": [{"name": "tcp-comm", "containerPort": COMM}, {"name": "http-dashboard", "containerPort": PAGES}],
        "readinessProbe": {**alive, "periodSeconds": 2, "timeoutSeconds": 30},
    }
    return {
        "apiVersion": f"{KIND}/v1",
        "kind": "DaskCluster",
        "metadata": {"name": name},
        "spec": {
            "idleTimeout": FORSAKEN,
            "worker": {"replicas": asked.least, "spec": _pod(asked, "worker", worker)},
            "scheduler": {"spec": scheduler, "service": _service(name)},
        },
    }


def _service(name: str) -> dict[str, Any]:
    ports = (("tcp-comm", COMM), ("http-dashboard", PAGES))
    return {
        "type": "ClusterIP",
        "selector": {"dask.org/cluster-name": name, "dask.org/component": "scheduler"},
        "ports": [{"name": port, "protocol": "TCP", "port": number, "targetPort": port} for port, number in ports],
    }


def _pod(asked: KubernetesCluster, role: str, command: list[str]) -> dict[str, Any]:
    """A pod that sees the volume of the project's folder, or has the keys of an object store."""
    limit = f"{asked.memory:.3f}Gi"
    resources = {"requests": {"cpu": "1", "memory": limit}, "limits": {"memory": limit}}
    container: dict[str, Any] = {"name": role, "image": asked.image, "args": command, "resources": resources}
    # What it said last is then told beside the fact that it does not start.
    container["terminationMessagePolicy"] = "FallbackToLogsOnError"
    pod: dict[str, Any] = {"containers": [container]}
    if asked.claim is not None:
        pod["volumes"] = [{"name": "projects", "persistentVolumeClaim": {"claimName": asked.claim}}]
        container["volumeMounts"] = [{"name": "projects", "mountPath": asked.mount}]
    if asked.secret is not None:
        container["envFrom"] = [{"secretRef": {"name": asked.secret}}]
    return pod


@dataclass(frozen=True)
class Obstacle:
    """What keeps a pod from starting: its kind, in words, and whether it lasts until somebody does something."""

    kind: str
    told: str
    lasts: bool


def obstacle_of(pod: dict[str, Any]) -> Obstacle | None:
    """What Kubernetes says of a pod that does not start; None where it has, or is about to."""
    status = pod.get("status", {})
    for container in status.get("containerStatuses", ()):
        waits = container.get("state", {}).get("waiting", {})
        if waits and waits.get("reason") not in ORDINARY:
            ended = container.get("lastState", {}).get("terminated", {})
            why = ended.get("message") or waits.get("message") or "no more is known"
            kind = "the image" if "Image" in waits["reason"] else "the container"
            return Obstacle(kind, f"{waits['reason']}, {' '.join(why.split())}", lasts=True)
        if "running" in container.get("state", {}) and not container.get("ready", True):
            return Obstacle(
                "no answer", "its program runs and does not answer, perhaps since the image is another one", lasts=False
            )
    for condition in status.get("conditions", ()):
        if condition.get("reason") == "Unschedulable":
            return Obstacle("no room", condition.get("message", "no node has room for it").rstrip("."), lasts=False)
    return None
