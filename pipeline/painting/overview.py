"""A raster of any size at reduced resolution: read one chunk at a time and reduced immediately.

Heights and colours by the mean of the pixels that have a value, codes by the middle pixel of every block. Blocks need not be
aligned with the chunks: a block that two chunks share is accumulated from both.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from math import ceil, sqrt

import numpy as np

from orthomill.pipeline.storage.reading import ReadableStore
from orthomill.schemas.raster import RasterSpec, Tile, Window, tiles_of

Reduced = tuple[tuple[slice, slice], np.ndarray, np.ndarray, np.ndarray]
"""(place in the overview, values (rows, cols, bands), pixels with a value (rows, cols, 1), all pixels (rows, cols, 1))"""


@dataclass(frozen=True)
class Overview:
    """A raster at reduced resolution: `values` (rows, cols) or (rows, cols, bands), float64, NaN where there is none.

    `share` (rows, cols) is the fraction of the original pixels that have a value, 0 to 1; `factor` the reduction.
    """

    values: np.ndarray
    share: np.ndarray
    factor: int


def overview(store: ReadableStore, name: str, limit: int, nearest: bool, most: int | None = None) -> Overview:
    """A raster reduced by an integer factor to `limit` px or less, reading one chunk at a time; of a raster of more than `most`
    chunks about so many, spread evenly.

    `nearest` takes the middle pixel of every block; otherwise the mean of its pixels that have a value (finite, not nodata,
    alpha above 0). Blocks without any are NaN.
    """
    spec = store.spec(name)
    factor = max(1, -(-max(spec.shape[:2]) // limit))
    rows, cols = -(-spec.shape[0] // factor), -(-spec.shape[1] // factor)
    bands = spec.shape[2] if len(spec.shape) == 3 else 1
    total, count, area = np.zeros((rows, cols, bands)), np.zeros((rows, cols, 1)), np.zeros((rows, cols, 1))
    # The mean of two codes is a third code, so codes are picked and never averaged.
    reduced = _thinned if nearest else _summed
    for tile in _spread(tiles_of(spec.shape, max(spec.chunk, 64)), most):
        place, values, present, pixels = reduced(spec, _bands(store.read(spec.name, tile.window)), tile.window, factor)
        total[place] += values
        count[place] += present
        area[place] += pixels
    with np.errstate(invalid="ignore"):  # 0 / 0 where a block has no value, which `where` replaces
        means = np.where(count > 0, total / count, np.nan)
    return Overview(means if len(spec.shape) == 3 else means[..., 0], (count / np.maximum(area, 1))[..., 0], factor)


def _spread(tiles: Iterator[Tile], most: int | None) -> list[Tile]:
    """Every so many-th row and column of tiles."""
    known = list(tiles)
    every = ceil(sqrt(len(known) / most)) if most and len(known) > most else 1
    return [tile for tile in known if tile.row % every == 0 and tile.col % every == 0]


def _bands(raw: np.ndarray) -> np.ndarray:
    return raw[..., None] if raw.ndim == 2 else raw


def _present(spec: RasterSpec, raw: np.ndarray) -> np.ndarray:
    """Which pixels (h, w, 1) have a value."""
    present = np.isfinite(raw).all(axis=2, keepdims=True) if raw.dtype.kind == "f" else np.ones((*raw.shape[:2], 1), bool)
    if spec.nodata is not None and spec.nodata == spec.nodata:  # a nodata of NaN, not equal to itself, is covered by isfinite
        present &= (raw != spec.nodata).any(axis=2, keepdims=True)
    if raw.shape[2] == 4:
        present &= raw[..., 3:] > 0
    return present


def _summed(spec: RasterSpec, raw: np.ndarray, window: Window, factor: int) -> Reduced:
    """Sums over the blocks that overlap the window; a block divided between two windows gets a part from each."""
    rows, high = _blocks(window.row, window.height, factor)
    cols, wide = _blocks(window.col, window.width, factor)
    area = np.outer(high, wide)[..., None]
    present = _present(spec, raw)
    # The usual case, and the fast one: no copy of the pixels, and no second sum.
    if present.all():
        return (rows, cols), _block_sums(raw, window, factor), area, area
    return (rows, cols), _block_sums(np.where(present, raw, 0), window, factor), _block_sums(present, window, factor), area


def _block_sums(array: np.ndarray, window: Window, factor: int) -> np.ndarray:
    """Sums over the blocks (rows, cols, bands) float64 of the pixels of a window."""
    # All first rows of blocks at once, then all second rows, and so on: `factor` vector operations instead of one per block.
    lines = _sums_along(array, window.row, factor)
    return _sums_along(lines.swapaxes(0, 1), window.col, factor).swapaxes(0, 1)


def _sums_along(array: np.ndarray, start: int, factor: int) -> np.ndarray:
    """Sums over blocks along the first axis, whose first line is number `start` of the whole raster."""
    out = np.zeros(((start + len(array) - 1) // factor - start // factor + 1, *array.shape[1:]))
    for first in range(min(factor, len(array))):
        part = array[first::factor]
        block = (start + first) // factor - start // factor
        out[block : block + len(part)] += part
    return out


def _blocks(start: int, length: int, factor: int) -> tuple[slice, np.ndarray]:
    """Which blocks the pixels from `start` belong to, and how many of them fall in each."""
    first, last = start // factor, (start + length - 1) // factor
    borders = np.clip(np.arange(first, last + 2) * factor, start, start + length)
    return slice(first, last + 1), np.diff(borders)


def _thinned(spec: RasterSpec, raw: np.ndarray, window: Window, factor: int) -> Reduced:
    """The middle pixels of the blocks whose middle lies in the window."""
    rows, row_pick = _middles(window.row, window.height, factor, spec.shape[0])
    cols, col_pick = _middles(window.col, window.width, factor, spec.shape[1])
    picked = raw[np.ix_(row_pick, col_pick)]
    present = _present(spec, picked)
    return (rows, cols), np.where(present, picked, 0), present, np.ones_like(present)


def _middles(start: int, length: int, factor: int, size: int) -> tuple[slice, np.ndarray]:
    """Blocks whose middle pixel (in an incomplete block: at most its last one) is in the window, and its place in the window."""
    blocks = np.arange(-(-size // factor))
    middle = np.minimum(blocks * factor + factor // 2, size - 1)
    inside = blocks[(middle >= start) & (middle < start + length)]
    first = int(inside[0]) if len(inside) else 0
    return slice(first, first + len(inside)), middle[inside] - start
