"""The footprint map: how many photographs see each place at the mean height of the ground (or of a wall), and their outlines."""

from dataclasses import dataclass

import cv2
import numpy as np

from orthomill.schemas.orientation import Block
from orthomill.tasks.geometry.view import View, block_view

SIDE = 320
"""px of the map"""
OVERLAP = "orientation/overlap"
MOST = 6
"""Counts of this many photographs and more have one colour: heights gain little from further ones."""
OUTLINE, CENTRE = 20, 21
_EDGE = 24
"""points along each side of an outline: distortion bends it"""
_FARTHEST = 3.0
"""Footprints end at this many flying heights: an oblique photograph reaches to the horizon."""


@dataclass(frozen=True, eq=False)
class GroundMap:
    """A square of ground: the place (2,) of its upper left corner, m, and the side of a pixel, m."""

    west_north: np.ndarray
    cell: float

    def pixels(self, xy: np.ndarray) -> np.ndarray:
        """(N, 2) (col, row) of places (N, 2)."""
        return (xy - self.west_north) / self.cell * [1.0, -1.0] - 0.5

    def places(self) -> np.ndarray:
        """(SIDE * SIDE, 2) the centres of all pixels, row by row."""
        col, row = np.meshgrid(np.arange(SIDE) + 0.5, np.arange(SIDE) + 0.5)
        return self.west_north + self.cell * np.column_stack([col.ravel(), -row.ravel()])


def overlap_map(block: Block) -> np.ndarray:
    """(SIDE, SIDE) uint8: photographs that see each place, at most MOST; outlines and projection centres drawn over it."""
    height, views = block.ground_mean, _views(block)
    outlines = [outline(view, height) for view in views]
    ground = _ground_map(block, views, outlines)
    places = np.column_stack([ground.places(), np.full(SIDE * SIDE, height)]).reshape(SIDE, SIDE, 3)
    count = np.zeros((SIDE, SIDE), np.int64)
    for view, line in zip(views, outlines, strict=True):
        near = _window(ground, line, view, height)
        own = places[near]
        count[near] += view.contains(view.project(own.reshape(-1, 3))).reshape(own.shape[:2])
    drawn = np.minimum(count, MOST).astype(np.uint8)
    # Drawn over the counts in codes of their own, so that one raster carries the whole map.
    for line in outlines:
        cv2.polylines(drawn, [np.rint(ground.pixels(line)).astype(np.int32)], True, OUTLINE)
    for view in views:
        # Three pixels wide: a single one is lost when the picture is reduced.
        col, row = np.rint(ground.pixels(view.centre[None, :2])[0]).astype(int)
        drawn[max(row - 1, 0) : row + 2, max(col - 1, 0) : col + 2] = CENTRE
    return drawn


def _window(ground: GroundMap, line: np.ndarray, view: View, height: float) -> tuple[slice, slice]:
    """The rows and columns of the map that the outline of a photograph surrounds; all where that was cut off far away."""
    away = np.linalg.norm(line - view.centre[:2], axis=1)
    if len(line) < 4 * _EDGE or away.max() > 0.999 * _reach(view, height):
        return slice(0, SIDE), slice(0, SIDE)
    pixels = ground.pixels(line)
    (left, top), (right, bottom) = np.floor(pixels.min(axis=0)).astype(int) - 1, np.ceil(pixels.max(axis=0)).astype(int) + 2
    return slice(max(top, 0), max(bottom, 0)), slice(max(left, 0), max(right, 0))


def _views(block: Block) -> list[View]:
    return [block_view(block, name) for name in block.names]


def outline(view: View, height: float) -> np.ndarray:
    """(N, 2) m the border of a photograph on level ground; rays that never meet it are left out."""
    col, row = view.camera.width - 1.0, view.camera.height - 1.0
    share = np.linspace(0.0, 1.0, _EDGE, endpoint=False)
    zero, one = np.zeros(_EDGE), np.ones(_EDGE)
    top, right = np.column_stack([share * col, zero]), np.column_stack([one * col, share * row])
    bottom, left = np.column_stack([(1 - share) * col, one * row]), np.column_stack([zero, (1 - share) * row])
    border = np.vstack([top, right, bottom, left])
    places = view.at_height(border, height)[:, :2]
    # Shortened along its ray, so that an oblique outline keeps its shape.
    reach = _reach(view, height)
    offset = places - view.centre[:2]
    places = view.centre[:2] + offset * np.minimum(1.0, reach / np.maximum(np.linalg.norm(offset, axis=1), 1e-9))[:, None]
    return places[np.isfinite(places).all(axis=1)]


def _reach(view: View, height: float) -> float:
    return float(_FARTHEST * abs(view.centre[2] - height))


def _ground_map(block: Block, views: list[View], outlines: list[np.ndarray]) -> GroundMap:
    """The square that contains all projection centres and outlines; of a plane, the area where its surface is made instead."""
    shown = outlines if block.area is None else [np.reshape(block.area, (2, 2))]
    xy = np.vstack([*shown, *(view.centre[None, :2] for view in views)])
    # Projection centres, too: those of oblique photographs lie outside of their footprints.
    low, high = xy.min(axis=0), xy.max(axis=0)
    # A margin of 3 % on each side keeps the outlines off the frame of the picture.
    cell = 1.06 * max(float((high - low).max()), 1e-6) / SIDE
    middle = 0.5 * (low + high)
    return GroundMap(middle + 0.5 * SIDE * cell * np.array([-1.0, 1.0]), cell)


def map_width(block: Block) -> float:
    """Side of the map of `overlap_map`, m."""
    # Computed again for the report: a job that writes a raster returns nothing else.
    views = _views(block)
    return SIDE * _ground_map(block, views, [outline(view, block.ground_mean) for view in views]).cell
