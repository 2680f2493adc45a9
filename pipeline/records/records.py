"""What is done: one small file per job under jobs/, with its fingerprints, the reason why it ran, and its time and memory.

A record is written after the job's results and removed before they are touched again, so that a run killed at any moment
leaves no record of unfinished work.
"""

from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict, ValidationError

from orthomill.pipeline.storage.file_names import file_name
from orthomill.pipeline.storage.kept_files import Defect, KeptFile
from orthomill.pipeline.storage.sealed_json import seal, unsealed
from orthomill.pipeline.storage.whole_files import write_whole

Key = tuple[str, str, int, int]
DEFECTS = ("result is missing", "result is damaged")
"""The reasons to do again what an earlier run had done, and which nothing in the project has changed."""


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
        record = _read(self.path(key))
        # A file that was copied or renamed by hand must not vouch for a job that it does not describe.
        return record if record and record.key == key else None

    def put(self, record: Record) -> None:
        write_whole(self.path(record.key), seal(record.model_dump_json().encode()))

    def remove(self, key: Key) -> None:
        self.path(key).unlink(missing_ok=True)

    def of_stage(self, stage: str) -> tuple[Record, ...]:
        """All readable records of a stage, by key."""
        return tuple(record for path in sorted((self.folder / stage).glob("*.json")) if (record := _read(path)))

    def sort_out(self) -> tuple[tuple[Record, ...], tuple[Path, ...]]:
        """All records, and the files of records that cannot be read or are not under their own name."""
        found = {path: _read(path) for path in sorted(self.folder.glob("*/*.json"))}
        good = {path: record for path, record in found.items() if record and self.path(record.key) == path}
        return tuple(good.values()), tuple(path for path in found if path not in good)


def _read(path: Path) -> Record | None:
    """A record; None when there is none, when it is damaged, or when it is of another version: doing a job again is always safe."""
    try:
        text = unsealed(path.read_bytes())
        return None if text is None else Record.model_validate_json(text)
    except (FileNotFoundError, ValidationError):
        return None


def reason_to_run(record: Record | None, fingerprint: Fingerprint, births: dict[str, str], defect: Defect | None) -> str | None:
    """Why a job must run, in a few words; None when its result is still valid. `defect` is that of its files."""
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
    if record.births != births:
        return "result is missing"
    if record.status == "damaged":
        return "result is damaged"
    return f"result is {defect}" if defect else None


def key_text(key: Key) -> str:
    """A key as text."""
    stage, item, row, col = key
    return f"{stage}/{item}/{row}/{col}"
