"""A kernel is compiled by one process, and found by the others that want it meanwhile.

The workers of a first run want the same kernels at the same time. numba lets each of them compile all of them, and where two
processes store a function for different types at once, one file holds the code of one type under the name of the other. So whoever
misses a kernel in the cache takes the lock of its file, looks again, and only then compiles.
"""

import fcntl
import time
from pathlib import Path
from typing import IO, Any

from numba.core import dispatcher
from numba.core.caching import FunctionCache

PATIENCE = 600.0
"""s; compiling takes seconds, on a machine with all processors busy minutes"""
_PAUSE = 0.05


class SharedKernels(FunctionCache):
    """The cache of one function, whose file only one process at a time may fill."""

    _lock: IO[bytes] | None = None

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """The compiled function for a signature; None where this process has to compile it."""
        found = super().load_overload(sig, target_context)
        # With the lock in hand it is compiling already, and met the same function again.
        if found is not None or self._lock is not None:
            return found
        self._lock = _locked(Path(self.cache_path), f"{self._impl.filename_base}.lock")
        found = super().load_overload(sig, target_context)
        if found is not None:
            self._release()
        return found

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep what was compiled, for all."""
        try:
            super().save_overload(sig, data)
        finally:
            self._release()

    def _release(self) -> None:
        if self._lock is not None:
            self._lock.close()
            self._lock = None


def _locked(folder: Path, name: str) -> IO[bytes] | None:
    """The lock of a file; None where the folder cannot be written or its owner does not end. It ends with its process."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock = (folder / name).open("wb")
    except OSError:
        return None
    deadline = time.monotonic() + PATIENCE
    while time.monotonic() < deadline:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return lock
        except BlockingIOError:
            time.sleep(_PAUSE)
        except OSError:  # a file system without locks
            break
    lock.close()
    return None


def share_kernels() -> None:
    """From now on functions that numba is asked to cache are compiled so. To be called before kernels are defined."""
    # numba asks its module for the class, and offers no other way.
    dispatcher.FunctionCache = SharedKernels  # type: ignore[attr-defined]
