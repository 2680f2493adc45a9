"""The surfaces that a matching window may lie on, read from a start surface, and the pixels of the window that support each.

Strategy
- A start surface (integer-pixel parallaxes of semi-global matching) gives every node one or several start parallaxes; a plane is
  fitted to the start parallaxes of the window that agree with one of them.
- The *support* of a node is the set of those pixels of its window that lie on this plane. At a roof edge the window keeps the roof
  and drops the ground, so that parallaxes are not smeared across the wall.

The support is our own; see methods/relative_orientation_and_epipolar.md 1.18.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

_FEWEST = 6
"""pixels that a plane needs: twice its unknowns, so that a few wrong ones cannot tilt it at will"""
_STEEPEST = 0.8
"""largest slope of a start plane, px of parallax per px; steeper surfaces are hidden in one of the images"""
_RIDGE = 0.05
"""px^2 added to the variances of the coordinates, so that the slope across a strip of pixels stays near zero"""
_SAME = np.float32(2.5)
"""px; start parallaxes closer than this converge to the same surface"""


class StartSurface(NamedTuple):
    """Start parallaxes of a left image (H, W), on a grid reduced by `factor`."""

    parallax: np.ndarray
    """(H / factor, W / factor) float32, px of the left image, NaN where unknown"""
    factor: int


class Node(NamedTuple):
    """A node of the left image and its window."""

    row: int
    col: int
    half: int
    """half side of the window, px"""


@njit(cache=True)
def surface_window(start, node, window):
    """Fill `window` (n,) with the start parallaxes of a node's window, NaN where unknown. start: `StartSurface`."""
    i = 0
    for r in range(node.row - node.half, node.row + node.half + 1):
        for c in range(node.col - node.half, node.col + node.half + 1):
            y, x = r // start.factor, c // start.factor
            known = 0 <= y < start.parallax.shape[0] and 0 <= x < start.parallax.shape[1]
            window[i] = start.parallax[y, x] if known else np.float32(np.nan)
            i += 1


@njit(cache=True)
def start_parallaxes(window, half, reach, found):
    """Start parallaxes worth trying at the centre of a window: its own, and the lowest and the highest within `reach` px of it.

    found (3,) is filled; returns their number.
    """
    side = 2 * half + 1
    own = window[half * side + half]
    low, high = np.float32(np.inf), np.float32(-np.inf)
    for y in range(-reach, reach + 1):
        for x in range(-reach, reach + 1):
            value = window[(half + y) * side + half + x]
            if value == value:
                low, high = min(low, value), max(high, value)
    count = 0
    if own == own:
        found[0] = own
        count = 1
    for value in (low, high):
        # Infinite where no start parallax is known in reach.
        new = abs(value) < np.float32(1e9)
        for i in range(count):
            new = new and abs(value - found[i]) > _SAME
        if new:
            found[count] = value
            count += 1
    return count


@njit(cache=True)
def _fit_plane(window, half, level, reach, guess, plane):
    """Fit `plane` (value from `level`, slope x, slope y) to the pixels within `reach` of the plane `guess`; False if too few."""
    n = sum_x = sum_y = sum_v = sum_xx = sum_xy = sum_yy = sum_vx = sum_vy = 0.0
    i = 0
    for y in range(-half, half + 1):
        for x in range(-half, half + 1):
            value = window[i] - level
            if abs(value - guess[0] - guess[1] * x - guess[2] * y) <= reach:
                n += 1
                sum_x += x
                sum_y += y
                sum_xx += x * x
                sum_xy += x * y
                sum_yy += y * y
                sum_v += value
                sum_vx += value * x
                sum_vy += value * y
            i += 1
    if n < _FEWEST:
        return False
    mx, my, mv = sum_x / n, sum_y / n, sum_v / n
    cxx, cxy, cyy = sum_xx - n * mx * mx + _RIDGE * n, sum_xy - n * mx * my, sum_yy - n * my * my + _RIDGE * n
    cvx, cvy = sum_vx - n * mv * mx, sum_vy - n * mv * my
    determinant = cxx * cyy - cxy * cxy
    sx, sy = (cvx * cyy - cvy * cxy) / determinant, (cvy * cxx - cvx * cxy) / determinant
    plane[1], plane[2] = min(max(sx, -_STEEPEST), _STEEPEST), min(max(sy, -_STEEPEST), _STEEPEST)
    plane[0] = mv - plane[1] * mx - plane[2] * my
    return True


@njit(cache=True)
def _mark_support(left, node, window, level, plane, tolerance, mask):
    """Mark in `mask` the pixels of the window that lie on the plane; returns their number."""
    half, side = node.half, 2 * node.half + 1
    foreign = 0
    for i in range(window.size):
        y, x = i // side - half, i % side - half
        if abs(window[i] - level - plane[0] - plane[1] * x - plane[2] * y) > tolerance:
            foreign += 1
    count = 0
    for i in range(window.size):
        y, x = i // side - half, i % side - half
        value = window[i]
        mask[i] = 0.0
        if value != value:
            # Unknown parallaxes cluster at occlusions: they belong to the node only in a window that shows one surface.
            belongs = foreign * 10 <= window.size
        else:
            belongs = abs(value - level - plane[0] - plane[1] * x - plane[2] * y) <= tolerance
        if belongs:
            r, c = node.row + y, node.col + x
            # The pixel and both neighbours of its gradient; NaN where one of them has no data.
            data = left[r, c] + left[r, c - 1] + left[r, c + 1]
            if data == data:
                mask[i] = 1.0
                count += 1
    return count


@njit(cache=True)
def fit_surface(left, node, window, level, tolerance, guess, plane, mask):
    """Fit the plane of the surface at `level` in a window and mark its support; the number of its pixels, 0 without a plane.

    plane (3,): parallax from `level`, and its slopes along x and y. tolerance: px. guess (3,) is scratch.
    """
    guess[:] = 0.0
    # First a level plane with room for a slope of 0.1 px per px, then what lies on the plane that this gave.
    if not _fit_plane(window, node.half, level, tolerance + 0.1 * node.half, guess, plane):
        return 0
    guess[:] = plane
    _fit_plane(window, node.half, level, tolerance, guess, plane)
    return _mark_support(left, node, window, level, plane, tolerance, mask)
