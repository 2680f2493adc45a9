"""Nodes joined with their neighbours: each on the plane through itself and those of the eight around it that go along.

Strategy: windows of neighbouring nodes overlap, but their weights change from pixel to pixel, so that part of the noise is each
node's own. A plane takes it away, an eighth of the whole on noisy images and a quarter on clean ones, for a hundredth of the time
that a larger window would take. It begins with the slopes that the node was matched with, is fitted to what neighbours differ from
them, weighted by their precision, and leaves out those of another surface. What is only one node's own stays where it is precise.

Standard errors stay as they are: what overlapping windows have in common no mean takes away.
"""

import numpy as np

from orthomill.kernels.kernel_compilation import njit

_TOGETHER = 0.5
"""px: neighbours farther than this from the plane of a node are not on its surface"""
_OWN = 2.0
"""standard errors of a node beyond which the plane of its neighbours does not speak for it"""
_FEWEST = 4
"""nodes that a plane needs: its three unknowns and one more"""
_RIDGE = 0.06
"""squared spacings added to the variances of the coordinates: where all neighbours are on one side the first slopes hold"""
_FLOOR = 4e-4
"""px^2 added to the variances in the weights, so that a node of strong texture does not outvote all others"""


def joined(parallax: np.ndarray, sigma: np.ndarray, slopes: np.ndarray) -> np.ndarray:
    """Parallaxes (rows, cols) float32 px of a grid of nodes, joined with their neighbours; NaN remains NaN.

    sigma (rows, cols): standard errors, px. slopes (rows, cols, 2): first slopes along columns and rows, px per node.
    """
    out = parallax.copy()
    _join(parallax, sigma, slopes, out)
    return out


@njit(error_model="numpy")
def _join(parallax, sigma, slopes, out):
    """Move every node of `parallax` (r, c) px to the plane of its neighbourhood, into `out`, where that is within its standard
    error."""
    for i in range(parallax.shape[0]):
        for j in range(parallax.shape[1]):
            if parallax[i, j] == parallax[i, j]:
                off = _off_plane(parallax, sigma, (i, j), (slopes[i, j, 0], slopes[i, j, 1]))
                if abs(off) <= _OWN * sigma[i, j]:
                    out[i, j] = parallax[i, j] + np.float32(off)


@njit(error_model="numpy", inline="always")
def _off_plane(parallax, sigma, at, slope):
    """How far the plane of the neighbours that go along lies above a node, px; 0 where there are too few."""
    rows, cols = parallax.shape
    n, total, x, y, v, xx, xy, yy, vx, vy = 0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for r in range(max(at[0] - 1, 0), min(at[0] + 2, rows)):
        for c in range(max(at[1] - 1, 0), min(at[1] + 2, cols)):
            down, right = r - at[0], c - at[1]
            off = float(parallax[r, c] - parallax[at]) - slope[0] * right - slope[1] * down
            # NaN fails the comparison.
            if not abs(off) <= _TOGETHER:
                continue
            weight = 1.0 / (float(sigma[r, c]) ** 2 + _FLOOR)
            n += 1
            total += weight
            x += weight * right
            y += weight * down
            v += weight * off
            xx += weight * right * right
            xy += weight * right * down
            yy += weight * down * down
            vx += weight * off * right
            vy += weight * off * down
    if n < _FEWEST:
        return 0.0
    x, y, v = x / total, y / total, v / total
    cxx, cxy, cyy = xx / total - x * x + _RIDGE, xy / total - x * y, yy / total - y * y + _RIDGE
    cvx, cvy = vx / total - v * x, vy / total - v * y
    determinant = cxx * cyy - cxy * cxy
    return v - ((cvx * cyy - cvy * cxy) * x + (cvy * cxx - cvx * cxy) * y) / determinant
