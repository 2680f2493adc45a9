"""What a surface promises at all places where a check point could test it, which is more than the points may show.

Points lie where surveyors like to stand. Where the surface promises larger errors elsewhere, a root mean square of the points is
none of the surface: the statement widens its interval by the difference (`tested_accuracy.py`).
"""

from dataclasses import dataclass

import numpy as np

from orthomill.schemas.accuracy.promised_errors import PromisedHeights
from orthomill.schemas.raster import MapGrid, Window
from orthomill.tasks.accuracy.points.surface_height import CellsAround, cells_around, height_at

LATTICE = 32
"""cells between places"""
AROUND = 5
"""cells beyond a part that the test of a place in it reads"""


@dataclass(frozen=True)
class TestablePart:
    """A window of a grid, and the rise over run up to which heights are tested."""

    grid: MapGrid
    window: Window
    steepest: float

    @property
    def read(self) -> Window:
        """The cells that its places are tested with."""
        return self.window.grown(AROUND).clipped(self.grid.shape)


def promised_heights(heights: tuple[np.ndarray, ...], part: TestablePart) -> PromisedHeights:
    """The standard errors that a part promises at the places of a lattice where its height can be tested.

    heights: heights, standard errors, codes of Provenance and the datum's part of the errors of `part.read`, as
    `schemas/surface.py` has them.
    """
    grid, window = part.grid, part.window
    found = []
    for row in range(-(-window.row // LATTICE) * LATTICE, window.row + window.height, LATTICE):
        for col in range(-(-window.col // LATTICE) * LATTICE, window.col + window.width, LATTICE):
            x, y = grid.west + (col + 0.501) * grid.cell, grid.north - (row + 0.501) * grid.cell
            around = cells_around(grid, x, y).clipped(grid.shape)
            inside = around.within(part.read).slices
            test = height_at(CellsAround(grid, around, *(raster[inside] for raster in heights)), x, y, part.steepest)
            if test.tested and test.sigma is not None:
                found.append(test.sigma)
    return PromisedHeights(np.array(found, np.float64))
