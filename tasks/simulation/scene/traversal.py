"""Rays through a height field of upright columns: what a ray meets first.

Every cell is a column whose top is a plane through its height at the centre, sloped as its neighbours suggest unless they stand
across a wall; smooth ground is thereby as good as continuous, roofs are exact planes and walls are upright. A ray walks cell by
cell through blocks of BLOCK x BLOCK cells and skips a block over whose highest point it passes. All crossings are computed
from the ray itself and never accumulated, so a hit does not depend on where the walk began: windows and tiles do not show.

Units inside the kernels: columns u and rows v of the grid's corners (cell k spans [k, k + 1]), heights z in m. A ray is
u = u0 + s du, v = v0 + s dv, z = z0 - s, with s the depth below its origin in m.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit

from orthomill.schemas.raster import Window
from orthomill.tasks.simulation.flight import BLOCK
from orthomill.tasks.simulation.scene.ground_texture import limited_slope

NOTHING, TOP, WALL = 0, 1, 2
"""What a ray met: nothing in the window, the top of a column, the side of one."""
TOLERANCE = 0.03
"""m"""


@dataclass(frozen=True, eq=False)
class UprightColumns:
    """Columns of a window whose first cell is (row, col) of the grid.

    tops float32 (rows, cols, 3): height at the centre (m), slope per cell along u and along v. highest float32: the highest
    point of each block of BLOCK x BLOCK cells. step: m, a greater difference between neighbours is a wall.
    """

    tops: np.ndarray
    highest: np.ndarray
    row: int
    col: int
    step: float

    @property
    def numbers(self) -> tuple[np.ndarray, np.ndarray, int, int, float]:
        """For kernels."""
        return self.tops, self.highest, self.row, self.col, self.step


def columns_of(height: np.ndarray, window: Window, cell: float) -> UprightColumns:
    """The columns of a height window (rows, cols) m that begins on a multiple of BLOCK cells of its grid."""
    tops = np.empty((*height.shape, 3), np.float32)
    highest = np.full((-(-height.shape[0] // BLOCK), -(-height.shape[1] // BLOCK)), -np.inf, np.float32)
    step = 1.5 * cell
    _tops(height, np.float32(step), tops, highest)
    return UprightColumns(tops, highest, window.row, window.col, step)


@njit(cache=True)
def _tops(height, step, tops, highest):
    rows, cols = height.shape
    for row in range(rows):
        for col in range(cols):
            z = height[row, col]
            gu = limited_slope(height[row, max(col - 1, 0)], z, height[row, min(col + 1, cols - 1)], step)
            gv = limited_slope(height[max(row - 1, 0), col], z, height[min(row + 1, rows - 1), col], step)
            tops[row, col, 0], tops[row, col, 1], tops[row, col, 2] = z, gu, gv
            peak = z + np.float32(0.5) * (abs(gu) + abs(gv)) + np.float32(0.001)
            if peak > highest[row // BLOCK, col // BLOCK]:
                highest[row // BLOCK, col // BLOCK] = peak


@njit(cache=True, inline="always")
def _leaves_at(low_u, low_v, size, u0, v0, du, dv):
    """Depth s at which a ray leaves the square [low, low + size], and whether it leaves it across a border in u."""
    su = np.inf
    if du > 0.0:
        su = (low_u + size - u0) / du
    elif du < 0.0:
        su = (low_u - u0) / du
    sv = np.inf
    if dv > 0.0:
        sv = (low_v + size - v0) / dv
    elif dv < 0.0:
        sv = (low_v - v0) / dv
    if su < sv:
        return su, True
    return sv, False


@njit(cache=True)
def first_hit(columns, u0, v0, z0, du, dv, start, end):
    """What the ray meets first between the depths `start` and `end` (m): (kind, s, row, col), row and col in the window."""
    tops, highest, row0, col0, step = columns
    rows, cols = tops.shape[0], tops.shape[1]
    step_u, step_v = (1 if du > 0.0 else -1), (1 if dv > 0.0 else -1)
    s = start
    bu, bv = int(np.floor((u0 + s * du) / BLOCK)), int(np.floor((v0 + s * dv) / BLOCK))
    first_u, first_v = col0 // BLOCK, row0 // BLOCK
    while s < end:
        iu, iv = bu - first_u, bv - first_v
        if iu < 0 or iv < 0 or iu >= highest.shape[1] or iv >= highest.shape[0]:
            return NOTHING, s, 0, 0
        block_end, block_across_u = _leaves_at(bu * BLOCK, bv * BLOCK, BLOCK, u0, v0, du, dv)
        peak = highest[iv, iu]
        if z0 - block_end <= peak:
            s = max(s, z0 - peak)
            cu = min(max(int(np.floor(u0 + s * du)), bu * BLOCK), bu * BLOCK + BLOCK - 1)
            cv = min(max(int(np.floor(v0 + s * dv)), bv * BLOCK), bv * BLOCK + BLOCK - 1)
            while cu // BLOCK == bu and cv // BLOCK == bv:
                col, row = cu - col0, cv - row0
                if col < 0 or row < 0 or col >= cols or row >= rows:
                    return NOTHING, s, 0, 0
                leave, across_u = _leaves_at(cu, cv, 1.0, u0, v0, du, dv)
                height, gu, gv = tops[row, col, 0], tops[row, col, 1], tops[row, col, 2]
                # Height of the ray above the plane of the column, linear in s.
                above = z0 - height - gu * (u0 - cu - 0.5) - gv * (v0 - cv - 0.5)
                fall = 1.0 + gu * du + gv * dv
                at_entry = above - s * fall
                if at_entry < -step:
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


@njit(cache=True)
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


@njit(cache=True)
def safe_start(high, row0, col0, u0, v0, z0, du, dv, start):
    """A depth before which no ray that stays within a block of this one meets anything; `high` as from `widened`."""
    step_u, step_v = (1 if du > 0.0 else -1), (1 if dv > 0.0 else -1)
    first_u, first_v = col0 // BLOCK, row0 // BLOCK
    s = start
    bu, bv = int(np.floor((u0 + s * du) / BLOCK)), int(np.floor((v0 + s * dv) / BLOCK))
    while True:
        iu, iv = bu - first_u, bv - first_v
        if iu < 0 or iv < 0 or iu >= high.shape[1] or iv >= high.shape[0]:
            return s
        end, across_u = _leaves_at(bu * BLOCK, bv * BLOCK, BLOCK, u0, v0, du, dv)
        if z0 - end <= high[iv, iu]:
            return max(s, z0 - high[iv, iu] - 0.01)
        s = end
        if across_u:
            bu += step_u
        else:
            bv += step_v


@njit(cache=True)
def is_free(columns, u0, v0, z0, du, dv, depth, clear):
    """Whether nothing stands between a point on the surface at `depth` below the ray's origin, and the depth `clear` (m).

    The point's own column is not asked; TOLERANCE forgives the small gaps between columns on smooth ground.
    """
    tops, highest, row0, col0, _ = columns
    rows, cols = tops.shape[0], tops.shape[1]
    step_u, step_v = (-1 if du > 0.0 else 1), (-1 if dv > 0.0 else 1)
    cu, cv = int(np.floor(u0 + depth * du)), int(np.floor(v0 + depth * dv))
    own_u, own_v = cu, cv
    first_u, first_v = col0 // BLOCK, row0 // BLOCK
    s = depth
    while s > clear:
        bu, bv = cu // BLOCK, cv // BLOCK
        iu, iv = bu - first_u, bv - first_v
        if iu < 0 or iv < 0 or iu >= highest.shape[1] or iv >= highest.shape[0]:
            return True
        peak = highest[iv, iu]
        if z0 - s > peak:
            s, across_u = _leaves_at(bu * BLOCK, bv * BLOCK, BLOCK, u0, v0, -du, -dv)
            s = -s
            if across_u:
                cu = bu * BLOCK + BLOCK if step_u > 0 else bu * BLOCK - 1
                cv = int(np.floor(v0 + s * dv))
                cv = min(max(cv, bv * BLOCK), bv * BLOCK + BLOCK - 1)
            else:
                cv = bv * BLOCK + BLOCK if step_v > 0 else bv * BLOCK - 1
                cu = int(np.floor(u0 + s * du))
                cu = min(max(cu, bu * BLOCK), bu * BLOCK + BLOCK - 1)
            continue
        col, row = cu - col0, cv - row0
        if col < 0 or row < 0 or col >= cols or row >= rows:
            return True
        leave, across_u = _leaves_at(cu, cv, 1.0, u0, v0, -du, -dv)
        leave = -leave
        if cu != own_u or cv != own_v:
            height, gu, gv = tops[row, col, 0], tops[row, col, 1], tops[row, col, 2]
            above = z0 - height - gu * (u0 - cu - 0.5) - gv * (v0 - cv - 0.5)
            fall = 1.0 + gu * du + gv * dv
            if above - s * fall < -TOLERANCE or above - leave * fall < -TOLERANCE:
                return False
        s = leave
        if across_u:
            cu += step_u
        else:
            cv += step_v
    return True
