"""The surface of a finished run, or another surface as its base, as windows that answers are computed from."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from orthomill.pipeline.storage.height_files import read_heights
from orthomill.pipeline.storage.store import Store
from orthomill.schemas.accuracy.surface_answers import SurfaceCut
from orthomill.schemas.errors import StoreError
from orthomill.schemas.job import HeightFile
from orthomill.schemas.orientation import BLOCK, Block
from orthomill.schemas.raster import MapGrid, Window
from orthomill.schemas.surface import CORRECTED, DATUM_PRECISION, HEIGHT, MEASURED, PROVENANCE, RELATIVE_PRECISION, SURFACE


@dataclass(frozen=True)
class RunSurface:
    """The surface of a run, as dsm.tif has it; `checked`: as the check has mended it."""

    folder: Path
    checked: bool = False

    @cached_property
    def store(self) -> Store:
        """Of the run. Raises StoreError where it has no surface."""
        store, needed = Store(self.folder), CORRECTED if self.checked else HEIGHT
        if not (store.has_table(SURFACE) and store.has(needed) and store.has(RELATIVE_PRECISION)):
            name = self.folder.name
            raise StoreError(f"{name} has no {'checked ' if self.checked else ''}surface yet; run it first: orthomill run {name}")
        return store

    @property
    def words(self) -> str:
        """What it is, where volumes are measured against it."""
        return f"the surface of {self.folder.name}"

    @cached_property
    def grid(self) -> MapGrid:
        """Of the surface."""
        return self.store.table(SURFACE).grid

    @cached_property
    def block(self) -> Block | None:
        """Whose photographs made the surface; None where it was given."""
        return self.store.table(BLOCK) if self.store.has_table(BLOCK) else None

    @property
    def crs(self) -> str:
        """The project's system."""
        return self.store.spec(HEIGHT).crs or ""

    def read(self, window: Window) -> SurfaceCut:
        """A window inside the grid."""
        names = CORRECTED if self.checked else HEIGHT, RELATIVE_PRECISION, DATUM_PRECISION
        height, relative, datum = (self.store.read(name, window) for name in names)
        return SurfaceCut(height, relative, datum, np.isin(self.store.read(PROVENANCE, window), MEASURED))


@dataclass(frozen=True)
class RunBase:
    """The surface of another run on the cells of the measured one: an earlier epoch."""

    base: RunSurface
    grid: MapGrid

    @property
    def words(self) -> str:
        """What it is."""
        return self.base.words

    def read(self, window: Window) -> SurfaceCut:
        """The base there, each cell from the nearest one of the other run. Raises StoreError where both do not meet."""
        x, y = self.grid.centres(window)
        other = self.base.grid
        cols, rows = (np.rint(places).astype(int) for places in other.pixel(x, y))
        top, left = int(rows.min()), int(cols.min())
        wanted = Window(top, left, int(rows.max()) - top + 1, int(cols.max()) - left + 1)
        inside = wanted.clipped(other.shape)
        if inside.empty:
            raise StoreError(f"{self.base.folder.name} has no surface where this is measured.")
        cut = self.base.read(inside)
        r, c = np.meshgrid(rows - inside.row, cols - inside.col, indexing="ij")
        there = (r >= 0) & (c >= 0) & (r < inside.height) & (c < inside.width)
        r, c = np.clip(r, 0, inside.height - 1), np.clip(c, 0, inside.width - 1)
        height, relative, datum = (np.where(there, part[r, c], np.nan) for part in (cut.height, cut.relative, cut.datum))
        return SurfaceCut(height, relative, datum, there & cut.measured[r, c])


@dataclass(frozen=True)
class FileBase:
    """A surface from a file, whose errors nobody states."""

    path: Path
    crs: str
    grid: MapGrid

    @property
    def words(self) -> str:
        """What it is."""
        return self.path.name

    def read(self, window: Window) -> SurfaceCut:
        """The heights of the file there."""
        heights = read_heights(self.path, HeightFile(str(self.path), self.crs, self.grid, window))
        nothing = np.full(heights.shape, np.nan, np.float32)
        return SurfaceCut(heights, nothing, nothing, np.ones(heights.shape, bool))
