"""Commands that answer questions about a finished run, each with its standard error."""

from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape

from orthomill.pipeline.cli.terminal import Debug, Name, err, out, plain_errors

answers = typer.Typer()


@answers.command()
def measure(
    name: Name,
    features: Annotated[Path, typer.Argument(help="Points, lines and polygons: GeoPackage, GeoJSON, or CSV with name,x,y.")],
    base: Annotated[
        str,
        typer.Option(
            help="What volumes are measured against: border (the plane through it), a level in m, a surface (GeoTIFF, LAS, LAZ) "
            "or the folder of another run (runs/NAME)."
        ),
    ] = "border",
    checked: Annotated[bool, typer.Option("--checked", help="The surface as the check has mended it, instead of dsm.tif.")] = False,
    corner: Annotated[
        float | None, typer.Option(help="Standard error of a coordinate of a corner, m; half a cell when left out.", min=0.0)
    ] = None,
    step: Annotated[
        float | None, typer.Option(help="Distance of the points of profiles, m; a cell when left out.", min=0.001)
    ] = None,
    output: Annotated[Path | None, typer.Option(help="A .gpkg, .json or .csv to write; printed when left out.")] = None,
    debug: Debug = False,
) -> None:
    """Heights, distances, slopes, profiles, areas and volumes on the surface, each with its standard error."""
    from orthomill.pipeline.cli.lookups.measured_answers import MeasureOptions, answer_lines, measured_answers
    from orthomill.pipeline.cli.projects import load_project
    from orthomill.tasks.lookups import measure as measured

    with plain_errors(debug):
        options = MeasureOptions(base, checked, corner, step, output)
        found = measured_answers(load_project(name).run_folder, features, options, measured)
        err.print(escape(found.correlation), soft_wrap=True)
        if output is None:
            for line in answer_lines(found):
                typer.echo(line)
        else:
            out.print(f"{output}: {len(found.answers)} answers", soft_wrap=True)


@answers.command()
def covariance(
    name: Name,
    points: Annotated[Path, typer.Option(help="Text file: 'name x y z' of a point on a line, or the name of a photograph alone.")],
    sigma: Annotated[
        float | None, typer.Option(help="Standard error of an image coordinate, px; the block's when left out.")
    ] = None,
    output: Annotated[Path | None, typer.Option(help="The JSON to write; printed when left out.")] = None,
    debug: Debug = False,
) -> None:
    """Covariances of points of the ground and of photographs, and between any two of them."""
    from orthomill.pipeline.cli.lookups.covariance_table import covariance_table
    from orthomill.pipeline.cli.projects import load_project
    from orthomill.pipeline.storage.whole_files import write_whole
    from orthomill.tasks.lookups import StoredCovariance

    with plain_errors(debug):
        table = covariance_table(load_project(name).run_folder, points, sigma, StoredCovariance)
        for sentence in table.missed:
            err.print(escape(sentence), soft_wrap=True)
        if output is None:
            typer.echo(table.json)
        else:
            write_whole(output, table.json.encode())
            out.print(f"{output}: {table.count} covariances", soft_wrap=True)
    if table.missed:
        raise typer.Exit(1)
