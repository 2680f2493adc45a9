"""What a tile of the volume says about its heights: one byte each, in the bands of one raster."""

from enum import IntEnum

import numpy as np

SPREAD_UNIT = 16
"""spreads of the raster per step between heights"""
STRETCH_UNIT = 16
"""stretches of the raster per step between heights"""
LEVEL_UNIT = 24
"""parts of a level in the raster"""


class Band(IntEnum):
    """The bands (rows, cols, 5) uint8 of a quality raster."""

    MARGIN = 0
    """by which the next best height is dearer, % of the bits of a signature"""
    COHERENCE = 1
    """% of the 9 x 9 cells around that go along with the height"""
    SEEN = 2
    """photographs that see the cell: fewer than two where something else stands before the others"""
    SPREAD = 3
    """of the rivals of the height, 1/SPREAD_UNIT steps"""
    STRETCH = 4
    """1/STRETCH_UNIT steps that count as one where bases are narrow or pixels large"""


def quality_bands(
    margin: np.ndarray, coherence: np.ndarray, seen: np.ndarray, spread: np.ndarray, stretch: np.ndarray
) -> np.ndarray:
    """(rows, cols, 5) uint8 from margin and coherence as shares, photographs, and spread and stretch in steps; too large values are
    cut off."""
    bands = (100 * margin, 100 * coherence, seen, SPREAD_UNIT * spread, STRETCH_UNIT * stretch)
    return np.stack([np.clip(np.rint(band), 0, 255).astype(np.uint8) for band in bands], axis=-1)


class Judgement(IntEnum):
    """The bands (rows, cols, 5) uint8 of a raster that judges the finest level."""

    COHERENCE = 0
    """as `Band.COHERENCE`"""
    DISTINCTIVENESS = 1
    """mean margin of a cell and its neighbours, % of that of the surroundings"""
    SPREAD = 2
    """root mean square spread of a cell and its neighbours, 1/SPREAD_UNIT steps"""
    STRETCH = 3
    """as `Band.STRETCH`"""
    LEVEL = 4
    """the level whose steps say what a height is worth that stands alone at the finest, 1/LEVEL_UNIT levels"""


SURROUNDINGS = 32
"""cells on every side over which margins are compared"""
FAR = 18
"""cells on every side whose mean coherence says whether heights go along with each other far and wide"""
_MOST = 100
"""% of the bits, a margin beyond which no rival matters"""


def judgement(quality: np.ndarray) -> np.ndarray:
    """(rows, cols, 5) uint8, see `Judgement`, of a quality (rows, cols, 5), without a level; nearer than SURROUNDINGS to an edge
    that is not one of the whole raster cells differ.

    How much worse rivals fit depends on texture, noise and the number of photographs. All of these change slowly: a place where
    the margin is far below that of its surroundings is one where the photographs differ (leaves, something that moved, an edge).
    """
    known = quality[..., Band.SEEN] > 0
    margin = np.where(known, np.minimum(quality[..., Band.MARGIN], _MOST), 0)
    squares = np.where(known, quality[..., Band.SPREAD].astype(np.int64) ** 2, 0)
    near, wide = (np.maximum(box_sums(known, half), 1) for half in (1, SURROUNDINGS))
    usual = np.maximum(box_sums(margin, SURROUNDINGS), 1) / wide
    distinctiveness = 100 * box_sums(margin, 1) / near / usual
    spread = np.rint(np.sqrt(box_sums(squares, 1) / near))
    no_level = np.zeros(known.shape, np.uint8)
    bands = quality[..., Band.COHERENCE], np.rint(distinctiveness), spread, quality[..., Band.STRETCH], no_level
    return np.stack([np.minimum(band, 255).astype(np.uint8) for band in bands], axis=-1)


def coheres_less(coherence: np.ndarray, counted: np.ndarray, limit: int) -> np.ndarray:
    """(rows, cols) bool: where the mean `coherence` (rows, cols), % as `Band.COHERENCE`, of the cells far and wide that are
    `counted` (rows, cols) bool is below `limit`, %."""
    return box_sums(np.where(counted, coherence, 0), FAR) < limit * box_sums(counted, FAR)


def box_sums(values: np.ndarray, half: int) -> np.ndarray:
    """Sums (rows, cols) int64 over the cells up to `half` away in rows and columns."""
    # Integers: a running sum of floats would depend on where the window begins.
    total = values.astype(np.int64)
    for axis in (0, 1):
        sums = np.concatenate([np.zeros_like(total.take([0], axis)), np.cumsum(total, axis)], axis)
        size, at = total.shape[axis], np.arange(total.shape[axis])
        total = sums.take(np.minimum(at + half + 1, size), axis) - sums.take(np.maximum(at - half, 0), axis)
    return total
