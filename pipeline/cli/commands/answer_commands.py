"""Commands that answer questions about a finished run, each with its standard error."""

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.markup import escape

from orthomill.pipeline.cli.terminal import Debug, Name, err, out, plain_errors

if TYPE_CHECKING:
    from orthomill.pipeline.workflow.workflow_file import LoadedWorkflow

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


@answers.command()
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
    from orthomill.pipeline.cli.lookups.delivery import (
        Delivered,
        acceptance_lines,
        facts_by_inspector,
        facts_of_files,
        facts_of_run,
        profile_of,
    )
    from orthomill.pipeline.cli.lookups.kept_acceptance import (
        area_of,
        by_name,
        digested,
        inputs_of,
        keep,
        of_run,
        recorded,
        written,
    )
    from orthomill.pipeline.cli.projects import load_project
    from orthomill.schemas.errors import WorkflowError
    from orthomill.tasks.lookups import Inspector, accepted, inspected, listed_points

    with plain_errors(debug):
        loaded = load_project(name) if name else None
        if not (loaded or dsm or ortho or photos or block):
            raise WorkflowError("Give a project that has been run, or files of a delivery with --dsm and --ortho.")
        named = {key: value for key, value in (("plan", plan), ("height", height)) if value is not None}
        limits = profile_of(profile, loaded.project if loaded else None, named)
        files, area = Delivered(dsm, ortho, points), area_of(limits, loaded.root if loaded else Path.cwd())
        delivery, under = " and ".join(path.name for path in (dsm, ortho) if path), tuple(vegetated or ())
        if photos or block:
            if loaded:
                raise WorkflowError("A project has its photographs and its block; leave --photos and --block out, or the project.")
            seen = _oriented(dsm or ortho, (photos, block), (points, marks), crs)
            facts = facts_by_inspector(
                seen.run_folder, files, seen.project.crs, partial(Inspector, vegetated=under), ("check", "control"), area
            )
        elif marks:
            raise WorkflowError("--marks are in photographs; give these with --photos and their orientation with --block.")
        elif loaded and not (dsm or ortho) and under:
            raise WorkflowError(
                "--vegetated is for products of another program; a project names these points in its stage: "
                f"kind: accuracy, vegetated: [{', '.join(under)}]."
            )
        elif loaded and not (dsm or ortho):
            facts, delivery = facts_of_run(loaded.run_folder, loaded.project.crs, area), loaded.project.project
        elif loaded:
            under = under or next((getattr(stage, "vegetated", ()) for stage in loaded.stages if stage.kind == "accuracy"), ())
            facts = facts_by_inspector(loaded.run_folder, files, loaded.project.crs, partial(Inspector, vegetated=under), area=area)
        else:
            facts = facts_of_files(files, crs, partial(inspected, vegetated=under), listed_points, area)
        for remark in facts.remarks:
            err.print(escape(remark), soft_wrap=True)
        own = loaded if loaded and not (dsm or ortho) else None
        sold = of_run(own) if own else by_name((dsm, ortho))
        used = inputs_of(loaded) if loaded else by_name((points, marks, block, area))
        result = recorded(accepted(limits, facts, delivery), limits, facts, digested(sold), digested(used))
        if own:
            result = keep(own, result)
        written(result, [output] if output else ())
        for line in acceptance_lines(result):
            out.print(escape(line), soft_wrap=True)
    if not result.complete:
        raise typer.Exit(3)


def _oriented(
    product: Path | None, seen: tuple[Path | None, Path | None], given: tuple[Path | None, Path | None], crs: str | None
) -> "LoadedWorkflow":
    """A block of another program with surveyed points, run to its orientation. Raises WorkflowError."""
    from orthomill.pipeline.cli.lookups.inspected_block import inspection_workflow
    from orthomill.pipeline.cli.progress.project_run import run_below
    from orthomill.pipeline.engine.running import Options
    from orthomill.schemas.errors import WorkflowError
    from orthomill.schemas.memory import MIB
    from orthomill.tasks.catalogue import STAGES

    if product is None:
        raise WorkflowError("Photographs and block inspect products: give these with --dsm and --ortho.")
    made = inspection_workflow(product, seen, given, crs, Path.cwd(), STAGES)
    run_below(made, Options(None, None, 0, 1500 * MIB, sequential=True))
    return made
