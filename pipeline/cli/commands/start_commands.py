"""Commands for the time before a run: a new workflow, this machine, a single photograph; and the pages made from the code."""

import json
from collections import ChainMap
from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape
from rich.table import Table as Lines

from orthomill.pipeline.cli.terminal import Debug, err, out, plain_errors
from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.inspections.window_method import Method

starting = typer.Typer()
inspect = typer.Typer(help="Look at a single photograph, without a project.", no_args_is_help=True)
starting.add_typer(inspect, name="inspect")


@starting.command()
def init(
    name: Annotated[str, typer.Argument(help="Name of the new project.")],
    photos: Annotated[
        str | None,
        typer.Option(
            help="Folder with the photographs, or s3://bucket/prefix (gs://, az://): fetched into the project. By default "
            "photographs/NAME."
        ),
    ] = None,
    crs: Annotated[str | None, typer.Option(help="Projected CRS, e.g. EPSG:32634; proposed from GPS when left out.")] = None,
    debug: Debug = False,
) -> None:
    """Write a commented starting workflow from the photographs' EXIF."""
    from orthomill.pipeline.forecast.outlook import outlook
    from orthomill.pipeline.workflow.found_lines import found_lines
    from orthomill.pipeline.workflow.starting_workflow import write_starting_workflow
    from orthomill.tasks.catalogue import STAGES
    from orthomill.tasks.lookups import look_ahead

    with plain_errors(debug):
        folder = _photographs(name, photos)
        start = write_starting_workflow(name, folder, Path.cwd(), STAGES, crs, outlook(look_ahead, STAGES, Path.cwd()))
        for note in (*found_lines(start.survey, start.look), *start.notes):
            out.print(escape(note), soft_wrap=True)
        out.print(f"{start.path} is written; read it, then: orthomill run {name}", soft_wrap=True)


def _photographs(name: str, place: str | None) -> Path:
    """The folder with the photographs, by default the one that has the project's name; those of an object store are brought there
    first. Raises WorkflowError where none is named and none is there."""
    from orthomill.pipeline.storage.depots.bucket import is_address
    from orthomill.pipeline.storage.depots.fetched_photographs import fetched_photographs
    from orthomill.pipeline.workflow.starting_workflow import new_workflow

    folder = Path("photographs") / name
    if place is None:
        if not folder.is_dir():
            raise WorkflowError(f"There is no folder {folder}: say where the photographs are, with --photos FOLDER")
        return folder
    if not is_address(place):
        return Path(place)
    new_workflow(name, Path.cwd())
    found = fetched_photographs(place, folder, say=err.print)
    left = f"; {found.left} objects of other kinds were left there" if found.left else ""
    out.print(
        f"{len(found.files)} files of {place} lie in {folder} now, {found.new} of them new{left}.", soft_wrap=True, markup=False
    )
    return folder


@starting.command()
def doctor() -> None:
    """Examine this machine: versions, cores, memory, free disk, what is missing."""
    from orthomill.pipeline.cli.doctor import doctor as examine

    rows = examine(Path.cwd())
    lines = Lines("what", "found", "", "advice", box=None)
    for row in rows:
        lines.add_row(row.name, escape(str(row.value)), "ok" if row.ok else "[red]![/red]", escape(row.advice))
    out.print(lines)
    if not all(row.ok for row in rows):
        raise typer.Exit(1)


@starting.command()
def reference(path: Annotated[Path | None, typer.Argument(help="Write them there, as a page in Markdown.")] = None) -> None:
    """List every setting with type, default, bounds and unit."""
    from orthomill.pipeline.export.export_formats import with_table
    from orthomill.pipeline.storage.whole_files import write_whole
    from orthomill.pipeline.workflow.settings_reference import settings_reference
    from orthomill.tasks.catalogue import STAGES

    page = settings_reference(STAGES)
    if path is None:
        out.print(page, markup=False, highlight=False, soft_wrap=True)
        return
    with plain_errors(False):
        write_whole(path, page.encode())
    # In the documentation the table of formats stands beside it.
    if (exports := path.with_name("exports.md")).is_file():
        exports.write_text(with_table(exports.read_text(encoding="utf-8")), encoding="utf-8")


@starting.command(hidden=True)
def figures(
    names: Annotated[list[str], typer.Argument(help="Finished projects that together have all stages.")],
    path: Annotated[Path, typer.Option(help="Where to write the page.")] = Path("docs/summary.md"),
    debug: Debug = False,
) -> None:
    """Write the page of all names in summary.json from finished runs."""
    from orthomill.pipeline.cli.projects import load_project
    from orthomill.pipeline.report.summary import summary_markdown

    with plain_errors(debug):
        loaded = map(load_project, names)
        files = [one.root / "runs" / one.project.project / "summary.json" for one in loaded]
        # The first has the last word on what several have.
        path.write_text(summary_markdown(dict(ChainMap(*(json.loads(file.read_text()) for file in files)))))


@inspect.command("targets")
def inspect_targets(
    photo: Annotated[Path, typer.Argument(help="A photograph: JPEG, TIFF or PNG.")],
    least: Annotated[float, typer.Option("--least", help="Lowest score of uncoded targets.", min=0.0, max=1.0)] = 0.5,
    debug: Debug = False,
) -> None:
    """Find signalised targets: AprilTag, ArUco, chequered plates, crosses, circles; centres with standard errors, as CSV."""
    from orthomill.pipeline.cli.lookups.inspect_photo import target_lines
    from orthomill.tasks.lookups import targets_of_photograph

    with plain_errors(debug):
        for line in target_lines(photo, targets_of_photograph, least):
            typer.echo(line)


@inspect.command("window-size")
def inspect_window_size(
    photo: Annotated[Path, typer.Argument(help="A photograph: JPEG, TIFF or PNG.")],
    method: Annotated[Method, typer.Option(help="How the size of the matching window is chosen.")] = Method.FOERSTNER,
    largest: Annotated[int, typer.Option("--max", help="Side of the largest window, px.", min=7, max=101)] = 35,
    limit: Annotated[float | None, typer.Option(help="Threshold of the method, instead of its default.")] = None,
    second: Annotated[
        float | None, typer.Option(help="Its second threshold: excess (statistical), gain (entropy) or roundness (foerstner).")
    ] = None,
    assigned: Annotated[float | None, typer.Option(help="Find the threshold that assigns a window to this % of pixels.")] = None,
    given: Annotated[
        list[str] | None,
        typer.Option(
            "--set", help="Any setting of a workflow's window, e.g. min_stalled=2.5, or entropy.min_gain=0.01 (combined)."
        ),
    ] = None,
    output: Annotated[Path | None, typer.Option(help="The PNG to write; by default in the current folder.")] = None,
    debug: Debug = False,
) -> None:
    """Map the size of the matching window at every pixel: dark is small, light is large, white is none."""
    from orthomill.pipeline.cli.lookups.inspect_photo import GuardedPhoto, picture_path, write_map
    from orthomill.tasks.lookups import share_of, sizing_of, window_size_map

    with plain_errors(debug):
        path = picture_path(photo, f"window_size_{method}", output)
        found = window_size_map(
            GuardedPhoto(photo), sizing_of(method, largest, limit, second, given or ()), share_of(assigned, limit)
        )
        write_map(found, path, out, err)
