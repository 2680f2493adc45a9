"""What the orientation adds to the standard error of heights: smooth over the block, common to neighbours.

Strategy: on a lattice of fixed places the variances of the pairs that see the ground there are averaged; between the places the
standard error is interpolated. It is a property of the orientation alone: whether a cell was matched does not matter.
"""

from collections.abc import Sequence

import numpy as np

from orthomill.schemas.epipolar import EpipolarPair
from orthomill.schemas.raster import MapGrid, Window
from orthomill.tasks.densification.ground_intersection import orientation_sigma
from orthomill.tasks.geometry.epipolar_window import left_pixels
from orthomill.tasks.imagery.resampling import between

SPACING = 16
"""cells between the places: errors of an orientation bend a model over hundreds of pixels"""


def datum_precision(pairs: Sequence[EpipolarPair], grid: MapGrid, window: Window, z: float) -> np.ndarray:
    """Standard errors (window.shape) float32, m, of heights near `z` (m) by the orientation; 0 where no pair sees the ground."""
    # Places on the absolute lattice around the window: every tile interpolates between the same ones.
    rows = np.arange(window.row // SPACING, -(-(window.row + window.height) // SPACING) + 1) * SPACING
    cols = np.arange(window.col // SPACING, -(-(window.col + window.width) // SPACING) + 1) * SPACING
    x, y = np.meshgrid(grid.west + (cols + 0.5) * grid.cell, grid.north - (rows + 0.5) * grid.cell)
    places = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, z)])
    seen, total = np.zeros(x.shape), np.zeros(x.shape)
    outside, anyway = np.zeros(x.shape), np.zeros(x.shape)
    for pair in pairs:
        variance = orientation_sigma(pair, x, y, np.full(x.shape, z)) ** 2
        inside = _shown(pair, places).reshape(x.shape)
        total, seen = total + np.where(inside, variance, 0.0), seen + inside
        outside, anyway = outside + np.where(np.isfinite(variance), variance, 0.0), anyway + np.isfinite(variance)
    # The mean of the variances, not the variance of a mean: the datum and the camera constant move all pairs alike, and no number
    # of pairs averages that out. Next to the block the nearest pairs still say more than zero.
    mean = np.where(seen > 0, total / np.maximum(seen, 1.0), outside / np.maximum(anyway, 1.0))
    at_row = (np.arange(window.row, window.row + window.height) - rows[0]) / SPACING
    at_col = (np.arange(window.col, window.col + window.width) - cols[0]) / SPACING
    return between(np.sqrt(mean), at_row, at_col)


def _shown(pair: EpipolarPair, places: np.ndarray) -> np.ndarray:
    """(N,) bool: ground points (N, 3) in the left epipolar image; it is cropped to what both photographs see."""
    pixels = left_pixels(pair, places)
    with np.errstate(invalid="ignore"):
        inside = (pixels >= 0) & (pixels <= (pair.left_cols - 1, pair.rows - 1))
    return inside[:, 0] & inside[:, 1]
