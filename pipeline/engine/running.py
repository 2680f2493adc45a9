"""Runs a workflow from start to report: the lock, the runner, the session, the summary, the page that people read."""

import os
import platform
import time
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, replace
from functools import partial
from importlib.metadata import version
from pathlib import Path

import psutil
from rich.console import Console

from orthomill.pipeline.cli.progress import Progress
from orthomill.pipeline.engine.lock import only_run
from orthomill.pipeline.engine.run_facts import RunFacts, StageTitle
from orthomill.pipeline.engine.runner import Runner, SequentialRunner
from orthomill.pipeline.engine.session import Session, now
from orthomill.pipeline.report.results import REPORT, keep_results, read_facts, write_facts, write_results
from orthomill.pipeline.storage.table_files import write_whole
from orthomill.pipeline.workflow.mistakes import did_you_mean
from orthomill.pipeline.workflow.workflow_file import LoadedWorkflow, image_files, write_workflow
from orthomill.schemas.errors import ResourceError, StoreError, WorkflowError
from orthomill.schemas.stage_contract import Stage

MIB = 2**20
WORKERS_PER_CORE = 8
"""More worker processes than this for each core are a slip of the pen, and starting them would stop the machine."""
DASHBOARD = "jobs/dashboard.txt"
"""Holds the address of the dashboard while a run on Dask is going on."""


@dataclass(frozen=True)
class Options:
    """How to run. `workers` 0 is one for each core; `memory` is bytes for each worker."""

    from_stage: str | None = None
    until: str | None = None
    workers: int = 0
    memory: int = 1500 * MIB
    sequential: bool = False
    scheduler: str | None = None
    port: int = 8787

    @property
    def processes(self) -> int:
        return self.workers or os.cpu_count() or 1


def session_of(loaded: LoadedWorkflow, from_stage: str | None = None, until: str | None = None) -> Session:
    """A session of the stages that were asked for. Raises WorkflowError for stages that the workflow does not have."""
    check_stage_names(loaded, tuple(name for name in (from_stage, until) if name is not None))
    kinds = [stage.kind for stage in loaded.stages]
    first = kinds.index(from_stage) if from_stage else len(kinds)
    last = kinds.index(until) if until else len(kinds) - 1
    if from_stage and first > last:
        raise WorkflowError(f"--from {from_stage} comes after --until {until}, so nothing would run; exchange the two.")
    forced = frozenset(kinds[first : last + 1])
    return Session(loaded.project, loaded.stages[: last + 1], loaded.root, partial(image_files, loaded.root), forced)


def check_stage_names(loaded: LoadedWorkflow, names: tuple[str, ...]) -> None:
    """Raises WorkflowError for a name that is no stage of the workflow."""
    kinds = [stage.kind for stage in loaded.stages]
    for name in names:
        if name not in kinds:
            meant = did_you_mean(name, kinds)
            raise WorkflowError(f"There is no stage '{name}' in {loaded.path.name}{meant} Its stages are {', '.join(kinds)}.")


def run_workflow(loaded: LoadedWorkflow, options: Options, out: Console, err: Console) -> RunFacts:
    """Run a workflow and write its report, whatever became of its tiles. Raises OrthomillError when it cannot start."""
    _check_workers(options)
    session = session_of(loaded, options.from_stage, options.until)
    with only_run(session.folder):
        write_workflow(loaded, session.folder / "workflow.yaml")
        facts = RunFacts(
            project=loaded.project.project,
            crs=loaded.project.crs,
            version=version("orthomill"),
            started=now(),
            workflow=(session.folder / "workflow.yaml").read_text(),
            machine=_machine(),
        )
        (session.folder / DASHBOARD).unlink(missing_ok=True)
        clock = time.monotonic()
        session.plan()
        work = bool(session.pending)
        if work:
            session.store.sweep()
            write_facts(session.folder, replace(facts, **_ends(session)))
            with _facts_of_an_interruption(session, facts):
                facts = replace(facts, scheduler=_run(session, options, out, err))
        facts = replace(facts, finished=now(), seconds=time.monotonic() - clock, **_ends(session))
        write = write_results if work else keep_results
        write(session.store, session.folder, _titles(session.stages if work else loaded.stages), facts)
    return facts


def _titles(stages: tuple[Stage, ...]) -> tuple[StageTitle, ...]:
    return tuple((stage.kind, stage.title) for stage in stages)


def _check_workers(options: Options) -> None:
    """Raises ResourceError for a number of workers that would drown this machine."""
    cores = os.cpu_count() or 1
    if not options.sequential and not options.scheduler and options.processes > WORKERS_PER_CORE * cores:
        raise ResourceError(
            f"--workers {options.processes} is too many for the {cores} cores of this machine, where more than one for each core "
            f"gain little; give at most {WORKERS_PER_CORE * cores}, or leave it out."
        )


@contextmanager
def _facts_of_an_interruption(session: Session, facts: RunFacts) -> Iterator[None]:
    """A run that is stopped leaves its facts, so that `orthomill report` can show what is there."""
    try:
        yield
    except BaseException:
        write_facts(session.folder, replace(facts, **_ends(session)))
        raise


def _run(session: Session, options: Options, out: Console, err: Console) -> str:
    session.check_resources(options.memory)
    titles = {stage.kind: stage.title for stage in session.stages}
    with _runner(session.folder, options, out) as runner, Progress(titles, options.processes, err) as progress:
        session.run(runner, progress)
        return runner.description


def _runner(folder: Path, options: Options, out: Console) -> AbstractContextManager[Runner]:
    return _sequential(options) if options.sequential else _on_dask(folder, options, out)


@contextmanager
def _sequential(options: Options) -> Iterator[Runner]:
    yield SequentialRunner(options.memory)


@contextmanager
def _on_dask(folder: Path, options: Options, out: Console) -> Iterator[Runner]:
    """Dask is imported only here: importing it takes longer than finding that nothing has changed."""
    from orthomill.pipeline.engine.dask_cluster import local_client, remote_client
    from orthomill.pipeline.engine.dask_runner import DaskRunner, kept_report

    if options.scheduler:
        place = f"the cluster at {options.scheduler}"
        client_of = remote_client(options.scheduler, options.memory)
    else:
        place = f"{options.processes} processes on this machine"
        client_of = local_client(options.processes, options.memory, options.port)
    address = folder / DASHBOARD
    with client_of as client:
        runner = DaskRunner(client, options.memory, place)
        out.print(f"dashboard: {client.dashboard_link}", soft_wrap=True)
        write_whole(address, client.dashboard_link.encode())
        with kept_report(runner, folder / "dask_report.html"):
            try:
                yield runner
            finally:
                runner.close()
                address.unlink(missing_ok=True)


def _ends(session: Session) -> dict:
    stages = session.stage_runs()
    peaks = [stage.peak_bytes for stage in stages if stage.peak_bytes]
    return {
        "stages": stages,
        "failures": session.failure_list(),
        "peak_bytes": max(peaks, default=None),
        "earlier": session.earlier_runs(),
    }


def _machine() -> tuple[tuple[str, str], ...]:
    libraries = ("numpy", "numba", "opencv-python-headless", "dask", "zarr", "rasterio")
    return (
        ("processor", platform.processor() or platform.machine()),
        ("cores", str(os.cpu_count())),
        ("memory", f"{psutil.virtual_memory().total / 2**30:.1f} GiB"),
        ("operating system", platform.platform()),
        ("Python", platform.python_version()),
        *((name, version(name)) for name in libraries),
    )


def rewrite_results(loaded: LoadedWorkflow) -> Path:
    """Write summary and report again from what is stored; returns the report's path. Raises StoreError before the first run,
    ResourceError while another is going on, whose facts would be overwritten."""
    session = session_of(loaded)
    if read_facts(session.folder) is None:
        raise StoreError(f"{loaded.project.project} has not been run yet; run it first: orthomill run {loaded.project.project}")
    with only_run(session.folder):
        write_results(session.store, session.folder, _titles(session.stages), read_facts(session.folder))
    return session.folder / REPORT
