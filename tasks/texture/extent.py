"""The extent of the orthoimage and the input of one of its tiles: nested grids, pyramid levels, windows of heights and photographs.

A DSM cell is divided into an integer number of ortho pixels, so that the two grids share their outer corner. Whatever can hide a
cell from a photograph lies between the cell and the foot of the ray's point at the greatest height: the window of heights of a tile
is the tile, and the tile moved that far towards every projection centre. With it a tile gives what the whole model would give.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.raster import MapGrid, Window
from orthomill.schemas.surface import Surface
from orthomill.tasks.geometry.footprint import photo_window
from orthomill.tasks.geometry.photograph_part import PhotoPart, PhotoSource, level_window
from orthomill.tasks.geometry.view import View
from orthomill.tasks.texture.draping import ground_window

NESTING = 1e-6
"""Tolerated deviation of the ratio of the cells from an integer: rounding of decimal fractions, no more."""
# auto rounds the photo pixels per DSM cell up, but not for less than a quarter: a cell slightly larger than the photo pixel loses
# nothing, while a divisor larger by one costs up to four times the pixels.
_FINER_FROM = 0.25
_HEIGHT_MARGIN = 0.05  # of the height range: the DSM may exceed the range known at planning


@dataclass(frozen=True)
class TileExtent:
    """One ortho tile: its window in the ortho grid, and the windows of the heights and photographs that belong to it."""

    ortho: MapGrid
    window: Window
    dsm: MapGrid
    heights: Window
    photos: tuple[PhotoPart, ...]

    @property
    def divisor(self) -> int:
        """Ortho pixels along the side of a DSM cell."""
        return round(self.dsm.cell / self.ortho.cell)

    @property
    def core(self) -> Window:
        """The DSM cells under the tile."""
        return dsm_core(self.dsm, self.divisor, self.window)

    @property
    def ground(self) -> Window:
        """The blocks of the whole model's ground that draping needs."""
        return ground_window(self.dsm, self.heights)


def ground_pixels(views: Iterable[View], ground: float) -> list[float]:
    """Side of a photo pixel on the ground at height `ground` (m), below the projection centre, one per view."""
    return [float(max(view.centre[2] - ground, 1e-6) / view.camera.c) for view in views]


def ortho_grid(dsm: MapGrid, cell: float | None, ground_pixel: float) -> MapGrid:
    """The grid of the orthoimage: that of the DSM with each cell divided into n x n.

    `cell` in m, or None for the one nearest to `ground_pixel` (m), preferably finer. Raises WorkflowError when a given cell does
    not divide that of the DSM.
    """
    ratio = dsm.cell / (cell or ground_pixel)
    divisor = max(1, round(ratio)) if cell else max(1, int(np.ceil(ratio - _FINER_FROM)))
    if cell and abs(ratio - divisor) > NESTING * divisor:
        raise WorkflowError(
            f"texture.cell is {cell:g} m, but the surface model has cells of {dsm.cell:g} m and the orthoimage must divide them: "
            f"use {dsm.cell / divisor:g} m or auto."
        )
    return MapGrid(west=dsm.west, north=dsm.north, cell=dsm.cell / divisor, rows=dsm.rows * divisor, cols=dsm.cols * divisor)


def dsm_core(dsm: MapGrid, divisor: int, window: Window) -> Window:
    """The DSM cells under a window of the ortho grid."""
    return window.reduced(divisor).clipped(dsm.shape)


def heights_window(surface: Surface, views: Sequence[View], core: Window, halo: int) -> Window:
    """The DSM cells that can hide `core` from any of `views`, with `halo` cells more on every side, clipped to the DSM."""
    grid, margin = surface.grid, _HEIGHT_MARGIN * (surface.height_high - surface.height_low)
    low, high = surface.height_low - margin, surface.height_high + margin
    rows, cols = [core.row, core.row + core.height - 1], [core.col, core.col + core.width - 1]
    top, left, bottom, right = rows[0], cols[0], rows[1], cols[1]
    for view in views:
        col0, row0 = grid.pixel(view.centre[0], view.centre[1])
        # At this share of the way to the centre a ray from the lowest ground is above the highest point of the model.
        share = min((high - low) / max(view.centre[2] - low, 1e-9), 1.0)
        reached_rows = [row + share * (row0 - row) for row in rows]
        reached_cols = [col + share * (col0 - col) for col in cols]
        top, bottom = min(top, *reached_rows), max(bottom, *reached_rows)
        left, right = min(left, *reached_cols), max(right, *reached_cols)
    row, col = int(np.floor(top)) - 1, int(np.floor(left)) - 1
    return Window(row, col, int(np.ceil(bottom)) + 2 - row, int(np.ceil(right)) + 2 - col).grown(halo).clipped(grid.shape)


def tile_extent(
    surface: Surface, ortho: MapGrid, window: Window, sources: Sequence[PhotoSource], halo: int, around: int = 0
) -> TileExtent:
    """All windows that the ortho tile `window` needs; photographs that cannot see it are left out.

    `halo`: cells of heights around what the rays cross; `around`: cells around the tile that the photographs show as well.
    """
    parts, seeing = [], []
    divisor = round(surface.grid.cell / ortho.cell)
    shown = window.grown(around * divisor).clipped(ortho.shape)
    for source in sources:
        margin = 4 * 2**source.level  # two pixels of the level for the bicubic kernel, two for the relief within the window
        full = photo_window(source.view, ortho, shown, surface.height_low, surface.height_high, margin)
        part = level_window(full, source.level, source.shape)
        if not (full.empty or part.empty):
            parts.append(PhotoPart(source.view.name, source.level, part))
            seeing.append(source.view)
    core = dsm_core(surface.grid, divisor, window)
    return TileExtent(ortho, window, surface.grid, heights_window(surface, seeing, core, halo), tuple(parts))
