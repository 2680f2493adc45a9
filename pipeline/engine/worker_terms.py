"""What a worker must fulfil before it does a job of a run. It answers for itself, with its first order: workers of a cluster come
and go while a run lasts, and whoever was asked at its beginning may have gone since.

The folder is recognised by a file that the run shows while it lasts: a folder of the same name may be another one.
"""

import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from orthomill import __version__
from orthomill.pipeline.engine.fingerprint import of_program
from orthomill.pipeline.storage.whole_files import write_whole

SHOWN = "jobs/.shown"
"""beginning of the name of the file by which workers recognise the run's folder"""
INSTALL = "install the version of this command in its environment, and start it again"
APPEARS = 3.0
"""seconds in which a file that was just written must be seen by another machine"""


@dataclass(frozen=True)
class Terms:
    """The run's `folder`, its `mark`, and the `program` that planned it."""

    folder: Path
    mark: str
    program: str


def program() -> str:
    """Version and digest of the program of this process."""
    return f"{__version__} ({of_program()[:8]})"


@contextmanager
def shown(folder: Path, mark: str) -> Iterator[Terms]:
    """The terms of a run whose folder can be recognised as long as this context lasts. Raises StoreError."""
    terms = Terms(folder, mark, program())
    for left in (folder / SHOWN).parent.glob(f"{Path(SHOWN).name}-*"):  # of a run that was killed
        left.unlink(missing_ok=True)
    write_whole(_place(terms), mark.encode())
    try:
        yield terms
    finally:
        _place(terms).unlink(missing_ok=True)


def _place(terms: Terms) -> Path:
    return terms.folder / f"{SHOWN}-{terms.mark}"


def objection(terms: Terms, threads: int) -> str | None:
    """Why this process, a worker with so many threads, may do no job of a run: the predicate of a sentence; None when it may."""
    if threads != 1:
        return f"has {threads} threads, and memory is counted per process; start it with --nthreads 1"
    if (own := program()) != terms.program:
        return f"has orthomill {own}, and this is {terms.program}; {INSTALL}"
    if not _sees(terms):
        return f"does not see {terms.folder}; let it see the project's folder under this path, and start it again"
    if not os.access(terms.folder / "jobs", os.W_OK | os.X_OK):
        return f"may not write to {terms.folder}; make the folder writable for its user"
    return None


class Declined(Exception):
    """A worker does not do a job: because of what it is (`why`, the predicate of a sentence), or as it has `room` bytes only."""

    def __init__(self, worker: str, why: str, room: float = 0.0) -> None:
        super().__init__(worker, why, room)
        self.worker, self.why, self.room = worker, why, room


def _sees(terms: Terms) -> bool:
    deadline = time.monotonic() + APPEARS
    while not _place(terms).exists():
        if time.monotonic() > deadline:
            return False
        time.sleep(0.1)
    return True
