"""Blocks of cells in which water is looked for: where heights stand alone far and wide, and how high the ground is
elsewhere.

Strategy. A lake is looked for on the whole surface at once, so that no tile cuts it; of cells this would be too many. A block says
what is asked of it: a raw height of the volume where its cells stand alone (see confidence.py), the mean of the heights that were
measured in it where most were, and how much of it was seen.
"""

from enum import IntEnum

import numpy as np

from orthomill.schemas.raster import MapGrid
from orthomill.tasks.densification.volume.confidence import Confidence
from orthomill.tasks.densification.volume.levels import SIDE, level_grid

_FINEST, _MOST_BLOCKS = 2, 1 << 22
"""halvings: blocks are 4 cells wide, or so many times two that there are no more of them"""
_ALONE = (Confidence.CALMED, Confidence.COARSE)


class BlockBand(IntEnum):
    """The bands (rows, cols, 3) float32 of a raster of blocks."""

    SPECKLE = 0
    """m, the raw height of the middle cell; NaN where most cells do not stand alone"""
    MEASURED = 1
    """m, the mean of the measured heights; NaN where half of the cells have none"""
    SEEN = 2
    """share of the cells that two photographs see"""


def block_grid(grid: MapGrid) -> MapGrid:
    """The grid of the blocks: 4 x 4 cells of the surface, more where it is very large."""
    halvings = _FINEST
    while 2**halvings < SIDE and level_grid(grid, halvings).cells > _MOST_BLOCKS:
        halvings += 1
    return level_grid(grid, halvings)


def speckle_blocks(raw: np.ndarray, judged: np.ndarray, confidence: np.ndarray, factor: int) -> np.ndarray:
    """(rows, cols, 3) float32, see `BlockBand`, of blocks of `factor` x `factor` cells; the last ones may have fewer.

    raw (rows, cols) m: heights of the finest level of the volume; judged (rows, cols) m and confidence (rows, cols), see
    `Confidence`: what was made of them.
    """
    alone, known = np.isin(confidence, _ALONE) & np.isfinite(raw), np.isfinite(raw)
    measured = (confidence == Confidence.HIGH) & np.isfinite(judged)
    speckled = 2 * _in_blocks(alone, factor, False).sum(axis=-1) > _in_blocks(known, factor, False).sum(axis=-1)
    middle = _in_blocks(raw, factor, np.nan)[..., factor * (factor // 2) + factor // 2]
    count = _in_blocks(measured, factor, False).sum(axis=-1)
    total = _in_blocks(np.where(measured, judged, 0.0), factor, 0.0).sum(axis=-1)
    mean = np.where(2 * count >= factor * factor, total / np.maximum(count, 1), np.nan)
    seen = _in_blocks(known, factor, False).sum(axis=-1) / _in_blocks(np.ones(raw.shape, bool), factor, False).sum(axis=-1)
    bands = np.where(speckled, middle, np.nan), mean, seen
    return np.stack(bands, axis=-1).astype(np.float32)


def _in_blocks(values: np.ndarray, factor: int, beyond: float | bool) -> np.ndarray:
    """(block rows, block cols, factor * factor): the values (rows, cols), `beyond` outside of them."""
    rows, cols = (-(-side // factor) for side in values.shape)
    padded = np.full((rows * factor, cols * factor), beyond, values.dtype)
    padded[: values.shape[0], : values.shape[1]] = values
    return padded.reshape(rows, factor, cols, factor).swapaxes(1, 2).reshape(rows, cols, factor * factor)
