"""What a mesh was found to be, and what had to be mended before it could be used."""

from dataclasses import dataclass

import numpy as np
from pydantic import BaseModel, ConfigDict

from orthomill.schemas.job import Columns


@dataclass(frozen=True)
class MeshVertices(Columns):
    """Vertices of the mended mesh, m relative to `MeshCensus.origin`, and their colours (0 where the file has none)."""

    x: np.ndarray
    y: np.ndarray
    z: np.ndarray
    """float64"""
    red: np.ndarray
    green: np.ndarray
    blue: np.ndarray
    """uint8"""


@dataclass(frozen=True)
class MeshTriangles(Columns):
    """Triangles of the mended mesh, in the order of the blocks in which they are stored; int32 numbers of vertices."""

    a: np.ndarray
    b: np.ndarray
    c: np.ndarray


class MeshCensus(BaseModel):
    """Counts of a mesh file; lengths in m, coordinates in the project's system."""

    model_config = ConfigDict(frozen=True)

    vertices: int
    triangles: int
    """those that are used"""
    read: int
    """those of the file; 0 for a point cloud"""
    not_finite: int = 0
    degenerate: int = 0
    duplicate: int = 0
    triangulated: bool = False
    """The file was a point cloud."""
    bodies: int = 1
    open_edges: int = 0
    """edges of one triangle only: borders of the surface and of its holes"""
    turned_edges: int = 0
    """edges between two triangles that face opposite ways"""
    system: str = ""
    """reference system of the file, where it is not that of the project"""
    median_edge: float
    origin: tuple[float, float, float]
    low: tuple[float, float, float]
    high: tuple[float, float, float]

    @property
    def size(self) -> float:
        """Diagonal of the box about the mesh, m."""
        return float(np.linalg.norm(np.subtract(self.high, self.low)))

    @property
    def middle(self) -> np.ndarray:
        """Middle of that box (3,) m."""
        return 0.5 * np.add(self.high, self.low)
