"""What a worker must fulfil before it does a job of a run. It answers for itself, with its first order: workers of a cluster come
and go while a run lasts, and whoever was asked at its beginning may have gone since.

The folder is recognised by a file that the run shows while it lasts: a folder of the same name may be another one.
"""

import os
import secrets
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from orthomill import __version__
from orthomill.pipeline.engine.fingerprint import of_program
from orthomill.pipeline.storage.depots.depot import Depot
from orthomill.pipeline.storage.depots.folder import Folder
from orthomill.pipeline.storage.depots.kept_at import noted
from orthomill.schemas.errors import OrthomillError, StoreError

SHOWN = "jobs/.shown"
"""beginning of the name of the file by which workers recognise the run's folder"""
INSTALL = "install the version of this command in its environment, and start it again"
SHARED = (
    "let it see the project's folder under this path and start it again, or keep the results where all machines reach them: "
    "run with --store s3://BUCKET/PREFIX"
)
REACHED = "give it the keys and the address of the store in its environment, and start it again"
APPEARS = 3.0
"""seconds in which a file that was just written must be seen by another machine"""


@dataclass(frozen=True)
class Terms:
    """Where the run's results are kept, its `mark`, and the `program` that planned it."""

    place: Path | str
    """its folder, or the address of an object store"""
    mark: str
    program: str

    @property
    def depot(self) -> Depot:
        """Raises OrthomillError."""
        if isinstance(self.place, Path):
            return Folder(self.place)
        from orthomill.pipeline.storage.depots.bucket import bucket_of

        return bucket_of(self.place)

    @property
    def sign(self) -> str:
        """The name of the file by which the place is recognised."""
        return f"{SHOWN}-{self.mark}"


def program() -> str:
    """Version and digest of the program of this process."""
    return f"{__version__} ({of_program()[:8]})"


@contextmanager
def shown(folder: Path, mark: str) -> Iterator[Terms]:
    """The terms of a run whose place can be recognised as long as this context lasts. Raises StoreError."""
    terms = Terms(noted(folder) or folder, mark, program())
    depot, (where, _, begins) = terms.depot, SHOWN.rpartition("/")
    for name, _ in depot.entries(where):  # of a run that was killed
        if name.startswith(f"{begins}-"):
            depot.delete(f"{where}/{name}")
    try:
        depot.put(terms.sign, mark.encode())
    except OSError as error:
        raise StoreError(f"{depot.address} cannot be written: {error.strerror}; make it writable, then run again.") from error
    try:
        yield terms
    finally:
        depot.delete(terms.sign)


def objection(terms: Terms, threads: int) -> str | None:
    """Why this process, a worker with so many threads, may do no job of a run: the predicate of a sentence; None when it may."""
    if threads != 1:
        return f"has {threads} threads, and memory is counted per process; start it with --nthreads 1"
    if (own := program()) != terms.program:
        return f"has orthomill {own}, and this is {terms.program}; {INSTALL}"
    return _objection_to_place(terms)


def _objection_to_place(terms: Terms) -> str | None:
    try:
        depot = terms.depot
        if not _sees(terms):
            return f"does not see {depot.address}; {SHARED if isinstance(terms.place, Path) else REACHED}"
        probe = f"{terms.sign}-{os.getpid()}-{secrets.token_hex(4)}"
        depot.put(probe, b"")
        depot.delete(probe)
    except OSError:
        return f"may not write to {terms.place}; make the folder writable for its user"
    except OrthomillError as error:
        return f"cannot use {terms.place} ({str(error).rstrip('.')})"
    return None


class Declined(Exception):
    """A worker does not do a job: because of what it is (`why`, the predicate of a sentence), or as it has `room` bytes only."""

    def __init__(self, worker: str, why: str, room: float = 0.0) -> None:
        super().__init__(worker, why, room)
        self.worker, self.why, self.room = worker, why, room


def _sees(terms: Terms) -> bool:
    deadline = time.monotonic() + APPEARS
    while terms.depot.state(terms.sign) is None:
        if time.monotonic() > deadline:
            return False
        time.sleep(0.1)
    return True
