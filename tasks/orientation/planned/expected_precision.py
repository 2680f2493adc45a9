"""Standard errors to be expected of a planned block: of the place of ground points, and of the shape of the ground.

The covariance is that of the product's own adjustment, at the geometry of the flight. What all positions have in common moves the
block as a whole; the shape is what is left of heights after that, in quadratic forms over the block.
"""

from dataclasses import dataclass

import numpy as np

from orthomill.tasks.adjustment.model.linearisation import Linear, linearised
from orthomill.tasks.adjustment.testing.covariances import Covariance, covariance_of, points_and_rays, with_considered
from orthomill.tasks.orientation.planned.planned_network import PlannedNetwork, with_kept

FORM = 5
"""Points along each side of the block whose heights make up its form."""
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
    form = _form(planned)
    kept = with_kept(planned, form)
    linear = linearised(kept.network, kept.state, kept.rays)
    covariance = with_considered(kept.network, linear, covariance_of(kept.network, kept.state, linear))
    variances = _of_points(kept, linear, covariance) + kept.shift**2
    height = np.sqrt(variances[:, 2])
    return ExpectedPrecision(
        plan=float(np.sqrt(np.median(variances[:, :2].mean(axis=1)))),
        height=float(np.median(height)),
        worst=float(np.percentile(height, 95)),
        bend=_bend(kept, covariance),
        extent=float(np.linalg.norm(np.ptp(kept.state.point[form, :2], axis=0))),
    )


def often_seen(planned: PlannedNetwork) -> np.ndarray:
    """Numbers of the tie points in SIDE photographs or more; of those in two where none is."""
    often = np.bincount(planned.rays.point, minlength=len(planned.state.point))[: planned.ties]
    return np.flatnonzero(often >= SIDE) if (often >= SIDE).any() else np.flatnonzero(often >= 2)


def _of_points(planned: PlannedNetwork, linear: Linear, covariance: Covariance) -> np.ndarray:
    """(n, 3) variances of the points that are often seen."""
    points, _ = points_and_rays(planned.network, linear, covariance)
    return np.diagonal(points[often_seen(planned)], axis1=1, axis2=2)


def _form(planned: PlannedNetwork) -> np.ndarray:
    """Numbers of points that are spread over the block."""
    known = often_seen(planned)
    xy = planned.state.point[known, :2]
    low, high = xy.min(axis=0), xy.max(axis=0)
    grid = np.stack(np.meshgrid(*np.linspace(low, high, FORM).T), axis=-1).reshape(-1, 2)
    return np.unique([known[np.linalg.norm(xy - place, axis=1).argmin()] for place in grid])


def _bend(planned: PlannedNetwork, covariance: Covariance) -> float:
    """Standard error of the range of heights, m, that the bend adds which the block knows least."""
    forms = bend_forms(planned.state.point[planned.network.kept, :2])
    unit = np.zeros((len(covariance), forms.shape[1]))
    unit[planned.network.kept_columns[:, 2]] = forms / len(forms)
    values, vectors = np.linalg.eigh(unit.T @ covariance.times(unit))
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
