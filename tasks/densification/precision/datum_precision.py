"""What the orientation adds to the standard error of heights: smooth over the block, common to neighbours.

Strategy: on a lattice of fixed places the information (one over the variance) of the pairs that see the ground there is averaged;
between the places the standard error is interpolated. It is a property of the orientation alone: whether a cell was matched does
not matter.
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
    seen, inside = np.zeros(x.shape), np.zeros(x.shape)
    known, anywhere = np.zeros(x.shape), np.zeros(x.shape)
    for pair in pairs:
        if not pair.height_sigmas:
            continue
        information = orientation_sigma(pair, x, y, np.full(x.shape, z)) ** -2.0
        shown = _shown(pair, places).reshape(x.shape)
        inside, seen = inside + np.where(shown, information, 0.0), seen + shown
        anywhere, known = anywhere + np.where(np.isfinite(information), information, 0.0), known + np.isfinite(information)
    # The mean of the information, not its sum: the datum and the camera constant move all pairs alike, and no number of pairs
    # averages that out. Heights that are weighted by information and share their errors wholly cannot have a larger variance than
    # this one (Cauchy and Schwarz), however little an oblique pair knows of ground near its horizon. Next to the block the nearest
    # pairs still say more than zero.
    total, count = np.where(seen > 0, inside, anywhere), np.where(seen > 0, seen, known)
    mean = np.divide(count, total, out=np.zeros(x.shape), where=total > 0)
    at_row = (np.arange(window.row, window.row + window.height) - rows[0]) / SPACING
    at_col = (np.arange(window.col, window.col + window.width) - cols[0]) / SPACING
    return between(np.sqrt(mean), at_row, at_col)


def _shown(pair: EpipolarPair, places: np.ndarray) -> np.ndarray:
    """(N,) bool: ground points (N, 3) in the left epipolar image; it is cropped to what both photographs see."""
    pixels = left_pixels(pair, places)
    with np.errstate(invalid="ignore"):
        inside = (pixels >= 0) & (pixels <= (pair.left_cols - 1, pair.rows - 1))
    return inside[:, 0] & inside[:, 1]
