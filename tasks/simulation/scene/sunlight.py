"""Sunlight on a surface: shadows and Lambert's law, with ambient light. The sun is in the south-east, on the diagonal of the grid,
so that a shadow is found by one sweep."""

import numpy as np

from orthomill.kernels.kernel_compilation import njit

SUN_ELEVATION = np.radians(47.0)
SUN = np.array([np.cos(SUN_ELEVATION) / np.sqrt(2.0), -np.cos(SUN_ELEVATION) / np.sqrt(2.0), np.sin(SUN_ELEVATION)])
"""Unit vector to the sun (east, north, up)."""
AMBIENT = 0.42
"""Share of the light that reaches ground in the shade."""
SHADOW_REACH = 40.0
"""m along x and along y: no shadow is longer."""
# m: a shadow begins this far below its upper bound and is full after the second length: penumbra, and no shadow by rounding.
_SHADOW_BEGIN, _PENUMBRA = 0.1, 0.7
_STEEPEST = 1.5  # m per m: a steeper step is a wall, which shades nothing by its slope


def light_on(height: np.ndarray, cell: float) -> np.ndarray:
    """Light on each cell, 1 on sunlit level ground (float32, same shape); the last rows and columns are a halo."""
    shadow = np.empty(height.shape, np.float32)
    _sweep_shadow(height, cell * np.sqrt(2.0) * np.tan(SUN_ELEVATION), shadow)
    light = np.empty(height.shape, np.float32)
    _shade(height, shadow, cell, SUN, light)
    return light


@njit()
def _sweep_shadow(height, drop, shadow):
    """The share of direct sunlight that is blocked, from the height of the shadow's upper bound carried along the diagonal."""
    # Two rows of bounds suffice: the sun is on the diagonal, so every cell is shaded by its south-eastern neighbour only.
    rows, cols = height.shape
    bound = np.full((2, cols + 1), -np.inf)
    for row in range(rows - 1, -1, -1):
        now, before = row % 2, (row + 1) % 2
        bound[now, cols] = -np.inf
        for col in range(cols - 1, -1, -1):
            z = float(height[row, col])
            above = bound[before, col + 1] - drop
            shadow[row, col] = min(max((above - z - _SHADOW_BEGIN) / _PENUMBRA, 0.0), 1.0)
            bound[now, col] = max(above, z)


@njit()
def _shade(height, shadow, cell, sun, light):
    """Lambert's law with ambient light; steps steeper than `_STEEPEST` count as level."""
    rows, cols = height.shape
    limit = _STEEPEST * cell
    light[:] = 1.0
    for row in range(1, rows - 1):
        for col in range(1, cols - 1):
            gx = limited_slope(height[row, col - 1], height[row, col], height[row, col + 1], limit) / cell
            gy = -limited_slope(height[row - 1, col], height[row, col], height[row + 1, col], limit) / cell
            facing = (sun[2] - gx * sun[0] - gy * sun[1]) / np.sqrt(1.0 + gx * gx + gy * gy)
            direct = max(facing, 0.0) / sun[2] * (1.0 - shadow[row, col])
            light[row, col] = AMBIENT + (1.0 - AMBIENT) * direct


@njit(inline="always")
def limited_slope(before, here, after, limit):
    """Height difference per cell from those neighbours that are not across a wall (a step above `limit`, m)."""
    left, right = here - before, after - here
    ok_left, ok_right = abs(left) <= limit, abs(right) <= limit
    if ok_left and ok_right:
        return 0.5 * (left + right)
    if ok_left:
        return left
    if ok_right:
        return right
    return 0.0 * here
