"""Which photographs show a place of the surface, and where in them."""

from dataclasses import dataclass

import numpy as np

from orthomill.schemas.orientation import Block
from orthomill.schemas.raster import MapGrid
from orthomill.tasks.geometry.view import block_view
from orthomill.tasks.visibility.monoplotting import SurfaceHeights, first_points

_NEAR = 1.5
"""cells between a place and the first point of the surface on its ray"""


@dataclass(frozen=True)
class ShownPlace:
    """A place in a photograph: pixel (col, row), size of a pixel on the ground (m), and whether nothing stands before it."""

    photo: str
    col: float
    row: float
    pixel: float
    free: bool


def photographs_of_place(block: Block, place: tuple[float, float, float], grid: MapGrid, heights: np.ndarray) -> list[ShownPlace]:
    """The photographs in whose frame a place (x, y, z) m lies: free sight first, then by the size of their pixels there.

    heights (rows, cols) m of the surface on `grid`, around the place: what stands farther away is not looked at.
    """
    point = np.array([place], np.float64)
    surface = SurfaceHeights(np.ascontiguousarray(heights, np.float32), grid)
    found = []
    for name in block.names:
        view = block_view(block, name)
        pixel = view.project(point)
        if not view.contains(pixel)[0]:
            continue
        first = first_points(view, pixel, surface)[0]
        away = np.linalg.norm(np.asarray(view.centre) - point[0])
        free = bool(np.linalg.norm(first - point[0]) < _NEAR * grid.cell)
        found.append(ShownPlace(name, float(pixel[0, 0]), float(pixel[0, 1]), float(away / view.camera.c), free))
    return sorted(found, key=lambda one: (not one.free, one.pixel))
