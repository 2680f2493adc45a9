"""Heights of the surface at points of known height: differences, and shares within n standard errors of each difference.

A height between four cells is theirs, bilinear; where one of them has none, the point is not compared. The standard error of a
difference is that of the surface and that of the point together.

Source: Karfis 2009 (sources/epipolar.md#evaluation: shares within n sigma); Skarlatos (sources/surface_check.md#against-points).
"""

from dataclasses import dataclass

import numpy as np
from pydantic import BaseModel, ConfigDict

from orthomill.schemas.job import Columns
from orthomill.schemas.raster import MapGrid, Window
from orthomill.schemas.surface import MEASURED
from orthomill.tasks.evaluation.accuracy import SIGMAS
from orthomill.tasks.evaluation.reference_points import ReferencePoints

HALO = 1
"""cells around a tile: a point near its border lies between cells of two"""


@dataclass(frozen=True)
class PointDifferences(Columns):
    """One row per point of a tile that was compared."""

    dh: np.ndarray
    """float64 m: surface minus point"""
    sigma: np.ndarray
    """float64 m: standard error of the difference; NaN where the surface states none"""
    measured: np.ndarray
    """bool: whether all heights around the point were measured"""


class PointGroup(BaseModel):
    """The differences at some of the points; m, and shares in %."""

    model_config = ConfigDict(frozen=True)

    name: str
    words: str
    points: int
    bias: float
    sd: float | None
    rmse: float
    nmad: float
    largest: float
    within: tuple[float | None, ...]


class PointsSummary(BaseModel):
    """All points of the reference, those inside the surface, and the groups that were compared."""

    model_config = ConfigDict(frozen=True)

    given: int
    inside: int
    groups: tuple[PointGroup, ...]


@dataclass(frozen=True)
class PointTile:
    """The cells `core` of a surface on `grid`, and the larger `window` that is read for them."""

    grid: MapGrid
    core: Window
    window: Window


def points_in_tile(
    height: np.ndarray, precision: np.ndarray, provenance: np.ndarray, points: ReferencePoints, where: PointTile
) -> PointDifferences:
    """The differences at the points whose cell is in the core; height, precision (rows, cols) m and provenance at the window."""
    col, row = where.grid.pixel(points.x, points.y)
    own = np.flatnonzero(_within(where.core, row, col))
    row, col = row[own] - where.window.row, col[own] - where.window.col
    # Points beyond the outermost centres of the grid have no four cells.
    r, c = np.floor(row).astype(int), np.floor(col).astype(int)
    whole = (r >= 0) & (c >= 0) & (r + 1 < height.shape[0]) & (c + 1 < height.shape[1])
    own, r, c, row, col = own[whole], r[whole], c[whole], row[whole] - r[whole], col[whole] - c[whole]
    weights = [(1 - row) * (1 - col), (1 - row) * col, row * (1 - col), row * col]
    corners = [(r, c), (r, c + 1), (r + 1, c), (r + 1, c + 1)]
    z = sum(w * height[at].astype(np.float64) for w, at in zip(weights, corners, strict=True))
    # Neighbouring cells err alike, so that the mean of four is no better than one of them.
    stated = sum(w * precision[at].astype(np.float64) for w, at in zip(weights, corners, strict=True))
    measured = np.all([np.isin(provenance[at], MEASURED) for at in corners], axis=0)
    known = np.isfinite(z)
    sigma = np.hypot(stated, points.sigma[own])
    return PointDifferences((z - points.z[own])[known], sigma[known], measured[known])


def _within(core: Window, row: np.ndarray, col: np.ndarray) -> np.ndarray:
    """Which pixel coordinates are nearest to a cell of the core."""
    r, c = np.rint(row), np.rint(col)
    return (r >= core.row) & (r < core.row + core.height) & (c >= core.col) & (c < core.col + core.width)


def summarise_points(parts: tuple[PointDifferences, ...], points: ReferencePoints, grid: MapGrid) -> PointsSummary:
    """The summary of all tiles of a surface on `grid`."""
    dh, sigma, measured = (np.concatenate([getattr(part, name) for part in parts]) for name in ("dh", "sigma", "measured"))
    col, row = grid.pixel(points.x, points.y)
    groups = (
        ("all", "all heights", np.ones(len(dh), bool)),
        ("measured", "measured heights", measured),
        ("estimated", "estimated heights", ~measured),
    )
    return PointsSummary(
        given=len(points),
        inside=int(_within(Window(0, 0, *grid.shape), row, col).sum()),
        groups=tuple(_group(name, words, dh[own], sigma[own]) for name, words, own in groups if own.any()),
    )


def _group(name: str, words: str, dh: np.ndarray, sigma: np.ndarray) -> PointGroup:
    stated = np.isfinite(sigma)
    ratio = np.abs(dh[stated]) / np.maximum(sigma[stated], 1e-9)
    middle = float(np.median(dh))
    return PointGroup(
        name=name,
        words=words,
        points=len(dh),
        bias=round(float(dh.mean()), 4),
        sd=round(float(dh.std(ddof=1)), 4) if len(dh) > 1 else None,
        rmse=round(float(np.sqrt((dh**2).mean())), 4),
        nmad=round(1.4826 * float(np.median(np.abs(dh - middle))), 4),
        largest=round(float(dh[np.abs(dh).argmax()]), 4),
        within=tuple(round(100.0 * float((ratio <= k).mean()), 2) if len(ratio) else None for k in SIGMAS),
    )
