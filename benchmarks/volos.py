"""The embedded project against its truth, beside what it is to reach: `python -m benchmarks.volos`.

Runs the project twice in a folder of its own: once from nothing, once unchanged. Every figure is read from summary.json or
measured from outside; nothing is computed here that the report does not show.
"""

import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from benchmarks import planted_errors
from benchmarks.measured_run import MeasuredRun, machine, orthomill, project_root, summary, write_result

PROJECT = "volos"
MIB = 2**20


@dataclass(frozen=True)
class Goal:
    """One line of the table: what, what is to be reached, the figure's name, and whether a value reaches it."""

    what: str
    to_reach: str
    name: str
    reached: Callable[[float], bool]


GOALS = (
    Goal("camera centres within 3 of their standard errors", "95 %", "evaluation.centres_within_3_sigma", lambda v: v >= 95),
    Goal("check points, plan", "0.35 m", "orientation.check_rmse_plan", lambda v: v <= 0.35),
    Goal("check points, height", "0.6 m", "orientation.check_rmse_height", lambda v: v <= 0.6),
    Goal("DSM on open ground, NMAD", "0.35 m", "evaluation.dsm_open_ground_nmad", lambda v: v <= 0.35),
    Goal(
        "DSM on open ground that two photos see, completeness", "92 %", "evaluation.dsm_open_ground_completeness", lambda v: v >= 92
    ),
    Goal("DSM on open ground, bias", "0.1 m", "evaluation.dsm_open_ground_bias", lambda v: abs(v) < 0.1),
    Goal("DSM on open ground, standard deviation", "-", "evaluation.dsm_open_ground_sd", lambda v: True),
    Goal("roofs, median error", "0.5 m", "evaluation.dsm_roof_median_error", lambda v: v <= 0.5),
    Goal("pond left empty", "-", "evaluation.dsm_water_left_empty", lambda v: True),
    Goal("orthoimage, median shift", "0.5 px", "evaluation.ortho_shift_median_px", lambda v: v <= 0.5),
    Goal("orthoimage, places shifted by more than 0.5 px", "0 %", "evaluation.ortho_shift_above_half_px_share", lambda v: v <= 0),
    Goal("orthoimage, doubled roofs", "0 %", "evaluation.ortho_doubled_share", lambda v: v <= 0),
    Goal(
        "orthoimage, disturbed road where 3 or more photos see it",
        "vehicles suppressed",
        "evaluation.ortho_roads_disturbed_3",
        lambda v: v <= 1,
    ),
    Goal("orthoimage, PSNR / SSIM: PSNR", "-", "evaluation.ortho_psnr", lambda v: True),
    Goal("orthoimage, PSNR / SSIM: SSIM", "-", "evaluation.ortho_ssim", lambda v: True),
)


def row(goal: Goal, figures: dict) -> str:
    """One line of the table of figures."""
    figure = figures[goal.name]
    value = figure["value"]
    reached = "yes" if goal.reached(value) else "no"
    return f"| {goal.what} | {goal.to_reach} | {value:.3f} {figure['unit']} | {reached} | `{goal.name}` |"


def run_rows(first: MeasuredRun, second: MeasuredRun, figures: dict) -> list[str]:
    """The lines about the runs themselves."""
    jobs_again, peak = figures["run.jobs_done"]["value"], first.peak_bytes / MIB
    return [
        f"| run from nothing | 360 s | {first.seconds:.0f} s | {'yes' if first.seconds <= 360 else 'no'} | |",
        f"| largest process | 1536 MiB | {peak:.0f} MiB | {'yes' if peak <= 1536 else 'no'} | |",
        f"| second run: jobs | 0 | {jobs_again} | {'yes' if jobs_again == 0 else 'no'} | `run.jobs_done` |",
        f"| second run: time | 15 s | {second.seconds:.1f} s | {'yes' if second.seconds <= 15 else 'no'} | |",
    ]


def main() -> None:
    """Run the project twice and write the page."""
    with tempfile.TemporaryDirectory() as scratch:
        root = project_root(Path(scratch), PROJECT)
        first = orthomill(root, "run", PROJECT)
        if first.code != 0:
            raise SystemExit(first.output)
        figures = summary(root, PROJECT)
        second = orthomill(root, "run", PROJECT)
        again = summary(root, PROJECT)
        planted_errors.write_page(root / "runs" / PROJECT)
    lines = [
        "# volos against its truth",
        "",
        f"`python -m benchmarks.volos`; {machine()}. Times vary with the load.",
        "",
        "| what | to reach | measured | reached | figure |",
        "| --- | --- | --- | --- | --- |",
        *run_rows(first, second, again),
        *(row(goal, figures) for goal in GOALS),
    ]
    stages = [name.split(".")[1] for name in figures if name.count(".") == 2 and name.endswith(".work_seconds")]
    lines += ["", "| stage | jobs | work (s) | peak memory of a worker |", "| --- | --- | --- | --- |"]
    for stage in stages:
        jobs, seconds, peak = (figures[f"run.{stage}.{what}"] for what in ("jobs", "work_seconds", "peak_memory"))
        lines.append(f"| {stage} | {jobs['value']} | {seconds['value']:.0f} | {peak['value']:.0f} {peak['unit']} |")
    write_result("volos", "\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
