"""One run of one project: plan, skip what is still valid, submit the rest, plan further as tables appear.

All stages that can be planned are in flight together; the session only ever waits for the next job to end.
"""

import shutil
import time
import uuid
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

from orthomill.pipeline.engine.execute import JobOrder
from orthomill.pipeline.engine.fingerprint import of_file
from orthomill.pipeline.engine.graph import Graph, NoWriter, PlannedJob, check_memory
from orthomill.pipeline.engine.interruption import stop_if_asked
from orthomill.pipeline.engine.planner import Planner
from orthomill.pipeline.engine.replaced_products import drop_replaced
from orthomill.pipeline.engine.run_facts import TIME_FORMAT, Failure, StageRun
from orthomill.pipeline.engine.runner import Finished, Runner
from orthomill.pipeline.export.file_parts import joins_parts, parts_of
from orthomill.pipeline.records.records import DEFECTS, Key, Record, Records, key_text, reason_to_run
from orthomill.pipeline.storage.depots.folder import Folder
from orthomill.pipeline.storage.depots.kept_at import depot_of
from orthomill.pipeline.storage.depots.kept_files import Defect, first_defect
from orthomill.pipeline.storage.depots.sent_inputs import SentInputs
from orthomill.pipeline.storage.store import Store
from orthomill.schemas.errors import ResourceError
from orthomill.schemas.job import Export, Raster, Table, regions_of
from orthomill.schemas.memory import MIB
from orthomill.schemas.project import MaskFiles, PhotoFiles, Project
from orthomill.schemas.stage_contract import NotYet, Outline, Stage
from orthomill.schemas.stage_report import report_table

DISK_RESERVE = 200 * MIB
"""bytes that must stay free: records, tables and products come on top of the rasters that are counted"""
COMPRESSION = 2
"""Rasters are stored compressed; half of their plain size is a cautious estimate for heights and photographs alike."""


class Watcher(Protocol):
    """Whatever shows the progress of a run."""

    def planned(self, planned: PlannedJob) -> None:
        """A job has entered the graph."""

    def skipped(self, key: Key) -> None:
        """A job's results of an earlier run are kept."""

    def finished(self, finished: Finished, record: Record | None) -> None:
        """A job has ended; without a record where nothing is kept of it."""


class Unwatched:
    """A watcher that shows nothing."""

    def planned(self, planned: PlannedJob) -> None:
        """Nothing is shown."""

    def skipped(self, key: Key) -> None:
        """Nothing is shown."""

    def finished(self, finished: Finished, record: Record | None) -> None:
        """Nothing is shown."""


@contextmanager
def unwatched(session: "Session", runner: Runner, workers: int) -> Iterator[Watcher]:
    """The progress display of a run that nobody watches."""
    yield Unwatched()


@dataclass
class Session:
    """The state of a run. `forced` stages run even where their results are still valid."""

    project: Project
    stages: tuple[Stage, ...]
    root: Path
    list_images: Callable[[PhotoFiles | MaskFiles], tuple[str, ...]]
    forced: frozenset[str] = frozenset()
    done: set[Key] = field(default_factory=set)
    skipped: set[Key] = field(default_factory=set)
    failures: dict[Key, str] = field(default_factory=dict)
    blocked: set[Key] = field(default_factory=set)
    reasons: dict[Key, str] = field(default_factory=dict)
    defects: dict[Key, str] = field(default_factory=dict)
    """jobs of earlier runs whose results were lost or damaged, and which of it"""
    pending: list[PlannedJob] = field(default_factory=list)
    """planned, to be run, not yet submitted; in an order in which they can run"""

    def __post_init__(self) -> None:
        relative = f"runs/{self.project.project}"
        self.folder = self.root / relative
        self.depot = depot_of(self.folder)
        self.store = Store(self.depot)
        self.records = Records(self.depot)
        self.inputs = SentInputs(self.root, self.depot, of_file)
        self._announced = 0
        self._found: dict[str, str] = {}
        """birth marks of rasters as this planning found them"""
        self._rotten: set[Key] = set()
        """skipped jobs whose results a reader found damaged, to be done again when all others have ended"""
        # Distinguishes the jobs of this run in the records: a worker that Dask asks twice can see that the job is done already.
        self.mark = uuid.uuid4().hex
        self.graph = Graph(self.root, relative)
        self.planner = Planner(self.project, self.stages, self.graph, self.store, self.is_valid, self.list_images)

    def is_valid(self, key: Key) -> bool:
        """Whether the results of a job are there and describe the project as it is."""
        return key in self.done or key in self.skipped

    def plan(self) -> None:
        """Plan all that can be planned now: what is still valid is skipped, the rest is pending."""
        # A skipped job may have written, in an earlier run, the table that a stage waits for: then more can be planned at once.
        self._found.clear()
        while True:
            new = self.planner.advance()
            for planned in new:
                reason = self._reason(planned)
                if reason is None:
                    self.skipped.add(planned.key)
                else:
                    self.reasons[planned.key] = reason
                    self.pending.append(planned)
            if not any(self._unlocks(planned.key) for planned in new if planned.key in self.skipped):
                return

    def _reason(self, planned: PlannedJob) -> str | None:
        if planned.job.stage in self.forced:
            return "asked for"
        record = self.records.get(planned.key)
        defect = self._defect(planned, record) if record else None
        if defect == "missing" and self._is_joined(planned):
            defect = None
        reason = reason_to_run(record, planned.fingerprint, self._births(planned), defect)
        if reason in DEFECTS:
            self.defects[planned.key] = reason
        return reason

    def _is_joined(self, planned: PlannedJob) -> bool:
        """Whether a job wrote the part of a file that is there: the part has gone then."""
        joined = self.graph.joined_by(planned.key)
        return joined is not None and self._reason(joined) is None

    def _births(self, planned: PlannedJob) -> dict[str, str]:
        if isinstance(planned.job, Export):
            return {}
        names = {region.name for region in planned.job.writes.values() if isinstance(region, Raster)}
        return {name: birth for name in names if (birth := self._birth(name))}

    def _birth(self, name: str) -> str:
        """The birth mark of a raster; empty where there is none as it is planned. Asked once a planning, not for every tile."""
        if name not in self._found:
            self._found[name] = self.store.birth(name) if self.store.holds(self.graph.specs[name]) else ""
        return self._found[name]

    def _defect(self, planned: PlannedJob, record: Record, thoroughly: bool = False) -> Defect | None:
        """What is wrong with the results of a job; None when they are all there."""
        # What an export left is in its record: a sheet without content is no file.
        if not isinstance(planned.job, Export) and not self._outputs_exist(planned):
            return "missing"
        found = first_defect(self.depot, record.files, thoroughly)
        return found[1] if found else None

    def _outputs_exist(self, planned: PlannedJob) -> bool:
        if isinstance(planned.job, Export):
            return self.depot.size(planned.job.path) is not None
        return all(
            self.store.has_table(region) if isinstance(region, Table) else bool(self._birth(region.name))
            for region in planned.job.writes.values()
        )

    def _unlocks(self, key: Key) -> bool:
        """Whether a stage waits for a table that this job wrote."""
        job = self.graph.jobs[key].job
        if isinstance(job, Export):  # stages plan with tables only; exported files are read by jobs
            return False
        tables = {f"the table {region.path}" for region in job.writes.values() if isinstance(region, Table)}
        return bool(tables.intersection(self.planner.waiting_for.values()))

    def outlines(self) -> Iterator[tuple[str, Outline]]:
        """What the photographs show of the ground, as far as it is known."""
        for stage in self.stages:
            with suppress(NotYet, NoWriter):
                yield from stage.outlines(self.planner)

    def run(self, runner: Runner, watcher: Watcher) -> None:
        """Run all that has to run. Failures are gathered, not raised; ResourceError before anything is submitted."""
        self._plan_and_submit(runner, watcher)
        while runner.busy or self._goes_again(runner):
            stop_if_asked()
            finished = runner.next()
            record = self._note(finished, watcher)
            if finished.status == "done" and record:
                runner.learn(finished.key, record.seconds)
            # Planning walks through all open stages, so it is repeated only when a table has appeared that one of them waits for.
            if finished.status == "done" and self._unlocks(finished.key):
                self._plan_and_submit(runner, watcher)

    def _plan_and_submit(self, runner: Runner, watcher: Watcher) -> None:
        self.plan()
        self.check_resources(runner.room)
        # Jobs are announced once, though planning is repeated: the graph keeps them in the order in which they were added.
        for key in list(self.graph.jobs)[self._announced :]:
            watcher.planned(self.graph.jobs[key])
            if self.is_valid(key):
                watcher.skipped(key)
        self._announced = len(self.graph.jobs)
        self._submit(runner)

    def _submit(self, runner: Runner) -> None:
        for planned in self.pending:
            stop_if_asked()
            # Rasters are created here and not by the workers: two workers that create the same one would race.
            self._create_outputs(planned)
            reason, wave = self.reasons[planned.key], self.records.begin()
            work = JobOrder(
                planned.job, self.root, self.folder, planned.fingerprint, reason, self.mark, wave, *self._elsewhere(planned)
            )
            runner.submit(work, planned.dependencies, planned.memory)
        self.pending.clear()

    def _elsewhere(self, planned: PlannedJob) -> tuple[str, tuple[tuple[str, str], ...]]:
        """For a worker that does not see this disk: where the results are kept, and the user's files that the job reads there."""
        if isinstance(self.depot, Folder):
            return "", ()
        regions = (
            () if isinstance(planned.job, Export) else (r for reading in planned.job.reads.values() for r in regions_of(reading))
        )
        paths = {region.path for region in regions if not isinstance(region, Raster | Table)}
        own = sorted(path for path in paths if not self.graph.is_exported(path))
        return self.depot.address, tuple((path, self.inputs.sent(path)) for path in own)

    def _create_outputs(self, planned: PlannedJob) -> None:
        if isinstance(planned.job, Export):
            return
        for region in planned.job.writes.values():
            if isinstance(region, Raster) and not self._birth(region.name):
                self._found[region.name] = self.store.create(self.graph.specs[region.name])

    def check_resources(self, room: int) -> None:
        """Raises ResourceError when a pending job needs more than `room` bytes, all that a job has which runs alone, or all of them
        more disk than is free."""
        for planned in self.pending:
            check_memory(planned, room)
        self.folder.mkdir(parents=True, exist_ok=True)
        if not isinstance(self.depot, Folder):
            return
        needed = sum(planned.output_bytes for planned in self.pending) // COMPRESSION
        free = shutil.disk_usage(self.folder).free
        if self.pending and needed + DISK_RESERVE > free:
            raise ResourceError(
                f"The disk of {self.folder} has {free / MIB:.0f} MiB free, but about "
                f"{(needed + DISK_RESERVE) / MIB:.0f} MiB are needed; make room, then run again."
            )

    def _note(self, finished: Finished, watcher: Watcher) -> Record | None:
        """Keeps what became of a job, and tells who watches; its record."""
        if finished.status == "done":
            self.done.add(finished.key)
            self._drop_parts(finished.key)
        elif finished.status == "failed":
            self.failures[finished.key] = finished.sentence
            self._suspect_inputs(finished.key)
        else:
            self.blocked.add(finished.key)
        # What was never tried may have a record of an earlier run.
        record = self._record_of(finished) if finished.status != "blocked" else None
        watcher.finished(finished, record)
        return record

    def _record_of(self, finished: Finished) -> Record | None:
        """What its worker recorded: others are read together with it, so that most are known before anybody asks."""
        known = self.records.get(finished.key)
        if known and (known.run, known.status) == (self.mark, finished.status):
            return known
        return self.records.afresh(finished.key)

    def _suspect_inputs(self, key: Key) -> None:
        """After a failure: what an earlier run left for the job may have been damaged without a trace but its content."""
        self._found.clear()
        for before in self.graph.jobs[key].dependencies:
            record = self.records.get(before) if before in self.skipped else None
            if record and self._defect(self.graph.jobs[before], record, thoroughly=True):
                self.records.put(record.model_copy(update={"status": "damaged"}))
                self._rotten.add(before)

    def _goes_again(self, runner: Runner) -> bool:
        """Whether results turned out to be damaged: their jobs run once more, and with them all that failed or was blocked."""
        if not self._rotten:
            return False
        again = {*self._rotten, *self.failures, *self.blocked, *self._parts_gone(self._rotten)}
        self.defects.update(dict.fromkeys(self._rotten, "result is damaged"))
        self.reasons.update(dict.fromkeys(again, "result is damaged"))
        self.skipped -= again
        self.blocked.clear()
        self.failures.clear()
        self._rotten.clear()
        self.pending = [planned for key, planned in self.graph.jobs.items() if key in again]
        self._submit(runner)
        return True

    def _parts_gone(self, joined: Iterable[Key]) -> Iterator[Key]:
        """The jobs whose files these ones joined, and which have gone since."""
        for before in (before for key in joined for before in self.graph.jobs[key].dependencies):
            if self.graph.joined_by(before) and not self._outputs_exist(self.graph.jobs[before]):
                yield before

    def drop_parts(self) -> None:
        """Remove the parts of all files that are there, whichever run made them."""
        for key in self.graph.jobs:
            if self.is_valid(key):
                self._drop_parts(key)

    def _drop_parts(self, key: Key) -> None:
        job = self.graph.jobs[key].job
        if isinstance(job, Export) and joins_parts(job):
            self.depot.clear(parts_of(job.path))

    def drop_replaced(self) -> str:
        """Remove products in the form that they had before; one sentence that names them."""
        made = (planned.job for key, planned in self.graph.jobs.items() if self.is_valid(key))
        return drop_replaced((job for job in made if isinstance(job, Export)), self.depot, self.records)

    def take_up(self) -> None:
        """After its runner was lost: whatever has not been done is pending again, for another runner and another watcher."""
        self.failures.clear()
        self.blocked.clear()
        self.pending = [planned for key, planned in self.graph.jobs.items() if not self.is_valid(key)]
        self._announced = 0

    def stage_runs(self) -> tuple[StageRun, ...]:
        """The state of every stage so far."""
        return tuple(self._stage_run(stage.kind) for stage in self.stages)

    def _stage_run(self, kind: str) -> StageRun:
        keys = [key for key in self.graph.jobs if key[0] == kind]
        valid = self._valid_records(keys)
        return StageRun(
            kind,
            jobs=len(keys),
            done=sum(key in self.done for key in keys),
            skipped=sum(key in self.skipped for key in keys),
            failed=sum(key in self.failures for key in keys),
            seconds=sum(record.seconds for record in valid),
            peak_bytes=max((record.peak_bytes for record in valid), default=None),
            cpu_seconds=sum(record.cpu_seconds for record in valid),
            written=sum(kept.size for record in valid for kept in record.files.values()),
            reported=self._reported(keys),
        )

    def _valid_records(self, keys: Iterable[Key]) -> list[Record]:
        """Records of the jobs whose results are valid, whichever run did them."""
        return [record for key in keys if self.is_valid(key) and (record := self.records.get(key))]

    def earlier_runs(self) -> tuple[float, ...]:
        """How long each earlier run took whose results are still valid, from its first to its last job among them, s."""
        spans: dict[str, tuple[float, float]] = {}
        for record in self._valid_records(self.skipped):
            begun, ended = spans.get(record.run, (record.started, 0.0))
            spans[record.run] = min(begun, record.started), max(ended, record.started + record.seconds)
        return tuple(ended - begun for begun, ended in sorted(spans.values()))

    def _reported(self, keys: list[Key]) -> bool:
        """Whether the job among `keys` that writes the stage's report is done; a report found otherwise is of an earlier run."""
        jobs = {key: self.graph.jobs[key].job for key in keys if key in self.done or key in self.skipped}
        return any(not isinstance(job, Export) and report_table(key[0]) in job.writes.values() for key, job in jobs.items())

    def failure_list(self) -> tuple[Failure, ...]:
        """The jobs that failed, each with its sentence."""
        return tuple(Failure(key[0], key_text(key), sentence) for key, sentence in self.failures.items())


def now() -> str:
    """The time of day as ISO 8601 text."""
    return time.strftime(TIME_FORMAT)
