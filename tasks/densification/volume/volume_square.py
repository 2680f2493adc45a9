"""Tiles of a level side by side, which one job solves one after the other: a job of seconds, whose results are stored in one piece.

Tiles are those of volume_tile.py, with halos of their own, whatever the square: the tile of the project changes nothing but how
many a job solves. Photographs are read for one tile at a time, so that memory is that of the most demanding tile.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from orthomill.schemas.orientation import Block
from orthomill.schemas.raster import Window, enclosing, tiles_of
from orthomill.tasks.densification.volume.levels import SIDE, VolumeLevel, VolumeScene
from orthomill.tasks.densification.volume.volume_tile import (
    SolvedVolume,
    VolumeTile,
    nothing,
    solve_volume,
    tile_memory,
    volume_tiles,
)
from orthomill.tasks.matching.volume.volume_settings import HeightVolume


@dataclass(frozen=True)
class VolumeSquare:
    """The tiles of a level in `window` that two photographs or more show, and what all of them read: the cells `coarser` of the
    next coarser level (None: there is none), and the places of the terrain."""

    level: VolumeLevel
    row: int
    col: int
    window: Window
    tiles: tuple[VolumeTile, ...]
    coarser: Window | None
    places: Window


def square_side(level: VolumeLevel, side: int) -> int:
    """Cells along a square that shows as much ground as `side` cells of the finest level, in whole tiles, one at least."""
    return SIDE * max((side >> level.number) // SIDE, 1)


def volume_squares(level: VolumeLevel, scene: VolumeScene, side: int) -> Iterator[VolumeSquare]:
    """The squares of a level, of `square_side`."""
    tiles = {(tile.window.row, tile.window.col): tile for tile in volume_tiles(level, scene)}
    for square in tiles_of(level.grid.shape, square_side(level, side)):
        window = square.window
        corners = ((window.row + one.window.row, window.col + one.window.col) for one in tiles_of(window.shape, SIDE))
        shown = tuple(tile for corner in corners if (tile := tiles[corner]).photos)
        coarser = enclosing(tile.coarser for tile in shown if tile.coarser)
        places = enclosing(tile.places for tile in shown)
        yield VolumeSquare(level, square.row, square.col, window, shown, None if coarser.empty else coarser, places)


def square_scratch(square: VolumeSquare, scene: VolumeScene) -> int:
    """Working memory of `solve_square` beside the photographs of its largest tile, bytes: whatever tile comes to most with its
    photographs."""
    memory = [tile_memory(tile, scene) for tile in square.tiles]
    return max((one.scratch + one.pixels for one in memory), default=0) - max((one.pixels for one in memory), default=0)


def solve_square(
    square: VolumeSquare,
    settings: HeightVolume,
    block: Block,
    photos: Iterable[tuple[np.ndarray, ...]] = (),
    terrain: np.ndarray | None = None,
    coarser: np.ndarray | None = None,
    reach: np.ndarray | None = None,
) -> SolvedVolume:
    """Every tile as `solve_volume` does it alone. photos: pixels (rows, cols, bands) of the photographs of each tile, in the order
    of the tiles; terrain, coarser, reach: as there, of the windows of the square."""
    whole, pixels = nothing(square.window.shape), iter(photos)
    for tile in square.tiles:
        near = _of(terrain, tile.places, square.places), _of(coarser, tile.coarser, square.coarser)
        # Bound to no name here: the photographs of a tile go before those of the next one are read.
        found = solve_volume(tile, settings, block, next(pixels), *near, _of(reach, tile.places, square.places))
        own = tile.window.within(square.window).slices
        whole.height[own], whole.quality[own] = found
    return whole


def _of(values: np.ndarray | None, window: Window | None, read: Window | None) -> np.ndarray | None:
    """The part of a window in values that were read for more."""
    return None if values is None or window is None or read is None else np.ascontiguousarray(values[window.within(read).slices])
