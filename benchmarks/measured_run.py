"""Runs the command as a user would, in a folder of its own, and watches the memory of all its processes."""

import json
import os
import platform
import shutil
import subprocess
import sys
import threading
import time
from dataclasses import dataclass
from pathlib import Path

import psutil

ROOT = Path(__file__).parent.parent
RESULTS = Path(__file__).parent / "results"


@dataclass(frozen=True)
class MeasuredRun:
    """One run of the command. Bytes are resident memory of the largest single process."""

    seconds: float
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
    started = time.monotonic()
    command = [Path(sys.executable).parent / "orthomill", *words]
    process = subprocess.Popen(command, cwd=root, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    peak = [0]
    watcher = threading.Thread(target=_watch, args=(process.pid, peak), daemon=True)
    watcher.start()
    output, _ = process.communicate()
    seconds = time.monotonic() - started
    return MeasuredRun(seconds, peak[0], process.returncode, output)


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


def summary(root: Path, project: str) -> dict:
    """The summary.json of a run."""
    return json.loads((root / "runs" / project / "summary.json").read_text())


def machine() -> str:
    """One line about the machine that figures were measured on."""
    lines = Path("/proc/cpuinfo").read_text().splitlines()
    model = next((line.split(":")[1].strip() for line in lines if line.startswith("model name")), "")
    return (
        f"{os.cpu_count()} cores ({model or platform.machine()}), {psutil.virtual_memory().total / 2**30:.0f} GiB, "
        f"Python {platform.python_version()}, {time.strftime('%Y-%m-%d')}"
    )


def revision() -> str:
    """The commit of the code that is measured, as it stands on a page of results."""
    words = ["git", "-C", str(ROOT), "log", "-1", "--format=%h"]
    return "commit " + (subprocess.run(words, capture_output=True, text=True).stdout.strip() or "unknown")


def write_result(name: str, text: str) -> None:
    """Print a page of results and keep it."""
    RESULTS.mkdir(exist_ok=True)
    (RESULTS / f"{name}.md").write_text(text)
    print(text)
