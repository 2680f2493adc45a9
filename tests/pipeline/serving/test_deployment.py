"""Images and charts start the command with options that it has, as nobody and on a read-only root; linters where they are there."""

import json
import re
import shutil
import subprocess
from pathlib import Path

import pytest
import yaml
from typer.main import get_command

from orthomill import __version__
from orthomill.pipeline.cli.commands.application import app
from orthomill.pipeline.serving.queue.task_process import TaskOrder, _run_words
from orthomill.pipeline.serving.queue.wishes import Wishes

DEPLOY = Path(__file__).parents[3] / "deploy"
DOCKERFILE = (DEPLOY / "Dockerfile").read_text()
CHART = (DEPLOY / "helm/orthomill/templates/node.yaml").read_text()
CLUSTER = (DEPLOY / "helm/orthomill/templates/cluster.yaml").read_text()
SYSTEMS = DEPLOY.parent / ".github/workflows/systems.yml"


def test_the_options_of_image_and_chart_are_those_of_the_command():
    serve = get_command(app).commands["serve"]
    known = {option for parameter in serve.params for option in parameter.opts + parameter.secondary_opts}
    words = json.loads(re.findall(r"^CMD (\[.*\])$", DOCKERFILE, re.MULTILINE)[-1])
    asked = [word.split("=")[0] for word in [*words, *re.findall(r"- (--[a-z0-9-]+)", CHART)] if word.startswith("--")]
    assert words[0] == "serve" and {"--tasks", "--memory", "--keep-days", "--s3", "--host", "--scheduler"} == set(asked) <= known


def test_the_chart_is_that_of_the_version():
    assert yaml.safe_load((DEPLOY / "helm/orthomill/Chart.yaml").read_text())["appVersion"] == __version__


def test_nothing_runs_as_root_or_writes_where_it_must_not():
    assert re.search(r"^USER 10001$", DOCKERFILE, re.MULTILINE) and "HEALTHCHECK" in DOCKERFILE and "--constraint" in DOCKERFILE
    node = yaml.safe_load((DEPLOY / "compose.yaml").read_text())["services"]["orthomill"]
    assert node["read_only"] and node["cap_drop"] == ["ALL"] and node["ports"] == ["127.0.0.1:3000:3000"]
    assert "readOnlyRootFilesystem: true" in CHART and "runAsNonRoot: true" in CHART and "allowPrivilegeEscalation: false" in CHART


def test_both_images_hold_the_same():
    recipe = (DEPLOY / "orthomill.def").read_text()
    for found in (r"/source\[[a-z,]+\]", r"lib[a-z]+-[a-z0-9.-]+|fonts-[a-z-]+", r"python:[0-9a-z.-]+"):
        assert set(re.findall(found, recipe)) == set(re.findall(found, DOCKERFILE)) != set()


def test_what_an_image_copies_and_a_chart_asks_for_is_there():
    assert (DEPLOY / "entry.sh").stat().st_mode & 0o111 and "deploy/entry.sh" in DOCKERFILE
    subprocess.run(["sh", "-n", str(DEPLOY / "entry.sh")], check=True)
    values = yaml.safe_load((DEPLOY / "helm/orthomill/values.yaml").read_text())
    for path in set(re.findall(r"\.Values\.([A-Za-z.]+)", CHART + CLUSTER)):
        found = values
        for name in path.split("."):
            assert name in found, path
            found = found[name]


def rendered(template: str) -> list[dict]:
    """A template with every switch on, plainly: words for values, mappings for what is YAML already."""
    text = re.sub(r"^\s*\{\{-? ?(if|end|range|else).*?\}\}\n", "", template, flags=re.MULTILINE)
    text = re.sub(r"\{\{ if .*? \}\}(\w+)\{\{ else \}\}\w+\{\{ end \}\}", r"\1", text)
    text = re.sub(r"\{\{-? toYaml.*?\}\}", " {}", text)
    return [one for one in yaml.safe_load_all(re.sub(r"\{\{.*?\}\}", "word", text)) if one]


def test_scheduler_and_workers_have_pods_of_their_own_that_the_node_reaches():
    pods = {one["metadata"]["name"]: one["spec"] for one in rendered(CLUSTER) if one["kind"] == "Deployment"}
    assert set(pods) == {"word-scheduler", "word-worker"}
    for spec in pods.values():
        assert spec["selector"]["matchLabels"] == spec["template"]["metadata"]["labels"]
        (container,) = spec["template"]["spec"]["containers"]
        assert container["args"][0] == "dask" and container["securityContext"]["readOnlyRootFilesystem"]
        assert spec["template"]["spec"]["securityContext"]["runAsNonRoot"]
    mounts = pods["word-worker"]["template"]["spec"]["containers"][0]["volumeMounts"]
    assert mounts[0] == {"name": "data", "mountPath": "/data"} and "/data/served" in CHART
    assert "tcp://{{ .Release.Name }}-scheduler:8786" in CHART and 'if [ "${1:-}" = dask ]' in (DEPLOY / "entry.sh").read_text()


def test_a_task_of_a_node_with_a_cluster_runs_there():
    order = TaskOrder(folder=Path("task"), processes=4, scheduler="tcp://10.0.0.5:8786")
    words = _run_words(order, Wishes())
    assert words[words.index("--scheduler") + 1] == "tcp://10.0.0.5:8786" and "--workers" not in words
    assert "--workers" in _run_words(order.model_copy(update={"scheduler": ""}), Wishes())


def test_the_fast_tests_run_on_three_systems():
    jobs = yaml.safe_load(SYSTEMS.read_text())["jobs"]
    assert {job["runs-on"].split("-")[0] for job in jobs.values()} == {"ubuntu", "macos", "windows"}
    assert all(any("not slow" in step.get("run", "") for step in job["steps"]) for job in jobs.values())


@pytest.mark.skipif(shutil.which("hadolint") is None, reason="no hadolint here")
def test_the_linter_of_images_has_nothing_to_say():
    subprocess.run(["hadolint", str(DEPLOY / "Dockerfile")], check=True)


CHARTS = {
    "a token": {"token": "x: {y"},
    "a cluster": {
        "existingSecret": "own",
        "cluster": {"enabled": True, "workers": 3},
        "objectStore": {"prefixes": ["s3://a/b", "gs://c"], "existingSecret": "keys"},
        "storage": {"className": "nfs"},
    },
    "an ingress": {"token": "x", "ingress": {"enabled": True, "className": "nginx", "tlsSecret": "tls"}},
}


@pytest.mark.parametrize("case", CHARTS)
def test_helm_fills_the_chart_with_what_kubernetes_takes(case):
    charts = pytest.importorskip("helm_python.chart", reason="no Helm here (pip install helm-python-sdk)")
    judge = pytest.importorskip("kubernetes_validate", reason="no schemas here (pip install kubernetes-validate)")
    root = DEPLOY / "helm/orthomill"
    assert not [one for one in charts.lint(root, values=CHARTS[case])["messages"] if one["severity"] > 1]
    with charts.Chart.load(root) as chart:
        files = chart.render(values=CHARTS[case], name="demo")
    found = {f"{one['kind']}/{one['metadata']['name']}": one for text in files.values() for one in yaml.safe_load_all(text) if one}
    for one in found.values():
        judge.validate(one, "1.31", strict=True)
    wanted = {
        "a token": {"Secret/demo-token"},
        "a cluster": {
            "Service/demo-scheduler",
            "NetworkPolicy/demo-cluster",
            "Deployment/demo-scheduler",
            "Deployment/demo-worker",
        },
        "an ingress": {"Secret/demo-token", "Ingress/demo"},
    }
    assert set(found) == {"Service/demo", "StatefulSet/demo"} | wanted[case]
    words = found["StatefulSet/demo"]["spec"]["template"]["spec"]["containers"][0]["args"]
    assert ("--scheduler=tcp://demo-scheduler:8786" in words) == (case == "a cluster")
    assert case != "a cluster" or words[-2:] == ["--s3=s3://a/b", "--s3=gs://c"]
    assert case != "a token" or found["Secret/demo-token"]["stringData"]["token"] == "x: {y"


def test_helm_starts_no_node_without_a_token():
    charts = pytest.importorskip("helm_python.chart", reason="no Helm here (pip install helm-python-sdk)")
    with charts.Chart.load(DEPLOY / "helm/orthomill") as chart, pytest.raises(Exception, match="a node without one is not started"):
        chart.render(values={}, name="demo")
