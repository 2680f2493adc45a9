"""The box of `box_scene` with texture on roof and ground: what dense matching can measure, with analytic truth."""

from functools import cache

import numpy as np
from box_scene import BOX, CENTRES, DSM, block, hits_box, view
from textured_plane import texture

from orthomill.schemas.orientation import Block
from orthomill.schemas.photo import Photo, Photos
from orthomill.schemas.raster import MapGrid, Window
from orthomill.schemas.surface import Surface
from orthomill.tasks.imagery.pyramid import halved
from orthomill.tasks.imagery.resampling import sample_cubic

SURFACE = Surface(grid=DSM, height_low=-12.0, height_high=30.0)
LEVELS = 3
_PIXEL = 0.25
"""m on the ground per texture pixel"""


def photos(names: str = "abcd") -> Photos:
    kind = {"width": 420, "height": 420, "bands": 1, "dtype": "uint8", "camera": "test", "levels": LEVELS}
    return Photos(photos=tuple(Photo(name=name, path=name, **kind) for name in names))


def colour(points: np.ndarray) -> np.ndarray:
    """Grey values of ground or roof points (N, 3) m: one texture, shifted on the roof."""
    shift = np.where(points[:, 2] > 1.0, 317.0, 0.0)
    return sample_cubic(texture(), np.column_stack([points[:, 0] / _PIXEL + 300 + shift, points[:, 1] / _PIXEL + 250]))


@cache
def pyramid(name: str) -> tuple[np.ndarray, ...]:
    """The levels of a photograph, uint8 (rows, cols, 1), with noise of a grey level and a gain of its own."""
    photo = view(name, "abcd")
    col, row = np.meshgrid(np.arange(420), np.arange(420))
    rays = photo.rays(np.column_stack([col.ravel(), row.ravel()]))
    distance, _ = hits_box(np.broadcast_to(photo.centre, rays.shape), rays)
    ground = -photo.centre[2] / rays[:, 2]
    points = photo.centre + rays * np.minimum(distance, ground)[:, None]
    number = sorted(CENTRES).index(name)
    noise = np.random.default_rng(number).normal(0, 1.0, len(points))
    grey = np.nan_to_num(colour(points)) * (0.8 + 0.05 * number) + noise
    levels = [np.clip(np.rint(grey), 1, 255).astype(np.uint8).reshape(420, 420, 1)]
    while len(levels) < LEVELS:
        levels.append(halved(levels[-1]))
    return tuple(levels)


def scene_block(names: str = "abcd") -> Block:
    return block(names)


def truth(grid: MapGrid) -> np.ndarray:
    """Heights (rows, cols) of cell centres, NaN within a cell of the walls."""
    x, y = grid.centres(Window(0, 0, grid.rows, grid.cols))
    x, y = x[None, :], y[:, None]
    signed = np.minimum(np.minimum(x - BOX[0], BOX[1] - x), np.minimum(y - BOX[2], BOX[3] - y))
    return np.where(abs(signed) < grid.cell, np.nan, np.where(signed > 0, BOX[4], 0.0))
