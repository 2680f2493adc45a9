"""Inspecting a single photograph without a project: what an inspection receives and what it returns.

Strips of pixels go in and strips of a map come out, so that memory does not grow with the photograph. Reading the file and writing
the picture are left to the caller.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from orthomill.schemas.photo import Header
from orthomill.schemas.raster import Window


class PhotoFile(Protocol):
    """A photograph as stored in its file, before the EXIF orientation flag is applied."""

    @property
    def header(self) -> Header:
        """Size, dtype and tags."""
        ...

    def read(self, window: Window) -> np.ndarray:
        """Pixels (height, width, bands) of a window of the file. Raises PhotoError where they cannot be decoded."""
        ...


@dataclass(frozen=True)
class PhotoMap:
    """A grey picture of a photograph, in its upright size."""

    shape: tuple[int, int]
    """rows and columns"""
    # An iterator, because the whole map of a scan of several hundred megapixels need not fit into memory.
    strips: Iterator[np.ndarray]
    """(rows, columns) uint8 from top to bottom; they can be iterated once"""
    labels: dict[int, str]
    """grey level -> what it means, in the order of the legend"""
    notes: tuple[str, ...] = ()
    """sentences about how the map was made"""


@dataclass(frozen=True)
class SurfacePoint:
    """A point of the surface that a photograph shows: `place` X, Y, Z m, its 3 x 3 `covariance` m^2, and the other photographs that
    see it."""

    place: tuple[float, float, float]
    covariance: tuple[tuple[float, float, float], ...]
    photos: tuple[str, ...]


@dataclass(frozen=True)
class PairUnknown:
    """An unknown of a relative orientation, from the tie points of the pair alone and from the adjusted block."""

    form: str
    name: str
    unit: str
    """of values and standard errors; empty for a ratio"""
    # Two photographs of a fixed block have no covariance, and a pair of six matches no redundancy.
    of_points: float
    sigma_of_points: float | None
    of_block: float
    sigma_of_block: float | None


@dataclass(frozen=True)
class PairForms:
    """The relative orientation of a pair in its classical forms."""

    left: str
    right: str
    quarter_turns: tuple[int, int]
    """by which the image systems of both were turned, counter-clockwise, so that the base lies along x"""
    matches: int
    kept: int
    sigma0_px: float
    unknowns: tuple[PairUnknown, ...]
    failed_start: tuple[int, float] | None = None
    """matches kept and sigma0 (px) of the published start at zero, where it went wrong and five points gave another"""


@dataclass(frozen=True)
class GrownUnknown:
    """An unknown of the dependent relative orientation with its standard error, in its unit."""

    name: str
    unit: str
    value: float
    sigma: float


@dataclass(frozen=True, eq=False)
class GrownPair:
    """Two photographs matched by region growing: from so many `seeds` of so many `nodes` the `matches` (N, 4) px (col, row on the
    left, on the right) with their standard errors `sigma` (N,) px of a coordinate on the right.

    Where the cameras are known: from `related` of them, of which `kept` agree, the dependent relative orientation with `sigma0_px`.
    """

    seeds: int
    nodes: int
    matches: np.ndarray
    sigma: np.ndarray
    related: int = 0
    kept: int = 0
    sigma0_px: float = float("nan")
    unknowns: tuple[GrownUnknown, ...] = ()
    turned: bool = False
    """whether both image systems are turned by a quarter, so that the base lies along x"""
