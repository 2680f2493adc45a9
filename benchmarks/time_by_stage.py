"""Where the time goes: processor time of every stage of finished runs, for each megapixel of their photographs.

`python -m benchmarks time_by_stage RUN...` reads finished runs; without folders two shipped projects are run first.
Processor time and not wall-clock time: it is the same on an idle and on a busy machine, and adds up over workers.
"""

import tempfile
from pathlib import Path

import orthomill as library
from benchmarks.instrument.result_page import write_page
from benchmarks.measured_run import project_root, run_folders, run_project
from orthomill.pipeline.engine.run_facts import RunFacts, StageRun, read_facts

PROJECTS = ("volos", "brighton")
TRUTH = ("simulation", "evaluation")
"""stages that exist for simulated photographs only"""
SURFACE = "densification"
"""the last stage of 'photographs to surface'"""


def megapixels(run: Path) -> float:
    """All pixels of the photographs of a run, in millions."""
    return sum(photo.width * photo.height for photo in library.open(run).photographs.photos) / 1e6


def to_surface(facts: RunFacts) -> tuple[StageRun, ...]:
    """The stages from the photographs to the surface, in order."""
    kinds = [stage.kind for stage in facts.stages]
    last = kinds.index(SURFACE) + 1 if SURFACE in kinds else len(kinds)
    return tuple(stage for stage in facts.stages[:last] if stage.kind not in TRUTH)


def table(name: str, facts: RunFacts, pixels: float) -> list[str]:
    """The lines of one run; pixels: millions."""
    all_stages = tuple(stage for stage in facts.stages if stage.kind not in TRUTH)
    whole = sum(stage.cpu_seconds for stage in all_stages)
    return [
        f"## {name}: {pixels:.1f} Mpx",
        "",
        "| stage | CPU-s | share | CPU-s per Mpx | largest worker (MiB) |",
        "| --- | --- | --- | --- | --- |",
        *(_row(stage.kind.replace("_", " "), (stage,), whole, pixels) for stage in facts.stages),
        _row("**photographs to surface**", to_surface(facts), whole, pixels),
        _row("**photographs to products**", all_stages, whole, pixels),
        "",
    ]


def _row(name: str, stages: tuple[StageRun, ...], whole: float, pixels: float) -> str:
    seconds = sum(stage.cpu_seconds for stage in stages)
    # Truth is made and judged on no client's block, so that it has no share in what a block costs.
    share = "" if stages[0].kind in TRUTH else f"{100 * seconds / max(whole, 1e-9):.0f} %"
    peak = max(stage.peak_bytes or 0 for stage in stages)
    return f"| {name} | {seconds:.1f} | {share} | {seconds / pixels:.2f} | {peak / 2**20:.0f} |"


def page(runs: tuple[Path, ...]) -> str:
    """The tables of finished runs. Raises SystemExit for a folder without one."""
    lines = ["# Where the time goes", "", "Kernels compiled before.", ""]
    for run in runs:
        facts = read_facts(run)
        if facts is None or not facts.stages:
            raise SystemExit(f"{run} is not the folder of a run; give folders like runs/volos.")
        lines += table(facts.project, facts, megapixels(run))
    return "\n".join(lines)


def main(words: list[str]) -> None:
    """Write the page of the runs that are named, or of the shipped projects, run in a folder of their own."""
    with tempfile.TemporaryDirectory() as scratch:
        root = project_root(Path(scratch), *PROJECTS)
        for project in () if words else PROJECTS:
            run_project(root, project)
        runs = run_folders(words or [str(root / "runs" / project) for project in PROJECTS])
        write_page("time_by_stage", words, page(runs))
