"""The plane that fits points best, with a right and an up direction on it, as one looks at a wall."""

from dataclasses import dataclass

import numpy as np

_UP, _NORTH = np.array([0.0, 0.0, 1.0]), np.array([0.0, 1.0, 0.0])


@dataclass(frozen=True, eq=False)
class PlaneAxes:
    """A plane through `point` (3,) m; `right`, `up` on it and `normal` towards the viewer are unit vectors, right-handed."""

    point: np.ndarray
    right: np.ndarray
    up: np.ndarray
    normal: np.ndarray


def plane_axes(point: np.ndarray, normal: np.ndarray) -> PlaneAxes:
    """The plane through `point` with its `normal` (of any length) towards the viewer: up is up on a wall, north on level ground."""
    n = np.asarray(normal, np.float64) / np.linalg.norm(normal)
    # Seen from below a ceiling is turned as a plan is: north stays up.
    upwards = _NORTH if abs(n[2]) > np.cos(np.radians(1e-3)) else _UP
    right = np.cross(upwards, n)
    right /= np.linalg.norm(right)
    return PlaneAxes(np.asarray(point, np.float64), right, np.cross(n, right), n)


def best_plane(points: np.ndarray, towards: np.ndarray | None = None) -> PlaneAxes:
    """The plane with the least squares of distances to points (N, 3); its normal points to the place `towards` (3,), or upwards."""
    middle = points.mean(axis=0)
    moments = np.einsum("ni,nj->ij", points - middle, points - middle)
    normal = np.linalg.eigh(moments)[1][:, 0]
    side = _UP + 1e-6 * np.array([0.3, -1.0, 0.0]) if towards is None else np.asarray(towards) - middle
    return plane_axes(middle, normal if normal @ side > 0 else -normal)
