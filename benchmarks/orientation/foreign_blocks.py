"""Blocks that nobody here has chosen: folders of photographs as people have them, oriented with all defaults, a peer beside them.

    python -m benchmarks.orientation.foreign_blocks [peer=PYTHON] FOLDER ...

Every folder is started by `init`, which uses the GCP list, positions and camera that lie in it, and run until the orientation; the
peer (COLMAP, by the Python that has it) gets the same photographs with its own defaults. The page has one row for each folder,
failures included: what a block says when it fails is part of the result. Rows of folders that are not named stay as they are.
"""

import json
import resource
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.measured_run import RESULTS, machine, orthomill, write_result
from benchmarks.orientation.orientation_truth import mean_residual
from orthomill.pipeline.workflow.starting_workflow import write_starting_workflow
from orthomill.schemas.orientation import Block, BlockPrecision, SeparateBlocks
from orthomill.tasks.catalogue import STAGES

WIDEST = 300
"""characters of what a failed run said"""
SUFFIXES = {".jpg", ".jpeg", ".tif", ".tiff", ".png"}
HEAD = "| folder | photographs | oriented | groups apart | mean residual px | iterations | CPU s | peer | px | CPU s | said |"


@dataclass(frozen=True)
class Row:
    """One folder: its `name`, number of `photos`, how many are `oriented`, groups of their own (`apart`), the mean residual in px,
    iterations, CPU seconds; what was `said`: the failure, or what was found to be wrong."""

    name: str
    photos: int
    oriented: int = 0
    apart: str = ""
    residual_px: float = 0.0
    iterations: int = 0
    cpu: float = 0.0
    said: str = ""


def cpu_of_children() -> float:
    """CPU seconds of all processes that were started and ended so far."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def row_of(folder: Path) -> Row:
    """The row of one folder of photographs."""
    photos = sum(path.suffix.lower() in SUFFIXES for path in folder.iterdir())
    with tempfile.TemporaryDirectory(dir=Path.cwd()) as place:
        root, before = Path(place), cpu_of_children()
        (root / "photographs").symlink_to(folder.resolve())
        write_starting_workflow("block", root / "photographs", root, STAGES)
        run = orthomill(root, "run", "block", "--until", "orientation")
        cpu = cpu_of_children() - before
        if run.code:
            failed = [line for line in run.output.splitlines() if "failed" in line or "rror" in line]
            return Row(folder.name, photos, cpu=cpu, said=" ".join((failed or [run.output])[-1].split())[:WIDEST])
        return _oriented(folder.name, photos, root / "runs" / "block", cpu)


def _oriented(name: str, photos: int, run: Path, cpu: float) -> Row:
    tables = run / "tables" / "orientation"
    block = Block.model_validate_json((tables / "block.json").read_bytes())
    apart = SeparateBlocks.model_validate_json((tables / "separate_blocks.json").read_bytes())
    precision = BlockPrecision.model_validate_json((tables / "precision.json").read_bytes())
    groups = ", ".join(str(len(one.photos)) for one in apart.blocks)
    said = ", ".join(sorted({finding.code for finding in precision.findings}))
    return Row(name, photos, len(block.photos), groups, mean_residual(run), block.iterations, cpu, said)


def peer_of(python: str, folder: Path) -> tuple[int, float, float]:
    """Photographs, mean residual in px and CPU seconds of the peer."""
    with tempfile.TemporaryDirectory() as place:
        names = sorted(path.name for path in folder.iterdir() if path.suffix.lower() in SUFFIXES)
        job = {"photographs": str(folder), "names": names, "out": place, "model": "SIMPLE_RADIAL", "camera": "", "fixed": False}
        path, before = Path(place) / "job.json", cpu_of_children()
        path.write_text(json.dumps(job | {"single": False}))
        script = Path(__file__).with_name("colmap_block.py")
        subprocess.run([python, script, path], check=False, capture_output=True)
        result, cpu = Path(place) / "result.json", cpu_of_children() - before
        if not result.exists():
            return 0, 0.0, cpu
        found = json.loads(result.read_text())
        return found["photos"], found["error_px"], cpu


def line_of(row: Row, peer: tuple[int, float, float] | None) -> str:
    """The line of the page."""
    beside = f"{peer[0]} | {peer[1]:.2f} | {peer[2]:.0f}" if peer else " | | "
    return (
        f"| {row.name} | {row.photos} | {row.oriented} | {row.apart} | {row.residual_px:.3f} | {row.iterations} | {row.cpu:.0f} | "
        f"{beside} | {row.said} |"
    )


def lines_before() -> dict[str, str]:
    """The lines of the page as it is, by folder."""
    page = RESULTS / "foreign_blocks.md"
    lines = page.read_text().splitlines() if page.exists() else []
    return {line.split(" | ")[0][2:]: line for line in lines if line.startswith("| ") and line != HEAD and "---" not in line}


def page(lines: dict[str, str]) -> str:
    """The page of all lines."""
    cells = [[cell.strip() for cell in line.split("|")[1:]] for line in lines.values()]
    compared = [(int(cell[2]), int(cell[7]), float(cell[6]), float(cell[9])) for cell in cells if cell[7]]
    more = sum(own >= other for own, other, _, _ in compared)
    cpu = np.sum([pair[2:] for pair in compared], axis=0) if compared else np.zeros(2)
    text = [
        "# Foreign blocks",
        "",
        f"`python -m benchmarks.orientation.foreign_blocks [peer=PYTHON] FOLDER ...`, {machine()}. All defaults, workflow by "
        "`init`; peer: COLMAP with its defaults (SIMPLE_RADIAL, cameras by EXIF) on the same photographs, its largest model.",
        "",
        f"As many photographs as the peer or more on **{more} of {len(compared)}** blocks; CPU time {cpu[0]:.0f} against "
        f"{cpu[1]:.0f} s. Not oriented at all: {sum(int(cell[2]) == 0 for cell in cells)} of {len(cells)}.",
        "",
        HEAD,
        "|" + " --- |" * (HEAD.count("|") - 1),
        *(lines[name] for name in sorted(lines)),
    ]
    return "\n".join(text) + "\n"


def main() -> None:
    """Measures the folders named on the command line."""
    folders = [Path(word) for word in sys.argv[1:] if "=" not in word]
    python = next((word.removeprefix("peer=") for word in sys.argv[1:] if word.startswith("peer=")), None)
    if not folders:
        sys.exit("Name the folders of photographs: python -m benchmarks.orientation.foreign_blocks FOLDER ...")
    for folder in folders:
        line = line_of(row_of(folder), peer_of(python, folder.resolve()) if python else None)
        write_result("foreign_blocks", page({**lines_before(), folder.name: line}))


if __name__ == "__main__":
    main()
