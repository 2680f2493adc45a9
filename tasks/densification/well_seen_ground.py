"""The ground that a block shows well enough for a surface.

Photographs that look along the ground see it to the horizon, in pixels that grow with the square of the distance. What two
photographs show in pixels much coarser than those of the block is its background: matching it gives heights as long as they are
wrong, and an orthoimage of streaks. Photographs that look down show no such ground.
"""

from math import isqrt
from typing import NamedTuple

import cv2
import numpy as np

from orthomill.schemas.maps.wanted_area import Ring, WantedArea
from orthomill.schemas.orientation import Area, Block
from orthomill.tasks.geometry.view import in_frame, view_of

COARSEST = 3.0
"""pixels of the block along the pixel of a photograph on the ground, of the second best that shows a place"""
_FIRST, _FINE = 64, 256
"""squares along a side that are looked at: to see whether there is background, and to draw its border"""
_MOST = 20_000_000
"""squares times photographs for a fine border: some seconds"""
_SCRAP = 0.05
"""share of the largest part below which another one is chance: a corner that two photographs happen to show"""
Rectangle = tuple[float, float, float, float]


def well_seen_ground(block: Block, bounds: Area, level: float, pixel: float) -> WantedArea:
    """Where two photographs show the ground at the height `level` (m) in pixels no coarser than `COARSEST` times the `pixel` (m) of
    the block, without scraps, within `bounds` (west, south, east, north) m; everywhere where all that two see is so, or
    nothing is."""
    coarse = _squares(block, bounds, level, _FIRST)
    well = coarse.size <= COARSEST * pixel
    if not well.any() or (well == np.isfinite(coarse.size)).all():
        return WantedArea()
    fine = _squares(block, bounds, level, max(_FIRST, min(_FINE, isqrt(_MOST // len(block.photos)))))
    if not (well := fine.size <= COARSEST * pixel).any():
        return WantedArea()
    whole = _with_neighbours(_without_scraps(well))
    return WantedArea(polygons=tuple((_ring(*box),) for box in _rectangles(whole, fine.x, fine.y)))


class _Squares(NamedTuple):
    """Borders of squares of the ground, `x` (cols + 1,) and `y` (rows + 1,) m, and `_second_smallest_pixel` in their middles (rows,
    cols), m."""

    x: np.ndarray
    y: np.ndarray
    size: np.ndarray


def _squares(block: Block, bounds: Area, level: float, side: int) -> _Squares:
    west, south, east, north = bounds
    x, y = (np.linspace(low, high, side + 1) for low, high in ((west, east), (south, north)))
    return _Squares(x, y, _second_smallest_pixel(block, 0.5 * (x[:-1] + x[1:]), 0.5 * (y[:-1] + y[1:]), level))


def _without_scraps(squares: np.ndarray) -> np.ndarray:
    """The connected parts of squares (rows, cols) bool that are no scraps beside the largest of them."""
    _, number, found, _ = cv2.connectedComponentsWithStats(squares.astype(np.uint8), connectivity=4)
    area = found[:, cv2.CC_STAT_AREA]
    return squares & (area >= _SCRAP * area[1:].max())[number]


def _second_smallest_pixel(block: Block, x: np.ndarray, y: np.ndarray, level: float) -> np.ndarray:
    """Of ground at x (cols,), y (rows,) and the height `level`, m: the longer side of the pixel (rows, cols) of the second best
    photograph on level ground, m; inf where fewer show it."""
    z = np.full((len(y), len(x)), level)
    best, second = np.full(z.shape, np.inf), np.full(z.shape, np.inf)
    for photo in block.photos:
        view = view_of(photo, block.camera_of(photo.photo))
        east, north, up = view.centre - (0.0, 0.0, level)
        if up <= 0:
            continue  # from below the ground
        shown = in_frame(view, x, y, z)
        size = np.where(shown, ((x - east) ** 2 + (y[:, None] - north) ** 2 + up**2) / (up * view.camera.c), np.inf)
        second = np.minimum(second, np.maximum(best, size))
        best = np.minimum(best, size)
    return second


def _with_neighbours(squares: np.ndarray) -> np.ndarray:
    """Squares (rows, cols) bool and those that touch them: what lies on the border of a square belongs to the block."""
    return cv2.dilate(squares.astype(np.uint8), np.ones((3, 3), np.uint8)).astype(bool)


def _rectangles(squares: np.ndarray, x: np.ndarray, y: np.ndarray) -> list[Rectangle]:
    """West, south, east, north of rectangles that make up the squares (rows, cols) between the borders `x` (cols + 1,), `y`
    (rows + 1,), and overlap nowhere."""
    found: list[Rectangle] = []
    growing: dict[tuple[int, int], int] = {}
    for row in range(len(squares) + 1):
        edges = np.flatnonzero(np.diff(np.pad(squares[row].astype(np.int8), 1))) if row < len(squares) else np.zeros(0, int)
        runs = set(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))
        for run in [run for run in growing if run not in runs]:
            found.append((float(x[run[0]]), float(y[growing.pop(run)]), float(x[run[1]]), float(y[row])))
        for run in sorted(runs):
            growing.setdefault(run, row)
    return found


def _ring(west: float, south: float, east: float, north: float) -> Ring:
    return ((west, south), (east, south), (east, north), (west, north))
