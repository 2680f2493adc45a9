"""Blunders among surveyed observations: positions, surveyed points and distances, each as a whole.

An observation is tested by the quadratic form of its misfit with the covariance of that misfit. The misfit is measured in units of
the usual misfit of its group where that is larger than stated, so that optimistic standard errors do not make blunders of good
points. The worst one is removed first and alone, because a blunder distorts its neighbours; the rest must still define the datum.

Source: Baarda 1968.
"""

from typing import NamedTuple

import numpy as np
from scipy.special import chdtri, ndtr

from orthomill.tasks.adjustment.model.datum import antennas, distance_residuals, position_residuals
from orthomill.tasks.adjustment.model.network import Network
from orthomill.tasks.adjustment.model.surveyed_observations import Blunder, SurveyedKind, weights_of, with_weight
from orthomill.tasks.adjustment.testing.adjustment_result import Adjustment, surveyed
from orthomill.tasks.adjustment.testing.variance_components import distance_variances, position_covariances

CHECKABLE = 1e-3
"""A combination of coordinates with a smaller redundancy number cannot be tested."""
# Square root of the median 2.366 of chi-squared with three degrees of freedom.
MEDIAN = 1.538
"""Median length of a three-dimensional normal vector, in standard errors."""
CLEAR = 1.2
"""With few surveyed observations left the worst is rejected only where its misfit is this many times the next largest."""


class Misfits(NamedTuple):
    """Tested observations of a kind: their numbers (n,), the quadratic forms (n,) of their misfits, degrees of freedom (n,), and
    the `group` (n,) of those that were measured alike."""

    number: np.ndarray
    square: np.ndarray
    dof: np.ndarray
    group: np.ndarray


def surveyed_blunder(
    result: Adjustment, limit: float, by_group: bool = True, kinds: tuple[SurveyedKind, ...] = tuple(SurveyedKind)
) -> Blunder | None:
    """The position, surveyed point or distance that contradicts the rest most, beyond `limit` standard errors (of a single number),
    among these `kinds`; `by_group`: in units of the usual misfit of its group, which a blunder also enlarges."""
    found = [
        blunder
        for kind in kinds
        for blunder in _beyond(kind, _misfits(result, kind), limit, by_group)
        if kind != SurveyedKind.CONTROL or not _pointing_is_worse(result, blunder)
    ]
    return worst_of(result.network, found)


def is_outlier(rest: Adjustment, first: Network, blunder: Blunder, limit: float) -> bool:
    """Whether an observation that took no part in `rest` (its weight is in the `first` network) contradicts it, in units of the
    usual misfit of the observations of its kind that took part."""
    square, numbers = _square_of_prediction(rest, first, blunder)
    misfits = _misfits(rest, blunder.kind)
    others, dof = (values[misfits.group == _groups(rest, blunder.kind, np.array([blunder.number]))] for values in misfits[1:3])
    return bool(square > largest_square(limit, numbers) * usual_misfit(np.sqrt(others[dof > 0])) ** 2)


def worst_of(network: Network, found: list[Blunder]) -> Blunder | None:
    """The largest misfit, if the rest still defines the datum and, where few are left, the largest is clearly the largest."""
    ranked = sorted(found, key=lambda blunder: -blunder.misfit)
    if ranked and ranked[0].kind == SurveyedKind.DISTANCE and not network.free:
        # Positions and control define the datum: no distance is needed for it.
        return ranked[0]
    if network.free:
        left = int((network.distances.weight > 0).sum())
    else:
        left = int(network.centre_weight.any(axis=1).sum() + network.point_weight.any(axis=1).sum()) - 1
    if not ranked or left < 3:
        return None
    if left < 5 and len(ranked) > 1 and ranked[0].misfit < CLEAR * ranked[1].misfit:
        return None
    return ranked[0]


def with_reinstated(network: Network, result: Adjustment, blunders: tuple[Blunder, ...], first: Network, limit: float) -> Network:
    """The network with those blunders reinstated (with the weights of the `first` network) that agree with the final solution: they
    were rejected while something else, a camera constant, was still wrong."""
    for blunder in blunders:
        square, numbers = _square_of_prediction(result, first, blunder)
        if square < largest_square(limit, numbers):
            network = with_weight(network, blunder, weights_of(first, blunder.kind)[blunder.number])
    return network


def _square_of_prediction(result: Adjustment, first: Network, blunder: Blunder) -> tuple[float, int]:
    """The quadratic form of the difference between an observation that took no part and the solution, and its degrees of freedom;
    inf where the solution does not predict it."""
    away, spread = _prediction_error(result, first, blunder)
    if not spread.any():
        return np.inf, len(away)
    weight = np.atleast_1d(weights_of(first, blunder.kind)[blunder.number])
    given = np.diag(np.divide(1.0, weight, out=np.zeros(len(weight)), where=weight > 0))
    return float(away @ np.linalg.solve(spread + given, away)), len(away)


def _prediction_error(result: Adjustment, first: Network, blunder: Blunder) -> tuple[np.ndarray, np.ndarray]:
    """Observed minus predicted (d,), and the covariance (d, d) of the prediction."""
    i = blunder.number
    if blunder.kind == SurveyedKind.POSITION:
        return first.centre[i] - antennas(result.network, result.state)[i], position_covariances(result, np.array([i]))[0]
    if blunder.kind == SurveyedKind.DISTANCE:
        return distance_residuals(first, result.state)[[i]], distance_variances(result)[i].reshape(1, 1)
    return first.point[i] - result.state.point[i], result.point_covariance[i]


def usual_misfit(size: np.ndarray) -> float:
    """The unit of misfits of these sizes (n,), at least 1; the median of fewer than four would depend on the blunder itself."""
    return max(1.0, float(np.median(size)) / MEDIAN) if len(size) >= 4 else 1.0


def _beyond(kind: SurveyedKind, misfits: Misfits, limit: float, by_group: bool) -> list[Blunder]:
    number, square, dof, group = misfits
    size, unit = np.sqrt(square), np.ones(len(square))
    beyond = np.sqrt(largest_square(limit, np.maximum(dof, 1)))
    for own in (group == one for one in np.unique(group)) if by_group else ():
        unit[own] = usual_misfit(size[own & (dof > 0)])
    far = (dof > 0) & (size > beyond * unit)
    return [Blunder(kind, int(i), float(s)) for i, s in zip(number[far], (size / unit)[far], strict=True)]


def _groups(result: Adjustment, kind: SurveyedKind, number: np.ndarray) -> np.ndarray:
    """(n,) the groups of observations of a kind: each receiver errs in its own way."""
    return result.network.gnss_groups[number] if kind == SurveyedKind.POSITION else np.zeros(len(number), np.int64)


def _misfits(result: Adjustment, kind: SurveyedKind) -> Misfits:
    if kind == SurveyedKind.POSITION:
        return _position_misfits(result)
    return _control_misfits(result) if kind == SurveyedKind.CONTROL else _distance_misfits(result)


def _control_misfits(result: Adjustment) -> Misfits:
    network = result.network
    seen = np.bincount(result.rays.point[result.used], minlength=len(network.point)) > 0
    number = np.flatnonzero(network.point_weight.any(axis=1) & seen)
    computed = result.as_computed.point_covariance
    rows = [
        misfit_square(
            network.point_weight[i], network.point[i] - result.state.point[i], computed[i], result.point_covariance[i] - computed[i]
        )
        for i in number
    ]
    return _table(result, SurveyedKind.CONTROL, number, rows)


def _position_misfits(result: Adjustment) -> Misfits:
    network, residual = result.network, position_residuals(result.network, result.state)
    number = np.flatnonzero(network.centre_weight.any(axis=1))
    computed = position_covariances(result.as_computed, number)
    added = position_covariances(result, number) - computed
    rows = [misfit_square(network.centre_weight[i], residual[i], *own) for i, *own in zip(number, computed, added, strict=True)]
    return _table(result, SurveyedKind.POSITION, number, rows)


def _distance_misfits(result: Adjustment) -> Misfits:
    weight, residual = result.network.distances.weight, distance_residuals(result.network, result.state)
    variance = distance_variances(result.as_computed)
    redundancy = 1.0 - weight * variance
    tested = (weight > 0) & (redundancy > CHECKABLE)
    added = weight * (distance_variances(result) - variance)
    square = weight * residual**2 / np.maximum(redundancy + added, CHECKABLE)
    return _table(result, SurveyedKind.DISTANCE, np.flatnonzero(tested), [(float(one), 1) for one in square[tested]])


def _table(result: Adjustment, kind: SurveyedKind, number: np.ndarray, rows: list[tuple[float, int]]) -> Misfits:
    table = np.array(rows).reshape(-1, 2)
    return Misfits(number, table[:, 0], table[:, 1].astype(int), _groups(result, kind, number))


def misfit_square(
    weight: np.ndarray, residual: np.ndarray, covariance: np.ndarray, added: np.ndarray | float = 0.0
) -> tuple[float, int]:
    """v' Q_vv^-1 v over the testable combinations of coordinates, and their number; `added` (3, 3) m^2: what considered parameters
    add to the `covariance` (3, 3) that the adjustment yields."""
    root = np.sqrt(weight)
    # Q_vv of weighted residuals is I - P^1/2 Q P^1/2; its eigenvalues are the redundancy numbers of its eigenvectors. A coordinate
    # that the datum depends on has one near 0, and its residual says nothing.
    redundancy, direction = np.linalg.eigh(np.diag((weight > 0).astype(float)) - root[:, None] * covariance * root)
    tested = redundancy > CHECKABLE
    testable = direction[:, tested]
    along = testable.T @ (root * residual)
    spread = np.diag(redundancy[tested]) + testable.T @ (root[:, None] * added * root) @ testable
    return float(along @ np.linalg.solve(spread, along)), int(tested.sum())


def _pointing_is_worse(result: Adjustment, blunder: Blunder) -> bool:
    """Whether one of the point's image measurements explains the contradiction better than its coordinates."""
    own = result.used & (result.rays.point == blunder.number) & surveyed(result.network, result.rays)
    # A single pointing has no other one to disagree with.
    if own.sum() < 2:
        return False
    # Each square minus its expectation: two coordinates of a ray, three of a point.
    return float((result.standardised[own] ** 2).sum(axis=1).max()) - 2.0 > blunder.misfit**2 - 3.0


def largest_square(limit: float, dof: int | np.ndarray) -> np.ndarray:
    """The quantile of chi-squared with `dof` degrees of freedom that is exceeded as rarely as a normal deviate exceeds
    +-`limit`."""
    # Two functions of scipy.special, because importing scipy.stats takes longer than planning a project.
    return chdtri(dof, 2.0 * ndtr(-limit))
