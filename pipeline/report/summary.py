"""The summary of a run: every figure of its report under a stable name, for programs and for comparisons between runs.

One flat table. A figure of a stage is `<stage>.<name>`; facts of the run itself are `run.<name>` and `run.<stage>.<name>`.
Each entry has a value, a unit and a sentence that says what it is. The file is sorted and strict JSON: a number that is not finite
is null.
"""

import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from orthomill.pipeline.engine.run_facts import RunFacts, StageRun, StageTitle
from orthomill.pipeline.report.present_reports import present_reports
from orthomill.pipeline.storage.reading import ReadableStore
from orthomill.pipeline.storage.whole_files import write_whole
from orthomill.schemas.memory import MIB
from orthomill.schemas.stage_report import Figure

Summary = dict[str, dict[str, Any]]
"""name -> {"value", "unit", "sentence"}"""


def summary(store: ReadableStore, stages: tuple[StageTitle, ...], run: RunFacts) -> Summary:
    """All figures of a run, sorted by name; stages without a report yet contribute only what is known of their jobs."""
    # No stage is called "run": facts of the run and figures of stages never collide.
    entries = [(f"run.{figure.name}", figure) for figure in _run_figures(run)]
    for kind, _ in stages:
        entries += [(f"run.{kind}.{figure.name}", figure) for figure in _stage_figures(run.stage(kind))]
    for kind, report in present_reports(store, stages, run).items():
        entries += _unique(kind, report.figures)
    return {name: _entry(figure) for name, figure in sorted(entries, key=lambda entry: entry[0])}


def _unique(kind: str, figures: tuple[Figure, ...]) -> Iterator[tuple[str, Figure]]:
    """The figures of a stage by name; a name that is used twice gets a number, so that no figure is lost."""
    seen: dict[str, int] = {}
    for figure in figures:
        seen[figure.name] = seen.get(figure.name, 0) + 1
        suffix = f"_{seen[figure.name]}" if seen[figure.name] > 1 else ""
        yield f"{kind}.{figure.name}{suffix}", figure


def _entry(figure: Figure) -> dict[str, Any]:
    value = figure.value
    # JSON has no NaN, and readers that accept one disagree about its spelling.
    if isinstance(value, float) and not math.isfinite(value):
        value = None
    return {"value": value, "unit": figure.unit, "sentence": figure.sentence}


def _run_figures(run: RunFacts) -> tuple[Figure, ...]:
    machine = "; ".join(f"{what}: {value}" for what, value in run.machine)
    return (
        _fact("project", run.project, "Name of the project."),
        _fact("crs", run.crs, "Coordinate reference system of all products."),
        _fact("version", run.version, "Version of orthomill that made the run."),
        _fact("scheduler", run.scheduler, "Where the jobs ran."),
        _fact("machine", machine, "The machine and its libraries."),
        _fact("started", run.started, "Beginning of the last run that did any work (ISO 8601)."),
        _fact("finished", run.finished, "End of that run (ISO 8601); null when it did not finish."),
        _fact("runs", run.runs, "Runs that produced these results; more than one after an interruption or a change."),
        _fact("wall_seconds", run.whole_seconds, "Wall-clock time of all runs that produced these results.", "s"),
        _fact("failed_tiles", ", ".join(failure.key for failure in run.failures), "Keys of the jobs that failed."),
        _fact("complete", run.complete, "Whether every planned job of every stage is done or unchanged."),
        *_job_figures(run.stages, run.peak_bytes),
    )


def _stage_figures(stage: StageRun) -> tuple[Figure, ...]:
    return (
        _fact("complete", stage.complete, "Whether every planned job of the stage is done or unchanged."),
        *_job_figures((stage,), stage.peak_bytes),
    )


def _job_figures(stages: tuple[StageRun, ...], peak_bytes: int | None) -> tuple[Figure, ...]:
    return (
        _fact("work_seconds", sum(stage.seconds for stage in stages), "Working time of all jobs, whichever run did them.", "s"),
        _fact(
            "cpu_seconds", sum(stage.cpu_seconds for stage in stages), "Processor time of all jobs, whichever run did them.", "s"
        ),
        _fact("peak_memory", _mebibytes(peak_bytes), "Largest memory of one worker.", "MiB"),
        _fact("jobs", sum(stage.jobs for stage in stages), "Jobs planned."),
        _fact("jobs_done", sum(stage.done for stage in stages), "Jobs done by the last run that did any work."),
        _fact("jobs_skipped", sum(stage.skipped for stage in stages), "Jobs that this run found unchanged since an earlier run."),
        _fact("jobs_failed", sum(stage.failed for stage in stages), "Jobs that failed."),
        _fact("jobs_waiting", sum(stage.waiting for stage in stages), "Jobs that were planned but not started."),
    )


def _fact(name: str, value: float | int | str | bool | None, sentence: str, unit: str = "") -> Figure:
    return Figure(name=name, value=value, unit=unit, sentence=sentence)


def _mebibytes(count: int | None) -> float | None:
    return None if count is None else round(count / MIB, 1)


def write_summary(store: ReadableStore, stages: tuple[StageTitle, ...], run: RunFacts, path: Path) -> None:
    """Write `summary.json`, completely or not at all. Raises StoreError when the disk refuses."""
    # Sorted and indented: two summaries can be compared line by line with ordinary tools.
    text = json.dumps(summary(store, stages, run), indent=1, sort_keys=True, ensure_ascii=False, allow_nan=False)
    write_whole(path, f"{text}\n".encode())


INTRODUCTION = """# The figures of `summary.json`

Every run writes `runs/<project>/summary.json`: one flat object, sorted by name. An entry is
`{"value": ..., "unit": "...", "sentence": "..."}`. Names are stable: a figure keeps its name from version to version, and
a new meaning gets a new name.

| name | what it is |
| --- | --- |
| `<stage>.<figure>` | a figure of the stage's report, in the unit given |
| `run.<fact>` | a fact of the run: versions, times, memory, jobs, whether it is complete |
| `run.<stage>.<fact>` | jobs, working time and memory of one stage |

A value is a number, a word, true or false, or null if it could not be determined. Lengths are in metres and image residuals in
pixels unless the unit says otherwise. A stage that has not reported yet has only its `run.<stage>` entries.

Generated from a run; do not edit by hand.
"""


def summary_markdown(entries: Summary) -> str:
    """The page `docs/summary.md`: the scheme, then every name with its unit and its sentence, by stage.

    Facts that every stage has (`run.<stage>.*`) are listed once. Values are left out: the page describes names.
    """
    rows: dict[str, dict[str, tuple[str, str]]] = {}
    for name, entry in entries.items():
        group, label = _documented_name(name)
        rows.setdefault(group, {})[label] = (entry["unit"], entry["sentence"])
    groups = sorted(rows, key=lambda group: (group.startswith("run"), group))
    return INTRODUCTION + "".join(_markdown_table(group, rows[group]) for group in groups)


def _documented_name(name: str) -> tuple[str, str]:
    parts = name.split(".")
    if parts[0] == "run" and len(parts) > 2:
        return "run.<stage>", f"run.<stage>.{parts[-1]}"
    return parts[0], name


def _markdown_table(group: str, rows: dict[str, tuple[str, str]]) -> str:
    lines = [f"| `{name}` | {_cell(unit)} | {_cell(sentence)} |" for name, (unit, sentence) in rows.items()]
    return "\n".join([f"\n## {group}\n", "| name | unit | what it is |", "| --- | --- | --- |", *lines]) + "\n"


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("\n", " ")
