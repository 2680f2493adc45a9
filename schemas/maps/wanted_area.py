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
            rows, cols = (_between(places, np.array(rings[0])[:, axis]) for axis, places in ((1, y), (0, x)))
            odd = np.zeros((len(y[rows]), len(x[cols])), bool)
            for ring in rings if odd.size else ():
                _cross(np.array(ring), x[None, cols], y[rows, None], odd)
            inside[rows, cols] |= odd
        return inside if self.polygons else ~inside


def _between(places: np.ndarray, corners: np.ndarray) -> slice:
    """Which of places in a row (N,), falling or rising, lie between the least and the greatest corner."""
    among = np.flatnonzero((places >= corners.min()) & (places <= corners.max()))
    return slice(among[0], among[-1] + 1) if len(among) else slice(0)


def _cross(ring: np.ndarray, x: np.ndarray, y: np.ndarray, odd: np.ndarray) -> None:
    """Turns `odd` (rows, cols) wherever a ray to the east crosses an edge of the ring (Jordan)."""
    for (x1, y1), (x2, y2) in zip(ring, np.roll(ring, -1, axis=0), strict=True):
        if y1 != y2:
            # Half-open, so that a corner is crossed once and not twice.
            crossed = ((min(y1, y2) <= y) & (y < max(y1, y2)))[:, 0]
            odd[crossed] ^= x < x1 + (y[crossed] - y1) * (x2 - x1) / (y2 - y1)
