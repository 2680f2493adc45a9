"""Ground points from rays of photographs whose orientation is fixed: least squares in the image, all points at once.

Residuals are taken between ideal image coordinates: distortion is removed from the measurements once and does not enter the
derivatives. The covariance holds the precision of the measurements only, not that of the orientation.
"""

from dataclasses import dataclass

import numpy as np

from orthomill.tasks.geometry.distortion import pixel_to_image
from orthomill.tasks.geometry.view import View

# Gauss-Newton starts at the point nearest to the rays in space and gains digits fast, because residuals are small; there is no test
# of convergence, since all points are iterated together.
_ITERATIONS = 8
_LEAST_DETERMINANT = 1e-9
"""Of the sum of projectors across the rays, whose eigenvalues are of the order of 1: below it all rays are parallel."""
_SINGULAR = 1e-14
"""Determinant of a normal matrix scaled to a mean diagonal of 1 that cannot be inverted in double precision."""


@dataclass(frozen=True, eq=False)
class Measured:
    """Image measurements in any order: `point` (M,) and `photo` (M,) numbers, `pixels` (M, 2) (col, row), `sigma` (M,) px."""

    point: np.ndarray
    photo: np.ndarray
    pixels: np.ndarray
    sigma: np.ndarray

    def take(self, index: np.ndarray) -> "Measured":
        """The measurements at `index` (mask or numbers)."""
        return Measured(self.point[index], self.photo[index], self.pixels[index], self.sigma[index])


@dataclass(frozen=True, eq=False)
class FixedIntersection:
    """`points` (n, 3) m, NaN where a point has fewer than two rays or they do not intersect in front of the cameras; `covariance`
    (n, 3, 3) m^2 for measurements of the stated sigma; `residual` (M, 2) px (col, row), computed minus observed."""

    points: np.ndarray
    covariance: np.ndarray
    residual: np.ndarray


def intersect_fixed(views: list[View], measured: Measured, count: int) -> FixedIntersection:
    """The least-squares points of `count` point numbers."""
    observed, directions = _prepared(views, measured)
    rotation = np.array([view.rotation for view in views])[measured.photo]
    centre = np.array([view.centre for view in views])[measured.photo]
    c = np.array([view.camera.c for view in views])[measured.photo]
    points = _nearest(centre, directions, measured.point, count)
    weight = 1.0 / measured.sigma**2
    for _ in range(_ITERATIONS):
        residual, J = _linear(points[measured.point], rotation, centre, c, observed)
        normal = _summed(np.einsum("m,mki,mkj->mij", weight, J, J), measured.point, count)
        right = _summed(np.einsum("m,mki,mk->mi", weight, J, residual), measured.point, count)
        points = points + _solved(normal, right)
    points[_behind(points, rotation, centre, measured.point, count)] = np.nan
    residual, _ = _linear(points[measured.point], rotation, centre, c, observed)
    # Image y points up, rows count down: hence the sign of the second component.
    return FixedIntersection(points, _inverse(normal), -residual * [1.0, -1.0])


def _prepared(views: list[View], measured: Measured) -> tuple[np.ndarray, np.ndarray]:
    """Ideal image coordinates (M, 2) px and unit directions of the rays (M, 3) in the ground system."""
    observed, directions = np.zeros((len(measured.point), 2)), np.zeros((len(measured.point), 3))
    for number in np.unique(measured.photo):
        own = measured.photo == number
        observed[own] = pixel_to_image(views[number].camera, measured.pixels[own])
        directions[own] = views[number].rays(measured.pixels[own])
    return observed, directions


def _nearest(centre: np.ndarray, direction: np.ndarray, point: np.ndarray, count: int) -> np.ndarray:
    """(count, 3) the points nearest to their rays in space; NaN where there are fewer than two rays, or all are parallel."""
    projector = np.eye(3) - direction[:, :, None] * direction[:, None, :]
    normal = _summed(projector, point, count)
    right = _summed(np.einsum("mij,mj->mi", projector, centre), point, count)
    weak = (np.bincount(point, minlength=count) < 2) | (np.linalg.det(normal) < _LEAST_DETERMINANT)
    return np.where(weak[:, None], np.nan, _solved(np.where(weak[:, None, None], np.eye(3), normal), right))


def _summed(values: np.ndarray, point: np.ndarray, count: int) -> np.ndarray:
    """Sums (count, ...) of the values (M, ...) of each point."""
    out = np.zeros((count, *values.shape[1:]))
    np.add.at(out, point, values)
    return out


def _solved(normal: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Solutions (n, 3) of the normal equations; NaN where they are singular."""
    return np.einsum("nij,nj->ni", _inverse(normal), right)


def _inverse(normal: np.ndarray) -> np.ndarray:
    """Inverses (n, 3, 3); NaN where a matrix is singular or not finite."""
    fine = np.isfinite(normal).all(axis=(1, 2))
    # One singular matrix makes NumPy refuse the whole stack; it is exchanged for the identity, and its inverse for NaN. The scale
    # makes the test of the determinant independent of the units of ground and image.
    scale = np.where(fine, np.trace(np.nan_to_num(normal), axis1=1, axis2=2) / 3.0, 1.0)
    scale = np.where(scale > 0, scale, 1.0)
    scaled = np.where(fine[:, None, None], np.nan_to_num(normal) / scale[:, None, None], np.eye(3))
    bad = ~fine | (np.abs(np.linalg.det(scaled)) < _SINGULAR)
    inverse = np.linalg.inv(np.where(bad[:, None, None], np.eye(3), scaled)) / scale[:, None, None]
    return np.where(bad[:, None, None], np.nan, inverse)


def _linear(
    at: np.ndarray, rotation: np.ndarray, centre: np.ndarray, c: np.ndarray, observed: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Observed minus computed (M, 2), and the derivatives (M, 2, 3) of the computed coordinates by those of the point."""
    u = np.einsum("mij,mj->mi", rotation, at - centre)
    with np.errstate(divide="ignore", invalid="ignore"):
        xy = -c[:, None] * u[:, :2] / u[:, 2:3]
        J = -(c / u[:, 2])[:, None, None] * (rotation[:, :2] - (u[:, :2] / u[:, 2:3])[:, :, None] * rotation[:, 2][:, None, :])
    return observed - xy, J


def _behind(points: np.ndarray, rotation: np.ndarray, centre: np.ndarray, point: np.ndarray, count: int) -> np.ndarray:
    """(count,) bool: points behind one of their cameras, where the collinearity equations hold as well."""
    depth = -np.einsum("mj,mj->m", rotation[:, 2], points[point] - centre)
    behind = np.zeros(count, bool)
    behind[point[depth <= 0]] = True
    return behind
