"""Points on the ground from rays of photographs whose orientation is held: least squares in the image, all points at once.

Ideal image coordinates are compared, so that a lens takes part through its correction only. What is uncertain of the orientation
itself does not enter the covariance.
"""

from dataclasses import dataclass

import numpy as np

from orthomill.tasks.geometry.distortion import pixel_to_image
from orthomill.tasks.geometry.view import View

_ROUNDS = 8


@dataclass(frozen=True, eq=False)
class Measured:
    """Rays sorted in any way: `point` (M,) and `photo` (M,) numbers, `pixels` (M, 2) (col, row) observed, `sigma` (M,) px."""

    point: np.ndarray
    photo: np.ndarray
    pixels: np.ndarray
    sigma: np.ndarray

    def take(self, index: np.ndarray) -> "Measured":
        """The rays at `index` (mask or numbers)."""
        return Measured(self.point[index], self.photo[index], self.pixels[index], self.sigma[index])


@dataclass(frozen=True, eq=False)
class FixedIntersection:
    """`points` (n, 3) m, NaN for fewer than two rays or none that meet before the photographs; `covariance` (n, 3, 3) m^2 for
    measurements of the stated sigma; `residual` (M, 2) px (col, row) computed minus observed."""

    points: np.ndarray
    covariance: np.ndarray
    residual: np.ndarray


def intersect_held(views: list[View], measured: Measured, count: int) -> FixedIntersection:
    """The `count` points that fit their rays best."""
    observed, directions = _prepared(views, measured)
    rotation = np.array([view.rotation for view in views])[measured.photo]
    centre = np.array([view.centre for view in views])[measured.photo]
    c = np.array([view.camera.c for view in views])[measured.photo]
    points = _nearest(centre, directions, measured.point, count)
    weight = 1.0 / measured.sigma**2
    for _ in range(_ROUNDS):
        residual, J = _linear(points[measured.point], rotation, centre, c, observed)
        normal = _summed(np.einsum("m,mki,mkj->mij", weight, J, J), measured.point, count)
        right = _summed(np.einsum("m,mki,mk->mi", weight, J, residual), measured.point, count)
        points = points + _solved(normal, right)
    points[_behind(points, rotation, centre, measured.point, count)] = np.nan
    residual, _ = _linear(points[measured.point], rotation, centre, c, observed)
    return FixedIntersection(points, _inverse(normal), -residual * [1.0, -1.0])


def _prepared(views: list[View], measured: Measured) -> tuple[np.ndarray, np.ndarray]:
    """Ideal image coordinates (M, 2) px and unit directions (M, 3) in the world."""
    observed, directions = np.zeros((len(measured.point), 2)), np.zeros((len(measured.point), 3))
    for number in np.unique(measured.photo):
        own = measured.photo == number
        observed[own] = pixel_to_image(views[number].camera, measured.pixels[own])
        directions[own] = views[number].rays(measured.pixels[own])
    return observed, directions


def _nearest(centre: np.ndarray, direction: np.ndarray, point: np.ndarray, count: int) -> np.ndarray:
    """(count, 3) the points nearest to their rays in space; NaN where the rays are fewer than two or parallel."""
    projector = np.eye(3) - direction[:, :, None] * direction[:, None, :]
    normal = _summed(projector, point, count)
    right = _summed(np.einsum("mij,mj->mi", projector, centre), point, count)
    weak = (np.bincount(point, minlength=count) < 2) | (np.linalg.det(normal) < 1e-9)
    return np.where(weak[:, None], np.nan, _solved(np.where(weak[:, None, None], np.eye(3), normal), right))


def _summed(values: np.ndarray, point: np.ndarray, count: int) -> np.ndarray:
    out = np.zeros((count, *values.shape[1:]))
    np.add.at(out, point, values)
    return out


def _solved(normal: np.ndarray, right: np.ndarray) -> np.ndarray:
    """(n, 3); NaN where nothing is determined."""
    return np.einsum("nij,nj->ni", _inverse(normal), right)


def _inverse(normal: np.ndarray) -> np.ndarray:
    fine = np.isfinite(normal).all(axis=(1, 2))
    scale = np.where(fine, np.trace(np.nan_to_num(normal), axis1=1, axis2=2) / 3.0, 1.0)
    scale = np.where(scale > 0, scale, 1.0)
    scaled = np.where(fine[:, None, None], np.nan_to_num(normal) / scale[:, None, None], np.eye(3))
    bad = ~fine | (np.abs(np.linalg.det(scaled)) < 1e-14)
    inverse = np.linalg.inv(np.where(bad[:, None, None], np.eye(3), scaled)) / scale[:, None, None]
    return np.where(bad[:, None, None], np.nan, inverse)


def _linear(
    at: np.ndarray, rotation: np.ndarray, centre: np.ndarray, c: np.ndarray, observed: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Observed minus computed (M, 2), and the derivatives (M, 2, 3) of the computed by the point."""
    u = np.einsum("mij,mj->mi", rotation, at - centre)
    with np.errstate(divide="ignore", invalid="ignore"):
        xy = -c[:, None] * u[:, :2] / u[:, 2:3]
        J = -(c / u[:, 2])[:, None, None] * (rotation[:, :2] - (u[:, :2] / u[:, 2:3])[:, :, None] * rotation[:, 2][:, None, :])
    return observed - xy, J


def _behind(points: np.ndarray, rotation: np.ndarray, centre: np.ndarray, point: np.ndarray, count: int) -> np.ndarray:
    """(count,) which points lie behind one of their photographs."""
    depth = -np.einsum("mj,mj->m", rotation[:, 2], points[point] - centre)
    behind = np.zeros(count, bool)
    behind[point[depth <= 0]] = True
    return behind
