"""The command that opens the page on which points are marked in photographs."""

import time
import webbrowser
from contextlib import suppress
from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape

from orthomill.pipeline.cli.terminal import Debug, Name, err, out, plain_errors

marking = typer.Typer()


@marking.command()
def mark(
    name: Name,
    points: Annotated[Path | None, typer.Option(help="Points to be marked: CSV, GeoPackage, or a surveyor's list.")] = None,
    crs: Annotated[str | None, typer.Option(help="Their reference system, where neither the file's nor the project's.")] = None,
    auto: Annotated[bool, typer.Option("--auto", help="Mark what needs nobody (targets, matches), without the page.")] = False,
    where: Annotated[bool, typer.Option("--where", help="Say where another point would help most, for the field.")] = False,
    port: Annotated[int, typer.Option(help="Port of 127.0.0.1; 0: a free one.", min=0, max=65535)] = 0,
    browser: Annotated[bool, typer.Option(help="Open the page in the browser.")] = True,
    debug: Debug = False,
) -> None:
    """Mark control points in photographs, on a page of this machine: predicted places, residuals at once, wrong marks named."""
    from orthomill.pipeline.cli.mark import Marking, marked_automatically, marking_session
    from orthomill.pipeline.cli.projects import load_project
    from orthomill.pipeline.serving.marking.mark_routes import mark_routes
    from orthomill.pipeline.watching.map_server import served
    from orthomill.tasks.lookups import given_points, hidden_mask, marker_of, marks_of, targets_in

    with plain_errors(debug):
        loaded = load_project(name)
        known = Marking(marker_of, given_points, marks_of, hidden_mask)
        if auto or where:
            with marking_session(loaded, known, points, crs) as session:
                for line in marked_automatically(session, targets_in, lambda text: err.print(escape(text))) if auto else ():
                    out.print(escape(line), soft_wrap=True)
                for line in session.next_points() if where else ():
                    out.print(escape(line), soft_wrap=True)
            return
        with marking_session(loaded, known, points, crs) as session, served(mark_routes(session), "marks", port) as address:
            out.print(f"marks: {address}", soft_wrap=True)
            err.print(f"Kept in {session.ledger.folder}; end with Ctrl-C.", soft_wrap=True)
            if browser:
                webbrowser.open(address)
            # Ctrl-C is the way out here, and loses nothing.
            with suppress(KeyboardInterrupt):
                while True:
                    time.sleep(3600)
