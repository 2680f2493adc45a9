"""Heights of many pairs over the same cells, one pair after the other: per cell the most precise ones near the volume.

Strategy: the pairs stream by, and a cell keeps at most `SLOTS` of their heights, the most precise ones. Memory is that of the
slots, whatever the number of pairs. Only heights near that of the volume enter: a wrong match in one pair is rarely where all
photographs together see the surface, and a right one always is.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit

from orthomill.tasks.densification.gridding import HeightCells

SLOTS = 12
"""heights that a cell keeps: the weighted mean of more hardly gains precision, for the nearest pairs share photographs"""


@dataclass(frozen=True, eq=False)
class HeightStack:
    """Heights float64 and standard errors float32 (SLOTS, rows, cols), m, NaN in free slots; `reference` (rows, cols) m, NaN:
    any."""

    height: np.ndarray
    sigma: np.ndarray
    reference: np.ndarray
    tolerance: np.ndarray
    """(rows, cols) float32 m: how far from the reference a height may lie"""

    @classmethod
    def over(cls, reference: np.ndarray, tolerance: np.ndarray) -> "HeightStack":
        """An empty stack over cells with a reference height (rows, cols), m."""
        shape = (SLOTS, *reference.shape)
        return cls(np.full(shape, np.nan), np.full(shape, np.nan, np.float32), reference, tolerance)

    def add(self, cells: HeightCells) -> None:
        """Add the heights of one pair, in place."""
        _add(cells.height, cells.sigma, self.reference, self.tolerance, self.height, self.sigma)


@njit(cache=True)
def _add(height, sigma, reference, tolerance, heights, sigmas):
    for r in range(height.shape[0]):
        for c in range(height.shape[1]):
            z = height[r, c]
            # Without a reference nothing contradicts the height; NaN fails the comparison.
            if z != z or abs(z - reference[r, c]) > tolerance[r, c]:
                continue
            place, worst = -1, sigma[r, c]
            for k in range(heights.shape[0]):
                if heights[k, r, c] != heights[k, r, c]:
                    place = k
                    break
                # Strictly: of equal standard errors the earlier pair stays, whatever comes after it.
                if sigmas[k, r, c] > worst:
                    place, worst = k, sigmas[k, r, c]
            if place >= 0:
                heights[place, r, c], sigmas[place, r, c] = z, sigma[r, c]
