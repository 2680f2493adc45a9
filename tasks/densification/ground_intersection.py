"""From parallaxes to ground: forward intersection in the base system, with the standard error of the height.

The point of a node lies on its left ray at (x, y, -c) B / p from the left projection centre, so an error of the parallax moves it
along that ray by distance / p: sigma_Z = |dZ| sigma_p / p. The parallax error has a matching part (per node) and an orientation
part that differs from pair to pair; the latter is taken to be as large as the y-parallax that its tie points show. Together they
decide whether the heights of several pairs agree. The part of the orientation error that all pairs share (datum, camera constant)
must not make contradicting heights agree; it is added to the precision of the fused height (`orientation_sigma`).

Source: Karfis 2009 (sources/epipolar.md#base-system, #intersection), with rotation and left centre to the ground.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from orthomill.kernels.kernel_compilation import njit
from orthomill.schemas.epipolar import EpipolarPair
from orthomill.schemas.raster import Window
from orthomill.tasks.geometry.epipolar_window import greatest_parallax

EXACT = 1e-9
"""m: an orientation that is given without an error has errors below this"""


@dataclass(frozen=True)
class NodesOnGround:
    """Nodes of a pair (rows, cols): x, y, z float64 m, sigma float32 m; NaN where there is no match."""

    x: np.ndarray
    y: np.ndarray
    z: np.ndarray
    sigma: np.ndarray
    parallax: np.ndarray
    """float32, px"""


class _BaseSystem(NamedTuple):
    """Normal case of a pair for the kernel: base m, c, principal column and row of the left image px, orientation part of the
    parallax error px, rotation (3, 3) world to base system, left centre (3,) m, greatest parallax px."""

    base: float
    c: float
    col0: float
    row0: float
    shared_sigma: float
    rotation: np.ndarray
    centre: np.ndarray
    greatest: float


@njit()
def _intersect(parallax, sigma, first, step, system, xyz, sigma_z):
    """Fills xyz (3, rows, cols) and sigma_z (rows, cols) m; first: (row, col) of the first node, step: node distance, px."""
    for i in range(parallax.shape[0]):
        v = system.row0 - (first[0] + i) * step
        for j in range(parallax.shape[1]):
            p = np.float64(parallax[i, j])
            # rays that do not converge in front of the cameras (p <= 0), nodes without a match (NaN) and those nearer than the pair
            # is searched stay NaN: windows of nodes that are read know nothing nearer
            if not 0.0 < p <= system.greatest:
                continue
            u, scale = (first[1] + j) * step - system.col0, system.base / p
            for k in range(3):
                offset = (u * system.rotation[0, k] + v * system.rotation[1, k] - system.c * system.rotation[2, k]) * scale
                xyz[k, i, j] = system.centre[k] + offset
            error = np.sqrt(sigma[i, j] ** 2 + system.shared_sigma * system.shared_sigma)
            sigma_z[i, j] = abs(xyz[2, i, j] - system.centre[2]) / p * error


def nodes_on_ground(pair: EpipolarPair, nodes: np.ndarray, window: Window, step: int) -> NodesOnGround:
    """Intersect the nodes `window` of a pair.

    nodes: (rows, cols, 2 or more) float32: parallax x_left - x_right and its standard error, px, NaN without a match. step:
    distance of nodes in px.
    """
    shape = nodes.shape[:2]
    xyz, sigma = np.full((3, *shape), np.nan), np.full(shape, np.nan, np.float32)
    rotation, centre = np.array(pair.rotation), np.array(pair.left_centre)
    system = _BaseSystem(
        base=pair.base,
        c=pair.c,
        col0=pair.left_col0,
        row0=pair.row0,
        shared_sigma=pair.row_sigma,
        rotation=rotation,
        centre=centre,
        greatest=greatest_parallax(pair),
    )
    # the kernel reads row by row; a view into the interleaved bands would touch memory three times as often
    parallax, matching_sigma = np.ascontiguousarray(nodes[..., 0]), np.ascontiguousarray(nodes[..., 1])
    _intersect(parallax, matching_sigma, (float(window.row), float(window.col)), float(step), system, xyz, sigma)
    x, y, z = xyz
    return NodesOnGround(x, y, z, sigma, parallax)


def orientation_sigma(pair: EpipolarPair, x: np.ndarray, y: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Standard error (m) of heights of a pair by its orientation, at ground points x, y, z (same shape, m); NaN stays NaN.

    Between the nine places of `pair.height_sigmas` its inverse is bilinear, as the inverse of the depth of a plane is: towards the
    horizon of an oblique pair both grow without bound. 0 where these are not known; constant beyond the image.
    """
    if not pair.height_sigmas:
        return np.where(np.isnan(z), np.nan, 0.0)
    rotation, centre = np.array(pair.rotation), np.array(pair.left_centre)
    u, v, w = (row[0] * (x - centre[0]) + row[1] * (y - centre[1]) + row[2] * (z - centre[2]) for row in rotation)
    # Clipping keeps the answer positive where a tile leaves the image of the pair: extrapolated it could become negative there.
    col = np.clip((pair.left_col0 - pair.c * u / w) / (pair.left_cols - 1) * 2, 0.0, 2.0)
    row = np.clip((pair.row0 + pair.c * v / w) / (pair.rows - 1) * 2, 0.0, 2.0)
    table = 1.0 / np.maximum(np.array(pair.height_sigmas).reshape(3, 3), EXACT)
    weights = [np.maximum(1.0 - np.abs(col - k), 0.0) for k in range(3)]
    total = np.zeros(np.shape(z))
    for r in range(3):
        for c in range(3):
            total = total + np.maximum(1.0 - np.abs(row - r), 0.0) * weights[c] * table[r, c]
    return 1.0 / total
