"""The colours of a photograph at places between its pixels: bicubic, on any level of its pyramid, from the part that is at hand.

Bicubic after Keys 1981, a = -1/2, which reproduces a linear ramp exactly. Callers compute the places, a row of them at a time.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from orthomill.kernels.kernel_compilation import njit
from orthomill.schemas.raster import Window
from orthomill.tasks.imagery.cubic_vectors import three_bands
from orthomill.tasks.imagery.masked_pixels import colours_of, picture_or_nan
from orthomill.tasks.imagery.pyramid import level_shape

LEAST_WEIGHT = 1e-12
"""Weight of a colour at least: a visible place differs from an invisible one, even on the very border of the photograph."""


@dataclass(frozen=True)
class PhotoPixelsAt:
    """Pixels of a photograph, (rows, cols, bands), at `window` of its pyramid level `level`; NaN where there is no picture."""

    pixels: np.ndarray
    window: Window
    level: int

    @classmethod
    def of(cls, pixels: np.ndarray, window: Window, level: int) -> "PhotoPixelsAt":
        """From pixels as they are stored, with the band of a mask or without."""
        return cls(np.ascontiguousarray(picture_or_nan(pixels)), window, level)


class PlaceLine(NamedTuple):
    """Full-size column and row in a photograph of a row of ortho pixels."""

    col: np.ndarray
    row: np.ndarray


class PartOrigin(NamedTuple):
    """First row and column of a part in its pyramid level, which is `inverse` times a full-size place plus `offset`."""

    row: int
    col: int
    inverse: float
    offset: float


class PartPixels(NamedTuple):
    """Pixels of a photograph for the kernels, their place, and the level's last row and column."""

    pixels: np.ndarray
    origin: PartOrigin
    last: tuple[int, int]


@njit(inline="always")
def _keys(t):
    """Weights of four neighbours at the distance `t` (float32) behind the second one (Keys 1981, a = -1/2)."""
    half, one = np.float32(0.5), np.float32(1.0)
    return (
        ((-half * t + one) * t - half) * t,
        (np.float32(1.5) * t - np.float32(2.5)) * t * t + one,
        ((-np.float32(1.5) * t + np.float32(2.0)) * t + half) * t,
        (half * t - half) * t * t,
    )


@njit(inline="always")
def _row_of_four(flat, first, bands, wx):
    """The weighted sum of four neighbours in a row of pixels, the first at position `first`, `bands` apart."""
    # Unsigned positions need no test for a negative one, which would cost as much as the sum.
    second, third, fourth = first + bands, first + bands + bands, first + bands + bands + bands
    two = wx[0] * np.float32(flat[first]) + wx[1] * np.float32(flat[second])
    return two + wx[2] * np.float32(flat[third]) + wx[3] * np.float32(flat[fourth])


@njit(error_model="numpy", fastmath={"contract"})
def inner_colours(flat, shape, origin, line, weight, colour):
    """Fills `colour` (cols, bands) at the places of `line` with weight whose 4 x 4 neighbours are among the pixels; returns how
    many are not. flat: pixels of `shape` (rows, cols, bands) as one row; origin: as of `PartOrigin`."""
    height, width, bands = shape
    step, beside, missing = np.uint64(width * bands), np.uint64(bands), 0
    for j in range(weight.size):
        if not weight[j] > 0.0:
            continue
        col, row = line.col[j] * origin.inverse + origin.offset, line.row[j] * origin.inverse + origin.offset
        c, r = int(np.floor(col)), int(np.floor(row))
        left, top = c - 1 - origin.col, r - 1 - origin.row
        if left < 0 or top < 0 or left + 3 >= width or top + 3 >= height:
            missing += 1
            continue
        x, y, start = np.float32(col - c), np.float32(row - r), np.uint64((top * width + left) * bands)
        if bands == 3:
            colour[j, 0], colour[j, 1], colour[j, 2] = three_bands(flat, start, step, x, y)
        else:
            wx, wy = _keys(x), _keys(y)
            # Sums in local numbers: after a write to an array the compiler must read every pixel again, as they might overlap.
            for band in range(bands):
                total, first = np.float32(0.0), start + np.uint64(band)
                for k in range(4):
                    total += wy[k] * _row_of_four(flat, first, beside, wx)
                    first += step
                colour[j, band] = total
    return missing


@njit()
def border_colours(pixels, last, origin, line, weight, colour):
    """Fills what `inner_colours` leaves: beyond the border of the photograph its outermost pixels are repeated.

    last: last row and column of the level. Where the part does not hold the neighbours, the weight becomes 0.
    """
    height, width, bands = pixels.shape
    for j in range(weight.size):
        if not weight[j] > 0.0:
            continue
        col, row = line.col[j] * origin.inverse + origin.offset, line.row[j] * origin.inverse + origin.offset
        c, r = int(np.floor(col)), int(np.floor(row))
        left, right = c - 1 - origin.col, c + 2 - origin.col
        top, bottom = r - 1 - origin.row, r + 2 - origin.row
        if left >= 0 and top >= 0 and right < width and bottom < height:
            continue
        wx, wy = _keys(np.float32(col - c)), _keys(np.float32(row - r))
        low_col, high_col = max(left, -origin.col), min(right, last[1] - origin.col)
        low_row, high_row = max(top, -origin.row), min(bottom, last[0] - origin.row)
        if low_col < 0 or low_row < 0 or high_col >= width or high_row >= height:
            weight[j] = 0.0
            continue
        for band in range(bands):
            total = np.float32(0.0)
            for k in range(4):
                four, y = np.float32(0.0), min(max(top + k, low_row), high_row)
                for m in range(4):
                    four += wx[m] * np.float32(pixels[y, min(max(left + m, low_col), high_col), band])
                total += wy[k] * four
            colour[j, band] = total


def part_pixels(photo: PhotoPixelsAt, size: tuple[int, int]) -> PartPixels:
    """A part of a photograph of `size` (rows, cols) for the kernels."""
    rows, cols = level_shape(size, photo.level)
    inverse = 0.5**photo.level
    origin = PartOrigin(photo.window.row, photo.window.col, inverse, 0.5 * inverse - 0.5)
    return PartPixels(np.ascontiguousarray(photo.pixels), origin, (rows - 1, cols - 1))


def colours_at(photo: PhotoPixelsAt, size: tuple[int, int], places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Grey values (N, bands) float32 at places (N, 2) (col, row) of the photograph of `size` (rows, cols); and bool (N,) where the
    part holds all pixels that they need. NaN places have no colour."""
    colour = np.zeros((len(places), photo.pixels.shape[2]), np.float32)
    weight = np.isfinite(places).all(axis=1).astype(np.float32)
    if photo.pixels.size and len(places):
        part, line = part_pixels(photo, size), PlaceLine(*np.ascontiguousarray(np.asarray(places, np.float64).T))
        if inner_colours(part.pixels.reshape(-1), part.pixels.shape, part.origin, line, weight, colour):
            border_colours(part.pixels, part.last, part.origin, line, weight, colour)
        if photo.pixels.dtype == np.float32:
            drop_gaps(colour, weight)
    return colour, (weight > 0) & bool(photo.pixels.size)


def most_bands(photos: Iterable[np.ndarray]) -> int:
    """Channels of colours that the pixels (rows, cols, bands) of all photographs fit in: 1 or 3; a grey photograph has three equal
    ones among coloured ones."""
    return max((int(colours_of(pixels).shape[2]) for pixels in photos), default=1)


def drop_gaps(colour: np.ndarray, weight: np.ndarray) -> None:
    """Takes colour and weight from the places (...,) that are not all picture, whose colours (..., bands) are NaN."""
    gap = np.isnan(colour).any(axis=-1)
    if gap.any():
        colour[gap], weight[gap] = 0.0, 0.0
