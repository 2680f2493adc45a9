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


@lookups.command()
def grow(
    left: Annotated[Path, typer.Argument(help="A photograph.")],
    right: Annotated[Path, typer.Argument(help="Another one of the same ground.")],
    seeds: Annotated[
        Path | None,
        typer.Option(help="List: col and row on the left, col and row on the right, px; found by features when left out."),
    ] = None,
    step: Annotated[int, typer.Option(help="Distance of the nodes, px.", min=2, max=256)] = 16,
    window: Annotated[int, typer.Option(help="Side of the matching window, px, an odd number.", min=7, max=61)] = 21,
    c: Annotated[float | None, typer.Option(help="Camera constant, px; that of the EXIF tags when left out.", min=1.0)] = None,
    output: Annotated[Path | None, typer.Option(help="The CSV of the matches to write.")] = None,
    debug: Debug = False,
) -> None:
    """Match two photographs of which nothing is known by region growing, and relate them by what has grown."""
    from orthomill.pipeline.cli.lookups.grown_photographs import grey_of, grown_lines, matches_csv, read_seeds
    from orthomill.pipeline.storage.whole_files import write_whole
    from orthomill.schemas.errors import WorkflowError
    from orthomill.tasks.lookups import GrowthRules, constants_of, grown_pair

    with plain_errors(debug):
        if window % 2 == 0:
            raise WorkflowError(f"A window of {window} px has no middle pixel; give an odd number.")
        (first, one), (second, other) = grey_of(left), grey_of(right)
        constants = (c, c) if c else constants_of((first, second))
        pair = grown_pair(one, other, None if seeds is None else read_seeds(seeds), GrowthRules(step, window, constants))
        for line in grown_lines(pair):
            typer.echo(line)
        if output is not None:
            write_whole(output, matches_csv(pair).encode())
            out.print(f"{output}: {len(pair.matches)} matches", soft_wrap=True)
