"""Large errors, found on coarse orthoimages: what is forty pixels there is five pixels of images eight times coarser.

Strategy. From coarse to fine: the surface is reduced, checked like any other, and moved by what the coarse check says where that is
certain and more than the next finer images would find by themselves. Smaller errors are left to them: a coarse cell mixes roof and
ground, and would spoil both. What no finer pass confirms is taken back at the end (`finish.py`).
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from orthomill.schemas.epipolar import EpipolarPairs
from orthomill.schemas.orientation import Block
from orthomill.schemas.raster import MapGrid, Window
from orthomill.schemas.surface import Surface
from orthomill.tasks.dsm_check.areas import blocks, slopes
from orthomill.tasks.dsm_check.correction_map import CorrectionMap, CorrectionNodes
from orthomill.tasks.dsm_check.coverage import CheckedPairs, choose_checked_pairs
from orthomill.tasks.dsm_check.tile import NodeWindow, joint_nodes, take_surface
from orthomill.tasks.imagery.resampling import between

_REACHED = 0.5
"""share of the reach of the finer search within which it finds an error by itself, whatever the ground around it does"""
PAIRED = 2
"""coarse cells along the blocks that tell a shift: the fewest that have a slope"""
_HALF = 0.5
"""share of the cells of a coarse one that must have a height"""


def level_surface(surface: Surface, level: int) -> Surface:
    """The grid of a level: cells 2^level times as wide, from the same corner."""
    grid, side = surface.grid, 2**level
    rows, cols = (-(-length // side) for length in grid.shape)
    coarse = MapGrid(west=grid.west, north=grid.north, cell=grid.cell * side, rows=rows, cols=cols)
    return Surface(grid=coarse, height_low=surface.height_low, height_high=surface.height_high)


def reduced_heights(heights: np.ndarray, level: int) -> np.ndarray:
    """Heights (rows, cols) float32 m of a level: means, NaN where half of the cells have none."""
    side = 2**level
    rows, cols = (-(-length // side) for length in heights.shape)
    padding = (0, rows * side - heights.shape[0]), (0, cols * side - heights.shape[1])
    folded = np.pad(heights.astype(np.float64), padding, constant_values=np.nan).reshape(rows, side, cols, side)
    number = np.isfinite(folded).sum(axis=(1, 3))
    mean = np.nan_to_num(folded).sum(axis=(1, 3)) / np.maximum(number, 1)
    return np.where(number >= _HALF * side**2, mean, np.nan).astype(np.float32)


def raised(heights: np.ndarray, up: float) -> np.ndarray:
    """Heights of a file (rows, cols) float32 m, raised by `up`; NaN where it has none."""
    return take_surface(heights + np.float32(up))


def choose_level_pairs(
    pairs: EpipolarPairs, block: Block, surface: Surface, level: int, tile: int, count: int | None, per_place: int
) -> CheckedPairs:
    """The pairs of a level; one pixel for a cell, because cells are coarser than the photographs here. Raises GeometryError."""
    return choose_checked_pairs(pairs, block, level_surface(surface, level), tile, count, 1, per_place)


class CoarseCells(NamedTuple):
    """A tile of a coarse check: dh and its standard error (m), and `areas.blocks` with slopes of every four cells (rows, cols, 5)
    float32."""

    dh: np.ndarray
    precision: np.ndarray
    coarse: np.ndarray


def judge_coarse(
    window: Window,
    pairs: tuple[NodeWindow, ...],
    grid: CorrectionNodes,
    cell: float,
    heights: np.ndarray,
    nodes: tuple[np.ndarray, ...] = (),
) -> CoarseCells:
    """What coarse orthoimages say of a tile; heights: (window.shape) m, of the reduced surface."""
    found = joint_nodes(window, pairs, grid, nodes).found
    dh, sigma = (np.where(np.isfinite(heights), band, np.float32(np.nan)) for band in (found.dh, found.sigma))
    bands = blocks(dh, sigma, PAIRED), slopes(heights, dh, PAIRED, cell)
    return CoarseCells(dh, sigma, np.concatenate(bands, axis=-1))


@dataclass(frozen=True)
class Proposal:
    """When a coarse correction moves the finer surface: standard errors, and the height (m) that finer images would not find."""

    level: int
    significance: float
    beyond: float

    @staticmethod
    def of(level: int, significance: float, reach: int, pixel_height: float) -> "Proposal":
        """reach: pixels of the search; pixel_height: m, of a pixel of the orthoimages of this level."""
        return Proposal(level, significance, _REACHED * reach * pixel_height / 2)


def move_surface(
    window: Window, given: Window, rule: Proposal, heights: np.ndarray, dh: np.ndarray, sigma: np.ndarray
) -> np.ndarray:
    """Heights (window.shape) float32 m, moved by coarse corrections dh with standard errors sigma in the coarse cells `given`."""
    certain = CorrectionMap(dh, sigma)
    with np.errstate(invalid="ignore"):
        good = (np.abs(certain.dh) > rule.significance * certain.sigma) & (np.abs(certain.dh) > rule.beyond)
    if not good.any():
        return heights
    side = 2**rule.level
    steps = np.where(good, np.nan_to_num(dh), 0.0)
    row = (window.row + np.arange(window.height) + 0.5) / side - 0.5 - given.row
    col = (window.col + np.arange(window.width) + 0.5) / side - 0.5 - given.col
    # Constant beyond the centres of the outermost cells.
    row, col = (np.clip(at, 0, size - 1) for at, size in zip((row, col), steps.shape, strict=True))
    return heights + between(steps, row, col)
