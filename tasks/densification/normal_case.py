"""From parallaxes to ground: forward intersection in the base system, with the standard error of the height.

A node's point lies on its left ray at (x, y, -c) B / p from the left projection centre, so an error of the parallax moves it along
that ray by distance / p: sigma_Z = |dZ| sigma_p / p. The parallax error has a matching part (per node) and an orientation part,
which all nodes of the pair share; the latter is taken to be as large as the expected y-parallax, which knows nothing of a weak
datum or a doubtful camera constant: these move all pairs alike and must not let heights agree that do not.

Source: Karfis 2009 (methods/relative_orientation_and_epipolar.md 1.12, 1.17), with rotation and left centre to the ground.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit

from schemas.epipolar import EpipolarPair
from schemas.raster import Window


@dataclass(frozen=True)
class NodesOnGround:
    """Nodes of a pair (rows, cols): x, y, z float64 m, sigma float32 m; NaN where there is no match."""

    x: np.ndarray
    y: np.ndarray
    z: np.ndarray
    sigma: np.ndarray
    parallax: np.ndarray
    """float32, px"""


@njit(cache=True)
def _intersect(parallax, sigma, first, step, rotation, centre, numbers, xyz, sigma_z):
    base, c, col0, row0, shared = numbers
    for i in range(parallax.shape[0]):
        v = row0 - (first[0] + i) * step
        for j in range(parallax.shape[1]):
            p = np.float64(parallax[i, j])
            if not p > 0.0:
                continue
            u, scale = (first[1] + j) * step - col0, base / p
            for k in range(3):
                offset = (u * rotation[0, k] + v * rotation[1, k] - c * rotation[2, k]) * scale
                xyz[k, i, j] = centre[k] + offset
            sigma_z[i, j] = abs(xyz[2, i, j] - centre[2]) / p * np.sqrt(sigma[i, j] ** 2 + shared * shared)


def nodes_on_ground(pair: EpipolarPair, nodes: np.ndarray, window: Window, step: int) -> NodesOnGround:
    """Intersect the nodes `window` of a pair.

    nodes: (rows, cols, 2 or more) float32: parallax x_left - x_right and its standard error, px, NaN without a match. step:
    distance of nodes in px.
    """
    shape = nodes.shape[:2]
    xyz, sigma = np.full((3, *shape), np.nan), np.full(shape, np.nan, np.float32)
    numbers = np.array([pair.base, pair.c, pair.left_col0, pair.row0, pair.row_sigma])
    parallax = np.ascontiguousarray(nodes[..., 0])
    _intersect(parallax, np.ascontiguousarray(nodes[..., 1]), np.array([window.row, window.col], np.float64), float(step),
               np.array(pair.rotation), np.array(pair.left_centre), numbers, xyz, sigma)
    return NodesOnGround(*xyz, sigma, parallax)
