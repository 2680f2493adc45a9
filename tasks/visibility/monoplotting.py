"""Monoplotting: the first point of a surface that the ray of an image point meets, with its covariance.

Strategy: the ray is followed from the highest ground downwards in steps of half a cell until it is below the surface (bilinear
between cell centres), and the place between the last two steps is found by halving. So a ray that passes over a roof and meets the
street behind it stops at the roof, where the published iteration (height, place, height of that place ...) may jump to and fro.
Holes are no surface: a ray that leaves the model or meets holes alone hits nothing.

The point moves with the image point, the orientation and the heights: on the plane of the surface about it the derivatives are
those of one intersection.

Source: Karfis 2009 (sources/epipolar.md#monoplotting).
"""

from typing import NamedTuple

import numpy as np

from orthomill.kernels.kernel_compilation import njit
from orthomill.schemas.raster import MapGrid
from orthomill.tasks.geometry.rotation import rotation_matrix
from orthomill.tasks.geometry.view import View

_HALVINGS = 40
"""a cell is divided by 2^40: the place is as exact as its coordinates"""
_STEEP = 0.02
"""vertical part of a unit direction below which a ray is level: it would cross the whole model"""
_SMALL = (1e-3, 1e-3, 1e-3, 1e-7, 1e-7, 1e-7, 1e-2, 1e-2)
"""steps of derivatives by centre (m), angles (rad) and pixels"""


class SurfaceHeights(NamedTuple):
    """A height model: `heights` (rows, cols) float32 m, NaN for holes, on the whole of `grid`."""

    heights: np.ndarray
    grid: MapGrid

    @property
    def bounds(self) -> tuple[float, float]:
        """Lowest and highest height, m; (0, 0) without any."""
        known = np.isfinite(self.heights)
        return (float(self.heights[known].min()), float(self.heights[known].max())) if known.any() else (0.0, 0.0)


def first_points(view: View, pixels: np.ndarray, surface: SurfaceHeights) -> np.ndarray:
    """The first points (N, 3) m of a surface on the rays of `pixels` (N, 2) (col, row); NaN where a ray hits nothing."""
    grid, (low, high) = surface.grid, surface.bounds
    directions = view.rays(np.asarray(pixels, np.float64).reshape(-1, 2))
    out = np.full((len(directions), 3), np.nan)
    corner = np.array([grid.west, grid.north, grid.cell])
    follow_rays(np.asarray(view.centre, np.float64), directions, surface.heights, corner, low, high, out)
    return out


@njit()
def _height(heights, corner, x, y):
    """Bilinear between the four cell centres around; NaN beyond them or at a hole."""
    c, r = (x - corner[0]) / corner[2] - 0.5, (corner[1] - y) / corner[2] - 0.5
    if not (c >= 0 and r >= 0 and c <= heights.shape[1] - 1 and r <= heights.shape[0] - 1):
        return np.nan
    j, i = min(int(c), max(heights.shape[1] - 2, 0)), min(int(r), max(heights.shape[0] - 2, 0))
    k, m = min(j + 1, heights.shape[1] - 1), min(i + 1, heights.shape[0] - 1)
    u, v = c - j, r - i
    upper = heights[i, j] * (1 - u) + heights[i, k] * u
    lower = heights[m, j] * (1 - u) + heights[m, k] * u
    return upper * (1 - v) + lower * v


@njit()
def follow_rays(centre, directions, heights, corner, low, high, out):
    """Fill out (N, 3) with the first points of `heights` on rays from `centre` along unit `directions` (N, 3).

    Where a ray hits nothing the row stays as it is. corner: west and north of the outer corner of the first cell, and its side, m;
    low, high: bounds of the heights, m.
    """
    for n in range(directions.shape[0]):
        dx, dy, dz = directions[n, 0], directions[n, 1], directions[n, 2]
        # NaN compares as False: a pixel without a ray hits nothing either.
        if not dz < -_STEEP:
            continue
        # A little above and below, so that level ground lies between the two ends.
        first, last = max((high + 0.01 - centre[2]) / dz, 0.0), (low - 0.01 - centre[2]) / dz
        level = np.sqrt(dx * dx + dy * dy)
        # Half a cell in plan and half a cell in height, whichever comes first.
        step = 0.5 * corner[2] / max(level, -dz)
        count = int(np.ceil(max(last - first, 0.0) / step)) + 1
        above = np.nan
        for q in range(count + 1):
            t = min(first + q * step, last)
            ground = _height(heights, corner, centre[0] + t * dx, centre[1] + t * dy)
            over = centre[2] + t * dz - ground
            if over <= 0.0:
                a, b = (above, t) if above == above else (t, t)
                for _ in range(_HALVINGS):
                    middle = 0.5 * (a + b)
                    ground = _height(heights, corner, centre[0] + middle * dx, centre[1] + middle * dy)
                    # At a hole beside the surface there is nothing to stay above of.
                    if centre[2] + middle * dz - ground <= 0.0:
                        b = middle
                    else:
                        a = middle
                out[n, 0], out[n, 1], out[n, 2] = centre[0] + b * dx, centre[1] + b * dy, centre[2] + b * dz
                break
            above = t if over > 0.0 else np.nan


def surface_normals(points: np.ndarray, surface: SurfaceHeights) -> np.ndarray:
    """Normals (N, 3) (-dZ/dX, -dZ/dY, 1) of a surface at points (N, 3), from heights a cell away; level where those are unknown."""
    cell, grid = surface.grid.cell, surface.grid
    corner = np.array([grid.west, grid.north, cell])
    out = np.tile([0.0, 0.0, 1.0], (len(points), 1))
    for n, (x, y, _) in enumerate(points):
        for axis, (dx, dy) in enumerate(((cell, 0.0), (0.0, cell))):
            rise = _height(surface.heights, corner, x + dx, y + dy) - _height(surface.heights, corner, x - dx, y - dy)
            out[n, axis] = -rise / (2 * cell) if np.isfinite(rise) else 0.0
    return out


def point_covariance(
    view: View,
    orientation: np.ndarray,
    angles: tuple[float, float, float],
    pixel: np.ndarray,
    point: np.ndarray,
    normal: np.ndarray,
    sigmas: tuple[float, float],
) -> np.ndarray:
    """Covariance (3, 3) m^2 of a point on the plane through it with a normal.

    orientation: (6, 6) of the photograph (X, Y, Z m, omega, phi, kappa radians); angles: omega, phi, kappa, radians; pixel: (col,
    row); sigmas: standard errors of the pixel's coordinates (px) and of the height of the surface (m).
    """

    def hit(values: np.ndarray) -> np.ndarray:
        moved = View(view.name, view.camera, rotation_matrix(*values[3:6]), values[:3])
        ray = moved.rays(values[None, 6:])[0]
        return values[:3] + ray * ((point - values[:3]) @ normal) / (ray @ normal)

    at = np.concatenate([view.centre, angles, pixel])
    steps = np.diag(_SMALL)
    jacobian = np.column_stack([(hit(at + step) - hit(at - step)) / (2 * step.max()) for step in steps])
    observed = np.zeros((8, 8))
    observed[:6, :6], observed[6, 6], observed[7, 7] = orientation, sigmas[0] ** 2, sigmas[0] ** 2
    # A surface that is higher by dh meets the ray earlier, by dh over the part of the ray along the normal.
    ray = view.rays(pixel[None])[0]
    lifted = ray * normal[2] / (ray @ normal) * sigmas[1]
    return jacobian @ observed @ jacobian.T + np.outer(lifted, lifted)
