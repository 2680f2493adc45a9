"""Jobs as bytes and back, in the memory of one process. What holds large arrays, or a function that no module has, is refused."""

import io
import pickle
from collections.abc import Callable
from dataclasses import fields
from operator import attrgetter
from typing import Any

import numpy as np

from orthomill.schemas.job import Export, Job, Raster
from orthomill.schemas.raster import Window

LARGEST = 4096
"""bytes of an array that is copied"""


def _small_array(value: np.ndarray) -> Any:
    # Several jobs may have parts of one large array among their parameters, which is in memory once.
    if value.nbytes > LARGEST:
        raise ValueError(f"an array of {value.nbytes} bytes")
    return value.__reduce__()


def _by_fields(kind: type) -> Callable[[Any], tuple[type, tuple]]:
    """How to make a frozen value again: pickle asks for its state in Python, field by field."""
    of = attrgetter(*(one.name for one in fields(kind)))
    return lambda value: (kind, of(value))


class _JobPickler(pickle.Pickler):
    dispatch_table = {np.ndarray: _small_array} | {kind: _by_fields(kind) for kind in (Job, Export, Raster, Window)}


def dumps(jobs: list[Job | Export]) -> bytes:
    """Jobs as bytes."""
    stream = io.BytesIO()
    _JobPickler(stream, pickle.HIGHEST_PROTOCOL).dump(jobs)
    return stream.getvalue()


def loads(content: bytes) -> list[Job | Export]:
    """Jobs from such bytes."""
    jobs: list[Job | Export] = pickle.loads(content)  # noqa: S301
    return jobs
