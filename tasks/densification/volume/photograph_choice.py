"""Which photographs of a block show a tile of the map best, for comparison with one another.

Strategy: one photograph after the other is added, each time the one that adds most over a grid of places on the tile: at every
place that it shows it adds the more the steeper it looks down, the larger its scale is beside the largest one, the fewer
photographs there already are, and the farther its direction is from theirs. So a strip gives the neighbours, a dense block
several azimuths, an oblique block whatever it has, and a photograph that alone shows a corner of the tile is not forgotten.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from orthomill.schemas.raster import MapGrid, Window
from orthomill.tasks.geometry.view import View

_PLACES = 5
"""places along each side of a tile"""
_APART = 0.15
"""Difference of two directions, as base over height, from which on a photograph counts as a new view."""
_SAMPLES = 9
"""places along each side of the surface at which the bases are looked at"""


class Sight(NamedTuple):
    """How views see places: `shown` (V, N) bool, `direction` (V, N, 2) horizontal over vertical distance to the projection centre,
    `scale` (V, N) ground pixel over the finest one at the place, 1 or more."""

    shown: np.ndarray
    direction: np.ndarray
    scale: np.ndarray


def places(grid: MapGrid, window: Window, ground: float, side: int = _PLACES) -> np.ndarray:
    """(side * side, 3) points (m) spread over a window of the map at the height `ground`."""
    x = grid.west + grid.cell * (window.col + window.width * (np.arange(side) + 0.5) / side)
    y = grid.north - grid.cell * (window.row + window.height * (np.arange(side) + 0.5) / side)
    return np.stack(np.meshgrid(x, y, [ground]), axis=-1).reshape(-1, 3)


def sight(views: Sequence[View], points: np.ndarray) -> Sight:
    """How the views see the points (N, 3) m."""
    shown = np.array([view.contains(view.project(points)) for view in views])
    away = np.array([view.centre for view in views])[:, None, :] - points
    shown &= away[..., 2] > 0
    with np.errstate(divide="ignore", invalid="ignore"):
        direction = away[..., :2] / away[..., 2:]
    pixel = np.linalg.norm(away, axis=-1) / np.array([view.camera.c for view in views])[:, None]
    finest = np.where(shown, pixel, np.inf).min(axis=0)
    return Sight(shown, direction, pixel / np.where(np.isfinite(finest), finest, 1.0))


def chosen(seen: Sight, most: int) -> tuple[int, ...]:
    """Numbers of at most `most` views, the best first; none that shows no place."""
    steep = 1.0 / (1.0 + (seen.direction**2).sum(axis=-1))
    worth = np.where(seen.shown, steep / seen.scale**2, 0.0)
    apart, count = np.ones(seen.shown.shape), np.zeros(seen.shown.shape[1])
    order: list[int] = []
    for _ in range(min(most, len(worth))):
        gain = (worth * apart / (1.0 + count)).sum(axis=1)
        gain[order] = -1.0
        best = int(np.argmax(gain))
        if gain[best] <= 0:
            break
        order.append(best)
        count += seen.shown[best]
        distance = np.linalg.norm(seen.direction - seen.direction[best], axis=-1)
        # Never zero: two photographs from one place are better than a place that only one shows.
        apart = np.where(seen.shown[best], np.minimum(apart, np.clip(distance / _APART, 0.01, 1.0)), apart)
    return tuple(order)


def base_height(views: Sequence[View], grid: MapGrid, ground: float, most: int) -> float:
    """The widest base over height of the photographs that are compared: median over the surface; 1 where no place is seen twice."""
    points = places(grid, Window(0, 0, grid.rows, grid.cols), ground, _SAMPLES)
    widest = []
    for point in points:
        seen = sight(views, point[None])
        directions = seen.direction[list(chosen(seen, most)), 0]
        if len(directions) >= 2:
            widest.append(np.linalg.norm(directions[:, None] - directions[None], axis=-1).max())
    return float(np.median(widest)) if widest else 1.0
