"""A height model as a triangle mesh: two triangles between any four cells, divided along the diagonal that is more level.

Only what has a height becomes surface: nothing bridges a hole.
"""

import numpy as np

from orthomill.schemas.raster import MapGrid
from orthomill.schemas.solid.mesh import TriangleMesh


def height_triangles(heights: np.ndarray, grid: MapGrid) -> TriangleMesh:
    """Triangles, with their fronts upwards, between the centres of the cells of heights (rows, cols) m on `grid`; NaN is a hole."""
    rows, cols = heights.shape
    x, y = grid.west + (np.arange(cols) + 0.5) * grid.cell, grid.north - (np.arange(rows) + 0.5) * grid.cell
    known = np.isfinite(heights)
    number = np.full(heights.shape, -1, np.int32)
    number[known] = np.arange(int(known.sum()), dtype=np.int32)
    row, col = np.nonzero(known)
    vertices = np.column_stack([x[col], y[row], heights[known].astype(np.float64)])
    nw, ne, sw, se = number[:-1, :-1], number[:-1, 1:], number[1:, :-1], number[1:, 1:]
    falling = np.abs(heights[:-1, :-1] - heights[1:, 1:])
    rising = np.abs(heights[:-1, 1:] - heights[1:, :-1])
    # A comparison with NaN is false: then the diagonal between the two known corners, or neither triangle counts.
    along = (falling <= rising) | (np.isnan(rising) & np.isfinite(falling))
    found = [
        np.where(along[..., None], np.stack([nw, sw, se], axis=2), np.stack([nw, sw, ne], axis=2)),
        np.where(along[..., None], np.stack([nw, se, ne], axis=2), np.stack([ne, sw, se], axis=2)),
    ]
    triangles = np.concatenate([one.reshape(-1, 3) for one in found])
    return TriangleMesh(vertices, np.ascontiguousarray(triangles[(triangles >= 0).all(axis=1)]))
