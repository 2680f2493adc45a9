"""Weights where the height is unsure: what a photograph shows is displaced by the error of the height times the tangent of its ray.

Strategy. Photographs that look at a place from different sides are displaced against each other by what its height is wrong:
blended, a crown shows its leaves several times and is as transparent as there are photographs. Where the standard error of the
height moves colours by less than a pixel nothing changes, and the colour is the mean of all. Where it moves them farther, those
count that it moves least, by the density of a normal distribution of a pixel: in crowns and on guesses the photograph that looks
down most steeply, alone but for a narrow seam to the next one.
"""

import numpy as np

from orthomill.kernels.kernel_compilation import njit
from orthomill.tasks.colouring.sampling.ground_sampling import Ground

PIXELS = 1.0
"""ortho pixels that colours may lie apart and are still blended"""
_WORTHY = 0.1
"""share of the greatest weight from which on a photograph may be the one that shows the place: not at the border of its frame, and
not hidden behind an estimate"""
_FARTHEST = 1e3
"""px that colours are moved at most: those of holes, whose heights are guessed"""
_LEAST = 1e-6
"""factor on a weight at least: it is seen, and hardly counts"""


@njit(error_model="numpy")
def _set_back(weights, centres, west, north, cell, z, error):
    """Multiplies `weights` (photographs, rows, cols) by their factors; see `less_displaced`."""
    photos, rows, cols = weights.shape
    for i in range(rows):
        y = north - i * cell
        for j in range(cols):
            x, height = west + j * cell, z[i, j]
            if not error[i, j] > 0.0 or not np.isfinite(height):
                continue
            greatest = 0.0
            for p in range(photos):
                greatest = max(greatest, weights[p, i, j])
            least = np.inf
            for p in range(photos):
                if weights[p, i, j] >= _WORTHY * greatest > 0.0:
                    least = min(least, _moved(centres[p], x, y, height, error[i, j]))
            for p in range(photos):
                if weights[p, i, j] > 0.0:
                    farther = _moved(centres[p], x, y, height, error[i, j]) - least
                    weights[p, i, j] *= max(np.exp(-0.5 * max(farther, 0.0)), _LEAST)


@njit(error_model="numpy", inline="always")
def _moved(centre, x, y, z, error):
    """The squared displacement, in units of PIXELS, of a colour that the photograph from `centre` (3,) m has at x, y, z (m)."""
    return error * error * ((x - centre[0]) ** 2 + (y - centre[1]) ** 2) / (centre[2] - z) ** 2


def less_displaced(weights: np.ndarray, ground: Ground, sigma: np.ndarray, centres: np.ndarray) -> None:
    """Sets back, in place, those of the `weights` (photographs, rows, cols) float32 whose colours lie farther from their places
    than those of others; sigma (rows, cols): standard error of the heights of `ground`, m, infinite where they are guessed; centres
    (photographs, 3): projection centres, m.
    """
    error = np.minimum(sigma / np.float32(PIXELS * ground.grid.cell), np.float32(_FARTHEST))
    x, y = ground.grid.centres(ground.window)
    if weights.size:
        _set_back(weights, centres, float(x[0]), float(y[0]), ground.grid.cell, ground.z, error)
