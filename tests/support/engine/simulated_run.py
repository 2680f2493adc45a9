"""The shipped project `volos_small`, run with the command in a root of its own."""

import json
import re
from dataclasses import dataclass
from pathlib import Path

from made_once import made_once
from small_site import start_command

WORKFLOWS = Path(__file__).parents[3] / "workflows"
PROJECT = "volos_small"
QUARTER = {"frame_mm": 28.75, "c_mm": 19.17, "base_m": 72.5, "buildings": 10, "board_photos": 5, "control": 4, "check": 2}
"""settings of the simulation that halve the sides of everything, and photographs of chessboards that are just enough"""


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
    made = _run((WORKFLOWS / f"{PROJECT}.yaml").read_text(), root, "--workers", "2")
    (root / "said.txt").write_text(made.said)


def quarter_in(root: Path, *words: str) -> Run:
    """The project with photographs of a quarter of its pixels, over a quarter of its ground."""
    text = (WORKFLOWS / f"{PROJECT}.yaml").read_text()
    for field, value in QUARTER.items():
        text, found = re.subn(rf"^( +{field}: )\S+", rf"\g<1>{value}", text, flags=re.MULTILINE)
        assert found == 1, field
    return _run(text, root, *words)


def _run(workflow: str, root: Path, *words: str) -> Run:
    (root / "workflows").mkdir(parents=True, exist_ok=True)
    (root / "workflows" / f"{PROJECT}.yaml").write_text(workflow)
    out, errors = (process := start_command(root, "run", PROJECT, *words)).communicate(timeout=500)
    assert process.returncode == 0, errors
    return Run(root, out)
