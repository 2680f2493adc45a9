"""The volume's heights in the left epipolar image of a pair: the parallaxes from which least-squares matching starts.

Strategy: every map cell is projected into the left image, where its parallax follows from its depth. Neighbouring cells on one
surface span triangles; at a break every cell covers the pixels around it. Where several cells fall on a pixel, the one with the
greatest parallax is in front and hides the others.
"""

import numpy as np
from numba import njit

from orthomill.schemas.epipolar import EpipolarPair
from orthomill.schemas.raster import MapGrid, Window
from orthomill.tasks.densification.gridding import rasterised
from orthomill.tasks.matching.dense.node_surfaces import StartSurface

FACTOR = 2
"""pixels of the left image per start parallax: cells of the volume are wider than a pixel"""
_SAME_SURFACE = 1.5
"""px of parallax between neighbouring cells above which the surface breaks"""


@njit(cache=True)
def _projected(heights, x, y, rotation, centre, c, base, places):
    """Fill places (3, rows, cols): x and y (px, from the principal point, y up) and the parallax (px) of every cell."""
    for i in range(heights.shape[0]):
        for j in range(heights.shape[1]):
            dx, dy, dz = x[j] - centre[0], y[i] - centre[1], np.float64(heights[i, j]) - centre[2]
            depth = -(rotation[2, 0] * dx + rotation[2, 1] * dy + rotation[2, 2] * dz)
            # NaN heights and cells behind the camera stay unknown.
            if not depth > 0.0:
                continue
            scale = c / depth
            places[0, i, j] = (rotation[0, 0] * dx + rotation[0, 1] * dy + rotation[0, 2] * dz) * scale
            places[1, i, j] = (rotation[1, 0] * dx + rotation[1, 1] * dy + rotation[1, 2] * dz) * scale
            places[2, i, j] = base * scale


def start_parallaxes(pair: EpipolarPair, heights: np.ndarray, grid: MapGrid, cells: Window, left: Window) -> StartSurface:
    """Parallaxes x_left - x_right of the pixels `left` of the left epipolar image, on a grid reduced by `FACTOR`.

    heights: (rows, cols) float32 m of the window `cells` of `grid`, NaN where unknown. `left` begins and ends at multiples of
    FACTOR and may leave the image.
    """
    places = np.full((3, *heights.shape), np.nan)
    x, y = grid.centres(cells)
    _projected(heights, x, y, np.array(pair.rotation), np.array(pair.left_centre), pair.c, pair.base, places)
    # The centre of reduced pixel k lies at FACTOR k + (FACTOR - 1) / 2 of the image.
    half = (FACTOR - 1) / 2
    col = (places[0] + pair.left_col0 - left.col - half) / FACTOR
    row = (pair.row0 - places[1] - left.row - half) / FACTOR
    # Half the distance of cells as seen in the image, and half a pixel at least, so that cells at a break leave no gaps.
    distance = grid.cell * float(np.nanmedian(places[2])) / pair.base / FACTOR if np.isfinite(places[2]).any() else 1.0
    shape = left.height // FACTOR, left.width // FACTOR
    return StartSurface(rasterised(col, row, places[2], shape, _SAME_SURFACE, max(0.5 * distance, 0.5)), FACTOR)
