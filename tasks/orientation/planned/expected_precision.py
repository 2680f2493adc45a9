"""Standard errors to be expected of a planned block: of the place of ground points, and of the shape of the ground.

The covariance is that of the product's own adjustment, at the geometry of the flight. What all positions have in common moves the
block as a whole; the shape is what is left of heights after that, in quadratic forms over the block.
"""

from dataclasses import dataclass

import numpy as np

from orthomill.tasks.adjustment.model.linearisation import Linear, linearised
from orthomill.tasks.adjustment.testing.covariances import Covariance, covariance_of, points_alone, with_considered
from orthomill.tasks.orientation.planned.planned_network import IMAGE, PlannedNetwork

NARROW = 0.05
"""Width of a block in units of its length below which nothing is said of a bend across it"""
SIDE = 3
"""Photographs that see the points from which an expectation is taken, as those of a surface mostly do."""


@dataclass(frozen=True)
class ExpectedPrecision:
    """Standard errors, m: of ground points in `plan` (of one coordinate) and `height`, the median and in the `worst` twentieth;
    of the range of heights that a `bend` adds over the block, which is `extent` m long."""

    plan: float
    height: float
    worst: float
    bend: float
    extent: float


def expected_precision(planned: PlannedNetwork) -> ExpectedPrecision:
    """The standard errors of a planned block. Raises GeometryError where it is not determined."""
    linear = linearised(planned.network, planned.state, planned.rays)
    covariance = with_considered(planned.network, linear, covariance_of(planned.network, planned.state, linear))
    points = often_seen(planned)
    variances = _of_points(planned, linear, covariance)[points] + planned.shift**2
    height, xy = np.sqrt(variances[:, 2]), planned.state.point[points, :2]
    return ExpectedPrecision(
        plan=float(np.sqrt(np.median(variances[:, :2].mean(axis=1)))),
        height=float(np.median(height)),
        worst=float(np.percentile(height, 95)),
        bend=_bend(linear, covariance, points, bend_forms(xy)),
        extent=float(np.linalg.norm(np.ptp(xy, axis=0))),
    )


def often_seen(planned: PlannedNetwork) -> np.ndarray:
    """Numbers of the tie points in SIDE photographs or more; of those in two where none is."""
    often = np.bincount(planned.rays.point, minlength=len(planned.state.point))[: planned.ties]
    return np.flatnonzero(often >= SIDE) if (often >= SIDE).any() else np.flatnonzero(often >= 2)


def _of_points(planned: PlannedNetwork, linear: Linear, covariance: Covariance) -> np.ndarray:
    """(N, 3) variances of the points: of the block, and of their own measurements, of which each is as good as one of an area."""
    own = linear._replace(weight=np.full_like(linear.weight, 1.0 / IMAGE**2))
    return np.diagonal(points_alone(planned.network, own, covariance), axis1=1, axis2=2)


def _bend(linear: Linear, covariance: Covariance, points: np.ndarray, forms: np.ndarray) -> float:
    """Standard error of the range of heights, m, that the bend adds which the block knows least.

    The coefficients of `forms` (n, k) are means of forms times heights; points follow the unknowns by back substitution. Their own
    errors are left out: they do not bend the block.
    """
    point = np.repeat(np.arange(len(linear.frame)), np.diff(linear.first))
    normal = np.zeros((len(linear.frame), 3, 3))
    np.add.at(normal, point, linear.weight[:, None, None] * np.einsum("mia,mib->mab", linear.jp, linear.jp))
    normal[:, range(3), range(3)] += linear.point_weight
    upward = np.zeros((len(linear.frame), forms.shape[1]))
    upward[points] = forms / len(forms)
    pull = np.linalg.pinv(normal, hermitian=True) @ (linear.frame[:, 2, :, None] * upward[:, None])
    by_rays = linear.weight[:, None, None] * np.einsum("mia,mak->mik", linear.jp, pull[point])
    unit = np.zeros((len(covariance) + 1, forms.shape[1]))
    # Absent unknowns have the column -1: the row that is cut off.
    np.add.at(unit, linear.columns[linear.row], -np.einsum("mia,mik->mak", linear.jg, by_rays))
    values, vectors = np.linalg.eigh(unit[:-1].T @ covariance.times(unit[:-1]))
    return float(np.sqrt(max(values[-1], 0.0)) * np.ptp(forms @ vectors[:, -1]))


def bend_forms(xy: np.ndarray) -> np.ndarray:
    """(n, k) quadratic forms at places (n, 2) m, orthogonal, of unit mean square and without any plane; a narrow block has a form
    along it only, and a twist."""
    away = xy - xy.mean(axis=0)
    _, spread, axes = np.linalg.svd(away, full_matrices=False)
    u, v = (away @ axes.T / np.maximum(spread, 1e-12)).T
    plane = np.column_stack([np.ones_like(u), u, v])
    forms = np.column_stack([u * u, u * v, v * v])[:, : 2 if spread[1] < NARROW * spread[0] else 3]
    forms = forms - plane @ np.linalg.lstsq(plane, forms, rcond=None)[0]
    return np.linalg.qr(forms)[0] * np.sqrt(len(xy))
