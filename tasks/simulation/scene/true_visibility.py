"""Which photographs truly see each cell: inside the photo, and nothing between the cell and the projection centre."""

import numpy as np
from numba import njit

from orthomill.schemas.raster import MapGrid, Window
from orthomill.tasks.geometry.view import View, project_point
from orthomill.tasks.simulation.scene.layout import Scene
from orthomill.tasks.simulation.scene.traversal import UprightColumns, columns_of, is_free

STEEPEST = 0.62
"""Slope of the ground that a simulated scene does not exceed."""


def occlusion_reach(views: tuple[View, ...], scene: Scene) -> float:
    """How far away (m) a thing can stand and still hide a point, for the flattest ray of the photos.

    A thing of height h on ground that rises with slope m hides a point below a ray that rises by 1 / t per metre when it is
    nearer than h / (1 / t - m).
    """
    camera = views[0].camera
    flattest = 1.12 * np.hypot(camera.width, camera.height) / 2.0 / camera.c
    return float((scene.settings.roof_top + 6.0) / max(1.0 / flattest - STEEPEST, 0.25))


def visibility(views: tuple[View, ...], grid: MapGrid, window: Window, wide: Window, height: np.ndarray) -> np.ndarray:
    """uint32 (rows, cols) of `window`: bit i is set where `views[i]` sees the cell's centre.

    `height` (m) are the cells of `wide`, a larger window that begins on a multiple of BLOCK and reaches as far as occlusion does.
    """
    columns: UprightColumns = columns_of(height, wide, grid.cell)
    seen = np.zeros(window.shape, np.uint32)
    place = np.array([grid.west, grid.north, grid.cell, float(columns.highest.max())])
    for bit, view in enumerate(views):
        _visibility(seen, np.uint32(1 << bit), view.numbers, place, (window.row, window.col), columns.numbers)
    return seen


@njit(cache=True)
def _visibility(seen, bit, n, place, corner, columns):
    """Sets `bit` of every cell that one photograph sees; `n` is `View.numbers`."""
    west, north, cell, top = place
    tops, row0, col0 = columns[0], columns[2], columns[3]
    u0, v0 = (n.xc - west) / cell, (north - n.yc) / cell
    for row in range(seen.shape[0]):
        for col in range(seen.shape[1]):
            u, v = corner[1] + col + 0.5, corner[0] + row + 0.5
            z = float(tops[corner[0] + row - row0, corner[1] + col - col0, 0])
            x, y = west + u * cell, north - v * cell
            c, r, depth = project_point(n, x, y, z)
            if depth > 0.0 and 0.0 <= c <= n.width - 1.0 and 0.0 <= r <= n.height - 1.0:
                fall = n.zc - z
                if is_free(columns, u0, v0, n.zc, (u - u0) / fall, (v - v0) / fall, fall, n.zc - top):
                    seen[row, col] |= bit
