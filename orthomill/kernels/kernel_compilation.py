"""A kernel is compiled by one process, and found by the others that want it meanwhile.

The workers of a first run want the same kernels at the same time. numba lets each of them compile all of them, and where two
processes store a function for different types at once, one file holds the code of one type under the name of the other. So whoever
misses a kernel in the cache takes the lock of its file, looks again, and only then compiles.

Nothing of numba is changed for others: kernels of this program have this cache, and no file is touched before one is called.
"""

import fcntl
import functools
import time
from collections.abc import Callable
from pathlib import Path
from typing import IO, Any, Self

import numba
from numba.core.caching import CompileResultCacheImpl, FunctionCache, _Cache, _CacheLocator
from numba.core.dispatcher import Dispatcher

from orthomill.kernels.kernel_cache import folder_of, mark_used, tidy

PATIENCE = 600.0
"""s; compiling takes seconds, on a machine with all processors busy minutes"""
_PAUSE = 0.05


def njit(**options: Any) -> Any:
    """numba's decorator of the same name, for a function that is compiled once for all processes and kept. options: numba's."""

    def compiled(function: Callable[..., Any]) -> Any:
        kernel = numba.njit(**options)(function)
        if isinstance(kernel, Dispatcher):  # with NUMBA_DISABLE_JIT it is the function itself
            kernel._cache = SharedKernels(function)  # type: ignore[attr-defined]  # as numba's own option `cache` does with its own class
        return kernel

    return compiled


class _Place(_CacheLocator):
    """Where numba finds the kernels of a function: the folder of the present state of its file and of all that it imports."""

    def __init__(self, function: Callable[..., Any], file: str) -> None:
        self._line = function.__code__.co_firstlineno
        self._py_file = file  # numba names it where it cannot keep a function
        self._folder = folder_of(Path(file))

    @classmethod
    def from_function(cls, py_func: Callable[..., Any], py_file: str) -> Self:
        return cls(py_func, py_file)

    def get_cache_path(self) -> str:
        return str(self._folder)

    def get_source_stamp(self) -> str:
        return self._folder.name

    def get_disambiguator(self) -> str:
        return str(self._line)


class _KernelFiles(CompileResultCacheImpl):
    _locator_classes = [_Place]  # noqa: RUF012  an instance variable for the types of numba


class _KernelIndex(FunctionCache):
    _impl_class = _KernelFiles


class SharedKernels(_Cache):
    """The cache of one function, whose file only one process at a time may fill. Opened when the function is first called."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self._function = function
        self._lock: IO[bytes] | None = None

    @functools.cached_property
    def _index(self) -> FunctionCache:
        index = _KernelIndex(self._function)
        mark_used(Path(index.cache_path))
        return index

    @property
    def cache_path(self) -> str:
        return self._index.cache_path

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """The compiled function for a signature; None where this process has to compile it."""
        found = self._index.load_overload(sig, target_context)
        # With the lock in hand it is compiling already, and met the same function again.
        if found is not None or self._lock is not None:
            return found
        self._lock = _locked(Path(self.cache_path), f"{self._index._impl.filename_base}.lock")
        found = self._index.load_overload(sig, target_context)
        if found is not None:
            self._release()
        return found

    def save_overload(self, sig: Any, cres: Any) -> None:
        """Keep what was compiled, for all."""
        try:
            if Path(self.cache_path).is_dir():
                self._index.save_overload(sig, cres)
                _tidy_once()
        except OSError:  # a disk that is full: the kernel was compiled all the same
            pass
        finally:
            self._release()

    def enable(self) -> None:
        self._index.enable()

    def disable(self) -> None:
        self._index.disable()

    def flush(self) -> None:
        self._index.flush()

    def _release(self) -> None:
        if self._lock is not None:
            self._lock.close()
            self._lock = None


@functools.cache
def _tidy_once() -> None:
    tidy()


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
