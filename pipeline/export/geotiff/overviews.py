"""Images of half the size, tile by tile: every tile is made of four of the level below, and none needs another one's pixels."""

from collections.abc import Callable

import numpy as np

from orthomill.pipeline.export.geotiff.band_stack import Stack
from orthomill.pipeline.export.geotiff.cloud_layout import TILE

Shape = tuple[int, int]


def level_shapes(shape: Shape) -> list[Shape]:
    """Rows and columns of a raster and of its overviews, until one is a single tile."""
    found = [shape]
    while max(found[-1]) > TILE:
        found.append((-(-found[-1][0] // 2), -(-found[-1][1] // 2)))
    return found


def valid_in(stack: Stack, values: np.ndarray) -> np.ndarray:
    """Where (bands, rows, cols) hold a value; the colours of a picture do where it is not transparent."""
    if stack.is_picture and stack.bands == 4:
        return np.ascontiguousarray(np.broadcast_to(values[3:] > 0, values.shape))
    valid = values == values if values.dtype.kind == "f" else np.ones(values.shape, bool)
    if stack.nodata is not None and stack.nodata == stack.nodata:
        valid &= values != values.dtype.type(stack.nodata)
    return valid


def halved(stack: Stack, values: np.ndarray) -> np.ndarray:
    """(bands, rows, cols) with half the rows and columns: the mean of up to four cells that hold a value, of codes the first one,
    since the mean of two codes is a third one."""
    if stack.has_codes:
        return values[:, ::2, ::2]
    valid = valid_in(stack, values)
    # Sums of four integers of 16 bits are exact in 32.
    known = np.where(valid, values, values.dtype.type(0)).astype(np.float64 if stack.dtype.kind == "f" else np.float32)
    count, total = _sums(valid.view(np.uint8)), _sums(known)
    means = total / np.maximum(count, 1)
    if stack.dtype.kind != "f":
        return np.rint(means).astype(stack.dtype)
    return np.where(count > 0, means, np.nan if stack.nodata is None else stack.nodata).astype(stack.dtype)


def _sums(values: np.ndarray) -> np.ndarray:
    """Of two rows by two columns each; the last of an odd number stands alone."""
    if any(side % 2 for side in values.shape[1:]):
        values = np.pad(values, ((0, 0), *((0, side % 2) for side in values.shape[1:])))
    rows = values[:, ::2] + values[:, 1::2]
    return np.asarray(rows[..., ::2] + rows[..., 1::2])


class Pyramid:
    """Makes the tiles of all levels from those of the first, which `finest` gives: (bands, rows, cols) of a tile by its row and
    column. Each is handed to `keep` (level, row, col, values) once; no more than four of a level are in memory."""

    def __init__(
        self,
        stack: Stack,
        shapes: list[Shape],
        finest: Callable[[int, int], np.ndarray],
        keep: Callable[[int, int, int, np.ndarray], None],
    ) -> None:
        self.stack, self.shapes, self.finest, self.keep = stack, shapes, finest, keep

    def make(self) -> None:
        """All tiles, those of the last level one after the other."""
        rows, cols = self._tiles(len(self.shapes) - 1)
        for row in range(rows):
            for col in range(cols):
                self._tile(len(self.shapes) - 1, row, col)

    def _tiles(self, level: int) -> tuple[int, int]:
        rows, cols = self.shapes[level]
        return -(-rows // TILE), -(-cols // TILE)

    def _tile(self, level: int, row: int, col: int) -> np.ndarray:
        values = self.finest(row, col) if level == 0 else self._of_four(level, row, col)
        self.keep(level, row, col, values)
        return values

    def _of_four(self, level: int, row: int, col: int) -> np.ndarray:
        rows, cols = self._tiles(level - 1)
        lines = [
            np.concatenate([halved(self.stack, self._tile(level - 1, down, right)) for right in _two(col, cols)], axis=2)
            for down in _two(row, rows)
        ]
        return np.concatenate(lines, axis=1)


def _two(place: int, number: int) -> range:
    return range(2 * place, min(2 * place + 2, number))
