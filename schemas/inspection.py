"""Looking at a single photograph, without a project: what an inspection is given, and what it gives back.

Strips of pixels go in and strips of a map come out, so that memory does not grow with the photograph. Who reads the file and
who writes the picture is no business of the method.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from orthomill.schemas.photo import Header
from orthomill.schemas.raster import Window


class PhotoFile(Protocol):
    """A photograph as it lies in its file; the EXIF orientation flag is not obeyed yet."""

    @property
    def header(self) -> Header:
        """Size, dtype and tags."""
        ...

    def read(self, window: Window) -> np.ndarray:
        """Pixels (height, width, bands) of a window of the file. Raises PhotoError where they cannot be decoded."""
        ...


@dataclass(frozen=True)
class PhotoMap:
    """A grey picture of a photograph, of its upright size."""

    shape: tuple[int, int]
    """rows and columns"""
    strips: Iterator[np.ndarray]
    """(rows, columns) uint8 from top to bottom; they can be taken once"""
    labels: dict[int, str]
    """grey level -> what it means, in the order of the legend"""
    notes: tuple[str, ...] = ()
    """whole sentences about how the map was made"""
