"""Heights of the finest level of the volume at which a place is coherent, for places whose finest heights contradict one another.

Strategy. Leaves have heights of their own that no neighbour shares; the crown that they make shows on a coarser level, whose cells
and steps are larger. From the coarsest level on, each takes over where its cells go along with one another, by degrees, so that no
step marks where one ends and the next begins; where it does not, the surface of the levels above goes on, interpolated. What no
level shows is closed from its surroundings, and from the tie points where nothing around is known either.

What such a height is worth: surfaces from disjoint halves of the photographs differ by 1.15 steps of that level and less, on three
levels alike (`python -m benchmarks disjoint_halves`). What no level shows is as uncertain as the heights of the coarsest one around
lie from it, and no less than a crown is deep.

Source: of the composition, Burt and Adelson 1983 (a multiresolution spline); of the closing, Gortler et al. 1996.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy import ndimage

from orthomill.schemas.raster import Window
from orthomill.tasks.imagery.pull_push import doubled

_NONE_YET, _WHOLLY = 60.0, 85.0
"""% of the cells around that go along, from which a level begins to take over, and from which it alone counts"""
SHOWN = 0.5
"""share of a height that comes from levels that are coherent there, from which on they show it"""
_CLOSING = 3
"""halvings of the coarsest level over which gaps are closed from their surroundings"""
_TIES = 0.05
"""weight of the tie points: as much as surroundings of which one cell in twenty is shown"""
_STEPS = 1.15
"""standard error of a height, steps of the level that shows it"""
_SCATTER = 4
"""cells on every side of the coarsest level over which heights scatter"""
_DEEP = 2.0
"""m, least standard error of a height that no level shows"""


class ShownHeights(NamedTuple):
    """Of every cell (rows, cols): `height` float32 m; `level` float32 whose steps say what it is worth (see `standard_errors`),
    between two where one passes into the next; `shown` bool: by a level that is coherent there."""

    height: np.ndarray
    level: np.ndarray
    shown: np.ndarray


@dataclass(frozen=True)
class LevelWindows:
    """The windows of the levels, the finest first, from which the heights of a window of the finest follow."""

    window: Window
    read: tuple[Window, ...]
    """what is smoothed: those that are made, with a cell more around them"""
    made: tuple[Window, ...]
    """cells of which each level gives a height; those past the last level close gaps"""

    @classmethod
    def of(cls, window: Window, shapes: Sequence[tuple[int, int]]) -> "LevelWindows":
        """window: of the finest level; shapes: of all levels, the finest first."""
        shapes, made = list(shapes), [window]
        for _ in range(_CLOSING):
            shapes.append((-(-shapes[-1][0] // 2), -(-shapes[-1][1] // 2)))
        for shape in shapes[1:]:
            made.append(made[-1].reduced(2).grown(1).clipped(shape))
        # What is halved must be there in whole blocks.
        for level in range(len(made) - 1, len(made) - 1 - _CLOSING, -1):
            made[level - 1] = made[level].scaled(2).clipped(shapes[level - 1])
        levels = len(shapes) - _CLOSING
        spare = [1] * (levels - 1) + [_SCATTER]
        read = tuple(here.grown(more).clipped(shape) for here, more, shape in zip(made, spare, shapes, strict=False))
        return cls(window, read, tuple(made))


def shown_heights(
    windows: LevelWindows, heights: Sequence[np.ndarray], coherence: Sequence[np.ndarray], terrain: np.ndarray, step: float
) -> ShownHeights:
    """The heights of the window of the finest level.

    heights (rows, cols) m, NaN for none, and coherence (rows, cols) % of `windows.read`, the finest level first; terrain (rows,
    cols) m: of the tie points, at the cells of the finest level; step: between its heights, m.
    """
    inner = [made.within(read).slices for made, read in zip(windows.made, windows.read, strict=False)]
    layers = [_layer(height, share, level) for level, (height, share) in enumerate(zip(heights, coherence, strict=True))]
    layers[-1][4:] = (1 - layers[-1][0]) * _around(heights[-1])
    layers = [layer[:, rows, cols] for layer, (rows, cols) in zip(layers, inner, strict=True)]
    whole = _closed(layers[-1], windows.made[len(layers) - 1 :])
    for level in range(len(layers) - 2, -1, -1):
        whole = _over(layers[level], whole, windows.made[level], windows.made[level + 1])
    # A volume of one level closes its gaps over more than the window.
    own = windows.window.within(windows.made[0]).slices
    share, weight, height, level, mean, square = whole[(slice(None), *own)]
    rest = 1 - share
    height = (height + _TIES * rest * terrain) / (weight + _TIES * rest)
    shown = share >= SHOWN
    # How far the heights around lie from what is said here: they scatter, and the tie points may know of no crown at all.
    mean, square = (values / np.maximum(rest, 1e-12) for values in (mean, square))
    away = np.sqrt(np.maximum(square + height * (height - 2 * mean), 0))
    unshown = np.log2(np.maximum(away, _DEEP) / (_STEPS * step))
    level = np.where(shown, level / np.maximum(weight, 1e-12), np.maximum(unshown, 0))
    return ShownHeights(height.astype(np.float32), level.astype(np.float32), shown)


def standard_errors(level: np.ndarray, step: float) -> np.ndarray:
    """Of heights (rows, cols) float32, m, from their level; step: between the heights of the finest level, m."""
    return (np.float32(_STEPS * step) * np.exp2(level)).astype(np.float32)


def _layer(height: np.ndarray, coherence: np.ndarray, level: int) -> np.ndarray:
    """(6, rows, cols) float64 of a level: share of the height that it shows, weight, weight times height and times level, and
    nothing of the heights around."""
    weight = np.clip((coherence.astype(np.float64) - _NONE_YET) / (_WHOLLY - _NONE_YET), 0, 1) * np.isfinite(height)
    around = _smoothed(np.stack([weight, weight * np.nan_to_num(height)]))
    smooth = around[1] / np.maximum(around[0], 1e-12)
    return np.stack([weight, weight, weight * smooth, weight * level, np.zeros_like(weight), np.zeros_like(weight)])


def _around(height: np.ndarray) -> np.ndarray:
    """Mean, and mean square (2, rows, cols) of the heights around, m and m^2; 0 where there are none."""
    known = np.isfinite(height)
    value = np.where(known, height, 0).astype(np.float64)
    count = np.maximum(_sums(known.astype(np.float64)), 1)
    return np.stack([_sums(value) / count, _sums(value**2) / count])


def _sums(values: np.ndarray) -> np.ndarray:
    """Sums (rows, cols) over the cells up to _SCATTER away; nothing beyond the edges."""
    for axis in (0, 1):
        values = ndimage.correlate1d(values, np.ones(2 * _SCATTER + 1), axis, mode="constant")
    return values


def _smoothed(values: np.ndarray) -> np.ndarray:
    """Means (bands, rows, cols) of 3 x 3 cells with the weights 1, 2, 1; nothing beyond the edges."""
    for axis in (1, 2):
        spare = np.pad(values, [(1, 1) if k == axis else (0, 0) for k in range(3)])
        size = values.shape[axis]
        before, here, after = (spare.take(range(start, start + size), axis) for start in range(3))
        values = 0.25 * before + 0.5 * here + 0.25 * after
    return values


def _over(layer: np.ndarray, whole: np.ndarray, window: Window, coarser: Window) -> np.ndarray:
    """A level over the surface of those above it; their windows."""
    return layer + (1 - layer[0]) * _finer(whole, window, coarser)


def _finer(whole: np.ndarray, window: Window, coarser: Window) -> np.ndarray:
    """The bands of a coarser window at the cells of `window`."""
    place = window.within(coarser.scaled(2))
    twice = coarser.height * 2, coarser.width * 2
    return np.stack([doubled(band, twice)[place.slices] for band in whole])


def _closed(layer: np.ndarray, windows: Sequence[Window]) -> np.ndarray:
    """The coarsest level with its gaps closed from their surroundings; what is closed has weight, but no share. windows: of the
    level, and of its halvings."""
    if len(windows) == 1:
        return layer
    coarser = _closed(_halved(layer, windows[1]), windows[1:])
    beyond = _finer(coarser, windows[0], windows[1])
    # A gap that is closed is shown by nothing, and what lies around is what it was.
    beyond[0], beyond[4:] = 0, 0
    return layer + (1 - layer[1]) * beyond


def _halved(layer: np.ndarray, window: Window) -> np.ndarray:
    """Means over blocks of 2 x 2 cells."""
    rows, cols = layer.shape[1:]
    spare = np.pad(layer, [(0, 0), (0, 2 * window.height - rows), (0, 2 * window.width - cols)])
    blocks = spare.reshape(len(spare), window.height, 2, window.width, 2)
    # Without dividing by the weight: what is shown in few cells of a block counts for little.
    return 0.25 * (blocks[:, :, 0, :, 0] + blocks[:, :, 0, :, 1] + blocks[:, :, 1, :, 0] + blocks[:, :, 1, :, 1])
