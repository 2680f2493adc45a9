"""The shipped project `volos_small`, run with the command in a root of its own."""

import json
from dataclasses import dataclass
from pathlib import Path

from made_once import made_once
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


def finished_run() -> Run:
    """The project as it is shipped, run by two worker processes; made once, to be looked at and copied only."""
    root = made_once("finished_run", _finish)
    return Run(root, (root / "said.txt").read_text())


def _finish(root: Path) -> None:
    (root / "workflows").mkdir(parents=True, exist_ok=True)
    (root / "workflows" / f"{PROJECT}.yaml").write_text((WORKFLOWS / f"{PROJECT}.yaml").read_text())
    said, errors = (process := start_command(root, "run", PROJECT, "--workers", "2")).communicate(timeout=500)
    assert process.returncode == 0, errors
    (root / "said.txt").write_text(said)
