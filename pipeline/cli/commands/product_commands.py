"""Commands about what a run has left: written again, signed, or removed."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.markup import escape

from orthomill.pipeline.cli.commands.option_types import RasterName
from orthomill.pipeline.cli.terminal import Debug, Name, out, plain_errors
from orthomill.pipeline.export.export_formats import names_in_words

if TYPE_CHECKING:
    from orthomill.pipeline.export.block_folder import BlockMethods
    from orthomill.pipeline.export.solids.relief_model import SolidMethods
    from orthomill.pipeline.report.first_page import FirstPage

products = typer.Typer()


@products.command()
def report(
    name: Name,
    pdf: Annotated[
        bool, typer.Option("--pdf", help="Print it to report.pdf (A4) as well, with a browser of this machine.")
    ] = False,
    debug: Debug = False,
) -> None:
    """Write the report and the summary again from the stored results."""
    from orthomill.pipeline.cli.projects import load_project
    from orthomill.pipeline.report.results import rewrite_results

    with plain_errors(debug):
        page = rewrite_results(load_project(name))
        out.print(str(page), soft_wrap=True)
        if pdf:
            from orthomill.pipeline.report.paper import write_pdf

            out.print(str(write_pdf(page)), soft_wrap=True)


@products.command()
def export(
    name: Name,
    raster: RasterName = None,
    path: Annotated[str | None, typer.Argument(help="File in the run's folder; default products/<raster>.tif.")] = None,
    kind: Annotated[str | None, typer.Option("--as", help=names_in_words())] = None,
    product: Annotated[str | None, typer.Option("--of", help="Product that is exported, e.g. ortho, dsm, terrain.")] = None,
    crs: Annotated[str | None, typer.Option(help="Reference system of the file, e.g. EPSG:3857.")] = None,
    area: Annotated[
        tuple[float, float, float, float] | None, typer.Option(help="West, south, east and north in that system.")
    ] = None,
    cell: Annotated[float | None, typer.Option(help="Cell of the file, in units of that system.", min=1e-9)] = None,
    cutline: Annotated[
        Path | None, typer.Option(help="Polygons (.gpkg, .geojson) in any system; what lies outside is left out.")
    ] = None,
    sheets: Annotated[
        str | None, typer.Option(help="A file for each sheet: an index (.gpkg, .geojson), 1km, 500m, linz:5000 or doqq.")
    ] = None,
    debug: Debug = False,
) -> None:
    """Write products again, any raster of the store as a GeoTIFF, or a product in another format, system, area or cell."""
    from orthomill.pipeline.export.conversions.wanted import Wanted

    wanted = Wanted(crs, area, cell, cutline)
    if kind is not None:
        return _export_as(name, (kind, product, wanted, raster or path, sheets), debug)
    from orthomill.pipeline.cli.export_choice import chosen_exports
    from orthomill.pipeline.cli.projects import load_project
    from orthomill.pipeline.engine.running import session_of
    from orthomill.pipeline.export.exports import export as export_file
    from orthomill.pipeline.export.file_parts import joins_parts, parts_of
    from orthomill.pipeline.records.lock import only_run
    from orthomill.pipeline.storage.depots.folder import PARTS
    from orthomill.schemas.errors import WorkflowError

    with plain_errors(debug):
        if wanted != Wanted() or product is not None or sheets is not None:
            raise WorkflowError("--of, --crs, --area, --cell, --cutline and --sheets say how --as exports; add --as FORMAT.")
        session = session_of(load_project(name))
        chosen = chosen_exports(session, raster, path)
        with only_run(session.folder):
            for job in chosen:
                for name in export_file(job, session.store, session.folder):
                    if not name.startswith(f"{PARTS}/"):
                        out.print(str(session.folder / name), soft_wrap=True)
                if joins_parts(job):
                    session.depot.clear(parts_of(job.path))


def _export_as(name: str, asked: tuple, debug: bool) -> None:
    from orthomill.pipeline.cli.export_kinds import Asked, export_as
    from orthomill.pipeline.cli.projects import load_project

    with plain_errors(debug):
        made = export_as(Asked(*asked), load_project(name).run_folder, _Methods())
        out.print(str(made), soft_wrap=True)


class _Methods:
    """The photogrammetry that some formats need, loaded when it is asked for."""

    def block(self) -> "BlockMethods":
        """What makes the files of other programs."""
        from orthomill.pipeline.export.block_folder import BlockMethods
        from orthomill.tasks.lookups import SURVEY_BLOCK, SURVEY_POINTS, OrientedProject, handed_files

        return BlockMethods(OrientedProject, handed_files, (SURVEY_BLOCK, SURVEY_POINTS))

    def solid(self) -> "SolidMethods":
        """What makes models in space."""
        from orthomill.pipeline.export.solids.relief_model import SolidMethods
        from orthomill.tasks.lookups import as_glb, height_patch, place_on_earth

        return SolidMethods(height_patch, as_glb, place_on_earth)


@products.command()
def clean(
    name: Name,
    stage: Annotated[list[str] | None, typer.Option(help="Only this stage's results (may be given again).")] = None,
    debug: Debug = False,
) -> None:
    """Remove a project's results; its photographs and workflow stay."""
    from orthomill.pipeline.cli.clean import clean_run
    from orthomill.pipeline.cli.projects import load_project
    from orthomill.pipeline.engine.running import check_stage_names

    with plain_errors(debug):
        loaded, stages = load_project(name), tuple(stage or ())
        check_stage_names(loaded, stages)
        clean_run(loaded.run_folder, stages)
        out.print(f"removed from {loaded.run_folder}: {', '.join(stages) or 'everything'}", soft_wrap=True)


@products.command()
def sign(
    name: Name,
    signer: Annotated[str, typer.Option("--name", help="Who signs.")],
    role: Annotated[str, typer.Option(help="In what capacity, e.g. 'licensed surveyor'.")],
    remarks: Annotated[str, typer.Option(help="What else is to be said.")] = "",
    key: Annotated[Path | None, typer.Option(help="A private Ed25519 key (PEM); your own, made when first needed.")] = None,
    yes: Annotated[bool, typer.Option("--yes", help="Sign without being asked; the figures are printed all the same.")] = False,
    debug: Debug = False,
) -> None:
    """Sign the figures and products of a finished run; `orthomill verify` tells whether they still belong together."""
    from orthomill.pipeline.cli.projects import load_project
    from orthomill.pipeline.cli.sign import Person, sign_project, signing_lines
    from orthomill.pipeline.signing.statement import Signer

    with plain_errors(debug):
        loaded = load_project(name)
        question = f"Do you, {signer}, {role}, sign these figures and the products they are about?"

        def agrees(page: "FirstPage") -> bool:
            for line in signing_lines(page):
                out.print(escape(line), soft_wrap=True)
            return yes or typer.confirm(question)

        person = Person(agrees, passphrase=lambda: str(typer.prompt("Passphrase", hide_input=True)))
        path = sign_project(loaded, Signer(name=signer, role=role, remarks=remarks), key, person)
        out.print(f"signed: {path}" if path else "not signed", soft_wrap=True)
    if path is None:
        raise typer.Exit(1)
