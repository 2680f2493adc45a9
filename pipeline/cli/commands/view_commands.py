"""The command that shows the map of a finished run."""

import time
import webbrowser
from contextlib import suppress
from typing import Annotated

import typer

from orthomill.pipeline.cli.terminal import Debug, Name, err, out, plain_errors

viewing = typer.Typer()


@viewing.command()
def view(
    name: Name,
    port: Annotated[int, typer.Option(help="Port of 127.0.0.1; 0: a free one.", min=0, max=65535)] = 0,
    browser: Annotated[bool, typer.Option(help="Open the page in the browser.")] = True,
    debug: Debug = False,
) -> None:
    """Show the map of a finished run on this machine, with the photographs that show every place."""
    from orthomill.pipeline.cli.projects import load_project
    from orthomill.pipeline.serving.viewer.viewer_routes import PlaceAnswers, map_of, viewer_routes
    from orthomill.pipeline.storage.store import Store
    from orthomill.pipeline.watching.map_server import served
    from orthomill.tasks.lookups import photographs_of_place

    with plain_errors(debug):
        run = load_project(name).run_folder
        products = map_of(run)
        answers = PlaceAnswers(Store(run), photographs_of_place)
        with served(viewer_routes(products, answers), "index.html", port) as address:
            out.print(f"map: {address}", soft_wrap=True)
            err.print("Only this machine sees it; end with Ctrl-C.", soft_wrap=True)
            if browser:
                webbrowser.open(address)
            # Ctrl-C is the way out here, and loses nothing.
            with suppress(KeyboardInterrupt):
                while True:
                    time.sleep(3600)
