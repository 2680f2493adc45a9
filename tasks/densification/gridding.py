"""From the nodes of one pair to heights of map cells.

Strategy: four neighbouring nodes span two triangles; where the parallax does not jump, a triangle gives every cell centre inside
it a height by linear interpolation. Where it jumps (roof edge, wall) there is no triangle: each node then gives its own height to
the cells within half a node distance, but only to cells that no triangle reached. Where a cell is met more than once the highest
wins, for that is what stands above. Everything is computed in coordinates of the whole grid, so tiles agree with the whole.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit

from orthomill.schemas.raster import MapGrid, Window
from orthomill.schemas.settings import Settings, setting
from orthomill.tasks.densification.ground_intersection import NodesOnGround


class Gridding(Settings):
    """From the nodes of a pair to map cells."""

    max_jump: float = setting(1.5, "Neighbouring nodes whose parallaxes differ by more are not on one surface.", "px", gt=0.0)
    node_reach: float = setting(0.5, "A node at a jump covers the cells around it up to this distance.", "nodes", ge=0.0, le=2.0)


@dataclass(frozen=True)
class HeightCells:
    """Heights (rows, cols) float64 and their standard errors float32, m; NaN where there is none."""

    height: np.ndarray
    sigma: np.ndarray


@njit(cache=True, inline="always")
def _triangle(ax, ay, az, sa, bx, by, bz, sb, cx, cy, cz, sc, first_row, first_col, height, sigma):
    area = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay)
    if not abs(area) > 1e-9:
        return
    last_row, last_col = first_row + height.shape[0] - 1, first_col + height.shape[1] - 1
    top, bottom = max(int(np.ceil(min(ay, by, cy))), first_row), min(int(np.floor(max(ay, by, cy))), last_row)
    left, right = max(int(np.ceil(min(ax, bx, cx))), first_col), min(int(np.floor(max(ax, bx, cx))), last_col)
    for r in range(top, bottom + 1):
        for c in range(left, right + 1):
            u = ((c - ax) * (cy - ay) - (cx - ax) * (r - ay)) / area
            v = ((bx - ax) * (r - ay) - (c - ax) * (by - ay)) / area
            if u >= -1e-9 and v >= -1e-9 and u + v <= 1.0 + 1e-9:
                z = az + u * (bz - az) + v * (cz - az)
                if not height[r - first_row, c - first_col] >= z:
                    height[r - first_row, c - first_col] = z
                    sigma[r - first_row, c - first_col] = sa + u * (sb - sa) + v * (sc - sa)


@njit(cache=True)
def _rasterise(col, row, z, s, p, max_jump, reach, bounds, first_row, first_col, height, sigma):
    rows, cols = p.shape
    low, high = bounds
    joined = np.zeros((rows, cols), np.uint8)
    for i in range(rows - 1):
        for j in range(cols - 1):
            for half in range(2):
                k, m = (i, j) if half == 0 else (i + 1, j + 1)
                values = (p[k, m], p[i, j + 1], p[i + 1, j])
                spread = max(values) - min(values)
                if not (spread <= max_jump and values[0] == values[0] and values[1] == values[1] and values[2] == values[2]):
                    continue
                if not (low <= z[k, m] <= high):
                    continue
                joined[k, m] += 1
                joined[i, j + 1] += 1
                joined[i + 1, j] += 1
                _triangle(
                    col[k, m],
                    row[k, m],
                    z[k, m],
                    s[k, m],
                    col[i, j + 1],
                    row[i, j + 1],
                    z[i, j + 1],
                    s[i, j + 1],
                    col[i + 1, j],
                    row[i + 1, j],
                    z[i + 1, j],
                    s[i + 1, j],
                    first_row,
                    first_col,
                    height,
                    sigma,
                )
    alone, alone_sigma = np.full(height.shape, np.nan), np.full(height.shape, np.float32(np.nan))
    for i in range(rows):
        for j in range(cols):
            if joined[i, j] >= 6 or not (low <= z[i, j] <= high):
                continue
            top, bottom = int(np.ceil(row[i, j] - reach)), int(np.floor(row[i, j] + reach))
            left, right = int(np.ceil(col[i, j] - reach)), int(np.floor(col[i, j] + reach))
            for r in range(max(top, first_row), min(bottom, first_row + height.shape[0] - 1) + 1):
                for c in range(max(left, first_col), min(right, first_col + height.shape[1] - 1) + 1):
                    if not alone[r - first_row, c - first_col] >= z[i, j]:
                        alone[r - first_row, c - first_col] = z[i, j]
                        alone_sigma[r - first_row, c - first_col] = s[i, j]
    for r in range(height.shape[0]):
        for c in range(height.shape[1]):
            if np.isnan(height[r, c]):
                height[r, c], sigma[r, c] = alone[r, c], alone_sigma[r, c]


@dataclass(frozen=True)
class TargetCells:
    """The cells to be filled: `window` of `grid`, heights within (low, high) m."""

    grid: MapGrid
    window: Window
    heights: tuple[float, float]


def grid_nodes(nodes: NodesOnGround, node_distance: float, target: TargetCells, settings: Gridding) -> HeightCells:
    """Heights of the target's cells from the nodes of one pair; node_distance: of nodes on the ground, m."""
    col, row = target.grid.pixel(nodes.x, nodes.y)
    height, sigma = np.full(target.window.shape, np.nan), np.full(target.window.shape, np.nan, np.float32)
    reach = max(settings.node_reach * node_distance / target.grid.cell, 0.5)
    _rasterise(
        col,
        row,
        nodes.z,
        nodes.sigma,
        nodes.parallax,
        np.float32(settings.max_jump),
        reach,
        target.heights,
        target.window.row,
        target.window.col,
        height,
        sigma,
    )
    return HeightCells(height, sigma)
