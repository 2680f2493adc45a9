"""Images and charts start the command with options that it has, as nobody and on a read-only root; linters where they are there."""

import json
import re
import shutil
import subprocess
from pathlib import Path

import pytest
import yaml
from typer.main import get_command

from orthomill.pipeline.cli.commands.application import app

DEPLOY = Path(__file__).parents[3] / "deploy"
DOCKERFILE = (DEPLOY / "Dockerfile").read_text()
CHART = (DEPLOY / "helm/orthomill/templates/node.yaml").read_text()


def test_the_options_of_image_and_chart_are_those_of_the_command():
    serve = get_command(app).commands["serve"]
    known = {option for parameter in serve.params for option in parameter.opts + parameter.secondary_opts}
    words = json.loads(re.findall(r"^CMD (\[.*\])$", DOCKERFILE, re.MULTILINE)[-1])
    asked = [word.split("=")[0] for word in [*words, *re.findall(r"- (--[a-z0-9-]+)", CHART)] if word.startswith("--")]
    assert words[0] == "serve" and {"--tasks", "--memory", "--keep-days", "--s3", "--host"} == set(asked) <= known


def test_nothing_runs_as_root_or_writes_where_it_must_not():
    assert re.search(r"^USER 10001$", DOCKERFILE, re.MULTILINE) and "HEALTHCHECK" in DOCKERFILE and "--constraint" in DOCKERFILE
    node = yaml.safe_load((DEPLOY / "compose.yaml").read_text())["services"]["orthomill"]
    assert node["read_only"] and node["cap_drop"] == ["ALL"] and node["ports"] == ["127.0.0.1:3000:3000"]
    assert "readOnlyRootFilesystem: true" in CHART and "runAsNonRoot: true" in CHART and "allowPrivilegeEscalation: false" in CHART


def test_what_an_image_copies_and_a_chart_asks_for_is_there():
    assert (DEPLOY / "entry.sh").stat().st_mode & 0o111 and "deploy/entry.sh" in DOCKERFILE
    subprocess.run(["sh", "-n", str(DEPLOY / "entry.sh")], check=True)
    values = yaml.safe_load((DEPLOY / "helm/orthomill/values.yaml").read_text())
    for path in set(re.findall(r"\.Values\.([A-Za-z.]+)", CHART)):
        found = values
        for name in path.split("."):
            assert name in found, path
            found = found[name]


@pytest.mark.skipif(shutil.which("hadolint") is None, reason="no hadolint here")
def test_the_linter_of_images_has_nothing_to_say():
    subprocess.run(["hadolint", str(DEPLOY / "Dockerfile")], check=True)
