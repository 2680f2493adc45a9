"""Contours of a tile: smoothed within the standard error of the ground, cut where the ground was not measured.

Strategy. The heights are smoothed by a Gaussian, but no cell is moved by more than its own standard error: a contour wanders
within what is not known of the shape of the ground, and no farther. Tiles share the row of cells between them, where the lines of
both end in the same points.
"""

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from orthomill.schemas.bare_ground import TerrainCode
from orthomill.schemas.job import Columns
from orthomill.schemas.raster import MapGrid, Window
from orthomill.tasks.terrain.contours.contour_interval import ContourInterval

SMOOTHING = 1.5
"""cells: standard deviation of the Gaussian"""
HALO = 6
"""cells around a tile that its contours follow from"""
DECIMALS = 3
"""of coordinates: millimetres"""


@dataclass(frozen=True)
class ContourPieces(Columns):
    """One row for every vertex, piece after piece."""

    piece: np.ndarray
    """int64, ascending from 0"""
    x: np.ndarray
    y: np.ndarray
    height: np.ndarray
    sigma: np.ndarray
    """float64 m: of the ground at the vertex"""
    measured: np.ndarray
    """bool: whether the ground there was measured"""


def smoothed(height: np.ndarray, sigma: np.ndarray) -> np.ndarray:
    """Heights (rows, cols) m, NaN in gaps, smoothed by no more than their standard errors (rows, cols) m."""
    known = np.isfinite(height)
    weight, total = (
        ndimage.gaussian_filter(values.astype(np.float64), SMOOTHING, truncate=HALO / SMOOTHING, mode="constant")
        for values in (known, np.where(known, height, 0.0))
    )
    move = np.where(known, total / np.maximum(weight, 1e-9) - np.nan_to_num(height), 0.0)
    limit = np.nan_to_num(sigma)
    return np.where(known, height + np.clip(move, -limit, limit), np.nan)


def contour_pieces(
    height: np.ndarray,
    precision: np.ndarray,
    relative: np.ndarray,
    code: np.ndarray,
    interval: ContourInterval,
    grid: MapGrid,
    windows: tuple[Window, Window],
) -> ContourPieces:
    """The contours at multiples of the interval of the cells of the second of the windows; height, precision, relative (m) and code
    (rows, cols) cover the first."""
    import contourpy

    outer, core = windows
    inner, step = core.within(outer).slices, interval.interval
    z = smoothed(height, relative)[inner]
    if min(z.shape) < 2 or not np.isfinite(z).any():
        return _no_pieces()
    x, y = grid.centres(core)
    lines = contourpy.contour_generator(x, y, np.ma.masked_invalid(z), line_type=contourpy.LineType.Separate)
    first, last = np.ceil(np.nanmin(z) / step), np.floor(np.nanmax(z) / step)
    found = [(k * step, line) for k in np.arange(first, last + 1) for line in lines.lines(k * step)]
    if not found:
        return _no_pieces()
    count = np.array([len(line) for _, line in found])
    xy = np.round(np.concatenate([line for _, line in found]), DECIMALS)
    col, row = grid.pixel(xy[:, 0], xy[:, 1])
    at = (
        np.clip(np.rint(row).astype(np.int64) - outer.row, 0, outer.height - 1),
        np.clip(np.rint(col).astype(np.int64) - outer.col, 0, outer.width - 1),
    )
    return ContourPieces(
        piece=np.repeat(np.arange(len(found)), count),
        x=xy[:, 0],
        y=xy[:, 1],
        height=np.repeat([level for level, _ in found], count).astype(np.float64),
        sigma=precision[at].astype(np.float64),
        measured=code[at] == TerrainCode.MEASURED,
    )


def _no_pieces() -> ContourPieces:
    none = np.zeros(0)
    return ContourPieces(np.zeros(0, np.int64), none, none, none, none, np.zeros(0, bool))
