"""What is done: a record of every job, with its fingerprints, the reason why it ran, and its time and memory.

Every process that does jobs appends its records to a file of its own, `jobs/STAGE/WAVE-PROCESS.log`; the wave is the number of the
run. A record is written after the job's results, and taken back before they are touched again, so that a run killed at any moment
leaves none of unfinished work: what a later wave says of a job counts, within a wave what is done. The files of a stage are folded
into one, `jobs/STAGE/WAVE.done`, when a run begins and ends. Earlier versions kept a file for each job; it counts as wave 0.
"""

from collections import OrderedDict
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict, ValidationError

from orthomill.pipeline.records.numbered_names import Key
from orthomill.pipeline.records.record_files import OwnLog, StageFiles, wave_of
from orthomill.pipeline.records.record_lines import RecordLine, line_of
from orthomill.pipeline.storage.depots.depot import Depot
from orthomill.pipeline.storage.depots.kept_at import depot_of
from orthomill.pipeline.storage.depots.kept_files import Defect, KeptFile

NOT_DONE = "not done yet"
"""The reason to do what nobody has a record of."""
DEFECTS = ("result is missing", "result is damaged")
"""The reasons to do again what an earlier run had done, and which nothing in the project has changed."""


# A plain class, unlike the records that hold it: every job of a plan has one, and the other kind takes 340 bytes more.
@dataclass(frozen=True, slots=True)
class Fingerprint:
    """What a result depends on, in three digests."""

    settings: str
    code: str
    inputs: str

    @property
    def text(self) -> str:
        """The digests in one word."""
        return f"{self.settings}-{self.code}-{self.inputs}"


class Record(BaseModel):
    """The outcome of one job."""

    model_config = ConfigDict(frozen=True)

    stage: str
    item: str
    row: int
    col: int
    status: Literal["done", "failed", "damaged"]
    """damaged: it was done, but what it left on the disk is not what it wrote"""
    fingerprint: Fingerprint
    reason: str
    run: str = ""
    """identifier of the run that did it"""
    births: dict[str, str] = {}
    """raster -> birth mark of the raster that was written"""
    files: dict[str, KeptFile] = {}
    """what it left on the disk, by path in the run's folder; a chunk that holds nothing but its fill value has no file"""
    started: float = 0.0
    seconds: float = 0.0
    # Wall-clock time tells what a job costs only on an idle machine: beside other programs it doubles.
    cpu_seconds: float = 0.0
    """processor time of the worker process while the job ran, s"""
    worker: str = ""
    peak_bytes: int = 0
    """peak memory of the worker process until the job's end"""
    attempt: int = 1
    error: str = ""
    traceback: str = ""

    @property
    def key(self) -> Key:
        """(stage, item, row, col): the key of the job."""
        return self.stage, self.item, self.row, self.col


JOBS = "jobs"
"""the folder of all records"""
UNDERSTOOD = 64
"""Records that are kept as they were read: who asks for one mostly asks once more at once."""


class Records:
    """The records of one run. Those of a stage are read when one is asked for, and are then kept here.

    Whoever writes belongs to a `wave`: a worker is told it with its order; who runs a project begins one.
    """

    def __init__(self, place: Path | Depot, wave: int | None = None) -> None:
        self.depot = depot_of(place)
        self._logs: dict[str, OwnLog] = {}
        self.wave = wave
        # A worker asks what other workers of its run have done, and nothing else.
        self._least = wave or 0
        self._stages: dict[str, StageFiles] = {}
        self._understood: OrderedDict[Key, tuple[bytes, Record | None]] = OrderedDict()
        """those that were asked for last, with their texts"""

    def begin(self) -> int:
        """Begin the wave of a run, unless it has begun; returns its number. Nobody else may run the project."""
        if self.wave is None:
            self.wave = 1 + max((wave_of(name) for stage in self._folders() for name, _ in self.depot.entries(stage)), default=0)
        return self.wave

    def _stage(self, stage: str, afresh: bool = True) -> StageFiles:
        if stage not in self._stages:
            self._stages[stage], afresh = StageFiles(self.depot, f"{JOBS}/{stage}", self._least), True
        if afresh:
            self._stages[stage].refresh()
        return self._stages[stage]

    def get(self, key: Key) -> Record | None:
        """The record of a job, None when there is none that can be read. What other processes write is seen by `afresh`."""
        line = self._stage(key[0], afresh=False).lines.get(key[1:])
        if line is None or not line.text:
            return None
        text, record = self._understood.get(key, (b"", None))
        if text != line.text:
            record = _record_of(line)
            self._understood[key] = line.text, record
            if len(self._understood) > UNDERSTOOD:
                self._understood.popitem(last=False)
        # A file that was copied or renamed by hand must not vouch for a job that it does not describe.
        return record if record and record.key == key else None

    def afresh(self, key: Key) -> Record | None:
        """The record of a job, with what other processes have written by now."""
        self._stage(key[0])
        return self.get(key)

    def known(self, key: Key) -> Record | None:
        """The record of a job as far as this process has read of its stage: it reads nothing for that."""
        return self.get(key) if key[0] in self._stages else None

    def put(self, record: Record) -> None:
        """Raises StoreError."""
        self._append(record.key, record.status, record.started, record.model_dump_json().encode())

    def remove(self, key: Key) -> None:
        """Take back the record of a job before its results are touched. Raises StoreError."""
        self._append(key, "removed", 0.0, b"")

    def _append(self, key: Key, status: str, started: float, text: bytes) -> None:
        if key[0] not in self._logs:
            self._logs[key[0]] = OwnLog(self.depot, f"{JOBS}/{key[0]}", self.begin())
        line = line_of(key[1:], status, started, text)
        name, size = self._logs[key[0]].append(line)
        if key[0] in self._stages:
            self._stages[key[0]].take_own(name, size, line)

    def of_stage(self, stage: str) -> tuple[Record, ...]:
        """All readable records of a stage, by key."""
        return tuple(self.each_of_stage(stage))

    def each_of_stage(self, stage: str) -> Iterator[Record]:
        """The same, one after the other: who adds them up need not hold them all."""
        keys = ((stage, *place) for place in sorted(self._stage(stage).lines))
        return (record for key in keys if (record := self.get(key)))

    def sort_out(self) -> tuple[tuple[Record, ...], tuple[str, ...]]:
        """All records, and the files in which some cannot be read."""
        return tuple(self.each()), self.unreadable()

    def each(self) -> Iterator[Record]:
        """All records, stage by stage, one after the other."""
        return (record for stage in self.depot.folders(JOBS) for record in self.each_of_stage(stage))

    def unreadable(self) -> tuple[str, ...]:
        """The files in which some records cannot be read."""
        stages = self.depot.folders(JOBS)
        return tuple(name for stage in stages for name in sorted(self._stage(stage, afresh=False).damaged))

    def fold(self) -> None:
        """Keep what counts of each stage in one file. Nobody else may run the project. Raises StoreError."""
        for folder in self._folders():
            StageFiles(self.depot, folder).fold()

    def _folders(self) -> list[str]:
        return [f"{JOBS}/{stage}" for stage in self.depot.folders(JOBS)]


def _record_of(line: RecordLine) -> Record | None:
    """A record; None when it is of another version: doing a job again is always safe."""
    try:
        return Record.model_validate_json(line.text)
    except ValidationError:
        return None


def reason_to_run(record: Record | None, fingerprint: Fingerprint, births: dict[str, str], defect: Defect | None) -> str | None:
    """Why a job must run, in a few words; None when its result is still valid. `defect` is that of its files."""
    if record is None:
        return NOT_DONE
    if record.status == "failed":
        return "failed before"
    if record.fingerprint.settings != fingerprint.settings:
        return "settings changed"
    if record.fingerprint.code != fingerprint.code:
        return "code changed"
    if record.fingerprint.inputs != fingerprint.inputs:
        return "inputs changed"
    # A raster that was deleted and created again has another birth mark: its chunks are empty although the array exists.
    if record.births != births:
        return "result is missing"
    if record.status == "damaged":
        return "result is damaged"
    return f"result is {defect}" if defect else None


def key_text(key: Key) -> str:
    """A key as text."""
    stage, item, row, col = key
    return f"{stage}/{item}/{row}/{col}"
