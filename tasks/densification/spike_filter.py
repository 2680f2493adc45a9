"""Removal of spikes: Karfis' Outlier_detector on a grid.

A cell is compared with the mean and the standard deviation of the cells in a circle around it, itself left out (else a lone spike
among few neighbours could never be found); beyond k sigma it goes. Karfis repeats until nothing changes; the number of rounds
is fixed here, because a fixpoint would let one tile feel the next one but one. Cells with too few neighbours that support them
go too: wrong matches in woods and on water stand alone, or among others that contradict each other, which no deviation shows.
A patch of wrong matches supports itself within that circle; so first every height needs support in a wider circle, too.

Source: Karfis 2009 (methods/relative_orientation_and_epipolar.md 1.19).
"""

import numpy as np
from numba import njit

from orthomill.schemas.settings import Settings, setting


class SpikeFilter(Settings):
    """Removal of spikes by comparison with the heights around."""

    radius: float = setting(4.0, "Radius of the circle of neighbours.", "cells", ge=1.0, le=30.0)
    sigmas: float = setting(3.0, "Standard deviations of the neighbours by which a height may leave their mean.", gt=0.0)
    rounds: int = setting(2, "How often the filter runs.", ge=0, le=10)
    min_support: int = setting(10, "A height that fewer neighbours support is removed.", "cells", ge=0)
    support_slope: float = setting(1.5, "A neighbour supports a height when the slope between them is at most this.", gt=0.0)
    far_radius: float = setting(
        12.0, "Radius of the wider circle in which a height also needs support; 0: none.", "cells", ge=0.0, le=60.0
    )
    far_support: float = setting(0.15, "Share of the wider circle that must support a height.", ge=0.0, le=1.0)
    far_slope: float = setting(3.0, "A height in the wider circle supports when the slope is at most this.", gt=0.0)
    floor: float = setting(0.3, "Deviations below this share of the cell size are never spikes.", "cells", ge=0.0)

    @property
    def halo(self) -> int:
        """How many cells away a height can matter."""
        return int(np.ceil(self.radius)) * self.rounds + int(np.ceil(self.far_radius))


@njit(cache=True)
def _spikes(height, rows, cols, reach, sigmas, min_support, floor):
    out = np.zeros(height.shape, np.bool_)
    for r in range(height.shape[0]):
        for c in range(height.shape[1]):
            here = np.float64(height[r, c])
            if here != here:
                continue
            n, support, total, squares = 0, 0, 0.0, 0.0
            for k in range(rows.size):
                y, x = r + rows[k], c + cols[k]
                if 0 <= y < height.shape[0] and 0 <= x < height.shape[1] and height[y, x] == height[y, x]:
                    d = np.float64(height[y, x]) - here
                    n += 1
                    support += abs(d) <= reach[k]
                    total += d
                    squares += d * d
            if support < min_support or n < 2:
                out[r, c] = support < min_support
                continue
            mean = total / n
            deviation = np.sqrt(max(squares / n - mean * mean, 0.0) * n / (n - 1))
            out[r, c] = abs(mean) > max(sigmas * deviation, floor)
    return out


@njit(cache=True)
def _unsupported(height, rows, cols, reach, least):
    out = np.zeros(height.shape, np.bool_)
    for r in range(height.shape[0]):
        for c in range(height.shape[1]):
            here, support = height[r, c], 0
            if here != here:
                continue
            for k in range(rows.size):
                y, x = r + rows[k], c + cols[k]
                if 0 <= y < height.shape[0] and 0 <= x < height.shape[1] and abs(height[y, x] - here) <= reach[k]:
                    support += 1
                    if support >= least:
                        break
            out[r, c] = support < least
    return out


def stray(height: np.ndarray, cell: float, settings: SpikeFilter) -> np.ndarray:
    """Which heights (rows, cols) m have too little support in the wider circle, of which every fourth cell is looked at: bool."""
    if settings.far_radius == 0.0:
        return np.zeros(height.shape, bool)
    reach = int(settings.far_radius) // 2 * 2
    y, x = np.mgrid[-reach : reach + 1 : 2, -reach : reach + 1 : 2]
    near = (x**2 + y**2 <= settings.far_radius**2) & ((x != 0) | (y != 0))
    support = (settings.far_slope * cell * np.hypot(x, y)[near] + settings.floor * cell).astype(np.float32)
    return _unsupported(height, y[near], x[near], support, int(np.ceil(settings.far_support * near.sum())))


def spikes(height: np.ndarray, cell: float, settings: SpikeFilter) -> np.ndarray:
    """Which heights (rows, cols) m are spikes: bool. Cells closer than `settings.halo` to the border may be judged too strictly."""
    reach = int(np.ceil(settings.radius))
    y, x = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    near = (x**2 + y**2 <= settings.radius**2) & ((x != 0) | (y != 0))
    floor = settings.floor * cell
    support = settings.support_slope * cell * np.hypot(x, y)[near] + floor
    found = stray(height, cell, settings)
    kept = np.where(found, np.float32(np.nan), height)
    for _ in range(settings.rounds):
        now = _spikes(kept, y[near], x[near], support, settings.sigmas, settings.min_support, floor)
        kept[now] = np.nan
        found |= now
    return found
