"""Which photographs of a block show a place best, for comparison with one another.

Strategy: at every place of a regular grid one photograph after the other is taken, each time the one that looks down steepest,
has the largest scale, and looks from a direction that those taken before do not have. So a strip gives the neighbours, a dense
block several azimuths, an oblique block whatever it has. A tile gets the photographs of all its places, however many its area
needs; a cell compares those of its place.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from orthomill.schemas.raster import MapGrid, Window
from orthomill.tasks.geometry.view import View

PLACE = 32
"""Cells of a level along the side of the square that a place stands for; tiles begin at multiples of it."""
_NEAR = 0.05
"""worth of a photograph that shows the surroundings of a place but not its middle"""
_APART = 0.15
"""Difference of two directions, as base over height, from which on a photograph counts as a new view."""
_SAMPLES = 9
"""places along each side of the surface at which the bases are looked at"""
_BASES = (0.1, 2.0)
"""Bases over height between which the steps of the heights follow them: level views of a wall would ask for steps of nothing."""


class Sight(NamedTuple):
    """How views see places: `shown` (V, N) bool, `near` the same for the surroundings, `direction` (V, N, 2) horizontal over
    vertical distance to the projection centre, `scale` (V, N) ground pixel over the finest one at the place, 1 or more."""

    shown: np.ndarray
    near: np.ndarray
    direction: np.ndarray
    scale: np.ndarray


def places(grid: MapGrid, window: Window) -> tuple[np.ndarray, np.ndarray]:
    """X (C,) and Y (R,) of the places of a window of a level that begins at a multiple of PLACE."""
    cols, rows = np.arange(-(-window.width // PLACE)), np.arange(-(-window.height // PLACE))
    x = grid.west + grid.cell * (window.col + PLACE * (cols + 0.5))
    y = grid.north - grid.cell * (window.row + PLACE * (rows + 0.5))
    return x, y


def sight(views: Sequence[View], points: np.ndarray, surroundings: float) -> Sight:
    """How the views see the points (N, 3) m; `surroundings`: how far they extend, m."""
    pixels = [view.project(points) for view in views]
    away = np.array([view.centre for view in views]).reshape(-1, 1, 3) - points
    distance = np.linalg.norm(away, axis=-1)
    pixel = distance / np.array([view.camera.c for view in views])[:, None]
    shown = np.array([view.contains(at) for view, at in zip(views, pixels, strict=True)], bool).reshape(distance.shape)
    margins = surroundings / np.median(pixel, axis=1)
    near = np.array([view.contains(at, -margin) for view, at, margin in zip(views, pixels, margins, strict=True)], bool)
    above = away[..., 2] > 0
    with np.errstate(divide="ignore", invalid="ignore"):
        direction = away[..., :2] / away[..., 2:]
    finest = np.where(shown & above, pixel, np.inf).min(axis=0, initial=np.inf)
    scale = pixel / np.where(np.isfinite(finest), finest, pixel.min(axis=0, initial=np.inf))
    return Sight(shown & above, near.reshape(distance.shape) & above, direction, scale)


def preferred(seen: Sight, most: int) -> np.ndarray:
    """Numbers (N, most) of the views that are compared at each place, the best first; -1 where there are no more."""
    steep = 1.0 / (1.0 + (seen.direction**2).sum(axis=-1))
    worth = np.where(seen.shown, 1.0, np.where(seen.near, _NEAR, 0.0)) * steep / np.maximum(seen.scale, 1.0) ** 2
    out = np.full((seen.shown.shape[1], most), -1)
    at = np.arange(seen.shown.shape[1])
    for turn in range(min(most, len(worth))):
        best = np.argmax(worth, axis=0)
        some = worth[best, at] > 0
        out[some, turn] = best[some]
        # A twin of a photograph adds little, but more than none at all.
        distance = np.linalg.norm(seen.direction - seen.direction[best, at], axis=-1)
        worth = worth * np.clip(distance / _APART, 0.01, 1.0)
        worth[best, at] = 0.0
    return out


def base_height(views: Sequence[View], grid: MapGrid, ground: float, most: int) -> float:
    """The widest base over height of the photographs that are compared: median over the surface, within
    0.1 to 2; 1 where no place is seen twice."""
    side = (np.arange(_SAMPLES) + 0.5) / _SAMPLES
    x, y = grid.west + grid.cell * grid.cols * side, grid.north - grid.cell * grid.rows * side
    seen = sight(views, np.stack(np.meshgrid(x, y, [ground]), axis=-1).reshape(-1, 3), 0.0)
    widest = []
    for place, numbers in enumerate(preferred(seen, most)):
        directions = seen.direction[numbers[numbers >= 0], place]
        if len(directions) >= 2:
            widest.append(np.linalg.norm(directions[:, None] - directions[None], axis=-1).max())
    return float(np.clip(np.median(widest), *_BASES)) if widest else 1.0
