"""Rays through a height field of vertical columns: what a ray meets first.

Every cell is a column whose top is a plane through its height at the centre, sloped as its neighbours suggest unless a wall is
between them; smooth ground is thereby as good as continuous, roofs are exact planes and walls are vertical. A ray walks cell by
cell through blocks of BLOCK x BLOCK cells and skips a block above whose highest point it passes. All crossings are computed from
the ray itself and never accumulated, so a hit does not depend on where the walk began: windows and tiles leave no trace.

Units inside the kernels: columns u and rows v of the grid's corners (cell k spans [k, k + 1]), heights z in m. A ray is
u = u0 + s du, v = v0 + s dv, z = z0 - s, with s the depth below its origin in m.
"""

from typing import NamedTuple

import numpy as np

from orthomill.kernels.kernel_compilation import njit
from orthomill.schemas.raster import Window
from orthomill.tasks.simulation.flight import BLOCK
from orthomill.tasks.simulation.scene.sunlight import limited_slope

NOTHING, TOP, WALL = 0, 1, 2
"""What a ray met: nothing in the window, the top of a column, the side of one."""
TOLERANCE = 0.03
"""m: depth below the tops that visibility tolerates, for the tops of neighbouring columns meet with small gaps"""
STEEPEST_TOP = 1.5
"""m per m: a steeper step between neighbours is a wall; more than the steepest ground (0.6) and roof (0.73) rise"""


class VerticalColumns(NamedTuple):
    """Columns of a window whose first cell is (row, col) of the grid; kernels take it as it is.

    tops float32 (rows, cols, 3): height at the centre (m), slope per cell along u and along v. highest float32: the highest
    point of each block of BLOCK x BLOCK cells. step: m, a greater difference between neighbours is a wall.
    """

    tops: np.ndarray
    highest: np.ndarray
    row: int
    col: int
    step: float


class Ray(NamedTuple):
    """u = u0 + s du, v = v0 + s dv, z = z0 - s."""

    u0: float
    v0: float
    z0: float
    du: float
    dv: float


def columns_of(height: np.ndarray, window: Window, cell: float) -> VerticalColumns:
    """The columns of a height window (rows, cols) m that begins on a multiple of BLOCK cells of its grid."""
    tops = np.empty((*height.shape, 3), np.float32)
    highest = np.full((-(-height.shape[0] // BLOCK), -(-height.shape[1] // BLOCK)), -np.inf, np.float32)
    step = STEEPEST_TOP * cell
    _tops(height, np.float32(step), tops, highest)
    return VerticalColumns(tops, highest, window.row, window.col, step)


@njit()
def _tops(height, step, tops, highest):
    """Fills the planes of all columns and the highest points of their blocks."""
    rows, cols = height.shape
    for row in range(rows):
        for col in range(cols):
            z = height[row, col]
            gu = limited_slope(height[row, max(col - 1, 0)], z, height[row, min(col + 1, cols - 1)], step)
            gv = limited_slope(height[max(row - 1, 0), col], z, height[min(row + 1, rows - 1), col], step)
            tops[row, col, 0], tops[row, col, 1], tops[row, col, 2] = z, gu, gv
            # A plane is highest in a corner of its cell, half a cell from the centre in both directions; a millimetre for rounding.
            peak = z + np.float32(0.5) * (abs(gu) + abs(gv)) + np.float32(0.001)
            if peak > highest[row // BLOCK, col // BLOCK]:
                highest[row // BLOCK, col // BLOCK] = peak


@njit(inline="always")
def exit_of(low_u, low_v, size, ray):
    """Depth s at which a ray leaves the square [low, low + size], and whether it leaves it across a border in u."""
    su = np.inf
    if ray.du > 0.0:
        su = (low_u + size - ray.u0) / ray.du
    elif ray.du < 0.0:
        su = (low_u - ray.u0) / ray.du
    sv = np.inf
    if ray.dv > 0.0:
        sv = (low_v + size - ray.v0) / ray.dv
    elif ray.dv < 0.0:
        sv = (low_v - ray.v0) / ray.dv
    if su < sv:
        return su, True
    return sv, False


@njit(inline="always")
def _above(tops, row, col, ray, cu, cv):
    """(a, b): the ray at depth s is a - s b above the top plane of the column (cu, cv), `row` and `col` of the window."""
    height, gu, gv = tops[row, col, 0], tops[row, col, 1], tops[row, col, 2]
    above = ray.z0 - height - gu * (ray.u0 - cu - 0.5) - gv * (ray.v0 - cv - 0.5)
    return above, 1.0 + gu * ray.du + gv * ray.dv


@njit(inline="always")
def _block_at(columns, ray, s):
    """The block (bu, bv) of the whole grid that the ray passes at depth s, and the first block of the window."""
    bu, bv = int(np.floor((ray.u0 + s * ray.du) / BLOCK)), int(np.floor((ray.v0 + s * ray.dv) / BLOCK))
    return bu, bv, columns.col // BLOCK, columns.row // BLOCK


@njit()
def first_hit(columns, ray, start, end):
    """What the ray meets first between the depths `start` and `end` (m): (kind, s, row, col), row and col in the window."""
    tops, highest = columns.tops, columns.highest
    rows, cols = tops.shape[0], tops.shape[1]
    step_u, step_v = (1 if ray.du > 0.0 else -1), (1 if ray.dv > 0.0 else -1)
    s = start
    bu, bv, first_u, first_v = _block_at(columns, ray, s)
    while s < end:
        iu, iv = bu - first_u, bv - first_v
        if iu < 0 or iv < 0 or iu >= highest.shape[1] or iv >= highest.shape[0]:
            return NOTHING, s, 0, 0
        block_end, block_across_u = exit_of(bu * BLOCK, bv * BLOCK, BLOCK, ray)
        peak = highest[iv, iu]
        # The ray is lowest where it leaves the block: only then may it be below the highest point.
        if ray.z0 - block_end <= peak:
            s = max(s, ray.z0 - peak)
            # Clamped, because rounding may put the entry point into the neighbouring block.
            cu = min(max(int(np.floor(ray.u0 + s * ray.du)), bu * BLOCK), bu * BLOCK + BLOCK - 1)
            cv = min(max(int(np.floor(ray.v0 + s * ray.dv)), bv * BLOCK), bv * BLOCK + BLOCK - 1)
            while cu // BLOCK == bu and cv // BLOCK == bv:
                col, row = cu - columns.col, cv - columns.row
                if col < 0 or row < 0 or col >= cols or row >= rows:
                    return NOTHING, s, 0, 0
                leave, across_u = exit_of(cu, cv, 1.0, ray)
                above, fall = _above(tops, row, col, ray, cu, cv)
                at_entry = above - s * fall
                # Far below the top where it enters the cell: it came through the side of the column.
                if at_entry < -columns.step:
                    return WALL, s, row, col
                if at_entry <= 0.0:
                    return TOP, s, row, col
                if above - leave * fall <= 0.0:
                    return TOP, above / fall, row, col
                s = leave
                if across_u:
                    cu += step_u
                else:
                    cv += step_v
        s = block_end
        if block_across_u:
            bu += step_u
        else:
            bv += step_v
    return NOTHING, s, 0, 0


@njit()
def widened(highest):
    """The highest point of each block and of the eight around it."""
    rows, cols = highest.shape
    out = np.empty((rows, cols), np.float32)
    for row in range(rows):
        for col in range(cols):
            peak = highest[row, col]
            for j in range(max(row - 1, 0), min(row + 2, rows)):
                for i in range(max(col - 1, 0), min(col + 2, cols)):
                    peak = max(peak, highest[j, i])
            out[row, col] = peak
    return out


@njit()
def safe_start(columns, high, ray, start):
    """A depth above which no ray that stays within a block of this one meets anything; `high` as from `widened`."""
    step_u, step_v = (1 if ray.du > 0.0 else -1), (1 if ray.dv > 0.0 else -1)
    s = start
    bu, bv, first_u, first_v = _block_at(columns, ray, s)
    while True:
        iu, iv = bu - first_u, bv - first_v
        if iu < 0 or iv < 0 or iu >= high.shape[1] or iv >= high.shape[0]:
            return s
        end, across_u = exit_of(bu * BLOCK, bv * BLOCK, BLOCK, ray)
        if ray.z0 - end <= high[iv, iu]:
            # A centimetre earlier: the four rays of a pixel differ a little in depth at the same height.
            return max(s, ray.z0 - high[iv, iu] - 0.01)
        s = end
        if across_u:
            bu += step_u
        else:
            bv += step_v


@njit()
def is_free(columns, ray, depth, clear):
    """Whether nothing is between a point on the surface at `depth` below the ray's origin and the depth `clear` (m).

    The point's own column is not tested; TOLERANCE allows for the small gaps between columns on smooth ground.
    """
    tops, highest = columns.tops, columns.highest
    rows, cols = tops.shape[0], tops.shape[1]
    # Upwards along the ray: the walk starts at the point and its steps are opposite to the direction of the ray.
    back = Ray(ray.u0, ray.v0, ray.z0, -ray.du, -ray.dv)
    step_u, step_v = (-1 if ray.du > 0.0 else 1), (-1 if ray.dv > 0.0 else 1)
    cu, cv = int(np.floor(ray.u0 + depth * ray.du)), int(np.floor(ray.v0 + depth * ray.dv))
    own_u, own_v = cu, cv
    first_u, first_v = columns.col // BLOCK, columns.row // BLOCK
    s = depth
    while s > clear:
        bu, bv = cu // BLOCK, cv // BLOCK
        iu, iv = bu - first_u, bv - first_v
        if iu < 0 or iv < 0 or iu >= highest.shape[1] or iv >= highest.shape[0]:
            return True
        peak = highest[iv, iu]
        if ray.z0 - s > peak:
            s, across_u = exit_of(bu * BLOCK, bv * BLOCK, BLOCK, back)
            s = -s
            if across_u:
                cu = bu * BLOCK + BLOCK if step_u > 0 else bu * BLOCK - 1
                cv = int(np.floor(ray.v0 + s * ray.dv))
                cv = min(max(cv, bv * BLOCK), bv * BLOCK + BLOCK - 1)
            else:
                cv = bv * BLOCK + BLOCK if step_v > 0 else bv * BLOCK - 1
                cu = int(np.floor(ray.u0 + s * ray.du))
                cu = min(max(cu, bu * BLOCK), bu * BLOCK + BLOCK - 1)
            continue
        col, row = cu - columns.col, cv - columns.row
        if col < 0 or row < 0 or col >= cols or row >= rows:
            return True
        leave, across_u = exit_of(cu, cv, 1.0, back)
        leave = -leave
        if cu != own_u or cv != own_v:
            above, fall = _above(tops, row, col, ray, cu, cv)
            if above - s * fall < -TOLERANCE or above - leave * fall < -TOLERANCE:
                return False
        s = leave
        if across_u:
            cu += step_u
        else:
            cv += step_v
    return True
