"""From corrections at scattered points to a correction and its precision in every cell, and to the corrected surface.

Strategy. The nodes of all pairs that lie near a tile are first freed of spikes (against the median of their neighbours). Then every
cell fits a plane to the corrections within a fixed radius, weighted by nearness: a linear interpolation that knows how well its
points agree. Only **corrections** are interpolated and added; interpolating corrected heights would smooth the surface
(methods/measured.md). The standard error holds the nodes' own and their scatter about the plane; it is not divided by the
square root of their number, because the windows of neighbours overlap. Points are added up in the order of the whole
raster, so that any tiling gives the same sums.

The surface is changed only where the correction exceeds its own standard error clearly: below, it is noise that would be added
to a good surface. The share grows from 0 to 1 around the limit, so that no step arises.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numba import njit

from orthomill.schemas.outcome import Outcome
from orthomill.schemas.raster import Window
from orthomill.tasks.dsm_check.nodes import DH, EAST, OUTCOME, SIGMA, SOUTH, node_offset

_STRIP = 64
"""rows of cells whose sums are held at a time"""


@dataclass(frozen=True)
class CorrectionNodes:
    """How nodes lie among the cells, and how far their corrections reach."""

    step: int
    pixels_per_cell: int
    radius: float
    """cells: a correction counts that far"""
    move: float
    """cells: a corrected point may lie that far from its node"""

    @property
    def halo(self) -> int:
        """Nodes around a tile that its cells depend on: reach of the fit, of the points, and of the median filter."""
        return int(np.ceil((self.radius + self.move) / self.step)) + 3


@dataclass(frozen=True)
class CorrectionMap:
    """dh and its standard error, both (rows, cols) float32 m, NaN where no node is near."""

    dh: np.ndarray
    sigma: np.ndarray


def without_spikes(nodes: np.ndarray) -> np.ndarray:
    """Nodes (rows, cols, bands) whose correction contradicts the median of their neighbours become INCONSISTENT; a copy."""
    nodes = nodes.copy()
    spikes = np.zeros(nodes.shape[:2], np.bool_)
    _spikes(np.ascontiguousarray(nodes[..., DH]), np.ascontiguousarray(nodes[..., SIGMA]), spikes)
    nodes[spikes, OUTCOME] = Outcome.INCONSISTENT
    nodes[spikes, DH] = np.nan
    return nodes


@njit(cache=True)
def _spikes(dh, sigma, spikes):
    """Against the median of the 5 x 5 neighbours: more than three times the greatest of own sigma and their spread."""
    near = np.empty(24)
    for r in range(dh.shape[0]):
        for c in range(dh.shape[1]):
            if not np.isfinite(dh[r, c]):
                continue
            n = 0
            for i in range(max(r - 2, 0), min(r + 3, dh.shape[0])):
                for j in range(max(c - 2, 0), min(c + 3, dh.shape[1])):
                    if (i != r or j != c) and np.isfinite(dh[i, j]):
                        near[n] = dh[i, j]
                        n += 1
            if n < 5:
                spikes[r, c] = True
                continue
            middle = np.median(near[:n])
            spread = 1.4826 * np.median(np.abs(near[:n] - middle))
            spikes[r, c] = abs(dh[r, c] - middle) > 3.0 * max(sigma[r, c], spread)


def node_points(nodes: np.ndarray, first: tuple[int, int], grid: CorrectionNodes) -> np.ndarray:
    """(N, 4) float64: row and column in cells of the whole surface, dh, sigma (m) of the good nodes (rows, cols, bands).

    first: number (row, col) of the first node of the array, counted over the whole surface.
    """
    rows, cols = np.nonzero(np.isfinite(nodes[..., DH]))
    good = nodes[rows, cols].astype(np.float64)
    near = np.hypot(good[:, EAST], good[:, SOUTH]) <= grid.move
    offset = node_offset(grid.step, grid.pixels_per_cell)
    points = np.column_stack(
        [
            (rows + first[0]) * grid.step + offset + good[:, SOUTH],
            (cols + first[1]) * grid.step + offset + good[:, EAST],
            good[:, DH],
            good[:, SIGMA],
        ]
    )
    return points[near]


def interpolate(points: np.ndarray, window: Window, radius: float) -> CorrectionMap:
    """dh in the cells of `window` from points (N, 4) of `node_points`; NaN where fewer than three lie within `radius` cells."""
    dh, sigma = np.full(window.shape, np.nan, np.float32), np.full(window.shape, np.nan, np.float32)
    for top in range(0, window.height, _STRIP):
        height = min(_STRIP, window.height - top)
        low, high = window.row + top - radius, window.row + top + height - 1 + radius
        near = points[(points[:, 0] >= low) & (points[:, 0] <= high)]
        sums = np.zeros((height, window.width, 12))
        _accumulate(near, (window.row + top, window.col), radius, sums)
        _solve(sums, radius, dh[top : top + height], sigma[top : top + height])
    return CorrectionMap(dh, sigma)


@njit(cache=True)
def _accumulate(points, origin, radius, sums):
    """Differences of coordinates are taken in one step, so that their rounding does not depend on the tile."""
    for i in range(points.shape[0]):
        row, col, dh, sigma = points[i, 0] - origin[0], points[i, 1] - origin[1], points[i, 2], points[i, 3]
        for r in range(max(int(np.ceil(row - radius)), 0), min(int(np.floor(row + radius)) + 1, sums.shape[0])):
            for c in range(max(int(np.ceil(col - radius)), 0), min(int(np.floor(col + radius)) + 1, sums.shape[1])):
                y, x = points[i, 0] - (origin[0] + r), points[i, 1] - (origin[1] + c)
                nearness = 1.0 - np.sqrt(x * x + y * y) / radius
                if nearness <= 0.0:
                    continue
                w = nearness * nearness
                s = sums[r, c]
                s[0] += w
                s[1] += w * x
                s[2] += w * y
                s[3] += w * x * x
                s[4] += w * x * y
                s[5] += w * y * y
                s[6] += w * dh
                s[7] += w * x * dh
                s[8] += w * y * dh
                s[9] += w * dh * dh
                s[10] += w * sigma * sigma
                s[11] += 1.0


@njit(cache=True)
def _solve(sums, radius, dh, sigma):
    """The plane at the cell's centre; a small ridge keeps the slope flat where the points lie on one side or on a line."""
    for r in range(sums.shape[0]):
        for c in range(sums.shape[1]):
            s = sums[r, c]
            if s[11] < 3.0:
                continue
            w, x, y, z = s[0], s[1] / s[0], s[2] / s[0], s[6] / s[0]
            ridge = (0.1 * radius) ** 2
            xx, xy, yy = s[3] / w - x * x + ridge, s[4] / w - x * y, s[5] / w - y * y + ridge
            xz, yz = s[7] / w - x * z, s[8] / w - y * z
            determinant = xx * yy - xy * xy
            a, b = (xz * yy - yz * xy) / determinant, (yz * xx - xz * xy) / determinant
            scatter = s[9] / w - z * z - a * xz - b * yz
            dh[r, c] = z - a * x - b * y
            sigma[r, c] = np.sqrt(s[10] / w + max(scatter, 0.0))


def share_applied(correction: CorrectionMap, apply: Literal["all", "significant", "none"], significance: float) -> np.ndarray:
    """(rows, cols) float32 in [0, 1]: how much of dh is added; 0 where there is none."""
    if apply == "none":
        return np.zeros_like(correction.dh)
    if apply == "all":
        return np.isfinite(correction.dh).astype(np.float32)
    with np.errstate(invalid="ignore"):
        return np.nan_to_num(np.clip((np.abs(correction.dh) / correction.sigma - significance + 1) / 2, 0, 1)).astype(np.float32)


def corrected_heights(heights: np.ndarray, correction: CorrectionMap, share: np.ndarray) -> np.ndarray:
    """heights + share * dh, (rows, cols) float32; without height there is none."""
    return (heights + np.where(share > 0, share * np.nan_to_num(correction.dh), 0)).astype(np.float32)
