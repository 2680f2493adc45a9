"""Commands that say how a project stands, and change nothing of it."""

import webbrowser

import typer
from rich.markup import escape
from rich.table import Table as Lines

from orthomill.pipeline.cli.commands.option_types import From, Until
from orthomill.pipeline.cli.terminal import Debug, Name, out, plain_errors
from orthomill.schemas.errors import StoreError

state = typer.Typer()


@state.command()
def plan(name: Name, from_stage: From = None, until: Until = None, debug: Debug = False) -> None:
    """Show what a run would do: jobs, bytes, peak memory, and why each stage would run. Writes nothing."""
    from orthomill.pipeline.cli.projects import load_project

    with plain_errors(debug):
        loaded = load_project(name)
        # After the workflow: a mistake in it is answered before the engine is loaded.
        from orthomill.pipeline.cli.plan_lines import plan_lines, plan_notes
        from orthomill.pipeline.engine.foresight import plan_ahead
        from orthomill.pipeline.engine.running import session_of
        from orthomill.pipeline.forecast.forecast import forecast

        session = session_of(loaded, from_stage, until)
        noticed = plan_ahead(session).remarks()
        expected = forecast(session)
        out.print(plan_lines(session, expected))
        for sentence in noticed:
            out.print(f"note: {escape(sentence)}", soft_wrap=True)
        for note in plan_notes(session, expected):
            out.print(escape(note), soft_wrap=True)
        from orthomill.schemas.orientation import BLOCK

        if not session.store.has_table(BLOCK):
            return
        # Only then: these load all that a block is made of.
        from orthomill.pipeline.cli.mark import Marking, foreseen_points
        from orthomill.tasks.lookups import given_points, hidden_mask, marker_of, marks_of

        for sentence in foreseen_points(loaded, Marking(marker_of, given_points, marks_of, hidden_mask)):
            out.print(escape(sentence), soft_wrap=True)


@state.command()
def status(name: Name, debug: Debug = False) -> None:
    """Show what is done, what failed and why, also while a run is in progress."""
    from orthomill.pipeline.cli.projects import load_project
    from orthomill.pipeline.cli.status_lines import begun_at, dashboard_address, status_row
    from orthomill.pipeline.records.lock import is_running
    from orthomill.pipeline.records.records import Records

    with plain_errors(debug):
        loaded = load_project(name)
        folder = loaded.run_folder
        begun = begun_at(folder)
        now = ("this run",) if begun else ()
        lines = Lines("stage", "done", *now, "failed", "seconds", "peak memory", "last error", box=None)
        for stage in loaded.stages:
            lines.add_row(stage.kind, *status_row(Records(folder).each_of_stage(stage.kind), begun))
        out.print(lines)
        address = dashboard_address(folder)
        running = f"running now; dashboard: {address}" if address else "running now"
        out.print(running if is_running(folder) else "not running", soft_wrap=True)


@state.command()
def verify(name: Name, debug: Debug = False) -> None:
    """Check every stored result against its checksum; what is damaged is computed again by the next run."""
    from orthomill.pipeline.cli.lookups.kept_acceptance import reaccepted
    from orthomill.pipeline.cli.projects import load_project
    from orthomill.pipeline.cli.verification_lines import verification_lines
    from orthomill.pipeline.records.verification import verify as verify_results
    from orthomill.pipeline.report.signed_page import covered_page
    from orthomill.pipeline.signing.restatement import restated
    from orthomill.pipeline.signing.signature import check_signature
    from orthomill.pipeline.signing.signature_lines import signature_lines
    from orthomill.tasks.lookups import accepted, statement_of

    with plain_errors(debug):
        loaded = load_project(name)
        folder = loaded.run_folder
        if not folder.is_dir():
            raise StoreError(f"{folder.name} has no results yet; run it first: orthomill run {name}")
        found = verify_results(folder)
        signed = check_signature(folder, covered_page)
        differs = restated(folder, statement_of)
        said = (*((differs,) if differs else ()), *reaccepted(loaded, name, accepted))
        for line in (*verification_lines(found, name), *(signature_lines(signed) if signed else ()), *said):
            out.print(escape(line), soft_wrap=True)
    if found.damaged or said or (signed and not signed.holds):
        raise typer.Exit(1)


@state.command()
def dashboard(name: Name, debug: Debug = False) -> None:
    """Print the address of the dashboard of a run in progress."""
    from orthomill.pipeline.cli.projects import load_project
    from orthomill.pipeline.cli.status_lines import dashboard_address
    from orthomill.pipeline.engine.run_facts import DASHBOARD
    from orthomill.pipeline.records.lock import is_running

    with plain_errors(debug):
        folder = load_project(name).run_folder
        soon = f"{folder.name} is starting, its dashboard is not there yet; ask again in some seconds"
        none = f"{folder.name} is running without Dask, so there is no dashboard; see: orthomill status {name}"
        idle = f"{folder.name} is not running; start it with: orthomill run {name}"
        without = idle if not is_running(folder) else soon if (folder / DASHBOARD).exists() else none
        out.print(dashboard_address(folder) or without, soft_wrap=True)


@state.command()
def watch(name: Name, debug: Debug = False) -> None:
    """Show the map of tiles in a browser: live while the project runs, as it ended afterwards."""
    from orthomill.pipeline.cli.projects import load_project
    from orthomill.pipeline.cli.status_lines import dashboard_address
    from orthomill.pipeline.engine.run_facts import TILES
    from orthomill.pipeline.watching.live_map import MAP

    with plain_errors(debug):
        folder = load_project(name).run_folder
        live = dashboard_address(folder, TILES)
        kept = folder / MAP
        if not live and not kept.exists():
            raise StoreError(f"{folder.name} has no map of tiles yet; run it first: orthomill run {name}")
        address = live or kept.resolve().as_uri()
        out.print(address, soft_wrap=True)
        webbrowser.open(address)
