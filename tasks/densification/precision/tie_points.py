"""What tie points say of the surface: how many of them lie off it by more than both standard errors allow.

Strategy. A tie point was measured by itself, before any height was looked for densely, and usually by more photographs. It takes no
part in the surface of most methods, so that it is the one test of heights that every run has without knowing the truth. A point
beside an edge belongs to either side of it: only what it lacks to the heights of the cells next to its own counts.
"""

from collections.abc import Iterator

import numpy as np
from pydantic import BaseModel, ConfigDict

from orthomill.schemas.observations import GroundPoints
from orthomill.schemas.raster import MapGrid, Window
from orthomill.schemas.surface import MEASURED
from orthomill.tasks.densification.height_differences import extremes

_SIGMAS = 3.0
"""standard errors, of the point and the height together, beyond which a point contradicts the surface"""
_BESIDE = 1
"""cells around that of a point whose heights are its own as well"""
DISTANCES = 80
"""classes of the distances, a quarter of the height of a pixel of parallax wide; the last is open"""


class TieCounts(BaseModel):
    """Tie points on measured heights: how many there are, contradict the surface, and lie how far off it."""

    model_config = ConfigDict(frozen=True)

    points: int = 0
    contradicting: int = 0
    """farther away than three standard errors of point and height"""
    distances: tuple[int, ...] = (0,) * DISTANCES
    """points by class of their distance, `width` m each"""
    width: float = 1.0


def sum_ties(parts: tuple[TieCounts, ...]) -> TieCounts:
    """Those of all parts of a surface, which have one width of classes."""
    distances = np.sum([part.distances for part in parts], axis=0)
    return TieCounts(
        points=sum(part.points for part in parts),
        contradicting=sum(part.contradicting for part in parts),
        distances=tuple(distances.tolist()),
        width=parts[0].width,
    )


def around(window: Window, shape: tuple[int, int]) -> Window:
    """The window of heights that the tie points of a tile are compared with."""
    return window.grown(_BESIDE).clipped(shape)


def tie_counts(
    points: GroundPoints,
    height: Iterator[np.ndarray],
    relative: Iterator[np.ndarray],
    provenance: Iterator[np.ndarray],
    grid: MapGrid,
    windows: tuple[Window, ...],
    width: float,
) -> TieCounts:
    """Tie points against the surface, tile by tile.

    height, relative (m) and provenance (rows, cols): the surface over `around` of every window, in their order; width: of a class
    of distances, m.
    """
    col, row = grid.pixel(points.x, points.y)
    row, col = np.rint(row).astype(np.int64), np.rint(col).astype(np.int64)
    parts = [np.empty((0, 2))]
    for window, *tile in zip(windows, height, relative, provenance, strict=True):
        last = window.row + window.height, window.col + window.width
        inside = (row >= window.row) & (row < last[0]) & (col >= window.col) & (col < last[1]) & np.isfinite(points.z)
        if inside.any():
            part = around(window, grid.shape)
            at = row[inside] - part.row, col[inside] - part.col
            parts.append(_departures(points.z[inside], points.sigma_z[inside], at, *tile))
    away, allowed = np.concatenate(parts).T
    classes = np.minimum(away / width, DISTANCES - 1).astype(int)
    return TieCounts(
        points=len(away),
        contradicting=int(np.sum(away > allowed)),
        distances=tuple(np.bincount(classes, minlength=DISTANCES).tolist()),
        width=width,
    )


def _departures(
    z: np.ndarray, sigma: np.ndarray, at: tuple[np.ndarray, np.ndarray], height: np.ndarray, relative: np.ndarray, code: np.ndarray
) -> np.ndarray:
    """(K, 2) m: how far the points on measured cells lie beyond the heights around them, and how far they may."""
    highest, lowest = (values[at] for values in extremes(height, np.isfinite(height), _BESIDE))
    away = np.maximum(np.maximum(z - highest, lowest - z), 0.0)
    allowed = _SIGMAS * np.hypot(np.nan_to_num(sigma), relative[at])
    return np.column_stack([away, allowed])[np.isin(code[at], MEASURED)]
