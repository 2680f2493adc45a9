"""Removal of spikes: Karfis' Outlier_detector on a grid.

A cell is compared with the mean and the standard deviation of the cells in a circle around it; beyond k sigma it is removed. The
cell itself is left out of the statistics, since a single spike among few neighbours could otherwise never be found. Karfis repeats
until nothing changes; here the number of rounds is fixed, because the effect of a fixpoint has no bounded reach and tiles would
differ from the whole. Cells with too little support by their neighbours are removed, too: wrong matches in woods and on water are
isolated, or surrounded by others that contradict each other, which no deviation shows. A patch of wrong matches supports itself
within that circle; so every height first needs support in a wider circle.

Source: Karfis 2009 (sources/epipolar.md#spikes).
"""

from typing import NamedTuple

import numpy as np

from orthomill.kernels.kernel_compilation import njit
from orthomill.tasks.densification.settings.surface_settings import SpikeFilter


class _Neighbours(NamedTuple):
    """Offsets (M,) of the neighbours in cells, and the height difference (M,) m up to which each supports a cell."""

    down: np.ndarray
    right: np.ndarray
    support: np.ndarray


@njit()
def _spikes(height, near, sigmas, min_support, floor):
    """(rows, cols) bool of heights (rows, cols) m; floor: m."""
    out = np.zeros(height.shape, np.bool_)
    for r in range(height.shape[0]):
        for c in range(height.shape[1]):
            here = np.float64(height[r, c])
            if here != here:
                continue
            n, support, total, squares = 0, 0, 0.0, 0.0
            for k in range(near.down.size):
                y, x = r + near.down[k], c + near.right[k]
                if 0 <= y < height.shape[0] and 0 <= x < height.shape[1] and height[y, x] == height[y, x]:
                    # differences from the cell, not heights: the one-pass variance below loses its digits with large values
                    d = np.float64(height[y, x]) - here
                    n += 1
                    support += abs(d) <= near.support[k]
                    total += d
                    squares += d * d
            if support < min_support or n < 2:
                out[r, c] = support < min_support
                continue
            mean = total / n
            deviation = np.sqrt(max(squares / n - mean * mean, 0.0) * n / (n - 1))
            # the floor: on a flat roof sigma tends to zero and every noise would be a spike
            out[r, c] = abs(mean) > max(sigmas * deviation, floor)
    return out


@njit()
def _unsupported(height, near, least):
    """(rows, cols) bool: heights that fewer than `least` neighbours support."""
    out = np.zeros(height.shape, np.bool_)
    for r in range(height.shape[0]):
        for c in range(height.shape[1]):
            here, support = height[r, c], 0
            if here != here:
                continue
            for k in range(near.down.size):
                y, x = r + near.down[k], c + near.right[k]
                if 0 <= y < height.shape[0] and 0 <= x < height.shape[1] and abs(height[y, x] - here) <= near.support[k]:
                    support += 1
                    if support >= least:
                        break
            out[r, c] = support < least
    return out


def stray(height: np.ndarray, cell: float, settings: SpikeFilter) -> np.ndarray:
    """Which heights (rows, cols) m have too little support in the wider circle: bool. One cell in four of the circle is used."""
    if settings.far_radius == 0.0:
        return np.zeros(height.shape, bool)
    # Support is a share of the circle: every second row and column estimate it as well, at a quarter of the cost.
    reach = int(settings.far_radius) // 2 * 2
    y, x = np.mgrid[-reach : reach + 1 : 2, -reach : reach + 1 : 2]
    near = (x**2 + y**2 <= settings.far_radius**2) & ((x != 0) | (y != 0))
    support = (settings.far_slope * cell * np.hypot(x, y)[near] + settings.floor * cell).astype(np.float32)
    return _unsupported(height, _Neighbours(y[near], x[near], support), int(np.ceil(settings.far_support * near.sum())))


def spikes(height: np.ndarray, cell: float, settings: SpikeFilter) -> np.ndarray:
    """Which heights (rows, cols) m are spikes: bool. Cells closer than `settings.halo` to the border lack neighbours and may be
    removed wrongly."""
    reach = int(np.ceil(settings.radius))
    y, x = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    near = (x**2 + y**2 <= settings.radius**2) & ((x != 0) | (y != 0))
    floor = settings.floor * cell
    neighbours = _Neighbours(y[near], x[near], settings.support_slope * cell * np.hypot(x, y)[near] + floor)
    # Stray heights leave first: they would inflate the standard deviations in which the true spikes are measured.
    found = stray(height, cell, settings)
    kept = np.where(found, np.float32(np.nan), height)
    # A second round finds the spikes that a greater one had hidden by inflating sigma.
    for _ in range(settings.rounds):
        now = _spikes(kept, neighbours, settings.sigmas, settings.min_support, floor)
        kept[now] = np.nan
        found |= now
    return found
