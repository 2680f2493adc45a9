"""Commands that run stages: of a workflow, or of one that the command makes itself."""

import json
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.markup import escape

from orthomill.pipeline.cli.commands.option_types import (
    BlockOf,
    CheckedArea,
    CheckedFile,
    CheckedPolygons,
    CrsOf,
    Fill,
    From,
    Memory,
    Ortho,
    PhotosOf,
    ProjectOf,
    RemoveShift,
    Sequential,
    SystemOf,
    Until,
    Workers,
)
from orthomill.pipeline.cli.terminal import Debug, Name, out, plain_errors
from orthomill.schemas.errors import ResourceError, WorkflowError

if TYPE_CHECKING:
    from orthomill.pipeline.engine.running import Options
    from orthomill.pipeline.workflow.workflow_file import LoadedWorkflow

running = typer.Typer()


@running.command()
def run(
    name: Name,
    from_stage: From = None,
    until: Until = None,
    workers: Workers = 0,
    memory: Memory = 1500,
    sequential: Sequential = False,
    scheduler: Annotated[str | None, typer.Option(help="Address of an existing Dask scheduler, e.g. tcp://10.0.0.5:8786.")] = None,
    cluster: Annotated[
        Path | None, typer.Option(help="A cluster to be started: its YAML file; 'orthomill cluster template slurm' writes one.")
    ] = None,
    store: Annotated[
        str, typer.Option(help="Keep the results in an object store: s3://BUCKET/PREFIX, gs:// or az://; no disk is shared then.")
    ] = "",
    port: Annotated[int, typer.Option(help="Port of the dashboard; the next free one if it is taken.", min=1, max=65535)] = 8787,
    tls_ca: Annotated[Path | None, typer.Option(help="Certificate of the authority of an existing cluster (PEM).")] = None,
    tls_cert: Annotated[Path | None, typer.Option(help="Your certificate for that cluster (PEM).")] = None,
    tls_key: Annotated[Path | None, typer.Option(help="The key of your certificate (PEM).")] = None,
    strict: Annotated[bool, typer.Option("--strict", help="End with exit code 3 where the results are in doubt.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Progress and result as one JSON object a line.")] = False,
    debug: Debug = False,
) -> None:
    """Run a workflow; continues where an earlier run stopped."""
    from orthomill.pipeline.cli.projects import load_project

    with plain_errors(debug):
        loaded = load_project(name)
        # After the workflow: a mistake in it is answered before the engine is loaded.
        from orthomill.pipeline.cli.progress.project_run import run_project
        from orthomill.pipeline.engine.running import Options
        from orthomill.schemas.memory import MIB

        asked = Options(
            from_stage=from_stage,
            until=until,
            workers=workers,
            memory=memory * MIB,
            sequential=sequential,
            scheduler=scheduler,
            port=port,
            store=store,
            tls=_tls_files(scheduler, (tls_ca, tls_cert, tls_key)),
        )
        end = run_project(loaded, asked if cluster is None else _on_cluster(asked, cluster), as_json)
        if loaded.project.acceptance.kind != "none":
            _accept(loaded, until, as_json)
    if end.doubts and strict:
        raise typer.Exit(3)


def _accept(loaded: "LoadedWorkflow", until: str | None, as_json: bool) -> None:
    """Hold the finished run against what was agreed, and say whether it keeps that, or why that was not asked."""
    from orthomill.pipeline.cli.lookups.delivery import profile_of
    from orthomill.pipeline.cli.lookups.kept_acceptance import PAGE, accept_run
    from orthomill.pipeline.cli.lookups.unjudged_run import unjudged
    from orthomill.tasks.lookups import accepted

    if reason := unjudged(loaded, until):
        if as_json:
            print(json.dumps({"event": "acceptance", "complete": None, "text": reason, "page": None}), flush=True)
        else:
            out.print(escape(reason), soft_wrap=True)
        return
    result = accept_run(loaded, profile_of(None, loaded.project), accepted)
    page = loaded.run_folder / PAGE
    if as_json:
        print(
            json.dumps({"event": "acceptance", "complete": result.complete, "text": result.sentence, "page": str(page)}), flush=True
        )
    else:
        out.print(escape(f"{result.sentence} Clause by clause: {page}"), soft_wrap=True)


@running.command()
def demo(workers: Workers = 0, memory: Memory = 1500, sequential: Sequential = False, debug: Debug = False) -> None:
    """Run a small embedded project in the current folder: photographs are simulated, everything else is as with real ones."""
    from orthomill.pipeline.cli.demo import write_demo
    from orthomill.pipeline.cli.progress.project_run import run_project
    from orthomill.pipeline.cli.projects import load_project
    from orthomill.pipeline.engine.running import Options
    from orthomill.schemas.memory import MIB

    with plain_errors(debug):
        path = write_demo(Path.cwd())
        run_project(load_project(str(path)), Options(None, None, workers, memory * MIB, sequential))


@running.command()
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
    from orthomill.pipeline.cli.calibrate import BoardOptions, calibration_workflow, print_calibration
    from orthomill.pipeline.cli.progress.project_run import run_project
    from orthomill.pipeline.engine.running import Options
    from orthomill.schemas.memory import MIB
    from orthomill.tasks.catalogue import STAGES

    with plain_errors(debug):
        boards_used = BoardOptions(corners, square, boards, arrangement, parameters)
        loaded = calibration_workflow(name, photos, boards_used, Path.cwd(), STAGES)
        run_project(loaded, Options(None, None, workers, memory * MIB, sequential))
    print_calibration(loaded.run_folder)


@running.command()
def check(
    surface: CheckedFile,
    photos: PhotosOf = None,
    block: BlockOf = None,
    project: ProjectOf = None,
    crs: CrsOf = None,
    system: SystemOf = None,
    remove_shift: RemoveShift = False,
    fill: Fill = False,
    ortho: Ortho = False,
    area: CheckedArea = None,
    cutline: CheckedPolygons = None,
    name: Annotated[str | None, typer.Option(help="Results go to runs/<name>.")] = None,
    workers: Workers = 0,
    memory: Memory = 1500,
    sequential: Sequential = False,
    debug: Debug = False,
) -> None:
    """Check a surface of any origin against photographs: where is it wrong, by how much, and what would have been found."""
    from orthomill.pipeline.cli import check_surface as checking
    from orthomill.pipeline.cli.progress.project_run import run_project
    from orthomill.pipeline.engine.running import Options
    from orthomill.schemas.memory import MIB
    from orthomill.tasks.catalogue import STAGES

    with plain_errors(debug):
        given = checking.CheckOptions(
            photos, project, block, crs, system, remove_shift, fill, ortho=ortho, area=area, cutline=cutline
        )
        loaded = checking.check_workflow(name or checking.check_name(surface), surface, given, Path.cwd(), STAGES)
        run_project(loaded, Options(None, None, workers, memory * MIB, sequential))


@running.command()
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
    from orthomill.pipeline.cli import check_surface as checking
    from orthomill.pipeline.cli.progress.project_run import run_project
    from orthomill.pipeline.engine.running import Options
    from orthomill.schemas.memory import MIB
    from orthomill.tasks.catalogue import STAGES

    with plain_errors(debug):
        loaded = checking.change_workflow(before, after, name, sigma, Path.cwd(), STAGES)
        run_project(loaded, Options(None, None, workers, memory * MIB, sequential))


def _on_cluster(asked: "Options", file: Path) -> "Options":
    """The options of a run on the cluster of a file. Raises WorkflowError for mistakes in it, ResourceError for two places."""
    from orthomill.pipeline.engine.clusters.cluster_file import SchedulerAddress, read_cluster
    from orthomill.schemas.memory import GIB

    if asked.scheduler or asked.sequential:
        raise ResourceError("--cluster, --scheduler and --sequential each say where jobs are done; give one of them.")
    found = read_cluster(file)
    there = replace(asked, memory=int(found.memory * GIB))
    if not isinstance(found, SchedulerAddress):
        return replace(there, cluster=found)
    files = tuple(Path(path) if path else None for path in (found.ca, found.cert, found.key))
    return replace(there, scheduler=found.address, tls=_tls_files(found.address, files))


@running.command("cluster")
def cluster_template_of(
    action: Annotated[str, typer.Argument(help="template: print a commented file of a cluster.")],
    kind: Annotated[str, typer.Argument(help="slurm, kubernetes, gateway, or address of a scheduler that is there already.")],
) -> None:
    """The file of a cluster, for `orthomill run PROJECT --cluster FILE`."""
    from orthomill.pipeline.engine.clusters.cluster_file import KINDS, cluster_template

    with plain_errors(debug=False):
        if action != "template" or kind not in KINDS:
            raise WorkflowError(f"Type: orthomill cluster template KIND, where KIND is one of {', '.join(KINDS)}.")
        typer.echo(cluster_template(kind), nl=False)


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
