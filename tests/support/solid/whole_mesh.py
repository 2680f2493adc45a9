"""A whole mesh in one raster, as the product never holds it: its jobs stream the blocks of a mesh through `add_triangles`."""

import numpy as np

from orthomill.schemas.raster import Window
from orthomill.tasks.visibility.scanline import NearestTriangles, Projection, add_triangles, empty_raster


def nearest_triangles(projection: Projection, vertices: np.ndarray, triangles: np.ndarray, window: Window) -> NearestTriangles:
    """The raster of a whole mesh: see `add_triangles`; the numbers are those of the rows of `triangles`."""
    raster = empty_raster(window)
    add_triangles(raster, projection, vertices, triangles, np.arange(len(triangles), dtype=np.int32))
    return raster
