"""What all commands share: the two streams of the terminal, their common arguments, and how an error is told."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.markup import escape

from orthomill.pipeline.cli.refusals import environment_sentence
from orthomill.pipeline.engine.interruption import listen
from orthomill.schemas.errors import OrthomillError

out = Console(highlight=False)
err = Console(stderr=True, highlight=False)


def project_names(beginning: str) -> list[str]:
    """Projects of the current folder, for the completion of the shell."""
    return sorted(path.stem for path in Path("workflows").glob("*.yaml") if path.stem.startswith(beginning))


Name = Annotated[
    str,
    typer.Argument(
        help="Project name (workflows/<name>.yaml) or the path of a workflow file.",
        autocompletion=project_names,
        show_default=False,
    ),
]
Debug = Annotated[bool, typer.Option("--debug", help="Show the traceback of an error.")]


@contextmanager
def plain_errors(debug: bool) -> Iterator[None]:
    """Turns every error that orthomill can explain into a sentence and an exit code, and listens for interruptions."""
    listen()
    try:
        yield
    except OrthomillError as error:
        if debug:
            raise
        _say_error(str(error))
        raise typer.Exit(2) from None
    except (OSError, MemoryError) as error:
        sentence = environment_sentence(error)
        if debug or sentence is None:
            raise
        _say_error(sentence)
        raise typer.Exit(2) from None
    except KeyboardInterrupt:
        err.print("Stopped. Finished jobs are kept; run the same command again to continue.")
        raise typer.Exit(130) from None


def _say_error(sentence: str) -> None:
    err.print(f"[red]error:[/red] {escape(sentence)}", soft_wrap=True)
