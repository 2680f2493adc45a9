"""The embedded project and the same town from another seed against their truth, beside what they are to reach.

`python -m benchmarks volos` runs both in a folder of their own (volos twice: once from nothing, once unchanged);
`python -m benchmarks volos runs/volos runs/volos_second` tells of finished runs instead. Every figure is read from summary.json or
measured from outside; nothing is computed here that the report does not show.
"""

import json
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from benchmarks import planted_errors
from benchmarks.instrument.result_page import write_page
from benchmarks.measured_run import MeasuredRun, orthomill, project_root, run_folders, run_project, summary
from orthomill.schemas.memory import MIB

PROJECTS = ("volos", "volos_second")

Figures = dict[str, dict]
"""name -> value, unit and sentence, as in summary.json"""


@dataclass(frozen=True)
class Goal:
    """One line of the table: what, what is to be reached, the figure's name, and whether a value reaches it (None: no goal)."""

    what: str
    to_reach: str
    name: str
    reached: Callable[[float], bool] | None = None


def most(limit: float) -> Callable[[float], bool]:
    """Whether a value is `limit` or less, whatever its sign."""
    return lambda value: abs(value) <= limit


def least(limit: float) -> Callable[[float], bool]:
    """Whether a value is `limit` or more."""
    return lambda value: value >= limit


GOALS = (
    Goal("camera centres within 3 of their standard errors", "95 %", "evaluation.centres_within_3_sigma", least(95)),
    Goal("check points, plan", "0.35 m", "orientation.check_rmse_plan", most(0.35)),
    Goal("check points, height", "0.6 m", "orientation.check_rmse_height", most(0.6)),
    Goal("measured heights, of cells truly seen twice", "93 %", "evaluation.dsm_measured_share", least(93)),
    Goal("all heights, of cells truly seen twice", "100 %", "evaluation.dsm_all_codes_share", least(99.995)),
    Goal("measured heights beyond 1 m", "1 %", "evaluation.dsm_measured_beyond_1_m", most(1)),
    Goal("the same, margins of buildings", "8 %", "evaluation.dsm_measured_building_margin_beyond_1_m", most(8)),
    Goal("the same, roofs", "2.5 %", "evaluation.dsm_measured_roof_beyond_1_m", most(2.5)),
    Goal("the same, open ground", "-", "evaluation.dsm_measured_open_ground_beyond_1_m"),
    Goal("the same, trees", "-", "evaluation.dsm_measured_tree_beyond_1_m"),
    Goal("the same, ground where vehicles stand", "-", "evaluation.dsm_measured_vehicle_beyond_1_m"),
    Goal("the same, ground below wires", "-", "evaluation.dsm_measured_wire_beyond_1_m"),
    Goal("all heights beyond 1 m", "-", "evaluation.dsm_all_codes_beyond_1_m"),
    Goal("called measured, of cells that fewer than two photographs see", "-", "evaluation.dsm_measured_unseen"),
    Goal("terrain against the true ground: open ground, RMSE", "0.06 m", "evaluation.terrain_open_ground_rmse", most(0.06)),
    Goal("the same, beside buildings", "0.15 m", "evaluation.terrain_building_margin_rmse", most(0.15)),
    Goal("the same, under roofs", "0.20 m", "evaluation.terrain_roof_rmse", most(0.20)),
    Goal("the same, under trees", "0.20 m", "evaluation.terrain_tree_rmse", most(0.20)),
    Goal("the same, under roofs, beyond 1 m", "0 %", "evaluation.terrain_roof_beyond_1_m", most(0.0)),
    Goal("measured ground within 2 of its standard errors", "93 %", "evaluation.terrain_measured_within_2_sigma", least(93)),
    Goal("the same, bridged under buildings", "93 %", "evaluation.terrain_under_buildings_within_2_sigma", least(93)),
    Goal("the same, bridged under wood", "93 %", "evaluation.terrain_under_wood_within_2_sigma", least(93)),
    Goal("the same, guessed", "93 %", "evaluation.terrain_guessed_within_2_sigma", least(93)),
    Goal("objects that are called ground", "0 %", "evaluation.terrain_type_2", most(0.0)),
    Goal("water that is measured", "-", "evaluation.dsm_measured_water_share"),
    Goal("open ground, NMAD", "0.06 m", "evaluation.dsm_measured_open_ground_nmad", most(0.06)),
    Goal("open ground, bias", "0.1 m", "evaluation.dsm_measured_open_ground_bias", most(0.1)),
    Goal("roofs grown", "-", "evaluation.dsm_measured_roofs_grown"),
    Goal("roofs lost", "-", "evaluation.dsm_measured_roofs_lost"),
    Goal("judged by the check, open ground", "98 %", "evaluation.check_judged_open_ground", least(98)),
    Goal("the same, roofs", "90 %", "evaluation.check_judged_roof", least(90)),
    Goal("the same, margins of buildings", "80 %", "evaluation.check_judged_building_margin", least(80)),
    Goal("orthoimage, filled where a photograph sees", "100 %", "evaluation.ortho_completeness", least(99.995)),
    Goal("the same where the surface model has a height", "100 %", "evaluation.ortho_completeness_on_surface", least(99.995)),
    Goal("orthoimage, shifted by more than 0.5 px", "0.05 %", "evaluation.ortho_shift_above_half_px_share", most(0.05)),
    Goal(
        "the same where all heights around are measured",
        "0.05 %",
        "evaluation.ortho_shift_measured_above_half_px_share",
        most(0.05),
    ),
    Goal("the same without the shift of the datum", "0.05 %", "evaluation.ortho_own_shift_above_half_px_share", most(0.05)),
    Goal("orthoimage, mean shift across", "-", "evaluation.ortho_shift_mean_col_px"),
    Goal("of this, by the datum of the block", "-", "evaluation.ortho_datum_shift_mean_col_px"),
    Goal("orthoimage, doubled roofs", "0.3 %", "evaluation.ortho_doubled_share", most(0.3)),
    Goal("the same without pixels that touch the roof", "0.3 %", "evaluation.ortho_doubled_apart_share", most(0.3)),
    Goal("orthoimage, roof edges from a straight line", "0.5 px", "evaluation.ortho_roof_edges_jagged_px", most(0.5)),
    Goal("orthoimage, disturbed road where 3 or more photos see it", "1 %", "evaluation.ortho_roads_disturbed_3", most(1)),
    Goal("orthoimage, PSNR", "-", "evaluation.ortho_psnr"),
    Goal("orthoimage, SSIM", "-", "evaluation.ortho_ssim"),
)
CODES = ("agreed", "one_pair", "volume", "disputed", "incoherent", "coarse", "interpolated")
PLACES = ("", "open_ground_", "roof_", "building_margin_", "tree_")


def _value(goal: Goal, figures: Figures) -> str:
    """The value of a goal in one run, with a note where it is missed."""
    figure = figures.get(goal.name)
    if figure is None or figure["value"] is None:
        return "-"
    missed = goal.reached is not None and not goal.reached(figure["value"])
    return f"{figure['value']:.3f} {figure['unit']}".strip() + (" (missed)" if missed else "")


def goal_rows(runs: dict[str, Figures]) -> Iterator[str]:
    """The table of goals, a column per run."""
    yield "| what | to reach | " + " | ".join(runs) + " | figure |"
    yield "| --- " * (len(runs) + 3) + "|"
    for goal in GOALS:
        yield f"| {goal.what} | {goal.to_reach} | " + " | ".join(_value(goal, f) for f in runs.values()) + f" | `{goal.name}` |"


def honesty_rows(runs: dict[str, Figures]) -> Iterator[str]:
    """Standard errors by code and class, a column per run."""
    yield "| code and class | " + " | ".join(runs) + " |"
    yield "| --- " * (len(runs) + 1) + "|"
    for code in CODES:
        for place in PLACES:
            head = f"evaluation.dsm_{code}_{place}"
            if any(f"{head}share" in figures for figures in runs.values()):
                words = f"{code} {place}".replace("_", " ").strip()
                yield f"| {words} | " + " | ".join(_honesty(head, figures) for figures in runs.values()) + " |"


def _honesty(head: str, figures: Figures) -> str:
    parts = (
        ("share",),
        ("beyond_1_m",),
        ("within_2_sigma", "beyond_4_sigma"),
        ("within_2_relative_sigma", "beyond_4_relative_sigma"),
    )
    return "; ".join(" / ".join(_percent(figures.get(f"{head}{name}", {}).get("value")) for name in names) for names in parts)


def crown_rows(runs: dict[str, Figures]) -> Iterator[str]:
    """What the heights on trees are, by code, a column per run."""
    yield "| code | " + " | ".join(runs) + " |"
    yield "| --- " * (len(runs) + 1) + "|"
    for code in ("measured", *CODES):
        head = f"evaluation.dsm_{code}_tree_"
        if any(f"{head}at_crown" in figures for figures in runs.values()):
            yield f"| {code.replace('_', ' ')} | " + " | ".join(_crowns(head, figures) for figures in runs.values()) + " |"


def _crowns(head: str, figures: Figures) -> str:
    parts = ("at_crown", "at_ground", "at_neither"), ("nearer_within_2", "nearer_beyond_4")
    return "; ".join(" / ".join(_percent(figures.get(f"{head}{name}", {}).get("value")) for name in names) for names in parts)


def _percent(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"


def run_rows(first: MeasuredRun, second: MeasuredRun, figures: Figures) -> list[str]:
    """The lines about the runs themselves."""
    jobs_again, peak = figures["run.jobs_done"]["value"], first.peak_bytes / MIB
    return [
        "| what | to reach | measured | reached |",
        "| --- | --- | --- | --- |",
        f"| run from nothing | 360 s | {first.seconds:.0f} s | {'yes' if first.seconds <= 360 else 'no'} |",
        f"| largest process | 1536 MiB | {peak:.0f} MiB | {'yes' if peak <= 1536 else 'no'} |",
        f"| second run: jobs | 0 | {jobs_again} | {'yes' if jobs_again == 0 else 'no'} |",
        f"| second run: time | 15 s | {second.seconds:.1f} s | {'yes' if second.seconds <= 15 else 'no'} |",
        "",
    ]


def page(runs: dict[str, Figures], about_runs: list[str]) -> str:
    """The page of results; `runs`: summaries by project."""
    note = (
        "Share of the cells seen twice; share beyond 1 m; within 2 (93 to 97) / beyond 4 (1 or less) of their standard errors; "
        "the same of those among neighbours, without the datum's error. All in %."
    )
    lines = ["# volos against its truth", "", "Times vary with the load.", ""]
    crowns = (
        "Heights on trees, through whose gaps photographs truly see the ground: at the crown / at the ground below / at neither "
        "(1 m); within 2 / beyond 4 of their standard errors among neighbours from the nearer of the two. All in %. Every other "
        "figure compares with the crown alone."
    )
    lines += [*about_runs, *goal_rows(runs), "", note, "", *honesty_rows(runs), "", crowns, "", *crown_rows(runs)]
    return "\n".join(lines) + "\n"


def main(words: list[str]) -> None:
    """Write the page: of the finished runs that are named, or of new ones."""
    if words:
        folders = run_folders(words)
        write_page("volos", words, page({folder.name: json.loads((folder / "summary.json").read_text()) for folder in folders}, []))
        return
    with tempfile.TemporaryDirectory() as scratch:
        root = project_root(Path(scratch), *PROJECTS)
        measured = [run_project(root, project) for project in PROJECTS]
        runs = {project: summary(root, project) for project in PROJECTS}
        second = orthomill(root, "run", PROJECTS[0])
        about = run_rows(measured[0], second, summary(root, PROJECTS[0]))
        planted_errors.main([str(root / "runs" / PROJECTS[0])])
    write_page("volos", words, page(runs, about))
