"""Commands that look something up in a finished run and change nothing."""

from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape

from orthomill.pipeline.cli.terminal import Debug, Name, err, out, plain_errors

lookups = typer.Typer()


@lookups.command()
def monoplot(
    name: Name,
    photo: Annotated[str, typer.Argument(help="A photograph of the block.")],
    points: Annotated[Path, typer.Option(help="Text file: col and row of a point on a line, px, perhaps with a name before them.")],
    sigma: Annotated[float, typer.Option(help="Standard error of an image coordinate, px.", min=0.0)] = 0.5,
    output: Annotated[Path | None, typer.Option(help="The CSV to write; printed when left out.")] = None,
    debug: Debug = False,
) -> None:
    """Points of one photograph on the surface: X, Y, Z, standard errors, covariances, and the photographs that see them."""
    from orthomill.pipeline.cli.lookups.monoplot import monoplot_table, read_image_points
    from orthomill.pipeline.cli.projects import load_project
    from orthomill.pipeline.storage.whole_files import write_whole
    from orthomill.tasks.lookups import points_on_surface

    with plain_errors(debug):
        table = monoplot_table(load_project(name).run_folder, photo, read_image_points(points), sigma, points_on_surface)
        for sentence in table.missed:
            err.print(escape(sentence), soft_wrap=True)
        if output is None:
            typer.echo(table.csv, nl=False)
        else:
            write_whole(output, table.csv.encode())
            out.print(f"{output}: {table.count} points", soft_wrap=True)
    if table.missed:
        raise typer.Exit(1)


@lookups.command()
def relative(
    name: Name,
    left: Annotated[str, typer.Argument(help="A photograph of the block.")],
    right: Annotated[str, typer.Argument(help="Another one beside it.")],
    json: Annotated[bool, typer.Option("--json", help="Print all figures as JSON.")] = False,
    debug: Debug = False,
) -> None:
    """The relative orientation of a pair as the textbooks write it: from its tie points alone, and from the adjusted block."""
    from orthomill.pipeline.cli.lookups.relative_lines import as_json, pair_forms, relative_lines
    from orthomill.pipeline.cli.projects import load_project
    from orthomill.tasks.lookups import classical_forms

    with plain_errors(debug):
        forms = pair_forms(load_project(name).run_folder, left, right, classical_forms)
        for line in [as_json(forms)] if json else relative_lines(forms):
            typer.echo(line)
