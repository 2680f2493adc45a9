"""Clusters of pods: what the operator is asked for, what is said of pods that do not start, and sentences before the first one."""

import importlib
import json
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from threading import Thread
from types import SimpleNamespace

import pytest

from orthomill.pipeline.engine.clusters.cluster_file import KubernetesCluster
from orthomill.pipeline.engine.clusters.pod_cluster import new_name, obstacle_of, pod_cluster
from orthomill.pipeline.engine.clusters.started_clusters import started_client
from orthomill.schemas.errors import ResourceError

ASKED = KubernetesCluster(kind="kubernetes", image="registry.example/orthomill:1", secret="store", least=2, memory=1.5)


def pods_of(asked=ASKED):
    spec = pod_cluster(asked, "site-1")["spec"]
    return spec, spec["scheduler"]["spec"], spec["worker"]["spec"]


def test_pods_start_with_the_commands_that_dask_and_the_image_have():
    spec, scheduler, worker = pods_of()
    assert scheduler["containers"][0]["args"][:2] == ["dask", "scheduler"]
    assert worker["containers"][0]["args"][:4] == ["dask", "worker", "--nthreads", "1"]
    # By its name the operator ends the worker that the scheduler has let go.
    assert worker["containers"][0]["args"][-2:] == ["--name", "$(DASK_WORKER_NAME)"]
    assert spec["worker"]["replicas"] == 2
    assert worker["containers"][0]["resources"]["limits"] == {"memory": "1.500Gi"}


def test_the_service_finds_the_ports_of_the_scheduler():
    spec, scheduler, _ = pods_of()
    named = {port["name"]: port["containerPort"] for port in scheduler["containers"][0]["ports"]}
    assert {port["targetPort"]: port["port"] for port in spec["scheduler"]["service"]["ports"]} == named
    assert spec["scheduler"]["service"]["selector"]["dask.org/cluster-name"] == "site-1"


def test_pods_see_the_volume_of_the_project_or_have_the_keys_of_a_store():
    for pod in pods_of()[1:]:
        assert pod["containers"][0]["envFrom"] == [{"secretRef": {"name": "store"}}] and "volumes" not in pod
    for pod in pods_of(KubernetesCluster(kind="kubernetes", image="a", claim="projects", mount="/projects"))[1:]:
        assert pod["volumes"][0]["persistentVolumeClaim"] == {"claimName": "projects"}
        assert pod["containers"][0]["volumeMounts"] == [{"name": "projects", "mountPath": "/projects"}]


def test_every_run_has_a_cluster_of_its_own_which_ends_when_it_is_forsaken():
    assert new_name(ASKED) != new_name(ASKED) and new_name(ASKED).startswith("orthomill-")
    assert pods_of()[0]["idleTimeout"] == 3600


def waits(reason, message=None, ended=None):
    return {
        "status": {
            "containerStatuses": [
                {
                    "state": {"waiting": {"reason": reason, **({"message": message} if message else {})}},
                    "lastState": {"terminated": ended} if ended else {},
                }
            ]
        }
    }


NO_ROOM = {"type": "PodScheduled", "status": "False", "reason": "Unschedulable", "message": "0/3 nodes: 3 Insufficient memory."}


@pytest.mark.parametrize(
    ("pod", "told", "lasts"),
    [
        (waits("ImagePullBackOff", "Back-off pulling image"), "ImagePullBackOff, Back-off pulling image", True),
        (waits("CreateContainerConfigError", 'secret "a" not found'), 'CreateContainerConfigError, secret "a" not found', True),
        (waits("CrashLoopBackOff", "back-off", {"exitCode": 1, "message": "no\nmodule"}), "CrashLoopBackOff, no module", True),
        (waits("CrashLoopBackOff"), "CrashLoopBackOff, no more is known", True),
        (
            {"status": {"containerStatuses": [{"state": {"running": {}}, "ready": False}]}},
            "its program runs and does not answer",
            False,
        ),
        ({"status": {"conditions": [NO_ROOM]}}, "0/3 nodes: 3 Insufficient memory", False),
    ],
)
def test_what_keeps_a_pod_from_starting_is_said(pod, told, lasts):
    found = obstacle_of(pod)
    assert found.told.startswith(told) and found.lasts == lasts


@pytest.mark.parametrize("pod", [{}, {"status": {"conditions": []}}, waits("ContainerCreating"), waits("PodInitializing")])
def test_nothing_keeps_a_pod_that_is_about_to_start(pod):
    assert obstacle_of(pod) is None


def test_a_pull_that_fails_and_waits_by_turns_is_one_obstacle():
    assert obstacle_of(waits("ErrImagePull", "a")).kind == obstacle_of(waits("ImagePullBackOff", "b")).kind


class ApiServer(BaseHTTPRequestHandler):
    """Knows its version, and lets nobody do anything."""

    def answer(self, body, code=200):
        text = json.dumps(body).encode()
        self.send_response(code)
        self.send_header("Content-Type", "application/json")
        self.send_header("Content-Length", str(len(text)))
        self.end_headers()
        self.wfile.write(text)

    def do_GET(self):
        if self.headers.get("Authorization") != "Bearer known":
            return self.answer({"message": "Unauthorized"}, 401)
        return self.answer({"gitVersion": "v1.31.0"})

    def do_POST(self):
        self.rfile.read(int(self.headers["Content-Length"]))
        self.answer({"status": {"allowed": False}}, 201)

    def log_message(self, *words):
        pass


@pytest.fixture
def kubeconfig(tmp_path, monkeypatch):
    """Writes one that names a server and a token; returns how."""
    pytest.importorskip("dask_kubernetes", reason="dask-kubernetes is not installed: pip install 'orthomill[kubernetes]'")
    monkeypatch.delenv("KUBERNETES_SERVICE_HOST", raising=False)
    monkeypatch.setenv("KUBECONFIG", str(tmp_path / "kubeconfig"))

    def write(server, token="known"):
        user = {"name": "u", "user": {"token": token}}
        context = {"name": "c", "context": {"cluster": "k", "user": "u"}}
        known = {"clusters": [{"name": "k", "cluster": {"server": server}}], "users": [user], "contexts": [context]}
        (tmp_path / "kubeconfig").write_text(json.dumps(known | {"apiVersion": "v1", "kind": "Config", "current-context": "c"}))

    return write


@pytest.fixture
def server():
    with ThreadingHTTPServer(("127.0.0.1", 0), ApiServer) as running:
        Thread(target=running.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{running.server_port}"
        running.shutdown()


def refusal(capfd):
    with pytest.raises(ResourceError) as caught, started_client(ASKED, 8787):
        pass
    assert "Traceback" not in "".join(capfd.readouterr())
    return str(caught.value)


def test_rights_that_are_missing_are_named(kubeconfig, server, capfd):
    kubeconfig(server)
    told = refusal(capfd)
    assert "In the namespace default you may not create daskclusters" in told and "pods/portforward" in told


def test_who_has_no_way_to_kubernetes_is_told_so(kubeconfig, server, tmp_path, capfd):
    assert "Nothing here says where Kubernetes is" in refusal(capfd)
    (tmp_path / "kubeconfig").write_text("{a: [")
    assert "Nothing here says where Kubernetes is" in refusal(capfd)
    kubeconfig("http://127.0.0.1:1")
    assert "API server of Kubernetes that your kubeconfig names does not answer" in refusal(capfd)
    kubeconfig(server, "unknown")
    assert "does not take your credentials (Unauthorized)" in refusal(capfd)


@pytest.mark.parametrize(
    ("code", "message", "told"),
    [
        (404, 'namespaces "a" not found', "has no namespace a"),
        # So answers an API server that does not know the kind.
        (404, "Client error '404 Not Found' for url '/namespaces/a/daskclusters'", "lacks the Dask operator"),
        (403, "pods is forbidden: exceeded quota", "refuses a cluster of Dask (pods is forbidden: exceeded quota)"),
    ],
)
def test_what_the_server_means_is_said(kubeconfig, code, message, told):
    operated = importlib.import_module("orthomill.pipeline.engine.clusters.operated_pods")
    error = importlib.import_module("kr8s").ServerError(message, response=SimpleNamespace(status_code=code))
    assert told in operated.refusal_of(error, "a")
