"""A cluster of pods by the Dask operator: whether it may be asked for, what keeps it from starting, and its end.

Loaded for clusters of this kind only: dask-kubernetes is no part of an ordinary installation.
"""

import asyncio
import json
import logging
import os
import time
import warnings
from collections.abc import Callable
from typing import Any

import httpx
import kr8s.asyncio
from dask_kubernetes.operator import KubeCluster
from dask_kubernetes.operator._objects import DaskCluster
from kr8s.asyncio.objects import Pod

from orthomill.pipeline.engine.clusters.cluster_file import KubernetesCluster
from orthomill.pipeline.engine.clusters.pod_cluster import KIND, Obstacle, new_name, obstacle_of, pod_cluster
from orthomill.pipeline.engine.interruption import stop_if_asked
from orthomill.schemas.errors import ResourceError

ANSWER = 20.0
"""seconds that the API server may take to answer, and the operator to end a cluster"""
LOOKED = 2.0
"""seconds after which it is looked again what the pods do"""
STUCK = 60.0
"""seconds for which a pod may have an obstacle: some go away by themselves"""
RIGHTS = (
    *((verb, KIND, "daskclusters") for verb in ("create", "get", "list", "delete")),
    *((verb, KIND, "daskautoscalers") for verb in ("create", "patch")),
    ("list", KIND, "daskworkergroups"),
    ("list", "", "pods"),
    *((verb, "", "services") for verb in ("get", "list")),
)
"""verb, group and kind; the library lists what it looks for by name"""
FORWARDING = tuple((verb, "", "pods/portforward") for verb in ("get", "create"))
"""what a command that is in no pod needs too: it reaches the scheduler through the API server, of which new ones ask for both"""
REFUSED = (kr8s.ServerError, kr8s.NotFoundError, kr8s.APITimeoutError, kr8s.ConnectionClosedError, httpx.HTTPError)
"""what the library raises beside Python's own errors"""
OPERATOR = "the Dask operator, which whoever runs the cluster installs (https://kubernetes.dask.org)"


class OperatedPods(KubeCluster):
    """The cluster, from its start to its end; `say` tells the user a sentence. Raises ResourceError where it does not start."""

    def __init__(self, asked: KubernetesCluster, say: Callable[[str], None]) -> None:
        self._asked, self._say = asked, say
        self._watching: asyncio.Task[None] | None = None
        self._told = ""
        # Versions of Kubernetes that the library was not tried with, and what is told here in sentences.
        warnings.filterwarnings("ignore", category=UserWarning, module=r"kr8s\.")
        logging.getLogger("dask_kubernetes").setLevel(logging.CRITICAL)
        # Outside, no name of Kubernetes means anything: the library would ask for it for 20 seconds.
        words = {"namespace": asked.namespace, "port_forward_cluster_ip": _outside(), "quiet": True, "shutdown_on_close": False}
        super().__init__(custom_cluster_spec=pod_cluster(asked, new_name(asked)), **words)

    async def _start(self) -> None:
        try:
            async with asyncio.timeout(3600 * self._asked.patience):
                await self._started()
        except REFUSED as error:
            await self._close()
            raise ResourceError(refusal_of(error, self._asked.namespace)) from error
        except TimeoutError as error:
            await self._close()
            why = self._told or "Nothing is known of its pods."
            raise ResourceError(f"The cluster has not started in {self._asked.patience:g} hours, its 'patience'. {why}") from error
        except BaseException:
            await self._close()
            raise

    async def _started(self) -> None:
        await _ask_whether_allowed(self._asked.namespace)
        self.shutdown_on_close = True
        # The library itself waits for ever for a pod that never starts.
        start, watch = asyncio.create_task(super()._start()), asyncio.create_task(self._watch("scheduler"))
        try:
            done, _ = await asyncio.wait({start, watch}, return_when=asyncio.FIRST_COMPLETED)
            for task in done:
                task.result()
        finally:
            start.cancel()
            watch.cancel()
        await self._adapt(minimum=self._asked.least, maximum=self._asked.workers)
        self._watching = asyncio.create_task(self._watch("worker"))

    async def _wait_for_controller(self) -> None:
        """Until the operator has seen the cluster. The library waits for its phase "Running", over which a loaded operator writes
        "Pending" afterwards, and for ever."""
        until = time.monotonic() + STUCK
        cluster = await DaskCluster.get(self.name, namespace=self.namespace, timeout=int(ANSWER))
        while "phase" not in cluster.raw.get("status", {}):
            if time.monotonic() > until:
                raise ResourceError(
                    f"Kubernetes knows of Dask, but nothing comes of a cluster that is asked for: it lacks {OPERATOR}."
                )
            await asyncio.sleep(LOOKED)
            await cluster.async_refresh()

    async def _watch(self, role: str) -> None:
        """Tell what keeps pods from starting. Raises ResourceError where it is the scheduler's and will not go away by itself."""
        since = time.monotonic()
        before: Obstacle | None = None
        while True:
            await asyncio.sleep(LOOKED)
            _end_if_asked()
            found = await self._obstacle(role)
            if found is None or before is None or found.kind != before.kind:
                since, before = time.monotonic(), found
            elif since and time.monotonic() - since > STUCK:
                self._told = f"A pod ({role}) does not start: {found.told}."
                if found.lasts and role == "scheduler":
                    raise ResourceError(f"{self._told} Compare image, secret and claim in the file of the cluster.")
                self._say(f"{self._told} This run waits for it.")
                since = 0.0

    async def _obstacle(self, role: str) -> Obstacle | None:
        labels = {"dask.org/cluster-name": self.name, "dask.org/component": role}
        pods: Any = Pod.list(label_selector=labels, namespace=self.namespace, raw=True)
        found = [obstacle_of(pod) async for pod in pods]
        return next((obstacle for obstacle in found if obstacle), None)

    async def _close(self, timeout: float = ANSWER) -> None:
        if self._watching is not None:
            self._watching.cancel()
        try:
            await super()._close(timeout=timeout)
        except (*REFUSED, OSError, TimeoutError) as error:
            self._say(
                f"The cluster {self.name} could not be ended ({error}); do so with: "
                f"kubectl --namespace {self.namespace} delete daskcluster {self.name}"
            )


def _outside() -> bool:
    """Whether this process is in no pod."""
    return "KUBERNETES_SERVICE_HOST" not in os.environ


def _end_if_asked() -> None:
    try:
        stop_if_asked()
    except KeyboardInterrupt:
        # It would end the thread that all of Dask's connections live in; whoever waits for the start asks again.
        raise ResourceError("The start of the cluster was stopped.") from None


async def _ask_whether_allowed(namespace: str) -> None:
    """Raises ResourceError where there is no Kubernetes, or it does not let its user have a cluster."""
    api = await _api()
    needed = (*RIGHTS, *FORWARDING) if _outside() else RIGHTS
    lacking = [f"{verb} {kind}" for verb, group, kind in needed if not await _allowed(api, namespace, verb, group, kind)]
    if lacking:
        raise ResourceError(
            f"In the namespace {namespace} you may not {', '.join(lacking)}; ask whoever runs the cluster for these rights."
        )


async def _api() -> Any:
    try:
        async with asyncio.timeout(ANSWER):
            return await kr8s.asyncio.api()
    except (httpx.HTTPError, kr8s.APITimeoutError, TimeoutError) as error:
        raise ResourceError(
            f"The API server of Kubernetes that your kubeconfig names does not answer ({str(error) or 'in time'}); "
            "try: kubectl version"
        ) from error
    except kr8s.ServerError as error:
        raise ResourceError(f"Kubernetes does not take your credentials ({error}); try: kubectl auth whoami") from error
    except Exception as error:  # whatever a file of the user's, or a program that it names, makes of reading it
        told = " ".join(str(error).split())
        raise ResourceError(
            f"Nothing here says where Kubernetes is ({told}): neither KUBECONFIG nor ~/.kube/config names an API server with "
            "credentials, and this is no pod; try: kubectl cluster-info"
        ) from error


async def _allowed(api: Any, namespace: str, verb: str, group: str, kind: str) -> bool:
    resource, _, part = kind.partition("/")
    about = {"namespace": namespace, "verb": verb, "group": group, "resource": resource, "subresource": part}
    review = {"apiVersion": "authorization.k8s.io/v1", "kind": "SelfSubjectAccessReview", "spec": {"resourceAttributes": about}}
    words = {"version": "authorization.k8s.io/v1", "url": "selfsubjectaccessreviews", "content": json.dumps(review)}
    async with api.call_api("POST", **words) as answer:
        return bool(answer.json()["status"]["allowed"])


def refusal_of(error: Exception, namespace: str) -> str:
    """What the API server means by refusing a cluster."""
    code = getattr(getattr(error, "response", None), "status_code", None)
    if code == 404 and f'namespaces "{namespace}" not found' in str(error):
        return f"Kubernetes has no namespace {namespace}; name another in the file of the cluster."
    if code == 404:
        return f"Kubernetes knows nothing of Dask: it lacks {OPERATOR}."
    return f"Kubernetes refuses a cluster of Dask ({error})."
