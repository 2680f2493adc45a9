"""What a power cut may take, and how the next run finds it.

Forcing every file to the disk when its job ends would stop each worker for several milliseconds a file, on a hard disk for tenths
of a second. Instead all that is written is forced to the disk every few seconds beside the run, and a note says when that was and
since when this machine has been up. Where the machine has been started again, results that are younger than the note are examined
by their checksums before anything else happens.
"""

import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from threading import Event

from pydantic import BaseModel, ValidationError

from orthomill.pipeline.records.beside import going_on
from orthomill.pipeline.records.started_machine import boot
from orthomill.pipeline.records.verification import Verification, examine
from orthomill.pipeline.storage.depots.kept_at import noted
from orthomill.pipeline.storage.whole_files import write_whole
from orthomill.schemas.errors import StoreError

NOTE = "jobs/flushed.json"
EVERY = 10.0
"""seconds between two times at which everything is forced to the disk"""


class Flushed(BaseModel):
    """Everything written before `time` (s since 1970) is on the disk; `boot` identifies the start of the machine."""

    boot: str
    time: float


def examine_after_power_cut(folder: Path) -> Verification | None:
    """Examine what may have been lost, and mark it; None when the machine has not been started again since it was written."""
    if noted(folder):  # an object store has no power cuts that it would not tell of
        return None
    try:
        note = Flushed.model_validate_json((folder / NOTE).read_bytes())
    except (FileNotFoundError, ValidationError):  # no run yet, or a power cut took the note itself
        note = Flushed(boot="", time=0.0)
    # One second for clocks of file systems that are coarser than that of records.
    return None if note.boot == boot() else examine(folder, since=note.time - 1.0)


@contextmanager
def flushing(folder: Path) -> Iterator[None]:
    """Force everything to the disk every few seconds and at the end."""
    if noted(folder):
        yield
        return
    with going_on(partial(_flush_until, folder)):
        yield


def _flush_until(folder: Path, ended: Event) -> None:
    while not ended.wait(EVERY):
        _flush(folder)
    _flush(folder)


def _flush(folder: Path) -> None:
    begun = time.time()
    os.sync()
    try:
        write_whole(folder / NOTE, Flushed(boot=boot(), time=begun).model_dump_json().encode())
    except StoreError:  # a full disk is reported by the jobs; without the note more is examined after a power cut
        return
