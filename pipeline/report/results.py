"""Summary and report of a run, and the functions that run a workflow and write them.

They are written when a run did something. A run that finds everything unchanged leaves them as they are, so that they keep the
figures of the runs that did the work.
"""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from orthomill.pipeline.engine.fingerprint import digest, of_modules
from orthomill.pipeline.engine.run_facts import FACTS, RunFacts, StageTitle, read_facts, write_facts
from orthomill.pipeline.engine.running import Options, Watch, run_workflow, session_of, titles_of
from orthomill.pipeline.engine.session import unwatched
from orthomill.pipeline.records.lock import only_run
from orthomill.pipeline.storage.reading import ReadableStore
from orthomill.pipeline.workflow.workflow_file import LoadedWorkflow
from orthomill.schemas.errors import StoreError

SUMMARY, REPORT = "summary.json", "report.html"
DEFAULTS = Options()
"""One worker per core of this machine, every stage."""


def run_with_report(
    loaded: LoadedWorkflow,
    options: Options = DEFAULTS,
    watch: Watch = unwatched,
    announce: Callable[[str], None] = lambda line: None,
) -> RunFacts:
    """Run a workflow and write its summary and report: the whole of `orthomill run`, for Python programs and notebooks.

    Silent unless `watch` (progress) and `announce` (single lines) are given. Raises OrthomillError when the run cannot start;
    jobs that failed are listed in the facts returned.
    """
    return run_workflow(loaded, options, update_results, watch, announce)


def update_results(store: ReadableStore, folder: Path, stages: tuple[StageTitle, ...], facts: RunFacts) -> None:
    """Facts, summary and report of a run that did something; after one that did nothing they stay as they are, if current."""
    if facts.worked:
        write_results(store, folder, stages, facts)
    else:
        keep_results(store, folder, stages, facts)


def write_results(store: ReadableStore, folder: Path, stages: tuple[StageTitle, ...], facts: RunFacts) -> None:
    """Write the facts, the summary and the report. `stages` are all of the workflow; --until leaves some of them out."""
    # matplotlib and OpenCV are loaded only where there is something to draw: importing them takes longer than a run without work.
    from orthomill.pipeline.report.page import write_report
    from orthomill.pipeline.report.summary import write_summary

    facts = replace(facts, written_by=_writers())
    write_facts(folder, facts)
    ran = {stage.kind for stage in facts.stages}
    write_summary(store, tuple(stage for stage in stages if stage[0] in ran), facts, folder / SUMMARY)
    write_report(store, stages, facts, folder / REPORT)


def keep_results(store: ReadableStore, folder: Path, stages: tuple[StageTitle, ...], facts: RunFacts) -> None:
    """After a run without work: summary and report stay, unless they are missing, incomplete, or written by other code.

    In those cases they are written again, from the facts of the run that did the work. `stages` are all of the workflow.
    """
    earlier = read_facts(folder)
    described = facts if earlier is None or not earlier.describes(facts) else earlier
    if described is facts or not _are_current(folder, described):
        write_results(store, folder, stages, described)


def rewrite_results(loaded: LoadedWorkflow) -> Path:
    """Write summary and report again from what is stored; returns the report's path.

    Raises StoreError before the first run, ResourceError while another run is in progress, whose facts would be overwritten.
    """
    session = session_of(loaded)
    facts = read_facts(session.folder)
    if facts is None:
        raise StoreError(f"{loaded.project.project} has not been run yet; run it first: orthomill run {loaded.project.project}")
    with only_run(session.folder):
        # Read again under the lock: a run that ended in the meantime has newer facts.
        write_results(session.store, session.folder, titles_of(session.stages), read_facts(session.folder) or facts)
    return session.folder / REPORT


def rewrite_page(store: ReadableStore, folder: Path, stages: tuple[StageTitle, ...], facts: RunFacts) -> None:
    """Write the report alone again: facts and summary, which may be signed, stay as they are."""
    from orthomill.pipeline.report.page import write_report

    write_report(store, stages, facts, folder / REPORT)


def _are_current(folder: Path, facts: RunFacts) -> bool:
    # The facts are written first, so that a page older than them belongs to a run that was killed before it wrote the page.
    written = (folder / FACTS).stat().st_mtime_ns
    pages = (folder / SUMMARY, folder / REPORT)
    return facts.written_by == _writers() and all(page.exists() and page.stat().st_mtime_ns >= written for page in pages)


def _writers() -> str:
    """Digest of everything but the results that determines summary and report."""
    templates = sorted((Path(__file__).parent / "templates").iterdir())
    modules = of_modules("orthomill.pipeline.report.page", "orthomill.pipeline.report.summary")
    return digest(modules, *(template.read_text() for template in templates))
