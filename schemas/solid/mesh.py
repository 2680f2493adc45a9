"""A triangle mesh: a surface with any number of heights at a place."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class TriangleMesh:
    """Triangles between numbered vertices. Seen from outside, the vertices of a triangle follow each other counter-clockwise."""

    vertices: np.ndarray
    """(V, 3) float64 m, relative to `origin`"""
    triangles: np.ndarray
    """(T, 3) int32: numbers of vertices"""
    # Added in float64 and only at the end: float32, in which meshes are stored and drawn, has 7 digits, and Y in a map 7 before the
    # point.
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """X, Y, Z m of the vertices' own origin in the project's system"""
    colours: np.ndarray | None = None
    """(V, 3) uint8, where the file has them"""

    def __post_init__(self) -> None:
        """Raises ValueError for arrays of other shapes and for triangles of vertices that do not exist."""
        if (
            self.vertices.ndim != 2
            or self.vertices.shape[1:] != (3,)
            or self.triangles.ndim != 2
            or self.triangles.shape[1:] != (3,)
        ):
            raise ValueError(f"vertices {self.vertices.shape} and triangles {self.triangles.shape} must both be (N, 3)")
        if self.triangles.size and not 0 <= self.triangles.min() <= self.triangles.max() < len(self.vertices):
            raise ValueError(f"triangles name vertices {self.triangles.min()} to {self.triangles.max()} of {len(self.vertices)}")
        if self.colours is not None and self.colours.shape != self.vertices.shape:
            raise ValueError(f"{len(self.colours)} colours for {len(self.vertices)} vertices")

    @property
    def corners(self) -> np.ndarray:
        """(T, 3, 3) float64 m: the three vertices of each triangle, relative to `origin`."""
        return self.vertices[self.triangles]

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest X, Y, Z (3,) m in the project's system."""
        shift = np.array(self.origin)
        return self.vertices.min(axis=0) + shift, self.vertices.max(axis=0) + shift
