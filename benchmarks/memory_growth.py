"""Does memory grow with the project? The small simulated project against one of four times the area.

Run with `python -m benchmarks.memory_growth`.
"""

import tempfile
from pathlib import Path

import yaml

from benchmarks.measured_run import MeasuredRun, machine, orthomill, project_root, summary, write_result

PROJECT = "volos_small"
LARGE = {"strips": 4, "photos_per_strip": 6}
"""24 photographs in place of 6: about four times the area"""


def run_project(folder: Path, changes: dict) -> tuple[MeasuredRun, dict]:
    """Run the small project with other settings of the simulation; returns the run and its figures."""
    root = project_root(folder, PROJECT)
    path = root / "workflows" / f"{PROJECT}.yaml"
    workflow = yaml.safe_load(path.read_text())
    for stage in workflow["stages"]:
        if isinstance(stage, dict) and stage["kind"] == "simulation":
            stage.update(changes)
    path.write_text(yaml.safe_dump(workflow, sort_keys=False))
    run = orthomill(root, "run", PROJECT, "--workers", "2")
    if run.code != 0:
        raise SystemExit(run.output)
    return run, summary(root, PROJECT)


def main() -> None:
    """Run both and write the page."""
    with tempfile.TemporaryDirectory() as scratch:
        small, small_figures = run_project(Path(scratch) / "small", {})
        large, large_figures = run_project(Path(scratch) / "large", LARGE)
    cells = [figures["densification.cells_with_height"]["value"] for figures in (small_figures, large_figures)]
    workers = [figures["run.peak_memory"]["value"] for figures in (small_figures, large_figures)]
    write_result(
        "memory_growth",
        "\n".join(
            [
                "# Memory against the size of the project",
                "",
                f"`python -m benchmarks.memory_growth`; {machine()}.",
                "",
                "| | small | large | ratio |",
                "| --- | --- | --- | --- |",
                f"| photographs | 6 | {LARGE['strips'] * LARGE['photos_per_strip']} | 4 |",
                f"| cells with a height | {cells[0]} | {cells[1]} | {cells[1] / cells[0]:.2f} |",
                f"| largest worker (MiB) | {workers[0]:.0f} | {workers[1]:.0f} | {workers[1] / workers[0]:.3f} |",
                f"| largest process of any kind (MiB) | {small.peak_bytes / 2**20:.0f} | {large.peak_bytes / 2**20:.0f} "
                f"| {large.peak_bytes / small.peak_bytes:.3f} |",
                f"| seconds | {small.seconds:.0f} | {large.seconds:.0f} | {large.seconds / small.seconds:.2f} |",
            ]
        )
        + "\n",
    )


if __name__ == "__main__":
    main()
