"""From corrections at scattered points to a correction and its precision in every cell, and to the corrected surface.

Strategy. Spikes are first removed from the nodes of all pairs near a tile (against the median of their neighbours). Then a plane is
fitted in every cell to the corrections within a fixed radius, weighted by distance: a linear interpolation that also shows how well
its points agree. Only **corrections** are interpolated and added; interpolating corrected heights would smooth the surface
(sources/measured.md#check). The windows of neighbours overlap, and so do their errors: a mean of nodes keeps what they have in
common and averages the rest. Scatter about the plane beyond that is an error of the plane, and is added. Points are summed in the
order of the whole raster, so that any tiling gives the same sums.

The surface is changed only where the correction clearly exceeds its own standard error: below, noise would be added to a good
surface. The share that is applied grows from 0 to 1 around the limit, so that no step arises.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from scipy.ndimage import binary_opening

from orthomill.kernels.kernel_compilation import njit
from orthomill.schemas.outcome import Outcome
from orthomill.schemas.raster import Window
from orthomill.tasks.dsm_check.nodes import DH, EAST, OUTCOME, SIGMA, SOUTH, node_offset

_STRIP = 64
"""rows of cells whose sums are in memory at a time"""
_LEAST_NEIGHBOURS = 5
"""of the 24 around a node: the median of fewer is no majority, and an isolated correction cannot be checked"""
_LEAST_POINTS = 3.0
"""points that determine a plane"""
POWER = 1.645
"""standard errors by which a correction exceeds its limit in 95 % of all cases, when its mean exceeds the limit by so many"""
TOGETHER = 2
"""cells along the least square that is called wrong"""
_SPIKE = 3.0
"""standard errors by which a correction may differ from the median of its neighbours"""
_W, _X, _Y, _XX, _XY, _YY, _Z, _XZ, _YZ, _ZZ, _VARIANCE, _WW, _POINTS = range(13)
"""weighted sums per cell: x to the right and y down from the cell to a point (cells), z its dh, its variance; sum of the squares of
the weights, number of points"""


@dataclass(frozen=True)
class CorrectionNodes:
    """The grid of nodes among the cells, and the reach of their corrections."""

    step: int
    pixels_per_cell: int
    radius: float
    """cells: a correction is used up to that distance"""
    move: float
    """cells: greatest distance of a corrected point from its node"""
    window: float
    """cells: side of the windows that were matched at the nodes"""

    @property
    def halo(self) -> int:
        """Nodes around a tile on which its cells depend: reach of the fit, of the points, of the median filter, and of the
        squares in which corrections must be significant."""
        return int(np.ceil((self.radius + self.move) / self.step)) + 4

    @cached_property
    def common(self) -> float:
        """The part of their errors that the nodes of a cell have in common: the share in which their windows overlap, the mean over
        all pairs of nodes, weighted as they are in the fit."""
        reach = int(np.ceil(self.radius / self.step)) + 1
        places = self.step * np.arange(-reach, reach + 1)
        at = np.stack(np.meshgrid(places, places), axis=-1).reshape(-1, 2)
        overlap = np.prod(np.maximum(1.0 - np.abs(at[:, None] - at[None]) / self.window, 0.0), axis=-1)
        np.fill_diagonal(overlap, 0.0)
        shared, all_pairs = 0.0, 0.0
        # The mean over the places that a cell can have between the nodes.
        for row in range(self.step):
            for col in range(self.step):
                weight = np.maximum(1.0 - np.hypot(at[:, 0] - col, at[:, 1] - row) / self.radius, 0.0) ** 2
                shared += float(weight @ overlap @ weight)
                all_pairs += float(weight.sum() ** 2 - (weight**2).sum())
        return shared / max(all_pairs, 1e-12)


@dataclass(frozen=True)
class CorrectionMap:
    """dh and its standard error, both (rows, cols) float32 m, NaN where no node is near."""

    dh: np.ndarray
    sigma: np.ndarray


def without_spikes(nodes: np.ndarray) -> np.ndarray:
    """A copy of nodes (rows, cols, bands) in which corrections that contradict the median of their neighbours are INCONSISTENT."""
    nodes = nodes.copy()
    spikes = np.zeros(nodes.shape[:2], np.bool_)
    _spikes(np.ascontiguousarray(nodes[..., DH]), np.ascontiguousarray(nodes[..., SIGMA]), spikes)
    nodes[spikes, OUTCOME] = Outcome.INCONSISTENT
    nodes[spikes, DH] = np.nan
    return nodes


@njit()
def _spikes(dh, sigma, spikes):
    """Marks differences from the median of the 5 x 5 neighbours beyond three times the larger of own sigma and their spread."""
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
            if n < _LEAST_NEIGHBOURS:
                spikes[r, c] = True
                continue
            middle = np.median(near[:n])
            # the spread of the neighbours: along a true step of the error they differ, and no side of it may be removed
            spread = 1.4826 * np.median(np.abs(near[:n] - middle))
            spikes[r, c] = abs(dh[r, c] - middle) > _SPIKE * max(sigma[r, c], spread)


def node_points(nodes: np.ndarray, first: tuple[int, int], grid: CorrectionNodes) -> np.ndarray:
    """(N, 4) float64: row and column in cells of the whole surface, dh and sigma (m) of the corrected nodes (rows, cols, bands).

    first: number (row, col) of the first node of the array, counted over the whole surface.
    """
    rows, cols = np.nonzero(np.isfinite(nodes[..., DH]))
    good = nodes[rows, cols].astype(np.float64)
    # A point may lie anywhere along its ray. The halo of a tile is finite: points beyond it would enter one tile only.
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


def interpolate(points: np.ndarray, window: Window, grid: CorrectionNodes) -> CorrectionMap:
    """dh in the cells of `window` from points (N, 4) of `node_points`; NaN where fewer than three lie within the radius."""
    radius = grid.radius
    dh, sigma = np.full(window.shape, np.nan, np.float32), np.full(window.shape, np.nan, np.float32)
    # In strips: the thirteen float64 sums per cell would take 100 MB for a tile of 1024 cells.
    for top in range(0, window.height, _STRIP):
        height = min(_STRIP, window.height - top)
        low, high = window.row + top - radius, window.row + top + height - 1 + radius
        near = points[(points[:, 0] >= low) & (points[:, 0] <= high)]
        sums = np.zeros((height, window.width, _POINTS + 1))
        _accumulate(near, (window.row + top, window.col), radius, sums)
        _solve(sums, radius, grid.common, dh[top : top + height], sigma[top : top + height])
    return CorrectionMap(dh, sigma)


@njit()
def _accumulate(points, origin, radius, sums):
    """Adds points (N, 4) to sums (rows, cols, 13) of the cells within `radius`."""
    for i in range(points.shape[0]):
        row, col, dh, sigma = points[i, 0] - origin[0], points[i, 1] - origin[1], points[i, 2], points[i, 3]
        for r in range(max(int(np.ceil(row - radius)), 0), min(int(np.floor(row + radius)) + 1, sums.shape[0])):
            for c in range(max(int(np.ceil(col - radius)), 0), min(int(np.floor(col + radius)) + 1, sums.shape[1])):
                # one subtraction from the integer cell, so that rounding does not depend on the origin of the tile
                y, x = points[i, 0] - (origin[0] + r), points[i, 1] - (origin[1] + c)
                nearness = 1.0 - np.sqrt(x * x + y * y) / radius
                if nearness <= 0.0:
                    continue
                # falls to zero with zero slope at the radius: a point that enters or leaves causes no step
                w = nearness * nearness
                s = sums[r, c]
                s[_W] += w
                s[_X] += w * x
                s[_Y] += w * y
                s[_XX] += w * x * x
                s[_XY] += w * x * y
                s[_YY] += w * y * y
                s[_Z] += w * dh
                s[_XZ] += w * x * dh
                s[_YZ] += w * y * dh
                s[_ZZ] += w * dh * dh
                s[_VARIANCE] += w * sigma * sigma
                s[_WW] += w * w
                s[_POINTS] += 1.0


@njit()
def _solve(sums, radius, common, dh, sigma):
    """Value and standard error of the plane at the cell's centre, dh and sigma (rows, cols) m."""
    for r in range(sums.shape[0]):
        for c in range(sums.shape[1]):
            s = sums[r, c]
            if s[_POINTS] < _LEAST_POINTS:
                continue
            w, x, y, z = s[_W], s[_X] / s[_W], s[_Y] / s[_W], s[_Z] / s[_W]
            # A small ridge: where all points lie on one side or on a line, the slope is undetermined and would extrapolate wildly.
            ridge = (0.1 * radius) ** 2
            xx, xy, yy = s[_XX] / w - x * x + ridge, s[_XY] / w - x * y, s[_YY] / w - y * y + ridge
            xz, yz = s[_XZ] / w - x * z, s[_YZ] / w - y * z
            determinant = xx * yy - xy * xy
            a, b = (xz * yy - yz * xy) / determinant, (yz * xx - xz * xy) / determinant
            scatter = s[_ZZ] / w - z * z - a * xz - b * yz
            dh[r, c] = z - a * x - b * y
            # What the nodes do not share is averaged, and makes them scatter about the plane.
            variance, alone = s[_VARIANCE] / w, (1.0 - common) * s[_WW] / (w * w)
            unexplained = max(scatter - variance * (1.0 - common - alone), 0.0)
            sigma[r, c] = np.sqrt(variance * (common + alone) + unexplained)


def detectable_error(sigma: np.ndarray, significance: float) -> np.ndarray:
    """(rows, cols) float32 m: the smallest error of the surface that the check finds with a probability of 95 %; NaN where it sees
    nothing. For errors at least as wide as the windows that are matched: of narrower ones it sees a part.

    Source: the smallest detectable error of Baarda 1968, with the correction of the cell as the only observation.
    """
    return (np.float32(significance + POWER) * sigma).astype(np.float32)


def clearly_wrong(correction: CorrectionMap, significance: float) -> np.ndarray:
    """(rows, cols) bool: cells in a square of `TOGETHER` cells that all ask for a significant correction to the same side; right
    from `TOGETHER` - 1 cells off a border on that is not the end of the surface.

    Of a million cells some exceed any limit; most of them stand alone.
    """
    with np.errstate(invalid="ignore"):
        high, low = (sign * correction.dh > significance * correction.sigma for sign in (1, -1))
    square = np.ones((TOGETHER, TOGETHER))
    return np.asarray(binary_opening(high, square) | binary_opening(low, square))


def share_applied(correction: CorrectionMap, apply: Literal["all", "significant", "none"], significance: float) -> np.ndarray:
    """(rows, cols) float32 in [0, 1]: the share of dh that is added; 0 where there is none."""
    if apply == "none":
        return np.zeros_like(correction.dh)
    if apply == "all":
        return np.isfinite(correction.dh).astype(np.float32)
    with np.errstate(invalid="ignore"):
        return np.nan_to_num(np.clip((np.abs(correction.dh) / correction.sigma - significance + 1) / 2, 0, 1)).astype(np.float32)


def corrected_heights(heights: np.ndarray, correction: CorrectionMap, share: np.ndarray) -> np.ndarray:
    """heights + share * dh, (rows, cols) float32 m; cells without a height stay empty."""
    return (heights + np.where(share > 0, share * np.nan_to_num(correction.dh), 0)).astype(np.float32)
