"""The levels of the height volume: their map grids and heights, from coarse to fine.

Strategy: level l has cells of 2^l cells of the surface and heights 2^l steps apart, so that every level asks for the same
parallax in its own cells. The coarsest level is the first whose heights span the surface with few enough of them. Grid and
heights are absolute (heights are multiples of the step), so that neighbouring tiles agree.
"""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from orthomill.schemas.orientation import Block
from orthomill.schemas.photo import Photos
from orthomill.schemas.raster import MapGrid, Window
from orthomill.schemas.surface import Surface
from orthomill.tasks.densification.settings.guide_settings import Guide, GuideFile, TiePointGuide
from orthomill.tasks.densification.volume.photograph_choice import base_height
from orthomill.tasks.geometry.footprint import ground_bounds
from orthomill.tasks.geometry.view import View, block_view
from orthomill.tasks.matching.volume.paths import UNIT
from orthomill.tasks.matching.volume.volume_settings import HeightVolume

HALO = 32
"""Cells on every side of a tile that are optimised with it, so that paths arrive there."""
SIDE = 256
"""Side of a tile in cells of its level, whatever the tile of the project: the result must not depend on that."""


@dataclass(frozen=True)
class VolumeLevel:
    """One level: cells `grid`, and heights (first + k) * step m, k = 0 ... count - 1."""

    number: int
    grid: MapGrid
    step: float
    first: int
    count: int

    @property
    def heights(self) -> np.ndarray:
        """(count,) m."""
        return (self.first + np.arange(self.count)) * self.step


def level_grid(grid: MapGrid, level: int) -> MapGrid:
    """The grid whose cells are 2^level x 2^level cells of `grid`; the last ones may reach beyond it."""
    factor = 2**level
    return MapGrid(
        west=grid.west, north=grid.north, cell=grid.cell * factor, rows=-(-grid.rows // factor), cols=-(-grid.cols // factor)
    )


@dataclass(frozen=True, eq=False)
class VolumeScene:
    """What the tiles of all levels are planned from."""

    block: Block
    photos: Photos
    surface: Surface
    settings: HeightVolume
    guide: Guide = field(default_factory=TiePointGuide)
    reach: float | None = None
    """how far the surface may lie from an existing model, m; None: as far as the tie points say"""

    @property
    def guided(self) -> bool:
        """Whether an existing model bounds the heights."""
        return isinstance(self.guide, GuideFile)

    @cached_property
    def views(self) -> tuple[View, ...]:
        """The oriented photographs, in the order of the block."""
        return tuple(block_view(self.block, name) for name in self.block.names)

    @cached_property
    def bounds(self) -> tuple[tuple[float, float, float, float], ...]:
        """(west, south, east, north) of the ground that each of them can show, m."""
        return tuple(ground_bounds(view, self.surface.height_low, self.surface.height_high) for view in self.views)

    @cached_property
    def levels(self) -> tuple[VolumeLevel, ...]:
        """The levels, the coarsest first."""
        widest = base_height(self.views, self.surface.grid, self.block.ground_mean, self.settings.photographs)
        step = self.settings.step * self.surface.grid.cell / widest
        coarsest = 0
        while _count(self.surface, step * 2**coarsest) > self.settings.widest:
            coarsest += 1
        return tuple(_level(self.surface, step * 2**number, number) for number in range(coarsest, -1, -1))


def _count(surface: Surface, step: float) -> int:
    """Heights that span the surface, as a multiple of UNIT."""
    span = np.ceil(surface.height_high / step) - np.floor(surface.height_low / step) + 1
    return int(-(-span // UNIT) * UNIT)


def _level(surface: Surface, step: float, number: int) -> VolumeLevel:
    first = int(np.floor(surface.height_low / step))
    return VolumeLevel(number, level_grid(surface.grid, number), step, first, _count(surface, step))


def coarser_window(work: Window, reach: int, shape: tuple[int, ...]) -> Window:
    """The cells of the next coarser level (of `shape`) from which the ranges of the cells `work` follow."""
    return work.reduced(2).grown(reach).clipped(shape)
