"""Image points of one photograph on the surface of a project: where they are, how precisely, and which photographs see them.

Another photograph sees a point when it is in its frame and the first point of the surface on its ray there is the same, to a cell.
"""

from collections.abc import Sequence

import numpy as np

from orthomill.schemas.inspections.inspection import SurfacePoint
from orthomill.schemas.orientation import Block
from orthomill.schemas.raster import MapGrid
from orthomill.tasks.geometry.view import block_view
from orthomill.tasks.visibility.monoplotting import SurfaceHeights, first_points, point_covariance, surface_normals

_NEAR = 1.5
"""cells, or metres per metre of height error: two rays meet the surface in the same place"""


def points_on_surface(
    block: Block, photo: str, pixels: np.ndarray, grid: MapGrid, heights: np.ndarray, sigmas: np.ndarray, pixel_sigma: float
) -> list[SurfacePoint | None]:
    """The points of `pixels` (N, 2) (col, row) of a photograph on a surface, None for a ray that hits nothing.

    heights, sigmas: (rows, cols) m of the whole `grid`; pixel_sigma: standard error of an image coordinate, px. Raises PhotoError
    for a photograph that is not in the block.
    """
    block.check_holds(photo)
    surface, view, orientation = SurfaceHeights(heights, grid), block_view(block, photo), block.of(photo)
    inside = view.contains(pixels)
    found = np.where(inside[:, None], first_points(view, pixels, surface), np.nan)
    known = np.flatnonzero(np.isfinite(found).all(axis=1))
    seen = _seen_by(block, photo, found[known], surface)
    normals = surface_normals(found[known], surface)
    covariance = np.zeros((6, 6)) if orientation.covariance is None else np.array(orientation.covariance)
    angles = tuple(np.radians(orientation.omega_phi_kappa))
    out: list[SurfacePoint | None] = [None] * len(pixels)
    for n, normal, photos in zip(known, normals, seen, strict=True):
        col, row = grid.pixel(found[n, 0], found[n, 1])
        height_sigma = float(np.nan_to_num(sigmas[round(row), round(col)], nan=0.0))
        precision = point_covariance(view, covariance, angles, pixels[n], found[n], normal, (pixel_sigma, height_sigma))
        x, y, z = map(float, found[n])
        out[n] = SurfacePoint(place=(x, y, z), covariance=_three(precision), photos=photos)
    return out


def _three(matrix: np.ndarray) -> tuple[tuple[float, float, float], ...]:
    return tuple((a, b, c) for a, b, c in matrix.tolist())


def _seen_by(block: Block, photo: str, points: np.ndarray, surface: SurfaceHeights) -> Sequence[tuple[str, ...]]:
    """The other photographs that see each point (N, 3)."""
    seen: list[list[str]] = [[] for _ in points]
    for name in block.names:
        if name == photo or not len(points):
            continue
        view = block_view(block, name)
        pixels = view.project(points)
        inside = np.flatnonzero(view.contains(pixels))
        away = np.linalg.norm(first_points(view, pixels[inside], surface) - points[inside], axis=1)
        for n in inside[away < _NEAR * surface.grid.cell]:
            seen[n].append(name)
    return [tuple(names) for names in seen]
