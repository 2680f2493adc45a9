"""The command that holds a delivery against what was agreed."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.markup import escape

from orthomill.pipeline.cli.terminal import Debug, err, out, plain_errors

if TYPE_CHECKING:
    from orthomill.pipeline.workflow.workflow_file import LoadedWorkflow

accepting = typer.Typer()


@accepting.command()
def accept(
    name: Annotated[
        str | None,
        typer.Argument(
            help="A project that has been run; with --dsm or --ortho, its check points and photographs inspect those files."
        ),
    ] = None,
    profile: Annotated[
        str | None, typer.Option(help="asprs_2023, adv_truedop, inspire_oi, custom, or a YAML file; the project's when left out.")
    ] = None,
    dsm: Annotated[Path | None, typer.Option(help="A surface of another program.")] = None,
    ortho: Annotated[Path | None, typer.Option(help="An orthoimage of another program.")] = None,
    points: Annotated[
        Path | None,
        typer.Option(
            help="Check points: a GeoPackage, a surveyor's list, or a CSV with name, x, y, z, sigma_x, sigma_y, sigma_z; ortho_x, "
            "ortho_y as measured in the image."
        ),
    ] = None,
    photos: Annotated[Path | None, typer.Option(help="Folder with the photographs of those products.")] = None,
    block: Annotated[
        Path | None,
        typer.Option(help="Their orientation, as for check: the photographs then show where an orthoimage has a point."),
    ] = None,
    marks: Annotated[Path | None, typer.Option(help="CSV of the points' marks in the photographs: name, photo, col, row.")] = None,
    crs: Annotated[
        str | None, typer.Option(help="Reference system of points and block; by default that of the block, or of the products.")
    ] = None,
    vegetated: Annotated[
        list[str] | None,
        typer.Option(help="Points under vegetation, by name or shell pattern, stated apart (VVA); can be given several times."),
    ] = None,
    plan: Annotated[float | None, typer.Option(help="Root mean square error in plan that was agreed, m.", min=1e-6)] = None,
    height: Annotated[float | None, typer.Option(help="Root mean square error in height that was agreed, m.", min=1e-6)] = None,
    output: Annotated[Path | None, typer.Option(help="A .json or .html to write besides; a run has both in its folder.")] = None,
    debug: Debug = False,
) -> None:
    """Hold a delivery against what was agreed, clause by clause; exit code 3 where not every clause is met."""
    from orthomill.pipeline.cli.lookups.asked_delivery import AskedDelivery, DeliveryMethods, accept_files
    from orthomill.pipeline.cli.lookups.delivery import Delivered, acceptance_lines, profile_of
    from orthomill.pipeline.cli.lookups.kept_acceptance import accept_run, written
    from orthomill.pipeline.cli.projects import load_project
    from orthomill.tasks.catalogue import STAGES
    from orthomill.tasks.lookups import Inspector, accepted, inspected, listed_points

    with plain_errors(debug):
        loaded = load_project(name) if name else None
        asked = AskedDelivery(loaded, Delivered(dsm, ortho, points), photos, block, marks, crs, tuple(vegetated or ()))
        named = {key: value for key, value in (("plan", plan), ("height", height)) if value is not None}
        limits = profile_of(profile, loaded.project if loaded else None, named)
        if asked.own:
            result = accept_run(asked.own, limits, accepted)
        else:
            result = accept_files(asked, limits, DeliveryMethods(accepted, inspected, Inspector, listed_points, _orient, STAGES))
        written(result, [output] if output else ())
        for remark in result.record.remarks if result.record else ():
            err.print(escape(remark), soft_wrap=True)
        for line in acceptance_lines(result):
            out.print(escape(line), soft_wrap=True)
    if not result.complete:
        raise typer.Exit(3)


def _orient(block: "LoadedWorkflow") -> None:
    """Run the block of another program to its orientation, in this process."""
    from orthomill.pipeline.cli.progress.project_run import run_below
    from orthomill.pipeline.engine.running import Options
    from orthomill.schemas.memory import MIB

    run_below(block, Options(None, None, 0, 1500 * MIB, sequential=True))
