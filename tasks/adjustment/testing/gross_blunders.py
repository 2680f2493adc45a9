"""Gross blunders among surveyed observations, found on a robust solution.

Positions are tested by their plain misfit. Surveyed points and distances are compared with the intersections of the rays of the
points without them: a precise coordinate or distance would pull these rays with it, and they would look wrong.
"""

from dataclasses import dataclass, replace

import numpy as np

from orthomill.tasks.adjustment.model.collinearity import residual_lengths
from orthomill.tasks.adjustment.model.datum import prior_sizes
from orthomill.tasks.adjustment.model.linearisation import linearised
from orthomill.tasks.adjustment.model.network import NO_DISTANCES, Network, Rays, State
from orthomill.tasks.adjustment.model.robust_weights import spread
from orthomill.tasks.adjustment.model.surveyed_observations import Blunder, SurveyedKind
from orthomill.tasks.adjustment.solve.normal_equations import point_corrections, point_precision_alone
from orthomill.tasks.adjustment.testing.adjustment_result import Factors
from orthomill.tasks.adjustment.testing.surveyed_blunders import usual_misfit, worst_of

# Gauss-Newton on three unknowns per point, from a robust solution; each step squares the error.
STEPS = 6
"""Steps of the intersection of the rays of a point."""
LEAST_CHECKS = 4
"""Redundancy of all intersections from which their residuals tell the standard error of a pointing."""
NOT_BY_CHANCE = 3
"""Rays that meet in one point although one of them belongs to another: two often do, three hardly ever."""
CONTRADICTED = 2.0
"""The usual misfit of a group that is larger, in stated standard errors, contradicts these: the median of four or more is not twice
as large by chance."""
RANK = 1e-14
"""Of the largest variance of a point: a smaller one is that of a point at infinity, or rounding."""


@dataclass(frozen=True, eq=False)
class Intersections:
    """Points that a person measured, as intersected from their rays alone: `point` (N, 3), `covariance` (N, 3, 3) m^2, `good` (N,)
    bool: their rays intersect."""

    point: np.ndarray
    covariance: np.ndarray
    good: np.ndarray


def gross_blunder(
    network: Network, state: State, rays: Rays, limit: float, kinds: tuple[SurveyedKind, ...] = tuple(SurveyedKind)
) -> Blunder | None:
    """The surveyed observation of these `kinds` with the largest misfit beyond `limit` standard errors; None where there is none.

    A surveyed point whose rays do not intersect has a wrong pointing, which the test of the rays finds.
    """
    centres = np.flatnonzero(network.centre_weight.any(axis=1))
    points = _intersections(network, state, rays, limit)
    found, groups = [], network.gnss_groups[centres]
    for group in np.unique(groups):
        own = centres[groups == group]
        found += _beyond(SurveyedKind.POSITION, own, prior_sizes(network, state).centre[own], limit)
    found += _beyond(SurveyedKind.CONTROL, *_control_misfits(network, points), limit)
    found += _beyond(SurveyedKind.DISTANCE, *_distance_misfits(network, points), limit)
    return worst_of(network, [one for one in found if one.kind in kinds])


def control_misfits(network: Network, state: State, rays: Rays, limit: float) -> np.ndarray:
    """(N,) distances of the surveyed points from the intersections of their rays, in standard errors; NaN where no coordinates are
    given or the rays do not intersect within `limit` standard errors."""
    number, size = _control_misfits(network, _intersections(network, state, rays, limit))
    misfit = np.full(len(network.point), np.nan)
    misfit[number] = size
    return misfit


def well_pointed(network: Network, state: State, rays: Rays, limit: float) -> np.ndarray:
    """(N,) bool: surveyed points whose rays, three or more, meet within `limit` standard errors: whatever is wrong about these
    points, it is not their measurements."""
    count = np.bincount(rays.point, minlength=len(network.point))
    return _intersections(network, state, rays, limit).good & (count >= NOT_BY_CHANCE)


def pointing_spread(network: Network, state: State, rays: Rays) -> float:
    """Standard error of a pointing in units of the stated ones, from how the rays of each point miss their own intersection; NaN
    for too few rays.

    Coordinates that are wrong, or worse than stated, do not enter it.
    """
    alone = _alone(network, state, rays)
    count = np.bincount(alone.rays.point, minlength=len(network.point))
    # Of the 2 m coordinates of m rays the point takes three: residuals are smaller than errors by the root of what is left.
    left = np.sqrt(1.0 - 1.5 / count[alone.rays.point])
    enough = (2 * count - 3)[count >= 2].sum() >= LEAST_CHECKS
    return spread(alone.size / left) if enough else np.nan


def surveyed_factors(network: Network, state: State, rays: Rays, limit: float) -> Factors:
    """How many times larger than stated the usual misfits of the groups of positions and of surveyed points are, where that is no
    chance; the others as stated."""
    sizes, known, groups = prior_sizes(network, state).centre, network.centre_weight.any(axis=1), network.gnss_groups
    misfits = _control_misfits(network, _intersections(network, state, rays, limit))[1]
    position = tuple(_contradicted(sizes[known & (groups == group)]) for group in range(int(groups.max(initial=0)) + 1))
    return Factors(position=position, control=_contradicted(misfits))


def _contradicted(size: np.ndarray) -> float:
    """The usual misfit of a group (n,), where it contradicts the stated standard errors."""
    return unit if (unit := usual_misfit(size)) > CONTRADICTED else 1.0


def lengths_of_rays(network: Network, state: State, rays: Rays, limit: float) -> tuple[np.ndarray, np.ndarray]:
    """The measured distances (D,) as the rays of their ends alone determine them, and standard errors; NaN where rays do not
    intersect within `limit` standard errors."""
    return _lengths(network, _intersections(network, state, rays, limit))


def _beyond(kind: SurveyedKind, number: np.ndarray, size: np.ndarray, limit: float) -> list[Blunder]:
    unit = usual_misfit(size)
    return [Blunder(kind, int(i), float(s)) for i, s in zip(number, size, strict=True) if s > limit * unit]


@dataclass(frozen=True, eq=False)
class _Alone:
    """Points that a person measured, intersected from the `rays` of those that have two or more: the network without anything else
    that is known of them, the state, and (m,) the lengths of the residuals in standard errors."""

    network: Network
    state: State
    rays: Rays
    size: np.ndarray


def _alone(network: Network, state: State, rays: Rays) -> _Alone:
    rays = rays.take(network.pointed[rays.point])
    count = np.bincount(rays.point, minlength=len(network.point))
    rays = rays.take(count[rays.point] >= 2)
    # Without their own coordinates and distances, so that the rays alone decide.
    bare = replace(network, point_weight=np.zeros_like(network.point_weight), kept=network.kept[:0], distances=NO_DISTANCES)
    fixed = np.zeros(bare.unknowns)
    for _ in range(STEPS):
        state = replace(state, point=state.point + point_corrections(linearised(bare, state, rays), fixed))
    return _Alone(bare, state, rays, residual_lengths(bare, state, rays))


def _intersections(network: Network, state: State, rays: Rays, limit: float) -> Intersections:
    alone = _alone(network, state, rays)
    covariance = point_precision_alone(linearised(alone.network, alone.state, alone.rays), alone.network.group_start)
    worst = np.zeros(len(network.point))
    np.maximum.at(worst, alone.rays.point, alone.size)
    # A point without rays has a worst residual of exactly 0.
    return Intersections(alone.state.point, covariance, (worst < limit) & (worst > 0.0) & _determined(covariance))


def _determined(covariance: np.ndarray) -> np.ndarray:
    """(N,) bool: points of finite place; rays that belong to different points may be parallel, and meet at infinity."""
    finite = np.isfinite(covariance).all(axis=(1, 2))
    size = np.linalg.eigvalsh(np.where(finite[:, None, None], covariance, 0.0))
    return finite & (size[:, 0] > RANK * size[:, 2])


def _control_misfits(network: Network, points: Intersections) -> tuple[np.ndarray, np.ndarray]:
    """Surveyed points (n,) whose rays intersect, and their distances from the given coordinates, in standard errors."""
    number = np.flatnonzero(points.good & network.point_weight.any(axis=1))
    away, weight = (network.point - points.point)[number], network.point_weight[number]
    given = np.divide(1.0, weight, out=np.zeros_like(weight), where=weight > 0)
    spread = points.covariance[number] + given[:, None] * np.eye(3)
    return number, np.sqrt(np.maximum(np.einsum("ni,nij,nj->n", away, np.linalg.inv(spread), away), 0.0))


def _distance_misfits(network: Network, points: Intersections) -> tuple[np.ndarray, np.ndarray]:
    """Distances (n,) between points whose rays intersect, and their differences from the intersected ones, in standard errors."""
    distances = network.distances
    found, sigma = _lengths(network, points)
    number = np.flatnonzero(np.isfinite(found) & (distances.weight > 0))
    return number, np.abs(distances.length - found)[number] / np.hypot(sigma, distances.sigma)[number]


def _lengths(network: Network, points: Intersections) -> tuple[np.ndarray, np.ndarray]:
    ends = network.distances.ends
    along = points.point[ends[:, 1]] - points.point[ends[:, 0]]
    found = np.linalg.norm(along, axis=1)
    along /= np.maximum(found, 1e-12)[:, None]
    spread = np.einsum("ni,nij,nj->n", along, points.covariance[ends].sum(axis=1), along)
    good = points.good[ends].all(axis=1)
    return np.where(good, found, np.nan), np.where(good, np.sqrt(spread), np.nan)
