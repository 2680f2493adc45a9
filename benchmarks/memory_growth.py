"""Does memory grow with the project? The small simulated project against one of four times the area, and against more pairs of
photographs over the same place.
"""

import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import yaml

from benchmarks.instrument.result_page import write_page
from benchmarks.measured_run import MeasuredRun, orthomill, project_root, summary
from benchmarks.orientation.growth.rolling_land import BASE, BETWEEN, MARGIN, Land, stations, write_photograph
from orthomill.pipeline.engine.run_facts import read_facts
from orthomill.pipeline.storage.store import Store
from orthomill.schemas.epipolar import PAIRS
from orthomill.schemas.raster import tiles_of
from orthomill.schemas.surface import SURFACE
from orthomill.tasks.geometry.epipolar_window import box_corners, node_window

PROJECT = "volos_small"
LARGE = {"strips": 4, "photos_per_strip": 6}
"""24 photographs in place of 6: about four times the area"""


@dataclass(frozen=True)
class Crowd:
    """A block of `strips` x `per` photographs that all show the same place; `pairs`: the setting of the stage epipolar, or None for
    its default."""

    strips: int
    per: int
    pairs: dict | None = None


CROWDS = (Crowd(2, 3), Crowd(4, 5), Crowd(4, 6, {"per_photo": 10, "per_place": 200}))
"""about 10, 40 and 100 pairs over a tile"""
SQUEEZE = 0.3, 0.5
"""factors on the distances of strips and of photographs of `rolling_land`, which leave 11 m between neighbours: a tenth of the
flying height, the shortest base that is matched"""
STAGES = ("tie_points", "orientation", "epipolar", "densification", "dsm_check", "texture")


def change_workflow(root: Path, stage: str, changes: dict, project: str = PROJECT) -> None:
    """Set settings of a stage of the project."""
    path = root / "workflows" / f"{project}.yaml"
    workflow = yaml.safe_load(path.read_text())
    for entry in workflow["stages"]:
        if entry["kind"] == stage:
            entry.update(changes)
    path.write_text(yaml.safe_dump(workflow, sort_keys=False))


def run_project(root: Path, *options: str) -> tuple[MeasuredRun, dict]:
    """Run the project in `root`; returns the run and its figures."""
    run = orthomill(root, "run", PROJECT, "--workers", "2", *options)
    if run.code != 0:
        raise SystemExit(run.output)
    return run, summary(root, PROJECT)


def area_lines(scratch: Path) -> list[str]:
    """The lines of 6 against 24 photographs."""
    roots = [project_root(scratch / size, PROJECT) for size in ("small", "large")]
    change_workflow(roots[1], "simulation", LARGE)
    (small, small_figures), (large, large_figures) = map(run_project, roots)
    cells = [figures["densification.cells_with_height"]["value"] for figures in (small_figures, large_figures)]
    workers = [figures["run.peak_memory"]["value"] for figures in (small_figures, large_figures)]
    return [
        "| | small | large | ratio |",
        "| --- | --- | --- | --- |",
        f"| photographs | 6 | {LARGE['strips'] * LARGE['photos_per_strip']} | 4 |",
        f"| cells with a height | {cells[0]} | {cells[1]} | {cells[1] / cells[0]:.2f} |",
        f"| largest worker (MiB) | {workers[0]:.0f} | {workers[1]:.0f} | {workers[1] / workers[0]:.3f} |",
        f"| largest process of any kind (MiB) | {small.peak_bytes / 2**20:.0f} | {large.peak_bytes / 2**20:.0f} "
        f"| {large.peak_bytes / small.peak_bytes:.3f} |",
        f"| seconds | {small.seconds:.0f} | {large.seconds:.0f} | {large.seconds / small.seconds:.2f} |",
        "",
    ]


def photograph_crowd(crowd: Crowd, folder: Path) -> None:
    """The photographs of a crowd, rendered into a folder."""
    folder.mkdir(parents=True)
    largest = CROWDS[-1]
    land = Land(folder.parent, largest.strips, largest.per)
    middle = np.array([MARGIN + BETWEEN * (largest.strips - 1) / 2, MARGIN + BASE * (largest.per - 1) / 2])
    for one in stations(crowd.strips, crowd.per):
        place = middle + (one.centre[:2] - middle) * SQUEEZE
        write_photograph(land, replace(one, centre=np.array([*place, one.centre[2]])), folder)


def pairs_over_a_tile(run: Path) -> int:
    """The most pairs that a tile of the surface reads."""
    store = Store(run)
    pairs, surface = store.table(PAIRS).pairs, store.table(SURFACE)
    tiles = (
        box_corners(surface.grid, tile.window, surface.height_low, surface.height_high)
        for tile in tiles_of(surface.grid.shape, 512)
    )
    return max(sum(not node_window(pair, 1, corners).empty for pair in pairs) for corners in tiles)


def crowd_row(root: Path, crowd: Crowd) -> str:
    """The line of one crowd, from photographs to the orthoimage."""
    photograph_crowd(crowd, root / "photographs")
    made = orthomill(root, "init", "crowd", "--photos", "photographs")
    if crowd.pairs:
        change_workflow(root, "epipolar", {"pairs": crowd.pairs}, "crowd")
    run = orthomill(root, "run", "crowd", "--workers", "2")
    if made.code or run.code:
        raise SystemExit(made.output + run.output)
    folder = root / "runs" / "crowd"
    facts = read_facts(folder)
    peaks = {stage.kind: (stage.peak_bytes or 0) / 2**20 for stage in facts.stages} if facts else {}
    cpu = sum(stage.cpu_seconds for stage in facts.stages) if facts else 0.0
    cells = " | ".join(f"{peaks.get(kind, 0):.0f}" for kind in STAGES)
    pairs = len(Store(folder).table(PAIRS).pairs)
    name = f"{crowd.strips * crowd.per}{'' if crowd.pairs else ', default settings'}"
    return f"| {name} | {pairs} | {pairs_over_a_tile(folder)} | {cells} | **{max(peaks.values()):.0f}** | {cpu:.0f} |"


def pairs_lines(scratch: Path) -> list[str]:
    """The table of more and more pairs over one place."""
    rows = [crowd_row(scratch / f"crowd_{number}", crowd) for number, crowd in enumerate(CROWDS)]
    return [
        "Rendered photographs of one megapixel which all show the same place, from the files to the orthoimage, two workers.",
        "Largest worker while jobs of a stage ran, MiB; a worker may use 1536.",
        "",
        f"| photographs | pairs | pairs over one tile | {' | '.join(STAGES).replace('_', ' ')} | largest of all | CPU-s |",
        "|" + " --- |" * (len(STAGES) + 5),
        *rows,
        "",
    ]


def main(words: list[str]) -> None:
    """Run all and write the page."""
    lines = ["# Memory against the size of the project", ""]
    with tempfile.TemporaryDirectory() as scratch:
        for table in (pairs_lines, area_lines):
            lines += table(Path(scratch))
            # Of the long run what is done is kept.
            write_page("memory_growth", words, "\n".join(lines))
