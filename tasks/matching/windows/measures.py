"""Measures of a window that grows about a point, size by size: entropy, mean, standard deviation and range, gradients.

Strategy: a window grows ring by ring, and a ring adds its pixels to running sums, so that all sizes together cost as much as the
largest one alone. The sums are integers (entropy: integer multiples of 2^-40), hence exact, and equal whatever tile the point lies
in. Images are int16 grey levels 0 to 255, -1 without data. Each measure has one row per point and one column per size, the first
column being the size before the smallest, for rules that compare with it; NaN where a window does not fit.

Source: Skarlatos (sources/matching.md#statistics, #entropy, #foerstner).
"""

from typing import NamedTuple

import numpy as np

from orthomill.kernels.kernel_compilation import njit

_FRACTION = 40
"""fractional bits in sums of k ln k"""
_MEAN, _DEVIATION, _RANGE = range(3)
_WEIGHT, _ROUNDNESS = range(2)
"""Layers of the tables that the kernels fill."""


class WindowGrowth(NamedTuple):
    """The windows of a set of points, from half size `first` - 1 to `last`."""

    pixels: np.ndarray
    """(N, 2) int64 (col, row) of the centres"""
    rooms: np.ndarray
    """(N,) int64: the largest half size without missing data, up to `last`; -1 where the centre has none"""
    first: int
    last: int

    @property
    def shape(self) -> tuple[int, int]:
        """(N, sizes): of a table with a column for each half size."""
        return len(self.pixels), self.last - self.first + 2


def entropy(levels: np.ndarray, growth: WindowGrowth) -> np.ndarray:
    """Entropy -sum p ln p of the grey levels, in nats, (N, sizes). levels: (H, W) int16."""
    counts = np.arange((2 * growth.last + 1) ** 2 + 1, dtype=np.float64)
    # Fixed point instead of float64: the sum is then the same in whatever order the pixels come.
    terms = np.rint(np.ldexp(counts * np.log(np.maximum(counts, 1.0)), _FRACTION)).astype(np.int64)
    out = np.full(growth.shape, np.nan)
    _entropy(levels, growth.pixels, growth.rooms, growth.first, terms, np.diff(terms), out)
    return out


def statistics(levels: np.ndarray, growth: WindowGrowth) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mean, standard deviation (over n) and range (max - min) of the grey levels, each (N, sizes). levels: (H, W) int16."""
    out = np.full((3, *growth.shape), np.nan)
    _statistics(levels, growth.pixels, growth.rooms, growth.first, out)
    return out[_MEAN], out[_DEVIATION], out[_RANGE]


def gradient_weights(levels: np.ndarray, growth: WindowGrowth) -> tuple[np.ndarray, np.ndarray]:
    """Foerstner's weight w = det N / tr N and roundness q = 4 det N / (tr N)^2, each (N, sizes). levels: (H, W) int16.

    N is the sum over the window of products of central differences, in grey levels per px, which need one pixel around the
    window: `growth.rooms` must leave it. 1 / w is the trace of N^-1: noise of s grey levels leaves a total standard error of
    s / sqrt(w) px. A window without any gradient has q = 0 (the formula's 0 / 0).
    """
    out = np.full((2, *growth.shape), np.nan)
    _gradient_weights(levels, growth.pixels, growth.rooms, growth.first, out)
    return out[_WEIGHT], out[_ROUNDNESS]


def border_rooms(shape: tuple[int, int], pixels: np.ndarray, last: int) -> np.ndarray:
    """(N,) int64: largest half size, up to `last`, of a window about each pixel (col, row) that stays in an image of `shape`."""
    col, row = pixels[:, 0], pixels[:, 1]
    border = np.minimum(np.minimum(col, shape[1] - 1 - col), np.minimum(row, shape[0] - 1 - row))
    return np.clip(border, -1, last)


@njit()
def data_rooms(levels, pixels, rooms):
    """(N,) int64: `rooms` (those of `border_rooms`) reduced until windows contain no missing data."""
    out = rooms.copy()
    for i in range(rooms.size):
        col, row = pixels[i]
        for h in range(rooms[i] + 1):
            lowest = 0
            for c in range(col - h, col + h + 1):
                lowest = min(lowest, levels[row - h, c], levels[row + h, c])
            for r in range(row - h + 1, row + h):
                lowest = min(lowest, levels[r, col - h], levels[r, col + h])
            if lowest < 0:
                out[i] = h - 1
                break
    return out


@njit()
def _entropy(levels, pixels, rooms, first, terms, gains, out):
    """Entropy of the grey `levels` in windows that grow about `pixels` (n, 2) (col, row) up to `rooms` (n,), into `out` (n,
    sizes). first: half side of the smallest; terms: k ln k; gains: their differences."""
    counts = np.zeros(256, np.int64)
    for i in range(rooms.size):
        col, row = pixels[i]
        counts[:] = 0
        total = 0
        for h in range(rooms[i] + 1):
            for c in range(col - h, col + h + 1):
                level = levels[row - h, c]
                # A level that occurs once more changes its term k ln k by a tabulated gain: no logarithm per pixel.
                total += gains[counts[level]]
                counts[level] += 1
            for r in range(row - h + 1, row + h):
                level = levels[r, col - h]
                total += gains[counts[level]]
                counts[level] += 1
                level = levels[r, col + h]
                total += gains[counts[level]]
                counts[level] += 1
            if h > 0:
                for c in range(col - h, col + h + 1):
                    level = levels[row + h, c]
                    total += gains[counts[level]]
                    counts[level] += 1
            if h >= first - 1:
                area = (2 * h + 1) ** 2
                # -sum p ln p with p = k / n is (n ln n - sum k ln k) / n.
                out[i, h - first + 1] = (terms[area] - total) / (1 << _FRACTION) / area


@njit()
def _statistics(levels, pixels, rooms, first, out):
    """Mean, standard deviation and range of the grey `levels` in growing windows, into `out` (3, n, sizes); arguments as in
    `_entropy`."""
    for i in range(rooms.size):
        col, row = pixels[i]
        total, squares, low, high = 0, 0, 255, 0
        for h in range(rooms[i] + 1):
            for side in range(2 if h > 0 else 1):
                r = row - h + 2 * h * side
                for c in range(col - h, col + h + 1):
                    level = levels[r, c]
                    total += level
                    squares += level * level
                    low, high = min(low, level), max(high, level)
                c = col - h + 2 * h * side
                for r in range(row - h + 1, row + h):
                    level = levels[r, c]
                    total += level
                    squares += level * level
                    low, high = min(low, level), max(high, level)
            if h >= first - 1:
                area, k = (2 * h + 1) ** 2, h - first + 1
                out[_MEAN, i, k] = total / area
                # n sum(x^2) - (sum x)^2 in integers: no digits cancel.
                out[_DEVIATION, i, k] = np.sqrt(area * squares - total * total) / area
                out[_RANGE, i, k] = high - low


@njit()
def _gradient_weights(levels, pixels, rooms, first, out):
    """Weight and roundness (Foerstner) of growing windows, into `out` (2, n, sizes); arguments as in `_entropy`."""
    for i in range(rooms.size):
        col, row = pixels[i]
        xx, xy, yy = 0, 0, 0
        for h in range(rooms[i] + 1):
            for side in range(2 if h > 0 else 1):
                r = row - h + 2 * h * side
                for c in range(col - h, col + h + 1):
                    gx, gy = levels[r, c + 1] - levels[r, c - 1], levels[r + 1, c] - levels[r - 1, c]
                    xx += gx * gx
                    xy += gx * gy
                    yy += gy * gy
                c = col - h + 2 * h * side
                for r in range(row - h + 1, row + h):
                    gx, gy = levels[r, c + 1] - levels[r, c - 1], levels[r + 1, c] - levels[r - 1, c]
                    xx += gx * gx
                    xy += gx * gy
                    yy += gy * gy
            if h >= first - 1:
                trace, determinant = xx + yy, xx * yy - xy * xy
                k = h - first + 1
                # The differences span two pixels: 1/4 makes their products those of gradients per px. Roundness has no unit.
                out[_WEIGHT, i, k] = 0.25 * determinant / trace if trace > 0 else 0.0
                out[_ROUNDNESS, i, k] = 4.0 * determinant / (float(trace) * trace) if trace > 0 else 0.0
