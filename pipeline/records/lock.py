"""One run of a project at a time: a lock that the operating system frees when the process ends, however it ends.

Where the results are in an object store, which several machines see, there is a lease in it as well (leases.py).
"""

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from orthomill.pipeline.records.leases import is_leased, leased
from orthomill.pipeline.storage.depots.bucket import Bucket
from orthomill.pipeline.storage.depots.kept_at import depot_of
from orthomill.schemas.errors import ResourceError


@contextmanager
def only_run(folder: Path) -> Iterator[None]:
    """Hold the project's lock. Raises ResourceError when another process holds it or the folder cannot be written."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        # Opened for appending: opening for writing would erase the process number of the owner before it can be reported.
        stream = (folder / ".lock").open("a+")
    except OSError as error:
        raise ResourceError(
            f"The folder {folder} cannot be written ({error.strerror}); make it writable or choose another project folder."
        ) from error
    with stream:
        try:
            fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:  # the owner wrote its number after it got the lock; in between the file may be empty
            stream.seek(0)
            owner = stream.read().strip() or "unknown"
            raise ResourceError(
                f"{folder.name} is already running (process {owner}); wait for it to end, or stop it first."
            ) from None
        stream.truncate(0)
        stream.write(str(os.getpid()))
        stream.flush()
        depot = depot_of(folder)
        if not isinstance(depot, Bucket):
            yield
            return
        with leased(depot, folder.name):
            yield


def is_running(folder: Path) -> bool:
    """Whether a process holds the project's lock at this moment; writes nothing."""
    try:
        with (folder / ".lock").open() as stream:
            # A shared lock suffices as a question, and two commands that ask at the same time do not take each other for a run.
            fcntl.flock(stream, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:
        return False
    depot = depot_of(folder)
    return isinstance(depot, Bucket) and is_leased(depot)
