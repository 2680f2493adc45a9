"""Runs a workflow from start to finish: the lock, the runner, the session, the facts of the run.

The engine neither draws reports nor prints: progress goes to a `Watcher`, the results to a `ResultWriter`, and both are handed in.
`orthomill.pipeline.report.results.run_with_report` is the composition that a notebook uses; the command adds its progress lines.
"""

import os
import platform
import resource
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, replace
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Protocol

import psutil

from orthomill import __version__
from orthomill.pipeline.engine.clusters.cluster_file import StartedCluster
from orthomill.pipeline.engine.foresight import Foresight, photograph_pixels
from orthomill.pipeline.engine.graph import PROCESS_BYTES
from orthomill.pipeline.engine.interruption import only_where_asked, stop_if_asked
from orthomill.pipeline.engine.run_facts import DASHBOARD, TILES, RunFacts, StageTitle, write_facts
from orthomill.pipeline.engine.runner import Runner, SchedulerLost, SequentialRunner
from orthomill.pipeline.engine.session import Session, Watcher, now, unwatched
from orthomill.pipeline.engine.workers.worker_terms import shown
from orthomill.pipeline.export.exports import sweep_products
from orthomill.pipeline.records.lock import only_run
from orthomill.pipeline.records.power_cut import examine_after_power_cut, flushing
from orthomill.pipeline.records.records import key_text
from orthomill.pipeline.storage.depots.kept_at import keep_in, send_pages
from orthomill.pipeline.storage.reading import ReadableStore
from orthomill.pipeline.workflow.mistakes import did_you_mean
from orthomill.pipeline.workflow.workflow_file import LoadedWorkflow, image_files, write_workflow
from orthomill.schemas.errors import ResourceError, WorkflowError, first_of, some_of
from orthomill.schemas.memory import GIB, MIB
from orthomill.schemas.stage_contract import Stage

WORKERS_PER_CORE = 8
"""More worker processes than this per core are a typing error, and starting them would stall the machine."""
LIBRARIES_BYTES = 3000 * MIB
"""Address space of a process with all libraries, kernels and threads, measured; most of it is never filled with anything."""

UNENCRYPTED = (
    "warning: the connection to {} is not encrypted, and whoever reaches that scheduler can run code as you; use certificates "
    "(--tls-ca, --tls-cert, --tls-key) unless the network is yours alone."
)

LOST = "The Dask scheduler of this machine was lost, perhaps for want of processors; {} jobs are done, and a new one does the rest."


@dataclass(frozen=True)
class Options:
    """How to run. `workers` 0 means one per core; `memory` is bytes per worker."""

    from_stage: str | None = None
    until: str | None = None
    workers: int = 0
    memory: int = 1500 * MIB
    sequential: bool = False
    scheduler: str | None = None
    port: int = 8787
    cluster: StartedCluster | None = None
    """a cluster that this run starts itself"""
    store: str = ""
    """address of an object store below which the results are kept, for a run that has none yet; empty: wherever they are"""
    tls: tuple[Path, Path, Path] | None = None
    """certificate of the authority, own certificate and own key for the scheduler of an existing cluster"""

    @property
    def processes(self) -> int:
        """Number of workers: as asked, the cluster's, or one for each processor."""
        return self.workers or (self.cluster.workers if self.cluster else os.cpu_count() or 1)

    @property
    def elsewhere(self) -> bool:
        """Whether the workers are not this machine's own."""
        return self.scheduler is not None or self.cluster is not None

    @property
    def room(self) -> int:
        """Bytes that a job may use that runs alone: what all workers of this machine have, less what the idle ones keep."""
        # Of a cluster nobody here knows how much more than its share a worker could take from its machine.
        others = 0 if self.elsewhere else self.processes - 1
        return self.memory + others * max(self.memory - PROCESS_BYTES, 0)


class ResultWriter(Protocol):
    """Writes summary and report of a run; `stages` are all stages of the workflow, in its order."""

    def __call__(self, store: ReadableStore, folder: Path, stages: tuple[StageTitle, ...], facts: RunFacts) -> None: ...


Watch = Callable[[Session, Runner, int], AbstractContextManager[Watcher]]
"""(session, its runner, number of workers) -> the progress display of one run."""


def session_of(loaded: LoadedWorkflow, from_stage: str | None = None, until: str | None = None) -> Session:
    """A session of the stages that were asked for. Raises WorkflowError for stages that the workflow does not have."""
    check_stage_names(loaded, tuple(name for name in (from_stage, until) if name is not None))
    kinds = [stage.kind for stage in loaded.stages]
    first = kinds.index(from_stage) if from_stage else len(kinds)
    last = kinds.index(until) if until else len(kinds) - 1
    if from_stage and first > last:
        raise WorkflowError(f"--from {from_stage} comes after --until {until}, so nothing would run; swap the two.")
    # Later stages run again even where their own settings are unchanged: "--from" is asked for when a result is not trusted.
    forced = frozenset(kinds[first : last + 1])
    return Session(loaded.project, loaded.stages[: last + 1], loaded.root, partial(image_files, loaded.root), forced)


def check_stage_names(loaded: LoadedWorkflow, names: tuple[str, ...]) -> None:
    """Raises WorkflowError for a name that is not a stage of the workflow."""
    kinds = [stage.kind for stage in loaded.stages]
    for name in names:
        if name not in kinds:
            meant = did_you_mean(name, kinds)
            raise WorkflowError(f"There is no stage '{name}' in {loaded.path.name}{meant} Its stages are {', '.join(kinds)}.")


def titles_of(stages: tuple[Stage, ...]) -> tuple[StageTitle, ...]:
    """(kind, title) of every stage."""
    return tuple((stage.kind, stage.title) for stage in stages)


def run_workflow(
    loaded: LoadedWorkflow,
    options: Options,
    write_results: ResultWriter,
    watch: Watch = unwatched,
    announce: Callable[[str], None] = lambda line: None,
) -> RunFacts:
    """Run a workflow and write its results, even when some of its jobs failed. Raises OrthomillError when it cannot start.

    `watch` shows progress; `announce` receives single lines, such as the address of the dashboard.
    """
    _check_workers(options)
    _check_address_space(options)
    if options.store:
        keep_in(loaded.run_folder, options.store)
    session = session_of(loaded, options.from_stage, options.until)
    with only_run(session.folder):
        clock = time.monotonic()
        _announce_dashboard(session.folder, options)
        examine_after_power_cut(session.folder)
        session.plan()
        _tell_foreseen(session, announce)
        facts = _begin(loaded, session)
        if session.pending:
            # Only now: the lock is held, so no live process can own a temporary file, and a run without work touches nothing.
            session.store.sweep()
            session.records.fold()
            write_facts(session.folder, _so_far(facts, session))
            with flushing(session.folder), _facts_survive(session, facts):
                facts = replace(facts, scheduler=_run(session, options, watch, announce))
            session.records.fold()
            # Of this run as well: a worker may have been killed in the middle of an export, which another one then made.
            sweep_products(session.folder)
        # Here too: a run may have been killed when it had joined them.
        session.drop_parts()
        if replaced := session.drop_replaced():
            announce(replaced)
        if session.defects:
            announce(_mended(session))
        facts = replace(_so_far(facts, session), finished=now(), seconds=time.monotonic() - clock)
        write_results(session.store, session.folder, titles_of(loaded.stages), facts)
        (session.folder / DASHBOARD).unlink(missing_ok=True)
        send_pages(session.folder)
    return facts


def _tell_foreseen(session: Session, announce: Callable[[str], None]) -> None:
    """Announce what is noticed in the files before anything runs. Raises WorkflowError for mistakes in them."""
    if not session.pending:
        return
    foresight = Foresight(session)
    foresight.look()
    for sentence in first_of(foresight.remarks()).splitlines():
        announce(f"note: {sentence}")


def _mended(session: Session) -> str:
    """What was computed again though nothing in the project has changed."""
    names = some_of([f"{key_text(key)} ({reason})" for key, reason in session.defects.items()], 3)
    return f"Found lost or damaged on the disk and computed again, {len(session.defects)} in all: {names}."


def _begin(loaded: LoadedWorkflow, session: Session) -> RunFacts:
    """Write the workflow as run, and return what is known before any job has run."""
    filled_in = session.folder / "workflow.yaml"
    write_workflow(loaded, filled_in)
    return RunFacts(
        project=loaded.project.project,
        crs=loaded.project.crs,
        tolerances=loaded.project.tolerances,
        version=__version__,
        started=now(),
        pixels=photograph_pixels(session),
        tile=session.project.tile,
        workflow=filled_in.read_text(),
        machine=_machine(),
    )


def _announce_dashboard(folder: Path, options: Options) -> None:
    """An empty address while a run on Dask has none yet, and none of a run that was killed, whose dashboard is dead."""
    for address in (DASHBOARD, TILES):
        (folder / address).unlink(missing_ok=True)
    if not options.sequential:
        write_for_the_user_only(folder / DASHBOARD, "")


def _check_workers(options: Options) -> None:
    """Raises ResourceError for more workers than this machine can serve."""
    cores = os.cpu_count() or 1
    if not options.sequential and not options.elsewhere and options.processes > WORKERS_PER_CORE * cores:
        raise ResourceError(
            f"--workers {options.processes} is too many for the {cores} cores of this machine, where more than one per core "
            f"gains little; give at most {WORKERS_PER_CORE * cores}, or leave it out."
        )


def _check_address_space(options: Options) -> None:
    """Raises ResourceError where the shell does not give a process the memory that a worker may use."""
    # Beyond such a limit the C++ libraries end the process without a word, and its workers would be started again and again.
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    needed = LIBRARIES_BYTES + max(options.memory - PROCESS_BYTES, 0)
    if 0 <= limit < needed and not options.elsewhere:
        raise ResourceError(
            f"This shell allows a process {limit / MIB:.0f} MiB of memory (ulimit -v), but with --memory "
            f"{options.memory / MIB:.0f} it may need {needed / MIB:.0f} MiB with its libraries; raise the limit with "
            "'ulimit -v unlimited', or set a smaller --memory."
        )


@contextmanager
def _facts_survive(session: Session, facts: RunFacts) -> Iterator[None]:
    """An interrupted run leaves its facts, so that `orthomill report` can show what has been computed."""
    try:
        yield
    except BaseException:  # KeyboardInterrupt included: Ctrl-C is the usual way in which a run is interrupted
        write_facts(session.folder, _so_far(facts, session))
        raise


def _run(session: Session, options: Options, watch: Watch, announce: Callable[[str], None]) -> str:
    """Run all pending jobs; returns the description of the runner."""
    # Checked before workers start: starting them takes seconds, and the refusal needs none of them.
    session.check_resources(options.room)
    while True:
        before = len(session.done)
        try:
            return _run_once(session, options, watch, announce)
        except SchedulerLost:
            stop_if_asked()
            # A cluster elsewhere is restarted by those who own it; one that finishes nothing will not do so the next time.
            if options.elsewhere or len(session.done) == before:
                raise
            announce(LOST.format(len(session.done)))
            session.take_up()


def _run_once(session: Session, options: Options, watch: Watch, announce: Callable[[str], None]) -> str:
    with _runner(session, options, announce) as runner, watch(session, runner, options.processes) as watcher:
        if runner.dashboard:
            announce(f"dashboard: {runner.dashboard}")
        session.run(runner, watcher)
        return runner.description


def _runner(session: Session, options: Options, announce: Callable[[str], None]) -> AbstractContextManager[Runner]:
    return _sequential(options) if options.sequential else _on_dask(session, options, announce)


@contextmanager
def _sequential(options: Options) -> Iterator[Runner]:
    yield SequentialRunner(options.memory, options.room)


@contextmanager
def _on_dask(session: Session, options: Options, announce: Callable[[str], None]) -> Iterator[Runner]:
    # Dask is imported only here: importing it takes longer than finding out that nothing has changed.
    from orthomill.pipeline.engine.dask_cluster import local_client, remote_client
    from orthomill.pipeline.engine.dask_runner import DaskRunner, kept_report
    from orthomill.pipeline.engine.workers.workforce import DESERTED

    folder = session.folder
    patience = DESERTED
    if options.cluster:
        from orthomill.pipeline.engine.clusters.started_clusters import started_client

        place, patience = (
            f"up to {options.processes} workers of a cluster ({options.cluster.kind})",
            3600.0 * options.cluster.patience,
        )
        client_of = started_client(options.cluster, options.port, announce)
    elif options.scheduler:
        if options.tls is None:
            announce(UNENCRYPTED.format(options.scheduler))
        place = f"the cluster at {options.scheduler}"
        client_of = remote_client(options.scheduler, options.tls)
    else:
        place = f"{options.processes} processes on this machine"
        client_of = local_client(options.processes, options.memory, options.port)
    address = folder / DASHBOARD
    # Workers of this machine are our own, started from the files of this program.
    recognised = shown(folder, session.mark) if options.elsewhere else nullcontext()
    # An exception in the middle of Dask's connections would end in its tracebacks: the runner asks for requests to stop.
    with only_where_asked(), recognised as terms, client_of as client:
        runner = DaskRunner(client, options.memory, place, options.room, terms, announce, patience)
        if terms:
            runner.workforce.muster(terms)
        write_for_the_user_only(address, runner.dashboard)
        try:
            with kept_report(runner, folder / "dask_report.html"):
                yield runner
        finally:
            runner.close()
            address.unlink(missing_ok=True)


def write_for_the_user_only(path: Path, text: str) -> None:
    """A file that others cannot read: whoever knows the address of the dashboard may look at it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.unlink(missing_ok=True)
    with open(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as stream:
        stream.write(text)


def _so_far(facts: RunFacts, session: Session) -> RunFacts:
    """The facts with what the session has done by now."""
    stages = session.stage_runs()
    return replace(
        facts,
        stages=stages,
        failures=session.failure_list(),
        peak_bytes=max((stage.peak_bytes for stage in stages if stage.peak_bytes), default=None),
        earlier=session.earlier_runs(),
    )


def _machine() -> tuple[tuple[str, str], ...]:
    libraries = ("numpy", "numba", "opencv-python-headless", "dask", "zarr", "rasterio")
    return (
        ("processor", platform.processor() or platform.machine()),
        ("cores", str(os.cpu_count())),
        ("memory", f"{psutil.virtual_memory().total / GIB:.1f} GiB"),
        ("operating system", platform.platform()),
        ("Python", platform.python_version()),
        *((name, version(name)) for name in libraries),
    )
