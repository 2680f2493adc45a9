"""Pages of results: every one begins with the command that makes it again, and with commit, machine and date of its figures."""

import os
import platform
import re
import subprocess
import time
from pathlib import Path
from typing import NamedTuple

import psutil

ROOT = Path(__file__).parents[2]
RESULTS = ROOT / "benchmarks" / "results"
CODE = ("orthomill", "schemas", "tasks", "pipeline", "benchmarks")


class PageHead(NamedTuple):
    """What a page says of its making. `recorded`: the commit was written down by the measurement itself; before the pages had this
    head many did not say it, and `commit` is that which brought the page."""

    command: str
    commit: str
    recorded: bool
    machine: str
    date: str

    def __str__(self) -> str:
        commit = f"commit {self.commit}" if self.recorded else f"commit not recorded, the page came with {self.commit}"
        return f"`{self.command}`; {commit}; {self.machine}; {self.date}."


_HEAD = re.compile(
    r"^`(?P<command>python -m benchmarks [^`]+)`; "
    r"(?:commit |(?P<unrecorded>commit not recorded, the page came with ))(?P<commit>[0-9a-f]{7,40})(?: with changes)?; "
    r"(?P<machine>.+); (?P<date>\d{4}-\d\d-\d\d)\.$"
)


def head_of(path: Path) -> PageHead | None:
    """What a page says of its making, in its third line; None where it does not."""
    found = _HEAD.match("".join(path.read_text().splitlines()[2:3]))
    return found and PageHead(found["command"], found["commit"], not found["unrecorded"], found["machine"], found["date"])


def new_head(study: str, words: list[str]) -> PageHead:
    """The head of what is measured now."""
    command = " ".join(["python -m benchmarks", study, *words])
    return PageHead(command, revision(), True, machine(), time.strftime("%Y-%m-%d"))


def write_page(study: str, words: list[str], text: str, path: Path | None = None) -> None:
    """Print a page and keep it, benchmarks/results/<study>.md if no other `path` is given. `text` begins with its title."""
    title, _, body = text.partition("\n\n")
    page = f"{title}\n\n{new_head(study, words)}\n\n{body.strip()}\n"
    (path or RESULTS / f"{study}.md").write_text(page)
    print(page)


def machine() -> str:
    """The machine that figures are measured on."""
    lines = Path("/proc/cpuinfo").read_text().splitlines()
    model = next((line.split(":")[1].strip() for line in lines if line.startswith("model name")), "")
    memory = psutil.virtual_memory().total / 2**30
    return f"{os.cpu_count()} cores ({model or platform.machine()}), {memory:.0f} GiB, Python {platform.python_version()}"


def revision() -> str:
    """The commit of the code that is measured, and whether it was changed since."""
    commit = _git("log", "-1", "--format=%h").strip()
    return f"{commit} with changes" if _git("status", "--porcelain", "--untracked-files=no", "--", *CODE).strip() else commit


def _git(*words: str) -> str:
    return subprocess.run(["git", "-C", str(ROOT), *words], capture_output=True, text=True, check=True).stdout
