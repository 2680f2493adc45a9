"""The ground that a block shows well enough for a surface.

Photographs that look along the ground see it to the horizon, in pixels that grow with the square of the distance. What two
photographs show in pixels much coarser than those of the block is its background: matching it gives heights as long as they are
wrong, and an orthoimage of streaks. Photographs that look down show no such ground.
"""

from itertools import pairwise
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
    return WantedArea(polygons=_outlines(fine, _without_scraps(well), COARSEST * pixel))


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


def _outlines(squares: _Squares, wanted: np.ndarray, limit: float) -> tuple[tuple[Ring, ...], ...]:
    """Polygons, each with its holes, around the `wanted` squares (rows, cols) bool and those that touch them, drawn where the size
    of pixels reaches the `limit` (m) between two middles."""
    import contourpy  # here, for the command would load it whenever it looks at settings

    # What lies on the border of a square belongs to the block: a square counts by the best of those that touch it.
    size = cv2.erode(np.where(wanted, squares.size, 2.0 * limit), np.ones((3, 3), np.uint8))
    x, y = (np.r_[at[0], 0.5 * (at[:-1] + at[1:]), at[-1]] - at[0] for at in (squares.x, squares.y))
    lines = contourpy.contour_generator(x, y, np.pad(size, 1, mode="edge"), fill_type=contourpy.FillType.OuterOffset)
    # Straight within a square: frames end in straight lines, of which squares make stairs.
    step = max(float(np.diff(squares.x).max()), float(np.diff(squares.y).max()))
    origin = np.array([squares.x[0], squares.y[0]])
    polygons = [
        [_straightened(corners[first:last], step) + origin for first, last in pairwise(ends)]
        for corners, ends in zip(*lines.filled(-1.0, limit), strict=True)
    ]
    return tuple(tuple(_ring(ring) for ring in rings if len(ring) > 2) for rings in polygons if len(rings[0]) > 2)


def _straightened(ring: np.ndarray, step: float) -> np.ndarray:
    """Corners (m, 2) of a closed ring (n, 2), first and last alike, without those that lie within a `step` of the lines between the
    others."""
    return cv2.approxPolyDP(ring[:-1].astype(np.float32), step, True)[:, 0].astype(np.float64)


def _ring(corners: np.ndarray) -> Ring:
    return tuple((float(x), float(y)) for x, y in corners)
