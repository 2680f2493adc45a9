"""The command `orthomill`: all commands under one name.

Every error that orthomill can explain is one sentence and an exit code: 1 for failed jobs, 2 for input that cannot be used,
3 for results in doubt with --strict, 130 for Ctrl-C. A traceback is shown with --debug only.
"""

import gc
import sys
from io import TextIOWrapper
from typing import Annotated

import typer

from orthomill import __version__
from orthomill.pipeline.cli.commands.accept_commands import accepting
from orthomill.pipeline.cli.commands.answer_commands import answers
from orthomill.pipeline.cli.commands.lookup_commands import lookups
from orthomill.pipeline.cli.commands.mark_commands import marking
from orthomill.pipeline.cli.commands.product_commands import products
from orthomill.pipeline.cli.commands.run_commands import running
from orthomill.pipeline.cli.commands.serve_commands import serving
from orthomill.pipeline.cli.commands.start_commands import starting
from orthomill.pipeline.cli.commands.state_commands import state
from orthomill.pipeline.cli.commands.view_commands import viewing
from orthomill.pipeline.cli.terminal import out

app = typer.Typer(
    help="From overlapping photographs to a checked surface model and a blended true orthoimage.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)
for group in (running, marking, serving, state, products, viewing, lookups, answers, accepting, starting):
    app.add_typer(group)


def _print_version(wanted: bool) -> None:
    if wanted:
        out.print(__version__)
        raise typer.Exit


@app.callback()
def main_options(
    show_version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Show the version and exit.")
    ] = False,
) -> None:
    """From overlapping photographs to a checked surface model and a blended true orthoimage."""


def main() -> None:
    """Entry point of the command."""
    # Planning creates hundreds of thousands of small objects that live on: collecting garbage among them at Python's usual
    # threshold of 700 takes longer than creating them.
    gc.set_threshold(50_000)
    # A terminal that is not UTF-8 shows names of photographs as codes; it must not end the run with an internal error.
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    app()
