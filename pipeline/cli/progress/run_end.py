"""What the terminal says at the end of a run: what was done, the report's verdict, its dearest warnings, where the results are.

With --json one object says the same.
"""

import json
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console
from rich.markup import escape

from orthomill.pipeline.engine.run_facts import RunFacts, StageTitle
from orthomill.pipeline.report.first_page import Caution, FirstPage, first_page
from orthomill.pipeline.report.numbers import bytes_text
from orthomill.pipeline.report.present_reports import present_reports
from orthomill.pipeline.storage.depots.kept_at import depot_of
from orthomill.pipeline.storage.store import Store

CAUTIONS_SHOWN, FAILURES_SHOWN = 3, 5
COLOURS = {"good": "green", "unjudged": "green", "fair": "yellow", "partial": "yellow", "poor": "red", "open": "red"}
WORDS = {"doubt": "doubtful", "loss": "costs accuracy or ground"}


@dataclass(frozen=True)
class RunEnd:
    """The end of a run, to be told."""

    facts: RunFacts
    folder: Path
    page: FirstPage

    @property
    def place(self) -> str:
        """Where the products are: the run's folder, or the address of an object store."""
        return depot_of(self.folder).address

    @property
    def doubts(self) -> tuple[Caution, ...]:
        """What puts the results in doubt."""
        return tuple(caution for caution in self.page.cautions if caution.cost == "doubt")

    @property
    def counts(self) -> str:
        """Jobs and seconds in words."""
        done, skipped = sum(s.done for s in self.facts.stages), sum(s.skipped for s in self.facts.stages)
        return f"{done} jobs run, {skipped} unchanged, {len(self.facts.failures)} failed in {self.facts.seconds:.0f} s"


def run_end(facts: RunFacts, folder: Path, stages: tuple[StageTitle, ...]) -> RunEnd:
    """The end of a run of `stages`, all of the workflow."""
    # Reports of stages that this run did not finish may be those of an earlier one.
    complete = tuple(title for title in stages if facts.stage(title[0]).complete)
    return RunEnd(facts, folder, first_page(present_reports(Store(folder), complete, facts), stages, facts, folder))


def tell(end: RunEnd, out: Console, err: Console) -> None:
    """Print it for a person."""
    facts, page = end.facts, end.page
    out.print(f"{end.counts}; report: {end.folder / 'report.html'}", soft_wrap=True)
    for failure in facts.failures[:FAILURES_SHOWN]:
        err.print(f"[red]failed[/red] {escape(failure.key)}: {escape(failure.sentence)}", soft_wrap=True)
    if (more := len(facts.failures) - FAILURES_SHOWN) > 0:
        err.print(f"... and {more} more failed; they are in the report.")
    out.print(f"[{COLOURS[page.level]}]{escape(page.headline)}[/]", soft_wrap=True)
    for reason in page.reasons:
        out.print(f"  {escape(reason.sentence)}", soft_wrap=True)
    costly = [caution for caution in page.cautions if caution.cost != "note"]
    for caution in costly[:CAUTIONS_SHOWN]:
        words, colour = WORDS[caution.cost], "red" if caution.cost == "doubt" else "yellow"
        place = f"(report: {escape(caution.title)})"
        err.print(f"[{colour}]{words}[/{colour}] {escape(caution.sentence)} {place}", soft_wrap=True)
    if len(costly) > CAUTIONS_SHOWN:
        rest = costly[CAUTIONS_SHOWN:]
        doubtful = sum(caution.cost == "doubt" for caution in rest)
        which = f"{doubtful} more that put the results in doubt" if doubtful else f"{len(rest)} more warnings"
        err.print(f"... and {which}; they are in the report.")
    for file in page.products:
        if file.product.main:
            out.print(f"{end.place}/{file.product.path}  {file.product.purpose}, {bytes_text(file.size)}", soft_wrap=True)


def tell_as_json(end: RunEnd) -> str:
    """The same as one line for other programs."""
    page = end.page
    return json.dumps(
        {
            "event": "end",
            "complete": end.facts.complete,
            "level": page.level,
            "verdict": page.headline,
            "reasons": [reason.sentence for reason in page.reasons],
            "warnings": [{"stage": c.kind, "cost": c.cost, "sentence": c.sentence} for c in page.cautions],
            "failed": [{"tile": failure.key, "sentence": failure.sentence} for failure in end.facts.failures],
            "products": [
                {"path": f"{end.place}/{file.product.path}", "purpose": file.product.purpose, "bytes": file.size}
                for file in page.products
            ],
            "report": str(end.folder / "report.html"),
            "seconds": round(end.facts.seconds, 1),
        },
        ensure_ascii=False,
    )
