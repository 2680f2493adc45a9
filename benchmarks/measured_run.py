"""Runs the command as a user would, in a folder of its own, and watches the memory and processor time of all its processes."""

import json
import resource
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import psutil
import yaml

from benchmarks.instrument.result_page import ROOT


@dataclass(frozen=True)
class MeasuredRun:
    """One run of a command. Bytes are resident memory of the largest single process; processor time is that of all its processes,
    of users and of the system."""

    seconds: float
    cpu_seconds: float
    peak_bytes: int
    code: int
    output: str


def project_root(folder: Path, *workflows: str) -> Path:
    """A new project root with copies of shipped workflows and their photographs."""
    (folder / "workflows").mkdir(parents=True, exist_ok=True)
    for name in workflows:
        shutil.copy(ROOT / "workflows" / f"{name}.yaml", folder / "workflows")
    link = folder / "workflows" / "photographs"
    if not link.exists():
        link.symlink_to(ROOT / "workflows" / "photographs")
    return folder


def orthomill(root: Path, *words: str) -> MeasuredRun:
    """Run `orthomill WORDS` in `root`."""
    return measured_command([Path(sys.executable).parent / "orthomill", *words], root)


def measured_command(command: list[Path | str], folder: Path) -> MeasuredRun:
    """Run a command in `folder`, alone among the children of this process."""
    started, cpu = time.monotonic(), _children_seconds()
    process = subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    peak = [0]
    watcher = threading.Thread(target=_watch, args=(process.pid, peak), daemon=True)
    watcher.start()
    output, _ = process.communicate()
    seconds = time.monotonic() - started
    return MeasuredRun(seconds, _children_seconds() - cpu, peak[0], process.returncode, output)


def _children_seconds() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def _watch(pid: int, peak: list[int]) -> None:
    while True:
        try:
            parent = psutil.Process(pid)
            for process in (parent, *parent.children(recursive=True)):
                peak[0] = max(peak[0], process.memory_info().rss)
        except psutil.NoSuchProcess:
            if not psutil.pid_exists(pid):
                return
        time.sleep(0.1)


def run_project(root: Path, project: str) -> MeasuredRun:
    """Run a project. Raises SystemExit with what it printed where it fails."""
    run = orthomill(root, "run", project)
    if run.code != 0:
        raise SystemExit(run.output)
    return run


@contextmanager
def named_or_new_run(words: list[str], workflow: dict[str, Any]) -> Iterator[Path]:
    """The folder of the finished run that is named, or of a new one of `workflow`, which is gone afterwards. Raises SystemExit
    for one that is none or fails."""
    if words:
        yield run_folders(words)[0]
        return
    project = workflow["project"]
    with tempfile.TemporaryDirectory() as scratch:
        root = Path(scratch)
        (root / "workflows").mkdir()
        (root / "workflows" / f"{project}.yaml").write_text(yaml.safe_dump(workflow, sort_keys=False))
        run_project(root, project)
        yield root / "runs" / project


def run_folders(words: list[str], *projects: str) -> tuple[Path, ...]:
    """Folders of runs: those that are named, or those of `projects` in this checkout. Raises SystemExit for one that is none."""
    folders = tuple(map(Path, words)) or tuple(ROOT / "runs" / project for project in projects)
    missing = [folder for folder in folders if not (folder / "jobs").is_dir()]
    if missing or not folders:
        what = f"{missing[0]} is not the folder of a run" if missing else "Name the folder of a run"
        raise SystemExit(f"{what}; `make project={projects[0] if projects else 'volos'} run` makes one.")
    return folders


def summary(root: Path, project: str) -> dict:
    """The summary.json of a run."""
    return json.loads((root / "runs" / project / "summary.json").read_text())
