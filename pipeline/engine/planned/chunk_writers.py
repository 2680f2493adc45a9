"""Which job writes each chunk of each raster: a number for every chunk, found by counting."""

from collections.abc import Iterator
from itertools import product

import numpy as np

from orthomill.schemas.raster import RasterSpec, Window

Chunk = tuple[int, int]
"""row and column among the chunks of a raster"""


def chunks_of(spec: RasterSpec, window: Window) -> Iterator[Chunk]:
    """The chunks that a window touches, row by row."""
    high, wide = spec.chunks[:2]
    rows = range(window.row // high, -(-(window.row + window.height) // high))
    cols = range(window.col // wide, -(-(window.col + window.width) // wide))
    return product(rows, cols)


class ChunkWriters:
    """Numbers of jobs by raster and chunk."""

    def __init__(self) -> None:
        self._grids: dict[str, tuple[memoryview, int]] = {}
        """(a number more than that of the writer, for every chunk, row by row; chunks in a row)"""

    def add_raster(self, spec: RasterSpec) -> None:
        """A raster of which nobody writes anything yet."""
        rows, cols = (-(-side // chunk) for side, chunk in zip(spec.shape[:2], spec.chunks[:2], strict=True))
        # The system gives zeros when they are looked at: of a raster of which little is written little is held.
        self._grids[spec.name] = np.zeros(rows * cols, np.int32).data, cols

    def writer(self, name: str, chunk: Chunk) -> int | None:
        """The job that writes a chunk; None where none does yet."""
        writers, cols = self._grids[name]
        number: int = writers[chunk[0] * cols + chunk[1]]
        return number - 1 if number else None

    def claim(self, name: str, chunk: Chunk, number: int) -> int:
        """The job that writes a chunk: from now on this one, where none did."""
        writers, cols = self._grids[name]
        place = chunk[0] * cols + chunk[1]
        if not writers[place]:
            writers[place] = number + 1
        writer: int = writers[place]
        return writer - 1
