"""Does memory grow with the project? The small simulated project against one of four times the area, and against more pairs of
photographs over the same place.

Run with `python -m benchmarks.memory_growth`.
"""

import tempfile
from pathlib import Path

import yaml

from benchmarks.measured_run import MeasuredRun, machine, orthomill, project_root, summary, write_result

PROJECT = "volos_small"
LARGE = {"strips": 4, "photos_per_strip": 6}
"""24 photographs in place of 6: about four times the area"""


DENSE = {"strips": 3, "photos_per_strip": 6, "base_m": 36, "side_overlap": 0.85}
"""18 photographs of nearly the same place: the middle of the map is seen by all of them, and thus lies under all pairs"""
PER_PHOTO = (1, 5, 12)
"""pairs of every photograph: about 10, 40 and 100 pairs in all"""


def change_workflow(root: Path, stage: str, changes: dict) -> None:
    """Set settings of a stage of the project."""
    path = root / "workflows" / f"{PROJECT}.yaml"
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


def area_table(scratch: Path) -> list[str]:
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
    ]


def pairs_table(scratch: Path) -> list[str]:
    """The lines of more and more pairs over one place: the same photographs, matched in more pairs."""
    root = project_root(scratch / "dense", PROJECT)
    change_workflow(root, "simulation", DENSE)
    # Workers keep the peak of all that they did: those of the first run have rendered and oriented the photographs as well.
    run_project(root, "--until", "orientation")
    rows = []
    for per_photo in PER_PHOTO:
        change_workflow(root, "epipolar", {"pairs": {"per_photo": per_photo, "per_place": 200}})
        _, figures = run_project(root, "--until", "densification")
        pairs, worker, cpu = (
            figures[name]["value"] for name in ("epipolar.pairs", "run.densification.peak_memory", "run.densification.cpu_seconds")
        )
        rows.append(f"| {pairs} | {worker:.0f} | {cpu:.0f} |")
    return [
        "| pairs over one tile | largest worker of the dense stage (MiB) | its processor time (s) |",
        "| --- | --- | --- |",
        *rows,
    ]


def main() -> None:
    """Run all and write the page."""
    with tempfile.TemporaryDirectory() as scratch:
        area, pairs = area_table(Path(scratch)), pairs_table(Path(scratch))
    lines = [
        "# Memory against the size of the project",
        "",
        f"`python -m benchmarks.memory_growth`; {machine()}.",
        "",
        *area,
        "",
        "18 photographs of nearly the same place in more and more pairs; the surface reads the nodes of one pair after the other.",
        "",
        *pairs,
    ]
    write_result("memory_growth", "\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
