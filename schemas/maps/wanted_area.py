"""Where on the map something is wanted: polygons that a client has drawn, or what a block shows well."""

import numpy as np
from pydantic import BaseModel, ConfigDict

from orthomill.schemas.raster import MapGrid, Window

Ring = tuple[tuple[float, float], ...]


class WantedArea(BaseModel):
    """Polygons, each of an outer ring and those of its holes: X and Y m in the project's system."""

    model_config = ConfigDict(frozen=True)

    polygons: tuple[tuple[Ring, ...], ...] = ()
    """none: everywhere"""

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """West, south, east, north of all polygons, m."""
        corners = np.concatenate([np.array(rings[0]) for rings in self.polygons])
        (west, south), (east, north) = corners.min(axis=0), corners.max(axis=0)
        return float(west), float(south), float(east), float(north)

    def cells(self, grid: MapGrid, window: Window) -> np.ndarray:
        """(rows, cols) bool: which cells of a window have their centres inside."""
        x, y = grid.centres(window)
        inside = np.zeros(window.shape, bool)
        for rings in self.polygons:
            odd = np.zeros(window.shape, bool)
            for ring in rings:
                _cross(np.array(ring), x[None, :], y[:, None], odd)
            inside |= odd
        return inside if self.polygons else ~inside


def _cross(ring: np.ndarray, x: np.ndarray, y: np.ndarray, odd: np.ndarray) -> None:
    """Turns `odd` (rows, cols) wherever a ray to the east crosses an edge of the ring (Jordan)."""
    for (x1, y1), (x2, y2) in zip(ring, np.roll(ring, -1, axis=0), strict=True):
        if y1 != y2:
            # Half-open, so that a corner is crossed once and not twice.
            crossed = ((min(y1, y2) <= y) & (y < max(y1, y2)))[:, 0]
            odd[crossed] ^= x < x1 + (y[crossed] - y1) * (x2 - x1) / (y2 - y1)
