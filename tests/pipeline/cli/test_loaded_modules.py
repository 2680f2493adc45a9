"""A command answers at once, because it loads what it needs and nothing else: the lists of what the light ones may load."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
TERMINAL = {"typer", "rich", "shellingham", "annotated_doc", "pygments", "markdown_it", "mdurl", "attr", "attrs"}
TERMINAL |= {
    "pydantic",
    "pydantic_core",
    "annotated_types",
    "typing_inspection",
    "typing_extensions",
}  # typer checks values with it
READ = """
import sys
from pathlib import Path
from orthomill.pipeline.cli.environment import main
sys.argv = ["orthomill", *sys.argv[1:]]
try:
    main()
except SystemExit:
    pass
names = {name.split(".")[0] for name, module in sys.modules.items() if "site-packages" in (getattr(module, "__file__", None) or "")}
ours = [name for name in sys.modules if name.startswith("orthomill.")]
print(*sorted(names), file=sys.stderr)
print(*sorted(ours), file=sys.stderr)
"""


def loaded(*words: str, **environment: str) -> tuple[set[str], set[str]]:
    """Libraries and modules of ours that a command has loaded when it is done."""
    command = [sys.executable, "-c", READ, *words]
    said = subprocess.run(command, env={**os.environ, **environment}, capture_output=True, text=True, timeout=120)
    libraries, ours = said.stderr.splitlines()[-2:]
    return {name for name in libraries.split() if not name.startswith("_")}, set(ours.split())


@pytest.mark.parametrize("words", [("--version",), ("--help",), ("run", "--help"), ("inspect", "window-size", "--help")])
def test_version_and_help_load_the_terminal_and_nothing_else(words):
    libraries, ours = loaded(*words)
    assert libraries <= TERMINAL
    assert not {name for name in ours if name.startswith(("orthomill.tasks", "orthomill.pipeline.storage"))}


def test_the_completion_of_the_shell_loads_the_terminal_and_nothing_else():
    asked = {"_ORTHOMILL_COMPLETE": "complete_bash", "COMP_WORDS": "orthomill run v", "COMP_CWORD": "2"}
    libraries, _ = loaded(**asked)
    assert libraries <= TERMINAL


WORKFLOW = TERMINAL | {"numpy", "yaml", "pyproj", "certifi", "click"}
"""what reading a workflow needs: settings, their lines in the file, and reference systems"""
METHODS = ("orthomill.kernels", "orthomill.pipeline.storage.store", "orthomill.pipeline.engine.session")


@pytest.mark.parametrize(("command", "mistake"), [("status", False), ("plan", True), ("run", True)])
def test_a_workflow_is_read_and_refused_without_the_photogrammetry(command, mistake, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    text = (ROOT / "workflows/volos_small.yaml").read_text()
    (tmp_path / "small.yaml").write_text(text.replace("kind: epipolar", "kind: epipolr") if mistake else text)
    libraries, ours = loaded(command, "small.yaml")
    assert {name for name in libraries if not name.startswith("_")} <= WORKFLOW
    assert not {name for name in ours if name.startswith(METHODS)}
    planned = {name for name in ours if {"plan", "report"} & set(name.split(".")) and name.startswith("orthomill.tasks")}
    assert not planned and len(ours) < 200
