"""The shipped project `volos_small`, run with the command in a root of its own."""

import json
import shutil
from dataclasses import dataclass
from pathlib import Path

from small_site import start_command

WORKFLOWS = Path(__file__).parents[3] / "workflows"
PROJECT = "volos_small"


@dataclass(frozen=True)
class Run:
    """A root in which the project was run, and what the command said."""

    root: Path
    said: str

    @property
    def folder(self) -> Path:
        return self.root / "runs" / PROJECT

    def summary(self) -> dict[str, object]:
        return {name: figure["value"] for name, figure in json.loads((self.folder / "summary.json").read_text()).items()}


def run_in(root: Path, *words: str) -> Run:
    (root / "workflows").mkdir(exist_ok=True)
    shutil.copy(WORKFLOWS / f"{PROJECT}.yaml", root / "workflows")
    out, errors = (process := start_command(root, "run", PROJECT, *words)).communicate(timeout=500)
    assert process.returncode == 0, errors
    return Run(root, out)
