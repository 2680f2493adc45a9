"""One height per cell from all levels of the volume: the finest level that is sure of it.

Strategy. On open ground the finest level answers. In a wood its windows show single leaves, which no two photographs see alike,
while a coarser level sees crowns: there the coarser height, which is coherent and clearly the best, is a better guess than a fine
one that stands alone. Next to a roof edge it is the other way round: a coarse level is sure of the wrong surface. So a coarser
level is asked only where the finer heights stand alone far and wide; of those asked the finest that is sure gives the height, or
the most coherent one. Only the finest level measures; what a coarser one says about its larger cells is an estimate in the finer
ones. Next to the border of what two photographs see, where a part of the heights leaves a photograph, nothing is sure, and the
nearest height farther inside is the better guess.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy import ndimage

from orthomill.schemas.raster import Window
from orthomill.schemas.settings import Settings, setting
from orthomill.tasks.matching.volume.winners import COHERENCE_HALF


class Sureness(Settings):
    """When a height of the volume counts as measured."""

    coherence: float = setting(0.7, "Share of the cells around that must go along with it.", ge=0.0, le=1.0)
    margin: float = setting(
        0.25, "How much worse the photographs must fit at any other height.", "share of the bits", ge=0.0, le=2.5
    )

    def sure(self, quality: np.ndarray) -> np.ndarray:
        """(rows, cols) bool from the quality (rows, cols, 4) of a level."""
        return (quality[..., 2] >= 100 * self.coherence) & (quality[..., 1] >= 100 * self.margin)


_AROUND = 9
"""cells of a coarser level along the side of the square in which the finer heights must stand alone, that of its coherence"""


@dataclass(frozen=True)
class LevelsUnderTile:
    """A tile of the surface grid, and the window of every level (finest first) under it, with the surroundings that count."""

    window: Window
    levels: tuple[Window, ...]

    @classmethod
    def of(cls, window: Window, shapes: Sequence[tuple[int, ...]]) -> "LevelsUnderTile":
        """shapes: of the levels, finest first; level k has cells of 2^k cells."""
        around = _AROUND * 2 ** (len(shapes) - 1) // 2
        under = (_under(window, 2**k).grown(1 if k else around).clipped(shape) for k, shape in enumerate(shapes))
        return cls(window, tuple(under))


class MergedVolume(NamedTuple):
    """A tile: `height` (rows, cols) float32 m; `quality` (rows, cols, 4) uint8 of the level that it comes from; `level`
    (rows, cols) uint8, that level, `UNSURE` more where no level is sure."""

    height: np.ndarray
    quality: np.ndarray
    level: np.ndarray


UNSURE = 128
"""added to the level of a height that is an estimate"""


def merge_levels(
    tile: LevelsUnderTile, settings: Sureness, heights: tuple[np.ndarray, ...], qualities: tuple[np.ndarray, ...]
) -> MergedVolume:
    """heights, qualities: of the windows `tile.levels`."""
    enclosed = _enclosed(heights[0])
    height, quality = _calmed(heights[0], enclosed)[_inner(tile)], qualities[0][_inner(tile)].copy()
    level = np.where(settings.sure(quality) & enclosed[_inner(tile)], np.uint8(0), np.uint8(UNSURE))
    settled = level < UNSURE
    for k in range(1, len(heights)):
        if settled.all():
            break
        rows, cols = _places(tile, k)
        own = qualities[k][np.ix_(np.rint(rows).astype(int), np.rint(cols).astype(int))]
        sure = settings.sure(own)
        # An estimate gives way to one whose surroundings agree more; of equals the finer one stays.
        better = ~settled & _alone(qualities[0], k, settings)[_inner(tile)] & (sure | (own[..., 2] > quality[..., 2]))
        values = _interpolated(heights[k], rows, cols)
        better &= np.isfinite(values) & np.isfinite(height)
        height[better], quality[better] = values[better], own[better]
        level[better] = UNSURE + k
        settled |= better & sure
    return MergedVolume(height, quality, level)


def _enclosed(height: np.ndarray) -> np.ndarray:
    """(rows, cols) bool: cells all around which, as far as coherence looks, two photographs or more see."""
    return _box_sums(np.isfinite(height), COHERENCE_HALF) == (2 * COHERENCE_HALF + 1) ** 2


def _calmed(height: np.ndarray, enclosed: np.ndarray) -> np.ndarray:
    """The heights (rows, cols); those next to the border are those of the nearest cell that is not, where one is near."""
    # Left alone they run to the ends of their ranges, and hide ground from photographs as if they were walls.
    if not enclosed.any():
        return height.copy()
    distance, nearest = ndimage.distance_transform_edt(~enclosed, return_indices=True)
    rim = np.isfinite(height) & ~enclosed & (distance <= 2 * COHERENCE_HALF)
    return np.where(rim, height[tuple(nearest)], height).astype(np.float32)


def _alone(quality: np.ndarray, level: int, settings: Sureness) -> np.ndarray:
    """(rows, cols) bool: where the mean coherence of the finest heights over the surroundings of a coarser cell is too low."""
    half = _AROUND * 2**level // 2
    known = quality[..., 3] > 0
    return _box_sums(np.where(known, quality[..., 2], 0), half) < 100 * settings.coherence * _box_sums(known, half)


def _box_sums(values: np.ndarray, half: int) -> np.ndarray:
    """Sums (rows, cols) int64 over the cells up to `half` away in rows and columns."""
    # Integers: a running sum of floats would depend on where the window begins.
    total = values.astype(np.int64)
    for axis in (0, 1):
        sums = np.concatenate([np.zeros_like(total.take([0], axis)), np.cumsum(total, axis)], axis)
        size, at = total.shape[axis], np.arange(total.shape[axis])
        total = sums.take(np.minimum(at + half + 1, size), axis) - sums.take(np.maximum(at - half, 0), axis)
    return total


def _under(window: Window, factor: int) -> Window:
    row, col = window.row // factor, window.col // factor
    bottom, right = -(-(window.row + window.height) // factor), -(-(window.col + window.width) // factor)
    return Window(row, col, bottom - row, right - col)


def _inner(tile: LevelsUnderTile) -> tuple[slice, slice]:
    row, col = tile.window.row - tile.levels[0].row, tile.window.col - tile.levels[0].col
    return slice(row, row + tile.window.height), slice(col, col + tile.window.width)


def _places(tile: LevelsUnderTile, level: int) -> tuple[np.ndarray, np.ndarray]:
    """Row (height,) and column (width,) of the tile's cells in the window of a level, fractional, within it."""
    factor, window = 2**level, tile.levels[level]
    rows = (np.arange(tile.window.row, tile.window.row + tile.window.height) + 0.5) / factor - 0.5 - window.row
    cols = (np.arange(tile.window.col, tile.window.col + tile.window.width) + 0.5) / factor - 0.5 - window.col
    return np.clip(rows, 0, window.height - 1), np.clip(cols, 0, window.width - 1)


def _interpolated(heights: np.ndarray, rows: np.ndarray, cols: np.ndarray) -> np.ndarray:
    """Bilinear between the four cells around, the nearest where one of them is unknown; float32."""
    i, j = (np.minimum(at.astype(int), max(size - 2, 0)) for at, size in ((rows, heights.shape[0]), (cols, heights.shape[1])))
    below, right = np.minimum(i + 1, heights.shape[0] - 1), np.minimum(j + 1, heights.shape[1] - 1)
    s, t = (rows - i)[:, None], (cols - j)[None, :]
    upper = heights[np.ix_(i, j)] * (1 - t) + heights[np.ix_(i, right)] * t
    lower = heights[np.ix_(below, j)] * (1 - t) + heights[np.ix_(below, right)] * t
    nearest = heights[np.ix_(np.rint(rows).astype(int), np.rint(cols).astype(int))]
    smooth = upper * (1 - s) + lower * s
    return np.where(np.isfinite(smooth), smooth, nearest).astype(np.float32)
