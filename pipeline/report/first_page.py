"""What the first page of the report and the end of a run say: is it good, why, what to do next, where are the results.

Stages judge themselves (`Verdict`), answer a client's questions (`Answer`) and name their files (`Product`); here all of it is
put in one order, without knowing what it means.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from orthomill.pipeline.engine.run_facts import RunFacts, StageTitle
from orthomill.pipeline.report import numbers
from orthomill.pipeline.signing.product_classes import product_classes
from orthomill.pipeline.storage.depots.kept_at import depot_of
from orthomill.pipeline.storage.depots.product_files import product_size
from orthomill.schemas.stage_report import OF_A_CAMERA, WHERE_CHECKED, Product, StageReport, Topic

Reports = Mapping[str, StageReport]
"""The present report of every stage that has one, by kind."""
Level = Literal["good", "fair", "poor", "unjudged", "partial", "open"]
WORDS: dict[Level, str] = {
    "good": "Good",
    "fair": "Usable within limits",
    "poor": "In doubt",
    "unjudged": "Complete",
    "partial": "Part of a run",
    "open": "Not complete",
}
"""How the verdict begins."""
SEVERITY = ("good", "fair", "poor")
Cost = Literal["doubt", "loss", "note"]
NOT_DETERMINED = "not determined"


@dataclass(frozen=True)
class Reason:
    """One reason of the verdict, and the stage that gives it."""

    kind: str
    level: str
    sentence: str


@dataclass(frozen=True)
class Caution:
    """A warning of a stage with what it costs: doubt (any result may be wrong), loss (accuracy or ground), note."""

    kind: str
    title: str
    cost: Cost
    sentence: str


@dataclass(frozen=True)
class ProductFile:
    """A file to take away, with its size in bytes."""

    product: Product
    size: int

    @property
    def format(self) -> str:
        """The format as people call it, by the end of the name."""
        return FORMATS.get(Path(self.product.path).suffix, Path(self.product.path).suffix.lstrip(".").upper() or "folder")


FORMATS = {
    ".tif": "GeoTIFF",
    ".vrt": "GeoTIFF in sheets",
    ".laz": "LAZ",
    ".json": "JSON",
    ".csv": "CSV",
    ".xml": "XML",
    ".yaml": "YAML",
    ".txt": "text",
}


@dataclass(frozen=True)
class FirstPage:
    """The answers, in the order in which they are read."""

    level: Level
    headline: str
    reasons: tuple[Reason, ...]
    cautions: tuple[Caution, ...]
    """all of them, the dearest first"""
    answers: tuple[tuple[str, str], ...]
    """(question, answer)"""
    products: tuple[ProductFile, ...]
    surveyed: bool = True
    """whether anything lies in the reference system; a calibration alone is no survey"""
    classes: tuple[str, ...] = ()
    """accuracy class of every product and whether it keeps what the survey allows, one sentence for each source"""


def first_page(reports: Reports, stages: tuple[StageTitle, ...], run: RunFacts, folder: Path) -> FirstPage:
    """The first page of a run in `folder`; `stages` are all of the workflow, in its order."""
    cautions = tuple(sorted(_cautions(reports, stages), key=lambda caution: ("doubt", "loss", "note").index(caution.cost)))
    reasons = tuple(_reasons(reports, stages))
    silent = tuple(title for kind, title in stages if run.stage(kind).jobs and not _judged(kind, reports))
    level = _level(reasons, cautions, stages, run, silent)
    given = {answer.topic: answer.text for kind, _ in stages if kind in reports for answer in reports[kind].answers}
    surveyed = bool(given.keys() - {*OF_A_CAMERA, Topic.PHOTOGRAPHS}) or not given.keys() & {*OF_A_CAMERA}
    return FirstPage(
        level=level,
        headline=f"{WORDS[level]}: {_state(level, cautions, stages, run, silent)}",
        reasons=reasons,
        cautions=cautions,
        answers=tuple(_answers(given, run, surveyed)),
        products=tuple(_products(reports, stages, folder)),
        surveyed=surveyed,
        classes=tuple(product_classes(reports, folder, run.tolerances)),
    )


def not_asked_for(stages: tuple[StageTitle, ...], run: RunFacts) -> tuple[str, ...]:
    """Titles of the stages that a finished run was not to do."""
    done = {stage.kind for stage in run.stages}
    return tuple(title for kind, title in stages if kind not in done) if run.finished and run.stages else ()


def job_count(run: RunFacts) -> str:
    """Whether all jobs are done, and if not, what is missing."""
    if run.complete:
        skipped = sum(stage.skipped for stage in run.stages)
        unchanged = f", {numbers.number_text(skipped)} of them unchanged since an earlier run" if skipped else ""
        jobs = numbers.number_text(sum(stage.jobs for stage in run.stages))
        stages = "1 stage" if len(run.stages) == 1 else f"{len(run.stages)} stages"
        return f"all {jobs} jobs of {stages} are done{unchanged}."
    begun = [stage for stage in run.stages if stage.done or stage.skipped or stage.failed]
    missing = (
        counted(sum(stage.failed for stage in run.stages), "job failed", "jobs failed"),
        counted(sum(stage.waiting for stage in run.stages), "job is waiting", "jobs are waiting"),
        counted(len(run.stages) - len(begun), "stage has not begun", "stages have not begun"),
    )
    otherwise = "no job has run" if run.finished else "it is still running or was interrupted"
    reason = "; ".join(part for part in missing if part) or otherwise
    # What depends on no failed job is done all the same.
    again = "mend what failed and run the project again" if run.failures else "run the project again to continue"
    return f"{reason}. What is said below holds for what is done; {again}."


def counted(count: int, one: str, many: str) -> str:
    """A count with its noun; empty for none."""
    return f"{numbers.number_text(count)} {one if count == 1 else many}" if count else ""


def _judged(kind: str, reports: Reports) -> bool:
    return kind in reports and reports[kind].verdict is not None


def _level(
    reasons: tuple[Reason, ...],
    cautions: tuple[Caution, ...],
    stages: tuple[StageTitle, ...],
    run: RunFacts,
    silent: tuple[str, ...],
) -> Level:
    if not run.complete:
        return "open"
    if not_asked_for(stages, run):
        return "partial"
    if any(caution.cost == "doubt" for caution in cautions):
        return "poor"
    if not reasons:
        return "unjudged"
    worst = max(SEVERITY.index(reason.level) for reason in reasons)
    # Silence is not a verdict: what nobody has judged may be anything.
    return "unjudged" if silent and worst == 0 else ("good", "fair", "poor")[worst]


def _state(
    level: Level, cautions: tuple[Caution, ...], stages: tuple[StageTitle, ...], run: RunFacts, silent: tuple[str, ...]
) -> str:
    """What follows the first word of the verdict."""
    doubts, losses = (sum(caution.cost == cost for caution in cautions) for cost in ("doubt", "loss"))
    look = f"{counted(doubts, 'finding', 'findings')} must be looked at before any result is used."
    if level == "open":
        return job_count(run)
    if level == "unjudged":
        unsaid = f"; nothing says how good these results are: {', '.join(silent)}." if silent else "."
        return f"{job_count(run)[:-1]}{unsaid}"
    if level == "partial":
        # Lower case in the middle of a sentence, but not for abbreviations.
        missing = (title if title[1:2].isupper() else title[:1].lower() + title[1:] for title in not_asked_for(stages, run))
        done = f"{job_count(run)[:-1]}; not run: {', '.join(missing)}."
        return f"{done} {look}" if doubts else done
    if doubts:
        return look
    if level == "poor":
        return "see the reasons."
    # Nothing reassuring may stand above a warning.
    if losses:
        return f"{counted(losses, 'warning says', 'warnings say')} below where accuracy or ground is lost, and what to do."
    notes = f"; {counted(len(cautions), 'thing', 'things')} good to know below" if cautions else ""
    return f"nothing was found that puts results in doubt or costs accuracy or ground{notes}."


def _reasons(reports: Reports, stages: tuple[StageTitle, ...]) -> Iterator[Reason]:
    """What the stages say of their results, the worst first."""
    found = [(kind, verdict) for kind, _ in stages if kind in reports and (verdict := reports[kind].verdict)]
    # Where nothing is made that weighs, as in a calibration alone, what there is decides.
    alone = not any(verdict.weighs for _, verdict in found)
    said = [
        Reason(kind, verdict.level, verdict.sentence)
        for kind, verdict in found
        if verdict.weighs or ((alone or verdict.level == "poor") and not reports[kind].aside)
    ]
    yield from sorted(said, key=lambda reason: -SEVERITY.index(reason.level))


def _cautions(reports: Reports, stages: tuple[StageTitle, ...]) -> Iterator[Caution]:
    """Every warning once, in the order of the stages; what concerns a simulation comes last."""
    ordered = sorted((stage for stage in stages if stage[0] in reports), key=lambda stage: reports[stage[0]].aside)
    for kind, title in ordered:
        report = reports[kind]
        rest = (sentence for sentence in report.warnings if sentence not in report.doubts and sentence not in report.losses)
        groups: tuple[tuple[Cost, Iterator[str]], ...] = (
            ("doubt", iter(report.doubts)),
            ("loss", (sentence for sentence in report.losses if sentence not in report.doubts)),
            ("note", rest),
        )
        yield from (Caution(kind, title, cost, sentence) for cost, sentences in groups for sentence in sentences)


def _answers(given: dict[Topic, str], run: RunFacts, surveyed: bool) -> Iterator[tuple[str, str]]:
    said = {**given, Topic.TIME: _time(run)}
    # What a survey is asked has no answer in a calibration alone, which is no survey.
    if surveyed:
        said[Topic.REFERENCE] = ", ".join(filter(None, (run.crs, given.get(Topic.REFERENCE))))
    for topic in Topic:
        if topic in said or (surveyed and topic not in (*OF_A_CAMERA, *WHERE_CHECKED)):
            yield str(topic), said.get(topic, NOT_DETERMINED)


def _time(run: RunFacts) -> str:
    whole = numbers.duration_text(run.whole_seconds)
    runs = f" in {run.runs} runs" if run.runs > 1 else ""
    memory = f"; largest worker {numbers.memory_text(run.peak_bytes)}" if run.peak_bytes else ""
    return f"{whole}{runs}{memory}"


def _products(reports: Reports, stages: tuple[StageTitle, ...], folder: Path) -> Iterator[ProductFile]:
    """Files that exist; those of later stages first, for they are what the run was made for."""
    depot = depot_of(folder)
    for kind, _ in reversed(stages):
        if kind in reports:
            for product in reports[kind].products:
                if (size := product_size(depot, product.path)) is not None:
                    yield ProductFile(product, size)
