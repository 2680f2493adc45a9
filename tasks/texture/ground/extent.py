"""The extent of the orthoimage and the input of one of its tiles: nested grids, pyramid levels, windows of heights and photographs.

A DSM cell is divided into an integer number of ortho pixels, so that the two grids share their outer corner. Whatever can hide a
cell from a photograph lies between the cell and the last place where the surface is higher than the ray: the window of heights of a
tile is the tile, and the tile moved that far towards every projection centre. With it a tile gives what the whole model would give.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import ceil, floor, isfinite

import numpy as np

from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.raster import MapGrid, Window
from orthomill.tasks.geometry.footprint import photo_window
from orthomill.tasks.geometry.photograph_part import PhotoPart, PhotoSource, level_window
from orthomill.tasks.geometry.view import View
from orthomill.tasks.texture.ground.draping import ground_window
from orthomill.tasks.texture.ground.relief import SIDE, ReliefMap

NESTING = 1e-6
"""Tolerated deviation of the ratio of the cells from an integer: rounding of decimal fractions, no more."""
# auto rounds the photo pixels per DSM cell up, but not for less than a quarter: a cell slightly larger than the photo pixel loses
# nothing, while a divisor larger by one costs up to four times the pixels.
_FINER_FROM = 0.25


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


def heights_window(relief: ReliefMap, views: Sequence[View], core: Window, halo: int) -> Window:
    """The DSM cells that can hide `core` from any of `views`, with `halo` cells more on every side, clipped to the DSM."""
    grid = relief.grid
    low, _ = relief.over(core.grown(halo))
    reached = [_crossed(relief, view, core, low, halo) for view in views] if isfinite(low) else []
    top, left = min([core.row, *(one[0] for one in reached)]), min([core.col, *(one[1] for one in reached)])
    bottom = max([core.row + core.height - 1, *(one[2] for one in reached)])
    right = max([core.col + core.width - 1, *(one[3] for one in reached)])
    row, col = int(np.floor(top)) - 1, int(np.floor(left)) - 1
    return Window(row, col, int(np.ceil(bottom)) + 2 - row, int(np.ceil(right)) + 2 - col).grown(halo).clipped(grid.shape)


def _crossed(relief: ReliefMap, view: View, core: Window, low: float, halo: int) -> tuple[float, float, float, float]:
    """(top, left, bottom, right) cells that rays from `core` to the projection centre cross where the surface may hide them.

    Followed from the far end, where rays from the lowest height `low` (m) have reached the greatest one of the model, block by
    block back to the first place whose surface is higher than the rays are there.
    """
    col0, row0 = relief.grid.pixel(view.centre[0], view.centre[1])
    rise = max(view.centre[2] - low, 1e-9)
    # At this share of the way to the centre a ray is above the highest point of the model.
    farthest = min((relief.highest - low) / rise, 1.0)
    # A step moves less than a block; where the camera stands far outside the model most of the way lies beyond it.
    far = max(abs(row0 - core.row), abs(col0 - core.col)) + max(core.shape)
    shares = np.linspace(0.0, farthest, max(2, ceil(farthest * far / SIDE) + 1))

    def moved(share: float) -> tuple[float, float, float, float]:
        up, across = share * (row0 - core.row), share * (col0 - core.col)
        shrunk = (1.0 - share) * (core.height - 1), (1.0 - share) * (core.width - 1)
        return core.row + up, core.col + across, core.row + up + shrunk[0], core.col + across + shrunk[1]

    for near, beyond in zip(shares[-2::-1], shares[:0:-1], strict=True):
        here, there = moved(near), moved(beyond)
        row, col = floor(min(here[0], there[0])) - 1, floor(min(here[1], there[1])) - 1
        bottom, right = ceil(max(here[2], there[2])) + 2, ceil(max(here[3], there[3])) + 2
        _, high = relief.over(Window(row, col, bottom - row, right - col).grown(halo))
        if high >= low + near * rise:
            return there
    return moved(0.0)


def tile_extent(
    relief: ReliefMap, ortho: MapGrid, window: Window, sources: Sequence[PhotoSource], halo: int, around: int = 0
) -> TileExtent:
    """All windows that the ortho tile `window` needs; photographs that cannot see it are left out.

    `halo`: cells of heights around what the rays cross; `around`: cells around the tile that the photographs show as well.
    """
    parts, seeing = [], []
    dsm = relief.grid
    divisor = round(dsm.cell / ortho.cell)
    core = dsm_core(dsm, divisor, window)
    # A height at a cell, bridged or draped, is one of those within the halo or between two of them.
    low, high = relief.over(core.grown(around + halo))
    shown = window.grown(around * divisor).clipped(ortho.shape)
    for source in sources if isfinite(low) else ():
        margin = 4 * 2**source.level  # two pixels of the level for the bicubic kernel, two for the relief within the window
        full = photo_window(source.view, ortho, shown, low, high, margin)
        part = level_window(full, source.level, source.shape)
        if not (full.empty or part.empty):
            parts.append(PhotoPart(source.view.name, source.level, part))
            seeing.append(source.view)
    return TileExtent(ortho, window, dsm, heights_window(relief, seeing, core, halo), tuple(parts))
