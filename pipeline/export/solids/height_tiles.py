"""A height model and its orthoimage as square tiles of several resolutions, read one at a time.

Level 0 has the cells of the model; each further level has cells of twice the size, so that a tile covers four of the level below.
The corners of all levels lie on whole cells of the coarsest one. A tile holds one row and column of its neighbours: no seam.
"""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from math import ceil, log2
from pathlib import Path
from typing import NamedTuple

import numpy as np
from rasterio.windows import Window

from orthomill.pipeline.export.conversions.wanted import Wanted
from orthomill.pipeline.export.conversions.warped_product import WarpedProduct, warped
from orthomill.schemas.errors import WorkflowError

SIDE = 128
"""cells along a tile"""
MOST_TEXELS = 8
"""px of the picture along a cell"""


class TilePlace(NamedTuple):
    """A tile: its level (0: the finest), row and column."""

    level: int
    row: int
    col: int


@dataclass(frozen=True, eq=False)
class HeightTile:
    """heights (rows, cols) m, NaN where there is none; the picture (h, w, 3) of its cells; the centre of the upper left cell (X, Y)
    m; the side of a cell, m."""

    heights: np.ndarray
    picture: np.ndarray
    corner: tuple[float, float]
    cell: float


class HeightTiles:
    """The tiles of all levels; `top`: the level of which one tile covers everything."""

    def __init__(self, heights: list[WarpedProduct], pictures: list[WarpedProduct], texels: int) -> None:
        self.heights, self.pictures, self.texels = heights, pictures, texels
        self.top = len(heights) - 1
        self.crs = heights[0].wkt

    def places(self, level: int) -> Iterator[TilePlace]:
        """The places of the tiles of a level, row by row."""
        view = self.heights[level]
        for row in range(ceil(view.height / SIDE)):
            for col in range(ceil(view.width / SIDE)):
                yield TilePlace(level, row, col)

    def children(self, place: TilePlace) -> Iterator[TilePlace]:
        """The tiles of the next finer level that a tile covers."""
        if place.level:
            view = self.heights[place.level - 1]
            for row in (2 * place.row, 2 * place.row + 1):
                for col in (2 * place.col, 2 * place.col + 1):
                    if row * SIDE < view.height and col * SIDE < view.width:
                        yield TilePlace(place.level - 1, row, col)

    def read(self, place: TilePlace) -> HeightTile | None:
        """A tile; None where it has no height."""
        view, picture = self.heights[place.level], self.pictures[place.level]
        first_row, first_col = place.row * SIDE, place.col * SIDE
        rows, cols = min(SIDE + 1, view.height - first_row), min(SIDE + 1, view.width - first_col)
        window = Window(first_col, first_row, cols, rows)
        seen = view.seen(window)
        if not seen.any():
            return None
        heights = np.where(seen, view.read(window, [1])[0], np.nan).astype(np.float64)
        n = self.texels
        pixels = picture.read(Window(first_col * n, first_row * n, cols * n, rows * n), [1, 2, 3])
        cell = float(view.transform.a)
        corner = view.transform.c + (first_col + 0.5) * cell, view.transform.f - (first_row + 0.5) * cell
        return HeightTile(heights, np.moveaxis(pixels, 0, -1), corner, cell)


@contextmanager
def height_tiles(heights: Path, picture: Path, wanted: Wanted) -> Iterator[HeightTiles]:
    """The tiles of a product of heights with a product of colours. Raises WorkflowError for what cannot be."""
    with warped(heights, wanted) as view, warped(picture, replace(wanted, cell=None, area=None, cutline=None)) as colours:
        if view.crs is not None and view.crs.is_geographic:
            raise WorkflowError("A model in space needs a system in metres; give another --crs.")
        if colours.dtypes[0] != "uint8" or colours.count < 3:
            raise WorkflowError(f"{picture.name} is no picture of 8 bits, which a model in space needs.")
        cell, bounds = float(view.transform.a), view.bounds
        texels = min(max(round(cell / colours.transform.a), 1), MOST_TEXELS)
        levels = max(ceil(log2(max(view.width, view.height) / SIDE)), 0) + 1
    whole = cell * 2 ** (levels - 1)
    west, north = np.floor(bounds.left / whole + 1e-9) * whole, np.ceil(bounds.top / whole - 1e-9) * whole
    east, south = np.ceil(bounds.right / whole - 1e-9) * whole, np.floor(bounds.bottom / whole + 1e-9) * whole
    area = (float(west), float(south), float(east), float(north))
    with ExitStack() as stack:
        kinds: tuple[list[WarpedProduct], list[WarpedProduct]] = ([], [])
        for level in range(levels):
            size = cell * 2**level
            kinds[0].append(stack.enter_context(warped(heights, replace(wanted, area=area, cell=size))))
            kinds[1].append(stack.enter_context(warped(picture, Wanted(wanted.crs, area, size / texels))))
        yield HeightTiles(*kinds, texels)
