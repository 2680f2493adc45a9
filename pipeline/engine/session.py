"""One run of one project: plan, skip what is still valid, submit the rest, plan further as tables appear.

All stages that can be planned are in flight together; the session only ever waits for the next job to end.
"""

import shutil
import time
import uuid
from array import array
from collections.abc import Callable, Collection, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

from orthomill.pipeline.engine.execute import JobOrder
from orthomill.pipeline.engine.fingerprint import of_file
from orthomill.pipeline.engine.graph import Graph, NoWriter, check_memory
from orthomill.pipeline.engine.interruption import stop_if_asked
from orthomill.pipeline.engine.planned.job_states import VALID, JobState, JobStates, KeysIn, Reasons
from orthomill.pipeline.engine.planned.planned_jobs import PendingJobs, PlannedJob
from orthomill.pipeline.engine.planned.record_sums import RecordSums
from orthomill.pipeline.engine.planner import Planner
from orthomill.pipeline.engine.replaced_products import drop_replaced
from orthomill.pipeline.engine.run_facts import TIME_FORMAT, Failure, StageRun
from orthomill.pipeline.engine.runner import End, Finished, Runner
from orthomill.pipeline.export.file_parts import parts_of
from orthomill.pipeline.records.numbered_names import Key
from orthomill.pipeline.records.records import DEFECTS, Record, Records, key_text, reason_to_run
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
WAVE = 1000
"""Jobs that are planned before those that have ended are looked at: some 60 ms"""
STATES: dict[End, JobState] = {"done": JobState.DONE, "failed": JobState.FAILED, "blocked": JobState.BLOCKED}
ENDS = {state: end for end, state in STATES.items()}
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
    failures: dict[Key, str] = field(default_factory=dict)
    defects: dict[Key, str] = field(default_factory=dict)
    """jobs of earlier runs whose results were lost or damaged, and which of it"""

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
        self.planner = Planner(self.project, self.stages, self.graph, self.store, self._is_known, self.list_images)
        self._jobs, keys = self.graph.jobs, self.graph.jobs.keys_by_number
        self._states = JobStates(keys)
        self.done, self.skipped, self.blocked = (
            KeysIn(self._states, state) for state in (JobState.DONE, JobState.SKIPPED, JobState.BLOCKED)
        )
        self.reasons = Reasons(keys)
        self.pending = PendingJobs(self._jobs)
        """planned, to be run, not yet submitted; in an order in which they can run"""
        self._sums = RecordSums()
        self._planned_before: int | None = None
        """while jobs are planned: the number of the first"""
        self._awaited: set[int] = set()
        """the jobs that write tables for which stages wait"""

    def is_valid(self, key: Key) -> bool:
        """Whether the results of a job are there and describe the project as it is."""
        number = self._jobs.keys_by_number.find(key)
        return number is not None and self._states.is_valid(number)

    def _is_known(self, key: Key) -> bool:
        """Whether stages may be told of a table of a job. Of what is planned at the moment the next planning makes use."""
        new = self._planned_before is not None and self._jobs.number(key) >= self._planned_before
        return not new and self.is_valid(key)

    def plan(self) -> None:
        """Plan all that can be planned now: what is still valid is skipped, the rest is pending."""
        for _ in self._waves():
            stop_if_asked()

    def _waves(self) -> Iterator[None]:
        """Plan all that can be planned now, and pause after every WAVE jobs and at the end of all stages."""
        self._found.clear()
        # A skipped job may have written, in an earlier run, the table that a stage waits for: then more can be planned at once.
        more = True
        while more:
            self._planned_before = len(self._jobs)
            try:
                for number, planned in enumerate(self.planner.advance(), self._planned_before):
                    self._sort(number, planned)
                    if number % WAVE == WAVE - 1:
                        yield
            finally:
                self._planned_before = None
            yield
            # Not before: a job may have ended in the pause.
            self._awaited = set(self._writers_of_awaited())
            more = any(map(self._states.is_valid, self._awaited))

    def _sort(self, number: int, planned: PlannedJob) -> None:
        """A job that was planned is skipped or pending."""
        record = self.records.get(planned.key)
        reason = self._reason(planned, record)
        if reason is None:
            self._states[number] = JobState.SKIPPED
            assert record
            self._sums.add(record, earlier=True)
        else:
            self.reasons[planned.key] = reason
            self.pending.append(number)

    def _writers_of_awaited(self) -> Iterator[int]:
        for what in self.planner.waiting_for.values():
            number = self.graph.number_of_table(what.removeprefix("the table "))
            if number is not None:
                yield number

    def _reason(self, planned: PlannedJob, record: Record | None) -> str | None:
        if planned.job.stage in self.forced:
            return "asked for"
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
        return joined is not None and self._reason(joined, self.records.get(joined.key)) is None

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

    def outlines(self) -> Iterator[tuple[str, Outline]]:
        """What the photographs show of the ground, as far as it is known."""
        for stage in self.stages:
            with suppress(NotYet, NoWriter):
                yield from stage.outlines(self.planner)

    def run(self, runner: Runner, watcher: Watcher) -> None:
        """Run all that has to run. Failures are gathered, not raised. Raises ResourceError before a job that needs too much is
        submitted, but for those of later stages not before the first one."""
        self._plan_and_submit(runner, watcher)
        while runner.busy or self.pending or self._goes_again():
            stop_if_asked()
            self._submit(runner)
            finished, record = self._next(runner)
            watcher.finished(finished, record)
            # Planning walks through all open stages, so it is repeated only when a table has appeared that one of them waits for.
            if finished.status == "done" and self._jobs.number(finished.key) in self._awaited:
                self._plan_and_submit(runner, watcher)

    def _plan_and_submit(self, runner: Runner, watcher: Watcher) -> None:
        """Plan what can be planned, with the first jobs of it at work while the last ones are planned."""
        ended = array("i")
        for _ in self._waves():
            stop_if_asked()
            self.check_resources(runner.room)
            self._submit(runner)
            while runner.has_ended:
                ended.append(self._jobs.number(self._next(runner)[0].key))
        # Who watches is told of all that is to be done before any of it is: shares of a part would mean nothing.
        self._announce(watcher, set(ended))
        for number in ended:
            self._tell_end(watcher, number)

    def _tell_end(self, watcher: Watcher, number: int) -> None:
        key, status = self._jobs.keys_by_number[number], ENDS[JobState(self._states[number])]
        record = None if status == "blocked" else self.records.get(key)
        watcher.finished(Finished(key, status, self.failures.get(key, "")), record)

    def _announce(self, watcher: Watcher, ended: Collection[int]) -> None:
        """Tell of new jobs, some of which have ended already."""
        # Jobs are announced once, though planning is repeated: the graph keeps them in the order in which they were added.
        for number in range(self._announced, len(self._jobs)):
            planned = self._jobs.at(number)
            watcher.planned(planned)
            if self._states.is_valid(number) and number not in ended:
                watcher.skipped(planned.key)
        self._announced = len(self._jobs)

    def _next(self, runner: Runner) -> tuple[Finished, Record | None]:
        """The next job that ends, and its record."""
        finished = runner.next()
        record = self._note(finished)
        if finished.status == "done" and record:
            runner.learn(finished.key, record.seconds)
        return finished, record

    def _submit(self, runner: Runner) -> None:
        """Hand over as many jobs as the runner wants; the rest waits here, where it takes less room."""
        while self.pending and runner.wants_more:
            stop_if_asked()
            planned = self.pending.popleft()
            # Rasters are created here and not by the workers: two workers that create the same one would race.
            self._create_outputs(planned)
            reason, wave = self.reasons[planned.key], self.records.begin()
            work = JobOrder(
                planned.job, self.root, self.folder, planned.fingerprint, reason, self.mark, wave, *self._elsewhere(planned)
            )
            runner.submit(work, planned.dependencies, planned.memory)

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
        if (large := self.pending.first_above(room)) is not None:
            check_memory(large, room)
        self.folder.mkdir(parents=True, exist_ok=True)
        if not isinstance(self.depot, Folder):
            return
        needed = self.pending.output_bytes // COMPRESSION
        free = shutil.disk_usage(self.folder).free
        if self.pending and needed + DISK_RESERVE > free:
            raise ResourceError(
                f"The disk of {self.folder} has {free / MIB:.0f} MiB free, but about "
                f"{(needed + DISK_RESERVE) / MIB:.0f} MiB are needed; make room, then run again."
            )

    def _note(self, finished: Finished) -> Record | None:
        """Keeps what became of a job; its record."""
        # What was never tried may have a record of an earlier run.
        record = self._record_of(finished) if finished.status != "blocked" else None
        number = self._jobs.number(finished.key)
        self._states[number] = STATES[finished.status]
        if finished.status == "done":
            if record:
                self._sums.add(record, earlier=False)
            self._drop_parts(number)
        elif finished.status == "failed":
            self.failures[finished.key] = finished.sentence
            self._suspect_inputs(number)
        return record

    def _record_of(self, finished: Finished) -> Record | None:
        """What its worker recorded: others are read together with it, so that most are known before anybody asks."""
        known = self.records.get(finished.key)
        if known and (known.run, known.status) == (self.mark, finished.status):
            return known
        return self.records.afresh(finished.key)

    def _suspect_inputs(self, number: int) -> None:
        """After a failure: what an earlier run left for the job may have been damaged without a trace but its content."""
        self._found.clear()
        for before in self._jobs.before(number):
            if self._states[before] != JobState.SKIPPED:
                continue
            planned = self._jobs.at(before)
            record = self.records.get(planned.key)
            if record and self._defect(planned, record, thoroughly=True):
                self.records.put(record.model_copy(update={"status": "damaged"}))
                self._rotten.add(planned.key)

    def _goes_again(self) -> bool:
        """Whether results turned out to be damaged: their jobs run once more, and with them all that failed or was blocked."""
        if not self._rotten:
            return False
        again = {*self._rotten, *self.failures, *self.blocked, *self._parts_gone(self._rotten)}
        self.defects.update(dict.fromkeys(self._rotten, "result is damaged"))
        self.reasons.update(dict.fromkeys(again, "result is damaged"))
        self.failures.clear()
        self._rotten.clear()
        for number in sorted(map(self._jobs.number, again)):
            self._states[number] = JobState.TO_DO
            self.pending.append(number)
        self._add_up()
        return True

    def _add_up(self) -> None:
        """Of the jobs that are valid now."""
        self._sums.clear()
        for state in VALID:
            for number in self._states.numbers(state):
                if record := self.records.get(self._jobs.keys_by_number[number]):
                    self._sums.add(record, earlier=state == JobState.SKIPPED)

    def _parts_gone(self, joined: Iterable[Key]) -> Iterator[Key]:
        """The jobs whose files these ones joined, and which have gone since."""
        for before in (before for key in joined for before in self._jobs[key].dependencies):
            if self.graph.joined_by(before) and not self._outputs_exist(self._jobs[before]):
                yield before

    def drop_parts(self) -> None:
        """Remove the parts of all files that are there, whichever run made them."""
        for number in self.graph.joining:
            if self._states.is_valid(number):
                self._drop_parts(number)

    def _drop_parts(self, number: int) -> None:
        job = self._jobs.job(number) if number in self.graph.joining else None
        if isinstance(job, Export):
            self.depot.clear(parts_of(job.path))

    def drop_replaced(self) -> str:
        """Remove products in the form that they had before; one sentence that names them."""
        made = (self._jobs.job(number) for number in self.graph.exports if self._states.is_valid(number))
        return drop_replaced([job for job in made if isinstance(job, Export)], self.depot, self.records)

    def take_up(self) -> None:
        """After its runner was lost: whatever has not been done is pending again, for another runner and another watcher."""
        self.failures.clear()
        for state in (JobState.FAILED, JobState.BLOCKED):
            self._states.clear(state)
        self.pending.clear()
        for number in range(len(self._jobs)):
            if not self._states.is_valid(number):
                self.pending.append(number)
        self._announced = 0

    def stage_runs(self) -> tuple[StageRun, ...]:
        """The state of every stage so far."""
        return tuple(self._stage_run(stage.kind) for stage in self.stages)

    def _stage_run(self, kind: str) -> StageRun:
        counts, taken = self._states.counts(kind), self._sums.of(kind)
        return StageRun(
            kind,
            jobs=sum(counts),
            done=counts[JobState.DONE],
            skipped=counts[JobState.SKIPPED],
            failed=counts[JobState.FAILED],
            seconds=taken.seconds,
            peak_bytes=taken.peak_bytes,
            cpu_seconds=taken.cpu_seconds,
            written=taken.written,
            reported=self._is_reported(kind),
        )

    def earlier_runs(self) -> tuple[float, ...]:
        """How long each earlier run took whose results are still valid, from its first to its last job among them, s."""
        return tuple(ended - begun for begun, ended in sorted(self._sums.spans.values()))

    def _is_reported(self, kind: str) -> bool:
        """Whether the job that writes a stage's report is done; a report found otherwise is of an earlier run."""
        number = self.graph.number_of_table(report_table(kind).path)
        return number is not None and self._states.is_valid(number)

    def failure_list(self) -> tuple[Failure, ...]:
        """The jobs that failed, each with its sentence."""
        return tuple(Failure(key[0], key_text(key), sentence) for key, sentence in self.failures.items())


def now() -> str:
    """The time of day as ISO 8601 text."""
    return time.strftime(TIME_FORMAT)
