"""Gives memory that jobs have freed back to the system, once it is much.

A worker keeps freed memory for the arrays of its next job, which is fast; but between what lives on (compiled kernels, caches of
libraries) free memory falls to pieces that no large array fits in, so that a worker grows from stage to stage although no job needs
more than planned. The C library gives such pieces back when it is told to, and so does Arrow, which keeps memory of its own: three
times a table of a hundred megabytes, after it was written.
"""

import ctypes
import os
from collections.abc import Callable
from functools import cache
from pathlib import Path

import pyarrow as pa

from orthomill.schemas.memory import MIB

MUCH = 900 * MIB
"""bytes: one and a half times what a process needs for itself; below, memory is kept for the next job"""
_OWN = Path("/proc/self/statm")


def give_back(much: int = MUCH) -> bool:
    """Return what is free where this process occupies more than `much` bytes; whether it was tried."""
    if occupied() <= much:
        return False
    pa.default_memory_pool().release_unused()
    trim = _trim()
    return trim is not None and trim(0) >= 0


def occupied() -> int:
    """Bytes of memory that this process occupies; 0 where the system does not tell."""
    try:
        return int(_OWN.read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except OSError:
        return 0


@cache
def _trim() -> Callable[[int], int] | None:
    """The function of the GNU C library; None with another one."""
    return getattr(ctypes.CDLL(None), "malloc_trim", None)
