"""The heights that the depth maps of narrow pairs agree on, over the cells of a tile."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from orthomill.schemas.epipolar import EpipolarPair
from orthomill.schemas.memory import array_bytes
from orthomill.schemas.raster import MapGrid, Window
from orthomill.schemas.surface import Surface
from orthomill.tasks.densification.canopy.depth_map import STEP
from orthomill.tasks.densification.canopy.votes import MOST, SightToCells, cast, elected, group, look, smoothed
from orthomill.tasks.densification.ground_intersection import nodes_on_ground
from orthomill.tasks.densification.precision.natural_sizes import LEAVES, natural
from orthomill.tasks.densification.surface_grid import ground_pixel
from orthomill.tasks.geometry.epipolar_window import box_corners, node_window

_COVERS = 1.0
"""pixels of a depth map on every side of a place that it speaks for: its own half, and as much that its window mixes in"""
_SMOOTH = 1.25
"""pixels on every side over which heights are smoothed"""
_ONE_CROWN = 2.5
"""m by which votes for one crown may differ: leaves, and the slope of the crown over what a pixel covers"""
_WIDEST = 8
"""cells on every side at most: a photograph from far away does not blur what others see from near"""


@dataclass(frozen=True)
class DepthPiece:
    """The pixels `window` of the depth map of a pair."""

    pair: EpipolarPair
    window: Window


@dataclass(frozen=True)
class CanopyTile:
    """The cells `window`, those `around` them whose heights they are smoothed from, and what is read of the depth maps."""

    surface: Surface
    window: Window
    around: Window
    smooth: int
    """cells on every side"""
    pieces: tuple[DepthPiece, ...]

    @classmethod
    def of(cls, surface: Surface, window: Window, pairs: tuple[EpipolarPair, ...]) -> "CanopyTile":
        """pairs: those that have a depth map; one or more."""
        grid = surface.grid
        smooth = min(round(_SMOOTH * float(np.median([pixel_of(pair) for pair in pairs])) / grid.cell), _WIDEST)
        around = window.grown(smooth).clipped(grid.shape)
        corners = box_corners(grid, around.grown(_WIDEST), surface.height_low, surface.height_high)
        pieces = (DepthPiece(pair, node_window(pair, STEP, corners)) for pair in pairs)
        return cls(surface, window, around, smooth, tuple(piece for piece in pieces if not piece.window.empty))

    @property
    def scratch(self) -> int:
        """Working memory of `canopy_heights`, bytes."""
        largest = max((piece.window.cells for piece in self.pieces), default=0)
        return array_bytes(6 * MOST + 24, self.around) + array_bytes(100, largest)


def pixel_of(pair: EpipolarPair) -> float:
    """Side of a pixel of the depth map on the mean ground, m."""
    return ground_pixel(pair) * STEP


def canopy_heights(tile: CanopyTile, maps: Iterable[np.ndarray]) -> np.ndarray:
    """Heights (rows, cols) float32 m of the cells `tile.window`, NaN where too few maps agree.

    maps: parallaxes (rows, cols) px, one for every piece of the tile, in their order, and all of them once more: they vote first,
    and then look at what was voted for.
    """
    read, cell = iter(maps), tile.surface.grid.cell
    votes, count = np.empty((MOST, *tile.around.shape), np.float32), np.zeros(tile.around.shape, np.uint8)
    highest = np.empty(tile.around.shape, np.float32)
    for piece, parallax in zip(tile.pieces, read, strict=False):
        reach = min(_COVERS * pixel_of(piece.pair) / cell, float(_WIDEST))
        cast(votes, count, _places(tile, piece, parallax), reach, highest)
    group(votes, count, natural(_ONE_CROWN, cell))
    lines = np.zeros((2, *votes.shape), np.uint8)
    for piece, parallax in zip(tile.pieces, read, strict=True):
        look(votes, count, lines, np.ascontiguousarray(parallax, np.float32), _sight(tile, piece), natural(LEAVES, cell))
    return smoothed(elected(votes, count, lines), tile.smooth)[tile.window.within(tile.around).slices]


def _sight(tile: CanopyTile, piece: DepthPiece) -> SightToCells:
    pair, grid = piece.pair, tile.surface.grid
    # The centre of pixel k lies at STEP k + (STEP - 1) / 2 of the image.
    col0, row0 = ((at - (STEP - 1) / 2) / STEP for at in (pair.left_col0, pair.row0))
    return SightToCells(
        rotation=np.array(pair.rotation),
        centre=np.array(pair.left_centre),
        scale=pair.c / STEP,
        col0=col0 - piece.window.col,
        row0=row0 - piece.window.row,
        base=pair.base * pair.c,
        west=grid.west + tile.around.col * grid.cell,
        north=grid.north - tile.around.row * grid.cell,
        cell=grid.cell,
    )


def _places(tile: CanopyTile, piece: DepthPiece, parallax: np.ndarray) -> np.ndarray:
    """Column and row in the cells around the tile, and height m (3, N), of the pixels of a depth map."""
    # The centre of pixel k lies at STEP k + (STEP - 1) / 2 of the image.
    half, pair = (STEP - 1) / 2, piece.pair
    centred = pair.model_copy(update={"left_col0": pair.left_col0 - half, "row0": pair.row0 - half})
    ground = nodes_on_ground(centred, np.stack([parallax, np.zeros_like(parallax)], axis=-1), piece.window, STEP)
    grid: MapGrid = tile.surface.grid
    col, row = grid.pixel(ground.x, ground.y)
    within = (ground.z >= tile.surface.height_low) & (ground.z <= tile.surface.height_high)
    height = np.where(within, ground.z, np.nan)
    col = np.where(within, col - tile.around.col, np.nan)
    return np.stack([col.ravel(), (row - tile.around.row).ravel(), height.ravel()])
