"""The volume's heights in the left epipolar image of a pair: the parallaxes from which least-squares matching starts.

Strategy: every map cell is projected into the left image, where its parallax follows from its depth. Neighbouring cells on one
surface span triangles; at a break every cell covers the pixels around it. Where several cells fall on a pixel, the one with the
greatest parallax is in front and hides the others.
"""

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np

from orthomill.kernels.kernel_compilation import njit
from orthomill.schemas.epipolar import EpipolarPair
from orthomill.schemas.raster import MapGrid, Window
from orthomill.tasks.densification.gridding import ValueRows, rasterised
from orthomill.tasks.geometry.epipolar_window import map_window
from orthomill.tasks.matching.dense.node_surfaces import StartSurface

FACTOR = 2
"""pixels of the left image per start parallax: cells of the volume are wider than a pixel"""
STRIP = 2**20
"""cells that are projected at a time"""
_CROPS = 2
"""times that the window of cells is cropped to the heights in it"""
_BESIDE = 8
"""cells beside those that are seen: corners of triangles that reach into the image"""
_SAME_SURFACE = 1.5
"""px of parallax between neighbouring cells above which the surface breaks"""


@njit(error_model="numpy")
def _projected(heights, x, y, pose, base, cell, first, shape, places):
    """Fill places (3, rows, cols): column and row in the reduced image of `shape`, and the parallax (px), of the cells near it.

    pose: rotation, projection centre and camera constant (px). first: principal column and row in the reduced image.
    """
    rotation, centre, c = pose
    for i in range(heights.shape[0]):
        for j in range(heights.shape[1]):
            dx, dy, dz = x[j] - centre[0], y[i] - centre[1], np.float64(heights[i, j]) - centre[2]
            depth = -(rotation[2, 0] * dx + rotation[2, 1] * dy + rotation[2, 2] * dz)
            # NaN heights and cells behind the camera stay unknown.
            if not depth > 0.0:
                continue
            scale = c / (depth * FACTOR)
            col = first[0] + (rotation[0, 0] * dx + rotation[0, 1] * dy + rotation[0, 2] * dz) * scale
            row = first[1] - (rotation[1, 0] * dx + rotation[1, 1] * dy + rotation[1, 2] * dz) * scale
            beside = _BESIDE * cell * scale
            if -beside < col < shape[1] + beside and -beside < row < shape[0] + beside:
                places[0, i, j], places[1, i, j], places[2, i, j] = col, row, base * scale * FACTOR


def _cropped(pair: EpipolarPair, heights: np.ndarray, grid: MapGrid, cells: Window, left: Window) -> tuple[np.ndarray, Window]:
    """The heights that the pixels `left` can show, and their window: that of all heights that may occur is many times as large."""
    for _ in range(_CROPS):
        if heights.size == 0 or not np.isfinite(low := np.fmin.reduce(heights, axis=None)):
            break
        high = np.fmax.reduce(heights, axis=None)
        seen = map_window(pair, left, grid, float(low), float(high), margin=_BESIDE)
        inside = seen.within(cells).clipped(cells.shape)
        heights, cells = heights[inside.slices], Window(cells.row + inside.row, cells.col + inside.col, *inside.shape)
    return heights, cells


class _CellsInImage(NamedTuple):
    """Cells of a window of the map, and the pose of the image that shows some of them."""

    heights: np.ndarray
    x: np.ndarray
    y: np.ndarray
    pose: tuple[np.ndarray, np.ndarray, float]
    base: float
    cell: float
    first: tuple[float, float]
    """principal column and row in the reduced image"""
    shape: tuple[int, int]

    def strips(self) -> Iterator[ValueRows]:
        """One after the other: towards the horizon a block shows millions of cells."""
        step = max(STRIP // max(self.heights.shape[1], 1), 1)
        return (self._strip(row, min(row + step, len(self.y))) for row in range(0, len(self.y), step))

    def _strip(self, begin: int, end: int) -> ValueRows:
        """The rows from `begin` to `end`, with one above and one below."""
        top, bottom = max(begin - 1, 0), min(end + 1, len(self.y))
        heights = self.heights[top:bottom]
        places = np.full((3, *heights.shape), np.nan)
        _projected(heights, self.x, self.y[top:bottom], self.pose, self.base, self.cell, self.first, self.shape, places)
        return ValueRows(places[0], places[1], places[2], (begin - top, end - top))


def _mean(strips: Iterable[ValueRows]) -> float:
    """The mean of the known values; NaN without any."""
    total, count = 0.0, 0
    for strip in strips:
        own = strip.value[slice(*strip.own)]
        total, count = total + float(np.nansum(own)), count + int(np.isfinite(own).sum())
    return total / count if count else np.nan


def start_parallaxes(pair: EpipolarPair, heights: np.ndarray, grid: MapGrid, cells: Window, left: Window) -> StartSurface:
    """Parallaxes x_left - x_right of the pixels `left` of the left epipolar image, on a grid reduced by `FACTOR`.

    heights: (rows, cols) float32 m of the window `cells` of `grid`, NaN where unknown. `left` begins and ends at multiples of
    FACTOR and may leave the image.
    """
    heights, cells = _cropped(pair, heights, grid, cells, left)
    # The centre of reduced pixel k lies at FACTOR k + (FACTOR - 1) / 2 of the image.
    half = (FACTOR - 1) / 2
    first = (pair.left_col0 - left.col - half) / FACTOR, (pair.row0 - left.row - half) / FACTOR
    pose, shape = (np.array(pair.rotation), np.array(pair.left_centre), pair.c), (left.height // FACTOR, left.width // FACTOR)
    places = _CellsInImage(heights, *grid.centres(cells), pose, pair.base, grid.cell, first, shape)
    # Most blocks are one strip, which is projected once; those that look to the horizon must not be held whole.
    kept = list(places.strips()) if heights.size <= STRIP else None
    parallax = _mean(kept or places.strips())
    # Half the distance of cells as seen in the image, and half a pixel at least, so that cells at a break leave no gaps.
    distance = grid.cell * parallax / pair.base / FACTOR if np.isfinite(parallax) else 1.0
    return StartSurface(rasterised(kept or places.strips(), shape, _SAME_SURFACE, max(0.5 * distance, 0.5)), FACTOR)
