"""A run as the terminal sees it: from a checked workflow to its last line."""

import json
from collections.abc import Callable

import typer
from rich.markup import escape

from orthomill.pipeline.cli.progress.run_display import run_display
from orthomill.pipeline.cli.progress.run_end import RunEnd, run_end, tell, tell_as_json
from orthomill.pipeline.cli.terminal import err, out
from orthomill.pipeline.engine.running import Options, titles_of
from orthomill.pipeline.report.results import run_with_report
from orthomill.pipeline.workflow.workflow_file import LoadedWorkflow


def run_project(loaded: LoadedWorkflow, options: Options, as_json: bool = False) -> RunEnd:
    """Run with progress lines, and tell how it ended. Ends the command where the project is not complete."""

    def announce(line: str) -> None:
        print(json.dumps({"event": "note", "text": line}), flush=True) if as_json else out.print(escape(line), soft_wrap=True)

    end = _run(loaded, options, announce, as_json)
    if as_json:
        print(tell_as_json(end), flush=True)
    else:
        tell(end, out, err)
    if not end.facts.complete:
        raise typer.Exit(1)
    return end


def run_below(loaded: LoadedWorkflow, options: Options) -> RunEnd:
    """Run what another command needs, which speaks for itself: how it ended is told only where the project is not complete, and
    then the command ends."""
    end = _run(loaded, options, lambda line: out.print(escape(line), soft_wrap=True), False)
    if not end.facts.complete:
        tell(end, out, err)
        raise typer.Exit(1)
    return end


def _run(loaded: LoadedWorkflow, options: Options, announce: Callable[[str], None], as_json: bool) -> RunEnd:
    facts = run_with_report(
        loaded,
        options,
        watch=lambda session, runner, workers: run_display(session, runner, workers, err, announce, as_json),
        announce=announce,
    )
    return run_end(facts, loaded.run_folder, titles_of(loaded.stages))
