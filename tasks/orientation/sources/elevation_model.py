"""An elevation model of the ground as a source: what it says of the height and the tilt of a block."""

from dataclasses import dataclass

import numpy as np

from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.photo import Photos
from orthomill.schemas.project_paths import ProjectMap
from orthomill.schemas.raster import MapGrid
from orthomill.schemas.settings import Settings, setting

MARGIN, LEAST_MARGIN = 0.5, 300.0
"""The model is read beyond the positions by this share of their extent, and by so many m at least: photographs see that far."""
MOST_CELLS, SMALLEST = 500, 0.25
"""Cells along a side, and the side of the smallest, m: heights are compared over whole fields, not over curbs."""


class ElevationFile(Settings):
    """An elevation model of the ground: GeoTIFF, LAS or LAZ."""

    path: ProjectMap = setting(..., "The file, relative to the project's root.")
    sigma: float = setting(..., "Standard error of its heights, of a single one and of all of them together.", "m", gt=0)
    system: str | None = setting(None, "Reference system of a file that names none, e.g. EPSG:2100+5773.")

    def lattice(self, photos: Photos) -> "Lattice":
        """Where it is read: below the positions of the photographs. Raises WorkflowError where there are none."""
        places = np.array([photo.position[:2] for photo in photos.photos if photo.position is not None]).reshape(-1, 2)
        if not len(places):
            raise WorkflowError(
                f"The elevation model {self.path} is compared with the positions of the photographs, and none has one; leave "
                "'elevation' out of the orientation."
            )
        low, high = places.min(axis=0), places.max(axis=0)
        margin = max(MARGIN * float((high - low).max()), LEAST_MARGIN)
        side = float((high - low).max()) + 2.0 * margin
        cell = max(side / MOST_CELLS, SMALLEST)
        count = max(int(np.ceil(side / cell)), 2)
        west, north = float(low[0]) - margin, float(high[1]) + margin
        return Lattice(MapGrid(west=west, north=north, cell=cell, rows=count, cols=count), self.sigma, self.path)


@dataclass(frozen=True)
class Lattice:
    """The `grid` on which the model of a file (`path`) was read, and the standard error `sigma` m of its heights."""

    grid: MapGrid
    sigma: float
    path: str = ""


@dataclass(frozen=True, eq=False)
class Elevation:
    """`heights` (rows, cols) m on a lattice, in the project's system (NaN: none)."""

    heights: np.ndarray
    lattice: Lattice

    def checked(self) -> "Elevation":
        """Itself. Raises WorkflowError where it has no height at all."""
        if not np.isfinite(self.heights).any():
            raise WorkflowError(
                f"The elevation model {self.lattice.path} has no height where the photographs were taken; compare its reference "
                "system (elevation > system) and its extent."
            )
        return self


@dataclass(frozen=True, eq=False)
class ElevationModel:
    """Heights in local coordinates, which have the `origin` (3,)."""

    elevation: Elevation
    origin: np.ndarray

    @property
    def sigma(self) -> float:
        """m"""
        return self.elevation.lattice.sigma

    def at(self, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Heights (n,) and slopes (n, 2) at local places (n, 3) m, bilinear between the centres of cells; NaN where any of the four
        has none."""
        heights, grid = self.elevation.heights, self.elevation.lattice.grid
        col, row = grid.pixel(places[:, 0] + self.origin[0], places[:, 1] + self.origin[1])
        rows, cols = heights.shape
        r, c = np.clip(np.floor(row), 0, rows - 2).astype(int), np.clip(np.floor(col), 0, cols - 2).astype(int)
        inside = (row >= 0) & (row <= rows - 1) & (col >= 0) & (col <= cols - 1)
        down, right = row - r, col - c
        (a, b), (d, e) = [[heights[r + i, c + j] for j in (0, 1)] for i in (0, 1)]
        upper, lower = (1.0 - right) * a + right * b, (1.0 - right) * d + right * e
        height = np.where(inside, (1.0 - down) * upper + down * lower, np.nan)
        east = (1.0 - down) * (b - a) + down * (e - d)
        return height - self.origin[2], np.column_stack([east, upper - lower]) / grid.cell
