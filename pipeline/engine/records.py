"""What is done: one small file per job under jobs/, with its fingerprints, the reason why it ran, and its time and memory.

A record is written after the job's results and removed before they are touched again, so that a run killed at any moment
leaves no record of unfinished work.
"""

from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict, ValidationError

from orthomill.pipeline.storage.file_names import file_name
from orthomill.pipeline.storage.table_files import write_whole

Key = tuple[str, str, int, int]


class Fingerprint(BaseModel):
    """What a result depends on, in three digests."""

    model_config = ConfigDict(frozen=True)

    settings: str
    code: str
    inputs: str

    @property
    def text(self) -> str:
        return f"{self.settings}-{self.code}-{self.inputs}"


class Record(BaseModel):
    """The outcome of one job."""

    model_config = ConfigDict(frozen=True)

    stage: str
    item: str
    row: int
    col: int
    status: Literal["done", "failed"]
    fingerprint: Fingerprint
    reason: str
    run: str = ""
    """identifier of the run that did it"""
    births: dict[str, str] = {}
    """raster -> birth mark of the raster that was written"""
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
        return self.stage, self.item, self.row, self.col


class Records:
    """The records of one run's folder."""

    def __init__(self, folder: Path) -> None:
        self.folder = Path(folder) / "jobs"

    def path(self, key: Key) -> Path:
        stage, item, row, col = key
        return self.folder / stage / f"{file_name(item)}.{row}.{col}.json"

    def get(self, key: Key) -> Record | None:
        """The record of a job, None when there is none that can be read."""
        try:
            record = Record.model_validate_json(self.path(key).read_bytes())
        except (FileNotFoundError, ValidationError):  # a record of another version: doing the job again is always safe
            return None
        # A file that was copied or renamed by hand must not vouch for a job that it does not describe.
        return record if record.key == key else None

    def put(self, record: Record) -> None:
        write_whole(self.path(record.key), record.model_dump_json().encode())

    def remove(self, key: Key) -> None:
        self.path(key).unlink(missing_ok=True)

    def of_stage(self, stage: str) -> tuple[Record, ...]:
        """All readable records of a stage, by key."""
        found = []
        for path in sorted((self.folder / stage).glob("*.json")):
            try:
                found.append(Record.model_validate_json(path.read_bytes()))
            except (ValidationError, FileNotFoundError):
                continue
        return tuple(found)


def reason_to_run(record: Record | None, fingerprint: Fingerprint, births: dict[str, str], outputs_exist: bool) -> str | None:
    """Why a job must run, in a few words; None when its result is still valid."""
    if record is None:
        return "not done yet"
    if record.status == "failed":
        return "failed before"
    if record.fingerprint.settings != fingerprint.settings:
        return "settings changed"
    if record.fingerprint.code != fingerprint.code:
        return "code changed"
    if record.fingerprint.inputs != fingerprint.inputs:
        return "inputs changed"
    # A raster that was deleted and created again has another birth mark: its chunks are empty although the array exists.
    if record.births != births or not outputs_exist:
        return "result is missing"
    return None
