"""The relief of the surface by places: lowest and highest height of every block of cells.

What a tile of the orthoimage reads follows from the heights around it, so that its memory does not grow with a mountain at the far
end of the block.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from orthomill.schemas.job import Columns, Table
from orthomill.schemas.raster import MapGrid, Window
from orthomill.tasks.texture.ground.draping import BLOCK

SIDE = 64
"""Side of the blocks, cells; divides every tile."""


@dataclass(frozen=True)
class Relief(Columns):
    """The relief of the blocks that have heights."""

    row: np.ndarray
    col: np.ndarray
    """int32: number of the block in the whole model"""
    low: np.ndarray
    high: np.ndarray
    """float32 m"""


RELIEF = Table("texture/relief.parquet", Relief)


def relief_table(row: int, col: int) -> Table[Relief]:
    """The relief of a tile of the surface model."""
    return Table(f"texture/relief/{row}-{col}.parquet", Relief)


def tile_relief(heights: np.ndarray, window: Window, ground: np.ndarray | None = None) -> Relief:
    """The relief of a tile: heights (rows, cols) m at `window`, which starts on a block, NaN in holes.

    ground: heights of the blocks of BLOCK cells that the window touches, as from `pull_push.filled`, where holes are draped.
    """
    shape = window.reduced(SIDE).shape
    low, high = _extremes(heights, SIDE, shape)
    if ground is not None:
        lowest, highest = _extremes(ground, SIDE // BLOCK, shape)
        low, high = np.fmin(low, lowest), np.fmax(high, highest)
    row, col = np.nonzero(np.isfinite(low))
    first = window.reduced(SIDE)
    return Relief((row + first.row).astype(np.int32), (col + first.col).astype(np.int32), low[row, col], high[row, col])


def _extremes(values: np.ndarray, side: int, shape: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """float32 lowest and highest value of blocks of `side` x `side`, NaN where there is none."""
    padded = np.full((shape[0] * side, shape[1] * side), np.nan, np.float32)
    padded[: values.shape[0], : values.shape[1]] = values
    blocks = padded.reshape(shape[0], side, shape[1], side)
    return np.fmin.reduce(np.fmin.reduce(blocks, axis=3), axis=1), np.fmax.reduce(np.fmax.reduce(blocks, axis=3), axis=1)


def whole_relief(parts: tuple[Relief, ...]) -> Relief:
    """The relief of the whole model from that of its tiles."""
    return Relief(*(np.concatenate([getattr(part, name) for part in parts]) for name in ("row", "col", "low", "high")))


@dataclass(frozen=True)
class ReliefMap:
    """The relief as a map, to be asked for windows of cells."""

    relief: Relief
    grid: MapGrid

    @cached_property
    def _bounds(self) -> tuple[np.ndarray, np.ndarray]:
        shape = Window(0, 0, *self.grid.shape).reduced(SIDE).shape
        low, high = np.full(shape, np.inf, np.float32), np.full(shape, -np.inf, np.float32)
        low[self.relief.row, self.relief.col], high[self.relief.row, self.relief.col] = self.relief.low, self.relief.high
        return low, high

    @cached_property
    def highest(self) -> float:
        """The greatest height of the model, m; -inf without any height."""
        return float(self._bounds[1].max(initial=-np.inf))

    def over(self, cells: Window) -> tuple[float, float]:
        """(lowest, highest) height in m of the blocks that a window of cells touches; (inf, -inf) where there is none."""
        low, high = self._bounds
        blocks = cells.clipped(self.grid.shape).reduced(SIDE).slices
        return float(low[blocks].min(initial=np.inf)), float(high[blocks].max(initial=-np.inf))
