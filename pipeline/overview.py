"""A raster in reduced size, whatever its size: read one chunk at a time and reduced on the way.

Heights and colours by the mean of the pixels that have a value, codes by the middle pixel of every block. Blocks need not fit
the chunks: a block that two chunks share is added up from both.
"""

from dataclasses import dataclass

import numpy as np

from pipeline.reading import ReadableStore
from schemas.raster import RasterSpec, Window, tiles_of

Reduced = tuple[tuple[slice, slice], np.ndarray, np.ndarray, np.ndarray]
"""(place in the overview, values (rows, cols, bands), pixels with a value (rows, cols, 1), all pixels (rows, cols, 1))"""


@dataclass(frozen=True)
class Overview:
    """A raster in reduced size: `values` (rows, cols) or (rows, cols, bands), float64, NaN where there is none.

    `share` (rows, cols) is the part of the original pixels that have a value, 0 to 1; `factor` the reduction.
    """

    values: np.ndarray
    share: np.ndarray
    factor: int


def overview(store: ReadableStore, name: str, limit: int, nearest: bool) -> Overview:
    """A raster reduced by a whole factor to `limit` px or less, reading one chunk at a time.

    `nearest` takes the middle pixel of every block; otherwise the mean of its pixels that have a value (finite, not nodata,
    alpha above 0). Blocks without any are NaN.
    """
    spec = store.spec(name)
    factor = max(1, -(-max(spec.shape[:2]) // limit))
    rows, cols = -(-spec.shape[0] // factor), -(-spec.shape[1] // factor)
    bands = spec.shape[2] if len(spec.shape) == 3 else 1
    total, count, area = np.zeros((rows, cols, bands)), np.zeros((rows, cols, 1)), np.zeros((rows, cols, 1))
    reduced = _thinned if nearest else _summed
    for tile in tiles_of(spec.shape, max(spec.chunk, 64)):
        place, values, present, pixels = reduced(spec, *_pixels(store, spec, tile.window), tile.window, factor)
        total[place] += values
        count[place] += present
        area[place] += pixels
    with np.errstate(invalid="ignore"):
        means = np.where(count > 0, total / count, np.nan)
    return Overview(means if len(spec.shape) == 3 else means[..., 0], (count / np.maximum(area, 1))[..., 0], factor)


def _pixels(store: ReadableStore, spec: RasterSpec, window: Window) -> tuple[np.ndarray, np.ndarray]:
    """Values (h, w, bands) float64, 0 where absent, and presence (h, w, 1)."""
    raw = store.read(spec.name, window)
    raw = raw[..., None] if raw.ndim == 2 else raw
    present = np.isfinite(raw).all(axis=2, keepdims=True)
    if spec.nodata is not None:
        present &= (raw != spec.nodata).any(axis=2, keepdims=True)
    if raw.shape[2] == 4:
        present &= raw[..., 3:] > 0
    return np.where(present, raw, 0).astype(np.float64), present.astype(np.float64)


def _summed(spec: RasterSpec, values: np.ndarray, present: np.ndarray, window: Window, factor: int) -> Reduced:
    """Sums over the blocks that the window touches; a block cut by two windows gets a part from each."""
    rows, row_starts = _blocks(window.row, window.height, factor)
    cols, col_starts = _blocks(window.col, window.width, factor)

    def sums(array: np.ndarray) -> np.ndarray:
        return np.add.reduceat(np.add.reduceat(array, row_starts, axis=0), col_starts, axis=1)

    return (rows, cols), sums(values), sums(present), sums(np.ones_like(present))


def _blocks(start: int, length: int, factor: int) -> tuple[slice, np.ndarray]:
    """Which blocks the pixels from `start` belong to, and where each block begins among them."""
    block = np.arange(start, start + length) // factor
    return slice(int(block[0]), int(block[-1]) + 1), np.flatnonzero(np.diff(block, prepend=block[0] - 1))


def _thinned(spec: RasterSpec, values: np.ndarray, present: np.ndarray, window: Window, factor: int) -> Reduced:
    """The middle pixels of the blocks whose middle lies in the window."""
    rows, row_pick = _middles(window.row, window.height, factor, spec.shape[0])
    cols, col_pick = _middles(window.col, window.width, factor, spec.shape[1])
    picked = np.ix_(row_pick, col_pick)
    return (rows, cols), values[picked], present[picked], np.ones_like(present[picked])


def _middles(start: int, length: int, factor: int, size: int) -> tuple[slice, np.ndarray]:
    """Blocks whose middle pixel (the last pixel in a cut block) lies in the window, and that pixel's place in the window."""
    blocks = np.arange(-(-size // factor))
    middle = np.minimum(blocks * factor + factor // 2, size - 1)
    inside = blocks[(middle >= start) & (middle < start + length)]
    first = int(inside[0]) if len(inside) else 0
    return slice(first, first + len(inside)), middle[inside] - start
