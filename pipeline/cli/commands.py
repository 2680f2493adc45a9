"""The command `orthomill`: hands the catalogue of stages to the engine and talks to the user at the terminal.

Every error that orthomill can explain is one sentence and an exit code: 1 for failed jobs, 2 for input that cannot be used,
3 for results in doubt with --strict, 130 for Ctrl-C. A traceback is shown with --debug only.
"""

import gc
import json
import sys
import webbrowser
from collections import ChainMap
from io import TextIOWrapper
from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape
from rich.table import Table as Lines

from orthomill import __version__
from orthomill.pipeline.cli import check_surface as checking
from orthomill.pipeline.cli.calibrate import BoardOptions, calibration_workflow, print_calibration
from orthomill.pipeline.cli.check_surface import BlockOf, CheckedFile, CrsOf, Fill, PhotosOf, ProjectOf, RemoveShift, SystemOf
from orthomill.pipeline.cli.clean import clean_run
from orthomill.pipeline.cli.demo import write_demo
from orthomill.pipeline.cli.doctor import doctor as examine
from orthomill.pipeline.cli.inspect_photo import GuardedPhoto, picture_path, write_map
from orthomill.pipeline.cli.lookups.lookup_commands import lookups
from orthomill.pipeline.cli.plan_lines import plan_lines, plan_notes
from orthomill.pipeline.cli.projects import load_project
from orthomill.pipeline.cli.run_display import run_display
from orthomill.pipeline.cli.run_end import RunEnd, run_end, tell, tell_as_json
from orthomill.pipeline.cli.sign import Person, sign_project, signing_lines
from orthomill.pipeline.cli.terminal import Debug, Name, err, out, plain_errors
from orthomill.pipeline.cli.verification_lines import begun_at, dashboard_address, status_row, verification_lines
from orthomill.pipeline.engine.foresight import plan_ahead
from orthomill.pipeline.engine.interruption import listen
from orthomill.pipeline.engine.running import MIB, TILES, Options, check_stage_names, session_of, titles_of
from orthomill.pipeline.engine.session import Session
from orthomill.pipeline.export.exports import export as export_file
from orthomill.pipeline.forecast.forecast import forecast
from orthomill.pipeline.forecast.outlook import outlook
from orthomill.pipeline.records.lock import is_running, only_run
from orthomill.pipeline.records.records import Records
from orthomill.pipeline.records.verification import verify as verify_results
from orthomill.pipeline.report.first_page import FirstPage
from orthomill.pipeline.report.paper import write_pdf
from orthomill.pipeline.report.results import rewrite_results, run_with_report
from orthomill.pipeline.report.summary import summary_markdown
from orthomill.pipeline.signing.signature import check_signature
from orthomill.pipeline.signing.signature_lines import signature_lines
from orthomill.pipeline.signing.statement import Signer
from orthomill.pipeline.watching.live_map import MAP
from orthomill.pipeline.workflow.found_lines import found_lines
from orthomill.pipeline.workflow.settings_reference import write_settings_reference
from orthomill.pipeline.workflow.starting_workflow import write_starting_workflow
from orthomill.pipeline.workflow.workflow_file import LoadedWorkflow
from orthomill.schemas.errors import ResourceError, StoreError
from orthomill.schemas.job import Export
from orthomill.tasks.catalogue import STAGES, Method, look_ahead, share_of, sizing_of, window_size_map

app = typer.Typer(
    help="From overlapping photographs to a checked surface model and a blended true orthoimage.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)
inspect = typer.Typer(help="Look at a single photograph, without a project.", no_args_is_help=True)
app.add_typer(inspect, name="inspect")
app.add_typer(lookups)
From = Annotated[str | None, typer.Option("--from", help="Run this stage and all later ones again, changed or not.")]
Until = Annotated[str | None, typer.Option(help="Stop after this stage.")]
Sequential = Annotated[bool, typer.Option("--sequential", help="One job after another in this process, without Dask.")]
Workers = Annotated[int, typer.Option(help="Worker processes; 0 is one per core.", min=0)]
Memory = Annotated[int, typer.Option(help="Memory that one worker may use, in MiB.", min=256)]
RasterName = Annotated[
    str | None, typer.Argument(help="A raster of the store, e.g. densification/precision; all products when left out.")
]


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


@app.command()
def run(
    name: Name,
    from_stage: From = None,
    until: Until = None,
    workers: Workers = 0,
    memory: Memory = 1500,
    sequential: Sequential = False,
    scheduler: Annotated[str | None, typer.Option(help="Address of an existing Dask scheduler, e.g. tcp://10.0.0.5:8786.")] = None,
    port: Annotated[int, typer.Option(help="Port of the dashboard; the next free one if it is taken.", min=1, max=65535)] = 8787,
    tls_ca: Annotated[Path | None, typer.Option(help="Certificate of the authority of an existing cluster (PEM).")] = None,
    tls_cert: Annotated[Path | None, typer.Option(help="Your certificate for that cluster (PEM).")] = None,
    tls_key: Annotated[Path | None, typer.Option(help="The key of your certificate (PEM).")] = None,
    strict: Annotated[bool, typer.Option("--strict", help="End with exit code 3 where the results are in doubt.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Progress and result as one JSON object a line.")] = False,
    debug: Debug = False,
) -> None:
    """Run a workflow; continues where an earlier run stopped."""
    with plain_errors(debug):
        loaded, tls = load_project(name), _tls_files(scheduler, (tls_ca, tls_cert, tls_key))
        end = _run(loaded, Options(from_stage, until, workers, memory * MIB, sequential, scheduler, port, tls), as_json)
    if end.doubts and strict:
        raise typer.Exit(3)


def _tls_files(scheduler: str | None, files: tuple[Path | None, ...]) -> tuple[Path, Path, Path] | None:
    """The three files of an encrypted connection, None without. Raises ResourceError for some of them only, or absent ones."""
    given = [path for path in files if path is not None]
    if not given:
        return None
    if len(given) < len(files) or not scheduler:
        raise ResourceError("--tls-ca, --tls-cert and --tls-key are given together, with the --scheduler that they are for.")
    for path in given:
        if not path.is_file():
            raise ResourceError(f"There is no file {path}; give the certificates and the key as PEM files.")
    return given[0], given[1], given[2]


def _run(loaded: LoadedWorkflow, options: Options, as_json: bool = False) -> RunEnd:
    """Run with progress lines, and tell how it ended. Ends the command where the project is not complete."""

    def announce(line: str) -> None:
        print(json.dumps({"event": "note", "text": line}), flush=True) if as_json else out.print(escape(line), soft_wrap=True)

    facts = run_with_report(
        loaded,
        options,
        watch=lambda session, runner, workers: run_display(session, runner, workers, err, announce, as_json),
        announce=announce,
    )
    end = run_end(facts, loaded.run_folder, titles_of(loaded.stages))
    if as_json:
        print(tell_as_json(end), flush=True)
    else:
        tell(end, out, err)
    if not end.facts.complete:
        raise typer.Exit(1)
    return end


@app.command()
def demo(workers: Workers = 0, memory: Memory = 1500, sequential: Sequential = False, debug: Debug = False) -> None:
    """Run a small embedded project in the current folder: photographs are simulated, everything else is as with real ones."""
    with plain_errors(debug):
        path = write_demo(Path.cwd())
        _run(load_project(str(path)), Options(None, None, workers, memory * MIB, sequential))


@app.command()
def calibrate(
    photos: Annotated[list[Path], typer.Argument(help="Photographs of the chessboards, or folders of them.")],
    corners: Annotated[str, typer.Option(help="Inner corners of a board: columns x rows, e.g. 5x6.")],
    square: Annotated[float, typer.Option(help="Side of a square, m.")],
    boards: Annotated[int, typer.Option(help="Number of equal boards in the scene; 0: as many as are found.")] = 0,
    arrangement: Annotated[str, typer.Option(help="plane: all in one plane; space: anywhere, but fixed.")] = "plane",
    parameters: Annotated[str, typer.Option(help="Interior parameters, e.g. c,x0,y0,k1,k2,p1,p2; chosen when left out.")] = "",
    name: Annotated[str, typer.Option(help="Results go to runs/<name>.")] = "calibration",
    workers: Workers = 0,
    memory: Memory = 1500,
    sequential: Sequential = False,
    debug: Debug = False,
) -> None:
    """Calibrate a camera from photographs of one or several chessboards."""
    with plain_errors(debug):
        boards_used = BoardOptions(corners, square, boards, arrangement, parameters)
        loaded = calibration_workflow(name, photos, boards_used, Path.cwd(), STAGES)
        _run(loaded, Options(None, None, workers, memory * MIB, sequential))
    print_calibration(loaded.run_folder)


@app.command()
def check(
    surface: CheckedFile,
    photos: PhotosOf = None,
    block: BlockOf = None,
    project: ProjectOf = None,
    crs: CrsOf = None,
    system: SystemOf = None,
    remove_shift: RemoveShift = False,
    fill: Fill = False,
    name: Annotated[str | None, typer.Option(help="Results go to runs/<name>.")] = None,
    workers: Workers = 0,
    memory: Memory = 1500,
    sequential: Sequential = False,
    debug: Debug = False,
) -> None:
    """Check a surface of any origin against photographs: where is it wrong, by how much, and what would have been found."""
    with plain_errors(debug):
        given = checking.CheckOptions(photos, project, block, crs, system, remove_shift, fill)
        loaded = checking.check_workflow(name or checking.check_name(surface), surface, given, Path.cwd(), STAGES)
        _run(loaded, Options(None, None, workers, memory * MIB, sequential))


@app.command()
def change(
    before: Annotated[str, typer.Argument(help="The earlier epoch: a finished project, or a surface file.")],
    after: Annotated[str, typer.Argument(help="The later epoch: a finished project.")],
    sigma: Annotated[float, typer.Option(help="Standard error of the earlier heights, m.", min=0.0)] = 0.0,
    name: Annotated[str | None, typer.Option(help="Results go to runs/<name>.")] = None,
    workers: Workers = 0,
    memory: Memory = 1500,
    sequential: Sequential = False,
    debug: Debug = False,
) -> None:
    """Where has the ground changed between two epochs, and is it significant? The earlier surface against the later photographs."""
    with plain_errors(debug):
        loaded = checking.change_workflow(before, after, name, sigma, Path.cwd(), STAGES)
        _run(loaded, Options(None, None, workers, memory * MIB, sequential))


@app.command()
def plan(name: Name, from_stage: From = None, until: Until = None, debug: Debug = False) -> None:
    """Show what a run would do: jobs, bytes, peak memory, and why each stage would run. Writes nothing."""
    with plain_errors(debug):
        session = session_of(load_project(name), from_stage, until)
        noticed = plan_ahead(session).remarks()
        expected = forecast(session)
        out.print(plan_lines(session, expected))
        for sentence in noticed:
            out.print(f"note: {escape(sentence)}", soft_wrap=True)
        for note in plan_notes(session, expected):
            out.print(escape(note), soft_wrap=True)


@app.command()
def status(name: Name, debug: Debug = False) -> None:
    """Show what is done, what failed and why, also while a run is in progress."""
    with plain_errors(debug):
        loaded = load_project(name)
        folder = loaded.run_folder
        begun = begun_at(folder)
        now = ("this run",) if begun else ()
        lines = Lines("stage", "done", *now, "failed", "seconds", "peak memory", "last error", box=None)
        for stage in loaded.stages:
            lines.add_row(stage.kind, *status_row(Records(folder).of_stage(stage.kind), begun))
        out.print(lines)
        address = dashboard_address(folder)
        running = f"running now; dashboard: {address}" if address else "running now"
        out.print(running if is_running(folder) else "not running", soft_wrap=True)


@app.command()
def report(
    name: Name,
    pdf: Annotated[
        bool, typer.Option("--pdf", help="Print it to report.pdf (A4) as well, with a browser of this machine.")
    ] = False,
    debug: Debug = False,
) -> None:
    """Write the report and the summary again from the stored results."""
    with plain_errors(debug):
        page = rewrite_results(load_project(name))
        out.print(str(page), soft_wrap=True)
        if pdf:
            out.print(str(write_pdf(page)), soft_wrap=True)


@app.command()
def export(
    name: Name,
    raster: RasterName = None,
    path: Annotated[str | None, typer.Argument(help="File in the run's folder; default products/<raster>.tif.")] = None,
    debug: Debug = False,
) -> None:
    """Write products again, or any raster of the store as a GeoTIFF."""
    with plain_errors(debug):
        session = session_of(load_project(name))
        chosen = _exports(session, raster, path)
        with only_run(session.folder):
            for job in chosen:
                export_file(job, session.store, session.folder)
                out.print(str(session.folder / job.path), soft_wrap=True)


def _exports(session: Session, raster: str | None, path: str | None) -> list[Export]:
    if raster is not None:
        session.store.spec(raster)  # raises for a raster that does not exist, before the lock is taken
        target = path or f"products/{raster.replace('/', '_')}.tif"
        return [Export("export", raster, target, "cog", rasters={"value": raster})]
    # Only products whose inputs exist: after an interrupted run the others are still to be computed.
    session.plan()
    planned = [p.job for p in session.graph.jobs.values() if isinstance(p.job, Export) and p.job.path.startswith("products/")]
    store = session.store
    ready = [job for job in planned if all(map(store.has, job.rasters.values())) and all(map(store.has_table, job.tables))]
    if not ready:
        raise StoreError(f"{session.folder.name} has no products yet; run it first: orthomill run {session.folder.name}")
    return ready


@app.command()
def clean(
    name: Name,
    stage: Annotated[list[str] | None, typer.Option(help="Only this stage's results (may be given again).")] = None,
    debug: Debug = False,
) -> None:
    """Remove a project's results; its photographs and workflow stay."""
    with plain_errors(debug):
        loaded, stages = load_project(name), tuple(stage or ())
        check_stage_names(loaded, stages)
        clean_run(loaded.run_folder, stages)
        out.print(f"removed from {loaded.run_folder}: {', '.join(stages) or 'everything'}", soft_wrap=True)


@app.command()
def verify(name: Name, debug: Debug = False) -> None:
    """Check every stored result against its checksum; what is damaged is computed again by the next run."""
    with plain_errors(debug):
        folder = load_project(name).run_folder
        if not folder.is_dir():
            raise StoreError(f"{folder.name} has no results yet; run it first: orthomill run {name}")
        found = verify_results(folder)
        signed = check_signature(folder)
        for line in (*verification_lines(found, name), *(signature_lines(signed) if signed else ())):
            out.print(escape(line), soft_wrap=True)
    if found.damaged or (signed and not signed.holds):
        raise typer.Exit(1)


@app.command()
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
    with plain_errors(debug):
        loaded = load_project(name)
        question = f"Do you, {signer}, {role}, sign these figures and the products they are about?"

        def agrees(page: FirstPage) -> bool:
            for line in signing_lines(page):
                out.print(escape(line), soft_wrap=True)
            return yes or typer.confirm(question)

        person = Person(agrees, passphrase=lambda: str(typer.prompt("Passphrase", hide_input=True)))
        path = sign_project(loaded, Signer(name=signer, role=role, remarks=remarks), key, person)
        out.print(f"signed: {path}" if path else "not signed", soft_wrap=True)
    if path is None:
        raise typer.Exit(1)


@app.command()
def dashboard(name: Name, debug: Debug = False) -> None:
    """Print the address of the dashboard of a run in progress."""
    with plain_errors(debug):
        folder = load_project(name).run_folder
        none = f"{folder.name} is running without Dask, so there is no dashboard; see: orthomill status {name}"
        idle = f"{folder.name} is not running; start it with: orthomill run {name}"
        out.print(dashboard_address(folder) or (none if is_running(folder) else idle), soft_wrap=True)


@app.command()
def watch(name: Name, debug: Debug = False) -> None:
    """Show the map of tiles in a browser: live while the project runs, as it ended afterwards."""
    with plain_errors(debug):
        folder = load_project(name).run_folder
        live = dashboard_address(folder, TILES)
        kept = folder / MAP
        if not live and not kept.exists():
            raise StoreError(f"{folder.name} has no map of tiles yet; run it first: orthomill run {name}")
        address = live or kept.resolve().as_uri()
        out.print(address, soft_wrap=True)
        webbrowser.open(address)


@app.command()
def init(
    name: Annotated[str, typer.Argument(help="Name of the new project.")],
    photos: Annotated[Path, typer.Option(help="Folder with the photographs.")],
    crs: Annotated[str | None, typer.Option(help="Projected CRS, e.g. EPSG:32634; proposed from GPS when left out.")] = None,
    debug: Debug = False,
) -> None:
    """Write a commented starting workflow from the photographs' EXIF."""
    with plain_errors(debug):
        start = write_starting_workflow(name, photos, Path.cwd(), STAGES, crs, outlook(look_ahead, STAGES, Path.cwd()))
        for note in (*found_lines(start.survey, start.look), *start.notes):
            out.print(escape(note), soft_wrap=True)
        out.print(f"{start.path} is written; read it, then: orthomill run {name}", soft_wrap=True)


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
    with plain_errors(debug):
        path = picture_path(photo, f"window_size_{method}", output)
        found = window_size_map(
            GuardedPhoto(photo), sizing_of(method, largest, limit, second, given or ()), share_of(assigned, limit)
        )
        write_map(found, path, out, err)


@app.command()
def doctor() -> None:
    """Examine this machine: versions, cores, memory, free disk, what is missing."""
    rows = examine(Path.cwd())
    lines = Lines("what", "found", "", "advice", box=None)
    for row in rows:
        lines.add_row(row.name, escape(str(row.value)), "ok" if row.ok else "[red]![/red]", escape(row.advice))
    out.print(lines)
    if not all(row.ok for row in rows):
        raise typer.Exit(1)


@app.command(hidden=True)
def reference(path: Annotated[Path, typer.Argument(help="Where to write the page.")] = Path("docs/settings.md")) -> None:
    """Write the settings reference from the schemas."""
    write_settings_reference(STAGES, path)


@app.command(hidden=True)
def figures(
    names: Annotated[list[str], typer.Argument(help="Finished projects that together have all stages.")],
    path: Annotated[Path, typer.Option(help="Where to write the page.")] = Path("docs/summary.md"),
    debug: Debug = False,
) -> None:
    """Write the page of all names in summary.json from finished runs."""
    with plain_errors(debug):
        loaded = map(load_project, names)
        files = [one.root / "runs" / one.project.project / "summary.json" for one in loaded]
        # The first has the last word on what several have.
        path.write_text(summary_markdown(dict(ChainMap(*(json.loads(file.read_text()) for file in files)))))


def main() -> None:
    """Entry point of the command."""
    # Planning creates hundreds of thousands of small objects that live on: collecting garbage among them at Python's usual
    # threshold of 700 takes longer than creating them.
    gc.set_threshold(50_000)
    # A terminal that is not UTF-8 shows names of photographs as codes; it must not end the run with an internal error.
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    listen()
    app()
