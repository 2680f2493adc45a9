"""The terrain of the cells of the surface model: between the blocks, and as measured where the surface is ground."""

from typing import NamedTuple

import numpy as np

from orthomill.schemas.raster import Window
from orthomill.tasks.imagery.resampling import between
from orthomill.tasks.terrain.ground.bridges import BANDS
from orthomill.tasks.terrain.ground.mean_value_fill import HALF, QUARTER


class CellGround(NamedTuple):
    """Of cells (rows, cols): height, its standard error among neighbours and that of the datum, float32 m, NaN where there is no
    terrain; whether it was measured, and whether it is bridged between ground on all sides."""

    height: np.ndarray
    sigma: np.ndarray
    datum: np.ndarray
    measured: np.ndarray
    bridged: np.ndarray


def blocks_around(window: Window, factor: int, shape: tuple[int, ...]) -> Window:
    """The blocks of `factor` cells (of `shape` in all) between whose centres the cells of a window lie."""
    return window.reduced(factor).grown(1).clipped(shape)


def cell_ground(
    bare: np.ndarray,
    open_side: np.ndarray,
    ground: np.ndarray,
    heights: np.ndarray,
    sigma: np.ndarray,
    measured: np.ndarray,
    place: tuple[Window, Window, int],
    rise: float,
) -> CellGround:
    """The ground of cells.

    bare (block rows, block cols, 4), open_side and ground (bool) of the blocks around; heights, sigma (rows, cols) m and measured
    (bool) of the cells; place: the window of the cells, that of the blocks, and cells along a block; `rise` m: how much ground may
    be off the mean of its block.
    """
    window, blocks, factor = place
    if factor == 1:
        inner = window.within(blocks).slices
        height, error, datum, added = (bare[inner][..., k] for k in range(BANDS))
        own, side = ground[inner], open_side[inner]
    else:
        row, col = _block_places(window, blocks, factor)
        height, error, datum, added = (between(bare[..., k], row, col) for k in range(BANDS))
        at = np.ix_(np.rint(row).astype(np.int64), np.rint(col).astype(np.int64))
        own, side = ground[at] & measured & (np.abs(heights - height) <= rise), open_side[at]
    # Inside a block the cell itself is the measurement: the mean of the block knows nothing of what is smaller. It is no better
    # than that, for neighbours share their errors.
    height, error = np.where(own, heights + added, height), np.where(own & (factor > 1), np.fmax(sigma, error), error)
    there = np.isfinite(height) & (np.isfinite(heights) | (side < QUARTER))
    height, error, datum = (np.where(there, values, np.nan).astype(np.float32) for values in (height, error, datum))
    return CellGround(height, error, datum, own & there, there & ~own & (side < HALF))


def _block_places(window: Window, blocks: Window, factor: int) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns of the centres of cells in the array of the blocks, held inside it."""
    row = (np.arange(window.row, window.row + window.height) + 0.5) / factor - 0.5 - blocks.row
    col = (np.arange(window.col, window.col + window.width) + 0.5) / factor - 0.5 - blocks.col
    return np.clip(row, 0, blocks.height - 1), np.clip(col, 0, blocks.width - 1)
