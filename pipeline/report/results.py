"""What people read of a run: its facts, the summary and the report. They are written when something was done; a run that finds
everything unchanged leaves them as they are, with the figures of the runs that did the work."""

from dataclasses import replace
from pathlib import Path

from pydantic import TypeAdapter, ValidationError

from orthomill.pipeline.engine.fingerprint import digest, of_modules
from orthomill.pipeline.engine.run_facts import RunFacts, StageTitle
from orthomill.pipeline.storage.reading import ReadableStore
from orthomill.pipeline.storage.table_files import write_whole

FACTS = "jobs/run.json"
SUMMARY, REPORT = "summary.json", "report.html"
_FACTS = TypeAdapter(RunFacts)


def write_facts(folder: Path, facts: RunFacts) -> None:
    """What summary and report are made from, besides the store."""
    write_whole(folder / FACTS, _FACTS.dump_json(facts, indent=1))


def read_facts(folder: Path) -> RunFacts | None:
    """The facts that the last run left; None when there are none, or none that this version understands."""
    try:
        return _FACTS.validate_json((folder / FACTS).read_bytes())
    except (FileNotFoundError, ValidationError):
        return None


def write_results(store: ReadableStore, folder: Path, stages: tuple[StageTitle, ...], facts: RunFacts) -> None:
    """The facts, the summary and the report."""
    from orthomill.pipeline.report.page import write_report  # what draws is loaded only where there is something to draw
    from orthomill.pipeline.report.summary import write_summary

    facts = replace(facts, written_by=_writers())
    write_facts(folder, facts)
    write_summary(store, stages, facts, folder / SUMMARY)
    write_report(store, stages, facts, folder / REPORT)


def keep_results(store: ReadableStore, folder: Path, stages: tuple[StageTitle, ...], facts: RunFacts) -> None:
    """After a run that had nothing to do: summary and report stay, unless they are missing, were not finished, or were written by
    other code; then they are written again from the facts of the run that did the work. `stages` are all of the workflow."""
    earlier = read_facts(folder)
    tells = facts if earlier is None or not earlier.tells_of(facts) else earlier
    if tells is facts or not _are_current(folder, tells):
        write_results(store, folder, tuple(stage for stage in stages if tells.stage(stage[0]).jobs), tells)


def _are_current(folder: Path, facts: RunFacts) -> bool:
    written = (folder / FACTS).stat().st_mtime_ns
    pages = (folder / SUMMARY, folder / REPORT)
    return facts.written_by == _writers() and all(page.exists() and page.stat().st_mtime_ns >= written for page in pages)


def _writers() -> str:
    """Digest of all that makes summary and report what they are, besides the results."""
    template = Path(__file__).parent / "templates" / "report.html"
    return digest(of_modules("orthomill.pipeline.report.page", "orthomill.pipeline.report.summary"), template.read_text())
