"""A second surface, which the photographs make from coarse to fine: what is forty pixels on the finest orthoimages is five on those
that are eight times coarser.

Strategy. The given surface only starts it: a median of many coarse cells, in which neither a spike nor a house is left. It is
checked like any other, moved to where the photographs agree, refined, and checked again. Errors of the given surface do not survive
that, however large, steep or narrow they are; nor do its walls, so that both surfaces are needed (`second_look.py`).
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from orthomill.schemas.epipolar import EpipolarPairs
from orthomill.schemas.orientation import Block
from orthomill.schemas.raster import MapGrid, Window
from orthomill.schemas.surface import Surface
from orthomill.tasks.dsm_check.areas import blocks, slopes
from orthomill.tasks.dsm_check.correction_map import CorrectionNodes
from orthomill.tasks.dsm_check.coverage import CheckedPairs, choose_checked_pairs
from orthomill.tasks.dsm_check.rounds.carried import carry
from orthomill.tasks.dsm_check.tile import NodeWindow, joint_nodes
from orthomill.tasks.imagery.resampling import between

_REACHED = 0.5
"""share of the reach of the finer search within which it finds an error by itself, whatever the ground around it does"""
PAIRED = 2
"""coarse cells along the blocks that tell a shift: the fewest that have a slope"""
_HALF = 0.5
"""share of the cells of a coarse one that must have a height"""
START_SIDE, _NARROW = 9, 5
"""coarse cells along the windows of the medians: at the beginning, where no error must be left, and from level to level"""
CARRIED = 24
"""coarse cells from which ground that no window judged takes its change: windows and search do not come nearer to a border"""
START_HALO, FINER_HALO = START_SIDE // 2, _NARROW // 2 + 1 + CARRIED
"""coarse cells around a tile that they need; one more for the interpolation"""


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


def start_surface(window: Window, given: Window, level: int, heights: np.ndarray) -> np.ndarray:
    """Where the second surface begins, in the coarse cells `window`: (rows, cols) float32 m; heights: of the surface under test, in
    the cells of the coarse ones `given`."""
    smooth = median_of_known(reduced_heights(heights, level), START_SIDE)
    return smooth[window.within(given).slices]


class FinestStart(NamedTuple):
    """The second surface as its last pass begins with it (m), and cells (uint8) whose given height is far from it."""

    second: np.ndarray
    far: np.ndarray


@dataclass(frozen=True)
class Far:
    """When a given height is far from the second surface: standard errors, and the height (m) that the search would not find."""

    significance: float
    beyond: float

    @staticmethod
    def of(significance: float, reach: int, pixel_height: float) -> "Far":
        """reach: pixels of the search; pixel_height: m, of a pixel of orthoimages of half the size."""
        return Far(significance, _REACHED * reach * pixel_height / 2)


def finer_surface(window: Window, given: Window, heights: np.ndarray, dh: np.ndarray) -> np.ndarray:
    """The second surface in cells `window` of the next level, float32 m, from heights and dh in the coarse cells `given`."""
    whole = Window(0, 0, *heights.shape)
    moved = carry(whole, whole, CARRIED, heights + dh, heights, dh)
    smooth = median_of_known(moved, _NARROW)
    smooth = np.where(np.isfinite(smooth), smooth, heights)
    row, col = (
        (first + np.arange(size) + 0.5) / 2 - 0.5 - corner
        for first, size, corner in ((window.row, window.height, given.row), (window.col, window.width, given.col))
    )
    # Constant beyond the centres of the outermost cells.
    row, col = (np.clip(at, 0, size - 1) for at, size in zip((row, col), smooth.shape, strict=True))
    return between(smooth, row, col).astype(np.float32)


def finest_surface(
    window: Window, given: Window, rule: Far, heights: np.ndarray, dh: np.ndarray, sigma: np.ndarray, under_test: np.ndarray
) -> FinestStart:
    """As `finer_surface`, for the cells of the surface `under_test` (window.shape) m; sigma: m, of dh."""
    inside = Window(window.row // 2, window.col // 2, -(-window.height // 2), -(-window.width // 2)).within(given).slices
    with np.errstate(invalid="ignore"):
        off = np.abs((heights + dh)[inside] - reduced_heights(under_test, 1))
        far = (off > rule.beyond) & (off > rule.significance * sigma[inside])
    cells = np.repeat(np.repeat(far, 2, 0), 2, 1)[: window.height, : window.width]
    return FinestStart(finer_surface(window, given, heights, dh), cells.astype(np.uint8))


def median_of_known(heights: np.ndarray, side: int) -> np.ndarray:
    """Median (rows, cols) float32 of the known heights in windows of `side` cells; NaN where fewer than a quarter are known."""
    half = side // 2
    padded = np.pad(heights.astype(np.float32), half, constant_values=np.nan)
    windows = np.lib.stride_tricks.sliding_window_view(padded, (side, side)).reshape(*heights.shape, side * side)
    # Sorted, NaN is last: the middle of those before it, without a warning for windows that hold nothing.
    ordered = np.sort(windows, axis=-1)
    number = np.isfinite(ordered).sum(axis=-1)
    low, high = (np.maximum(number - 1, 0) // 2, number // 2)
    pick = [np.take_along_axis(ordered, np.minimum(k, side * side - 1)[..., None], axis=-1)[..., 0] for k in (low, high)]
    return np.where(4 * number >= side * side, (pick[0] + pick[1]) / 2, np.nan).astype(np.float32)
