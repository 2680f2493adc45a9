"""The colours that a photograph has for points of a surface, wherever they lie, and what these are worth.

The weight of a colour is the area of the surface element in the photograph: c^2 (n d) / w^3 for the unit normal n, the way d to the
projection centre and the depth w along the axis; the element itself is the same for all photographs. It is made soft towards the
border of the photograph.

Source: Petsa et al. 2007 (sources/blending.md, M6, M12).
"""

from dataclasses import dataclass

import numpy as np

from orthomill.kernels.kernel_compilation import njit
from orthomill.tasks.colouring.sampling.photograph_colours import LEAST_WEIGHT, PhotoPixelsAt, colours_at
from orthomill.tasks.colouring.sight.sight_rasters import TilePoints
from orthomill.tasks.geometry.view import View, project_point


@dataclass(frozen=True, eq=False)
class SampledPoints:
    """Pixels (N, 2), colours (N, bands), weights (N,) and squared distances from the middle (N,) of the points at `at` (N,) in one
    photograph."""

    at: np.ndarray
    pixels: np.ndarray
    colour: np.ndarray
    weight: np.ndarray
    r2: np.ndarray


def sample_points(
    view: View, part: PhotoPixelsAt, surface: TilePoints, chosen: np.ndarray, facing: float, border: float
) -> SampledPoints:
    """What a photograph shows of the `chosen` (N,) bool points of a tile; `facing`: -1 for a mesh whose triangles face inwards;
    `border`: width of the soft border, px."""
    at, camera = np.flatnonzero(chosen), view.camera
    pixels, weight, r2 = np.empty((at.size, 2)), np.empty(at.size, np.float32), np.empty(at.size, np.float32)
    soft = max(border, 1e-9)
    _show(view.numbers, surface.points, surface.normals, at, float(facing), soft, pixels, weight, r2)
    colour, known = colours_at(part, (camera.height, camera.width), pixels)
    return SampledPoints(surface.at[at], pixels, colour, weight * known, r2)


def of_tile(surface: TilePoints, values: np.ndarray) -> np.ndarray:
    """Those of `values` (rows, cols) at the points of a tile."""
    return values.ravel()[surface.at]


@njit()
def _show(n, points, normals, chosen, facing, soft, pixels, weight, r2):
    """Fills `pixels` (M, 2), `weight` and `r2` (M,) of the `chosen` (M,) of points and unit normals (N, 3): where the view `n`
    shows them, with which weight, and how far from its middle; `soft`: px of border."""
    right, bottom = 0.5 * (n.width - 1.0), 0.5 * (n.height - 1.0)
    corner = right * right + bottom * bottom
    for i in range(chosen.size):
        k = chosen[i]
        x, y, z = points[k, 0], points[k, 1], points[k, 2]
        col, row, depth = project_point(n, x, y, z)
        inside = min(min(col, n.width - 1.0 - col), min(row, n.height - 1.0 - row)) + 0.5
        # NaN is not inside.
        border = min(inside / soft, 1.0) if inside > 0.0 else 0.0
        towards = normals[k, 0] * (n.xc - x) + normals[k, 1] * (n.yc - y) + normals[k, 2] * (n.zc - z)
        area = n.c * n.c * facing * towards / (depth * depth * depth)
        pixels[i, 0], pixels[i, 1] = col, row
        weight[i] = max(area * border * border * (3.0 - 2.0 * border), LEAST_WEIGHT)
        r2[i] = ((col - right) ** 2 + (row - bottom) ** 2) / corner
