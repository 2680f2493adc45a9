"""How alike windows of several photographs are about the images of a ground point.

Strategy. A window has one sub-pixel place, the same for all its pixels: its grey values are four products with constant weights,
which compilers turn into vector instructions. Windows are brought to mean 0 and length 1; the squared length of the sum of N of
them gives the mean of the correlations of all their pairs at the cost of N windows: (|sum|^2 - N) / (N (N - 1)).

A photograph here is a pyramid level with its lens, or an image that was rectified to a plane: that is a photograph without tilt and
without lens, whose pixels have the axes of the map.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from orthomill.kernels.kernel_compilation import njit
from orthomill.tasks.geometry.view import ViewNumbers, project_point, view_of_row
from orthomill.tasks.matching.least_squares.grey_values import EXACT

_FLAT = 1e-4
"""grey levels^2; a window of less variance has no texture at all"""
_ENDED = 0.02
"""square of an autocorrelation below which it is taken as none"""


@dataclass(frozen=True, eq=False)
class GreyImage:
    """Grey values float32 (rows, cols), NaN where there are none, of a part of a photograph."""

    grey: np.ndarray
    numbers: ViewNumbers
    scale: float = 1.0
    """pixels of the image per pixel of `numbers`, 0.5 per pyramid level"""
    col: float = 0.0
    row: float = 0.0
    """place of the first pixel, px of the image"""


class GreyImages(NamedTuple):
    """Several images as kernels take them: all pixels in one row (float32), `frames` (N, 3) int64 (first pixel, rows, cols), and
    `numbers` (N, 35) float64, the view and then scale, col and row."""

    pixels: np.ndarray
    frames: np.ndarray
    numbers: np.ndarray

    @classmethod
    def of(cls, images: Sequence[GreyImage]) -> "GreyImages":
        """Images of any size one behind the other."""
        sizes = np.cumsum([0, *(image.grey.size for image in images)])
        frames = [(first, *image.grey.shape) for first, image in zip(sizes, images, strict=False)]
        numbers = [(*image.numbers.row(), image.scale, image.col, image.row) for image in images]
        pixels = np.concatenate([np.empty(0, np.float32), *(image.grey.ravel() for image in images)])
        return cls(
            pixels.astype(np.float32, copy=False), np.array(frames, np.int64).reshape(-1, 3), np.array(numbers).reshape(-1, 35)
        )


class WindowBuffers(NamedTuple):
    """Buffers of a window: the grey values of one image, and the sum of those of all (pixels,) float32."""

    one: np.ndarray
    total: np.ndarray

    @classmethod
    def of(cls, half: int) -> "WindowBuffers":
        """Buffers for windows of 2 half + 1 pixels a side, not yet filled."""
        size = (2 * half + 1) ** 2
        return cls(np.empty(size, np.float32), np.empty(size, np.float32))


@njit(error_model="numpy")
def image_place(images, k, x, y, z):
    """(col, row) of a ground point in image k, px of its part; NaN behind the camera."""
    row = images.numbers[k]
    c, r, _ = project_point(view_of_row(row), x, y, z)
    # Pixel p of a level has its centre at (p + 0.5) / scale - 0.5 of the full photograph.
    return (c + 0.5) * row[32] - 0.5 - row[33], (r + 0.5) * row[32] - 0.5 - row[34]


@njit(error_model="numpy")
def holds(images, k, c, r, half):
    """Whether a window about (c, r) lies in image k; NaN does not."""
    return c >= half and r >= half and c < images.frames[k, 2] - 1 - half and r < images.frames[k, 1] - 1 - half


@njit(error_model="numpy", fastmath=EXACT)
def _bilinear(pixels, first, stride, side, u, v, out):
    """Sum of the window whose upper-left pixel is `first`, shifted by (u, v) of a pixel; `out` (side^2,) gets its values."""
    a, b = (np.float32(1.0) - u) * (np.float32(1.0) - v), u * (np.float32(1.0) - v)
    d, e = (np.float32(1.0) - u) * v, u * v
    total = np.float32(0.0)
    for j in range(side):
        upper = pixels[first + j * stride : first + j * stride + side + 1]
        lower = pixels[first + (j + 1) * stride : first + (j + 1) * stride + side + 1]
        row = out[j * side : (j + 1) * side]
        for i in range(side):
            g = a * upper[i] + b * upper[i + 1] + d * lower[i] + e * lower[i + 1]
            row[i] = g
            total += g
    return total


@njit(error_model="numpy", fastmath=EXACT)
def _squares(values, mean):
    """Sum of the squares of `values` less their `mean`."""
    total = np.float32(0.0)
    for i in range(values.size):
        d = values[i] - mean
        total += d * d
    return total


@njit(error_model="numpy", fastmath=EXACT)
def _add(values, mean, factor, total):
    """Add `factor` times the `values` less their `mean` to `total`."""
    for i in range(values.size):
        total[i] += (values[i] - mean) * factor


@njit(error_model="numpy")
def window_values(images, k, c, r, half, bilinear, out):
    """Grey values of the window about (c, r) of image k to `out`, and their sum; the window must be held."""
    if bilinear:
        left, top = int(c), int(r)
        u, v = np.float32(c - left), np.float32(r - top)
    else:
        left, top = int(c + 0.5), int(r + 0.5)
        u, v = np.float32(0.0), np.float32(0.0)
    stride = images.frames[k, 2]
    first = images.frames[k, 0] + (top - half) * stride + left - half
    return _bilinear(images.pixels, first, stride, 2 * half + 1, u, v, out)


@njit(error_model="numpy")
def correlation_at(images, chosen, x, y, z, half, bilinear, scratch):
    """Mean correlation of all pairs of the images `chosen` (numbers) about a ground point; NaN where one of the windows is not
    complete, 0 without texture (the second value then is False)."""
    count, size = chosen.size, scratch.total.size
    scratch.total[:] = 0.0
    for n in range(count):
        k = chosen[n]
        c, r = image_place(images, k, x, y, z)
        if not holds(images, k, c, r, half):
            return np.nan, True
        mean = window_values(images, k, c, r, half, bilinear, scratch.one) / np.float32(size)
        squares = _squares(scratch.one, mean)
        # NaN of missing pixels has come through the sums.
        if squares != squares:
            return np.nan, True
        if squares <= np.float32(_FLAT) * size:
            return 0.0, False
        _add(scratch.one, mean, np.float32(1.0) / np.sqrt(squares), scratch.total)
    length = np.float64(_squares(scratch.total, np.float32(0.0)))
    return (length - count) / (count * (count - 1)), True


@njit(error_model="numpy", fastmath=EXACT)
def autocorrelation(values, mean, side, down, right):
    """Sum of the products of the pixels of a window (side^2,) with those `down` rows and `right` columns away."""
    total = np.float32(0.0)
    for j in range(side - down):
        here = values[j * side : (j + 1) * side - right]
        there = values[(j + down) * side + right : (j + down + 1) * side]
        for i in range(here.size):
            total += (here[i] - mean) * (there[i] - mean)
    return total


@njit(error_model="numpy")
def correlated_pixels(values, side, across):
    """How many neighbouring pixels along the rows (or across them) say as much as one: the sum of squared autocorrelations.

    Lags grow, and the sum between them is that of trapezia; it ends where the texture repeats no more.
    """
    mean = np.float32(values.sum() / values.size)
    squares = _squares(values, mean)
    if not squares > 0.0:
        return np.float64(side)
    total, lag, before = 1.0, 1, 1.0
    last = 0
    while lag <= side // 2:
        product = autocorrelation(values, mean, side, lag if across else 0, 0 if across else lag)
        # As many products as there are neighbours, so that the window's border does not count as a difference.
        here = max(product / squares * side / (side - lag), 0.0) ** 2
        # Trapezium over the lags last + 1 ... lag, on both sides of zero.
        total += 2.0 * (0.5 * (before + here) * (lag - last) + 0.5 * (here - before))
        if here < _ENDED:
            break
        last, before = lag, here
        lag += max(1, lag // 3)
    return min(total, np.float64(side))
