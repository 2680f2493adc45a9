"""Which photographs truly see each cell: inside the photo, and nothing between the cell and the projection centre."""

import numpy as np

from orthomill.kernels.kernel_compilation import njit
from orthomill.schemas.raster import MapGrid, Window
from orthomill.tasks.geometry.view import View, project_point
from orthomill.tasks.simulation.scene.layout import Scene
from orthomill.tasks.simulation.scene.traversal import Ray, columns_of, is_free

STEEPEST = 0.62
"""Slope of the ground that a simulated scene does not exceed."""
_MARGIN = 6.0  # m on top of the highest roof: for crowns, and for ground that is no plane


def occlusion_reach(views: tuple[View, ...], scene: Scene) -> float:
    """The distance (m) within which an object can hide a point, for the flattest ray of the photos.

    An object of height h on ground that rises with slope m hides a point below a ray that rises by 1 / t per metre when it is
    nearer than h / (1 / t - m).
    """
    camera = views[0].camera
    # 12 % more than the half diagonal over c: distortion and tilts of up to two degrees make the corner ray flatter.
    flattest = 1.12 * np.hypot(camera.width, camera.height) / 2.0 / camera.c
    # The lower bound keeps the reach finite for wide angles.
    return float((scene.settings.roof_top + _MARGIN) / max(1.0 / flattest - STEEPEST, 0.25))


def visibility(views: tuple[View, ...], grid: MapGrid, window: Window, wide: Window, height: np.ndarray) -> np.ndarray:
    """uint32 (rows, cols) of `window`: bit i is set where `views[i]` sees the cell's centre.

    `height` (m) are the cells of `wide`, a larger window that begins on a multiple of BLOCK and reaches as far as occlusion does.
    """
    columns = columns_of(height, wide, grid.cell)
    seen = np.zeros(window.shape, np.uint32)
    for bit, view in enumerate(views):
        place = (float(grid.west), float(grid.north), float(grid.cell))
        _visibility(seen, np.uint32(1 << bit), view.numbers, place, (window.row, window.col), columns)
    return seen


@njit()
def _visibility(seen, bit, n, place, corner, columns):
    """Sets `bit` of every cell that one photograph sees; `n` is `View.numbers`."""
    west, north, cell = place
    top = float(columns.highest.max())
    u0, v0 = (n.xc - west) / cell, (north - n.yc) / cell
    for row in range(seen.shape[0]):
        for col in range(seen.shape[1]):
            u, v = corner[1] + col + 0.5, corner[0] + row + 0.5
            z = float(columns.tops[corner[0] + row - columns.row, corner[1] + col - columns.col, 0])
            x, y = west + u * cell, north - v * cell
            c, r, depth = project_point(n, x, y, z)
            if depth > 0.0 and 0.0 <= c <= n.width - 1.0 and 0.0 <= r <= n.height - 1.0:
                fall = n.zc - z
                # Above the highest point of the window nothing can be in the way.
                if is_free(columns, Ray(u0, v0, n.zc, (u - u0) / fall, (v - v0) / fall), fall, n.zc - top):
                    seen[row, col] |= bit
