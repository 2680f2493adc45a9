"""Heights of many pairs over the same cells, one pair after the other: per cell the most precise ones near the volume.

Strategy: the pairs stream by, and a cell keeps at most `SLOTS` of their heights, the most precise ones. Memory is that of the
slots, whatever the number of pairs. Only heights near that of the volume enter: a wrong match in one pair is rarely where all
photographs together see the surface, and a right one always is. The volume is the noisier of the two: a single one of its heights
may be off where pairs are right, so a height also enters near the middle one of the volume's heights around.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from scipy import ndimage

from orthomill.kernels.kernel_compilation import njit
from orthomill.tasks.densification.gridding import HeightCells

SLOTS = 12
"""heights that a cell keeps: the weighted mean of more hardly gains precision, for the nearest pairs share photographs"""
_AROUND = 5
"""cells along the side of the square whose middle height counts too: less than what a roof or a street is wide"""
REACH = _AROUND // 2
"""cells around a cell whose reference decides which heights enter"""


@dataclass(frozen=True, eq=False)
class HeightStack:
    """Heights float64 and standard errors float32 (SLOTS, rows, cols), m, NaN in free slots; `reference` (rows, cols) m, NaN:
    any."""

    height: np.ndarray
    sigma: np.ndarray
    reference: np.ndarray
    tolerance: np.ndarray
    """(rows, cols) float32 m: how far from the reference a height may lie"""
    calm: np.ndarray
    """(rows, cols) m: the middle one of the references around; NaN near an unknown one"""

    @classmethod
    def over(cls, reference: np.ndarray, tolerance: np.ndarray) -> "HeightStack":
        """An empty stack over cells with a reference height (rows, cols), m."""
        shape = (SLOTS, *reference.shape)
        return cls(np.full(shape, np.nan), np.full(shape, np.nan, np.float32), reference, tolerance, _calm(reference))

    def near(self, row: np.ndarray, col: np.ndarray, height: np.ndarray) -> np.ndarray:
        """Whether heights, m, may enter the cells `row`, `col`; all of one shape."""
        reference, calm, tolerance = (values[row, col] for values in (self.reference, self.calm, self.tolerance))
        return ~(np.abs(height - reference) > tolerance) | (np.abs(height - calm) <= tolerance)

    def add(self, cells: HeightCells) -> None:
        """Add the heights of one pair, in place."""
        _add(cells.height, cells.sigma, self.reference, self.calm, self.tolerance, self.height, self.sigma)


def _calm(reference: np.ndarray) -> np.ndarray:
    known = ndimage.minimum_filter(np.isfinite(reference), _AROUND)
    # The middle one of a square that holds NaN would depend on the order in which they are compared.
    wide = np.pad(np.nan_to_num(reference).astype(np.float32), REACH, mode="symmetric")
    return np.where(known, cv2.medianBlur(wide, _AROUND)[REACH:-REACH, REACH:-REACH], np.nan)


@njit()
def _beyond(z, reference, calm, tolerance):
    """Whether a height is contradicted. Without a reference nothing contradicts it: NaN fails the comparison."""
    return abs(z - reference) > tolerance and not abs(z - calm) <= tolerance


@njit()
def _add(height, sigma, reference, calm, tolerance, heights, sigmas):
    """Put heights of one pair (r, c), m, into the stacks `heights`, `sigmas` (k, r, c), in place of the least precise one. Heights
    beyond what `reference`, `calm` and `tolerance` allow are left out."""
    for r in range(height.shape[0]):
        for c in range(height.shape[1]):
            z = height[r, c]
            if z != z or _beyond(z, reference[r, c], calm[r, c], tolerance[r, c]):
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
