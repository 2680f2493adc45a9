"""Which observations contradict all others: rays one by one, positions and surveyed points as a whole.

A ray is tested by its standardised residuals (data snooping). A position or a surveyed point is tested by the square form of its
misfit with the covariance of that misfit; it is measured in units of its group's usual misfit where that is larger than stated,
so that optimistic standard errors make no blunders of good points. The worst goes first and alone, for a blunder spoils its
neighbours; what it leaves must still hold the block.

Source: Baarda 1968.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtri, ndtr

from orthomill.tasks.adjustment.model.adjustment_result import Adjustment, Blunder, surveyed
from orthomill.tasks.adjustment.model.collinearity import residual_lengths
from orthomill.tasks.adjustment.model.datum import distance_residuals, position_residuals, prior_sizes
from orthomill.tasks.adjustment.model.linearisation import linearised
from orthomill.tasks.adjustment.model.network import NO_DISTANCES, Network, Rays, State
from orthomill.tasks.adjustment.solve.normal_equations import point_corrections, point_precision_alone
from orthomill.tasks.adjustment.testing.variance_components import distance_variances, position_covariances

CHECKABLE = 1e-3
"""A combination of coordinates with a smaller redundancy number cannot be tested."""
MEDIAN = 1.538
"""Median length of a three-dimensional normal vector, in standard errors."""
CLEAR = 1.2
"""With few surveyed points left one of them is only named when its misfit is this many times the next largest."""


def ray_blunders(result: Adjustment, limit: np.ndarray) -> np.ndarray:
    """(M,) bool: the worst ray of every point whose standardised residual is beyond its `limit` (M,)."""
    worst = np.nan_to_num(np.abs(result.standardised).max(axis=1))
    highest = np.zeros(len(result.state.point))
    np.maximum.at(highest, result.rays.point, worst)
    return (worst > limit) & (worst == highest[result.rays.point])


def surveyed_blunder(result: Adjustment, limit: float, by_group: bool = True) -> Blunder | None:
    """The position, surveyed point or distance that contradicts the rest most, beyond `limit` standard errors (of a single
    number); `by_group`: in units of its group's usual misfit, which a blunder enlarges, too."""
    found = [
        blunder
        for kind, misfits in _MISFITS.items()
        for blunder in _tested(kind, *misfits(result), limit, by_group)
        if kind != "control" or not _pointing_is_worse(result, blunder)
    ]
    return worst_of(result.network, found)


def is_outlier(rest: Adjustment, first: Network, blunder: Blunder, limit: float) -> bool:
    """Whether something that had no part in `rest` (its weight is in the `first` network) contradicts it by the usual misfit of
    those of its kind that had."""
    square, numbers = _square_away(rest, first, blunder)
    _, others, dof = _MISFITS[blunder.kind](rest)
    return square > _largest_square(limit, numbers) * _unit(np.sqrt(others[dof > 0])) ** 2


def gross_blunder(network: Network, state: State, rays: Rays, limit: float) -> Blunder | None:
    """The same on a robust solution: positions by their plain misfit, surveyed points and distances by what the rays of the points
    say without them (a precise coordinate or distance would drag these rays along, and they would look wrong).

    A surveyed point whose rays do not meet has a wrong pointing, which is a matter of the rays.
    """
    centres, met = np.flatnonzero(network.centre_weight.any(axis=1)), _met(network, state, rays, limit)
    found = _far("position", centres, prior_sizes(network, state).centre[centres], limit)
    found += _far("control", *_apart(network, met), limit)
    return worst_of(network, found + _far("distance", *_stretched(network, met), limit))


def _far(kind: str, number: np.ndarray, size: np.ndarray, limit: float) -> list[Blunder]:
    unit = _unit(size)
    return [Blunder(kind, int(i), float(s)) for i, s in zip(number, size, strict=True) if s > limit * unit]


@dataclass(frozen=True, eq=False)
class _Met:
    """Points that a person measured, as their rays alone put them: `point` (N, 3), `covariance` (N, 3, 3), `good` (N,) bool: their
    rays meet."""

    point: np.ndarray
    covariance: np.ndarray
    good: np.ndarray


def _met(network: Network, state: State, rays: Rays, limit: float) -> _Met:
    rays = rays.take(network.pointed[rays.point])
    count = np.bincount(rays.point, minlength=len(network.point))
    rays = rays.take(count[rays.point] >= 2)
    bare = replace(network, point_weight=np.zeros_like(network.point_weight), kept=network.kept[:0], distances=NO_DISTANCES)
    nothing = np.zeros(bare.unknowns)
    for _ in range(6):
        state = replace(state, point=state.point + point_corrections(linearised(bare, state, rays), nothing))
    covariance = point_precision_alone(linearised(bare, state, rays), bare.group_start)
    worst = np.zeros(len(network.point))
    np.maximum.at(worst, rays.point, residual_lengths(bare, state, rays))
    return _Met(state.point, covariance, (count >= 2) & (worst < limit) & (worst > 0.0))


def _apart(network: Network, met: _Met) -> tuple[np.ndarray, np.ndarray]:
    """Surveyed points (n,) whose rays meet, and how far these meet from the given coordinates, in standard errors."""
    number = np.flatnonzero(met.good & network.point_weight.any(axis=1))
    away, weight = (network.point - met.point)[number], network.point_weight[number]
    given = np.divide(1.0, weight, out=np.zeros_like(weight), where=weight > 0)
    spread = met.covariance[number] + given[:, None] * np.eye(3)
    return number, np.sqrt(np.maximum(np.einsum("ni,nij,nj->n", away, np.linalg.inv(spread), away), 0.0))


def _stretched(network: Network, met: _Met) -> tuple[np.ndarray, np.ndarray]:
    """Distances (n,) whose ends' rays meet, and how far these ends are from the given length, in standard errors."""
    distances = network.distances
    found, sigma = _lengths(network, met)
    number = np.flatnonzero(np.isfinite(found) & (distances.weight > 0))
    return number, np.abs(distances.length - found)[number] / np.hypot(sigma, distances.sigma)[number]


def lengths_of_rays(network: Network, state: State, rays: Rays, limit: float) -> tuple[np.ndarray, np.ndarray]:
    """The measured distances (D,) as the rays of their ends alone give them, and standard errors; NaN where rays do not meet within
    `limit` standard errors."""
    return _lengths(network, _met(network, state, rays, limit))


def _lengths(network: Network, met: _Met) -> tuple[np.ndarray, np.ndarray]:
    ends = network.distances.ends
    along = met.point[ends[:, 1]] - met.point[ends[:, 0]]
    found = np.linalg.norm(along, axis=1)
    along /= np.maximum(found, 1e-12)[:, None]
    spread = np.einsum("ni,nij,nj->n", along, met.covariance[ends].sum(axis=1), along)
    good = met.good[ends].all(axis=1)
    return np.where(good, found, np.nan), np.where(good, np.sqrt(spread), np.nan)


def worst_of(network: Network, found: list[Blunder]) -> Blunder | None:
    """The largest misfit, if the rest still holds the block without it and it stands out clearly where few are left."""
    ranked = sorted(found, key=lambda blunder: -blunder.misfit)
    if ranked and ranked[0].kind == "distance" and not network.free:
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


def reinstated(result: Adjustment, blunders: list[Blunder], stated: Network, first: Network, limit: float) -> Network:
    """The `stated` network with those blunders put back (weights of the `first` network) that agree with the final solution: they
    were thrown out while something else, a camera constant, was still wrong."""
    for blunder in blunders:
        square, numbers = _square_away(result, first, blunder)
        if square < _largest_square(limit, numbers):
            stated = _with_weight(stated, blunder, weights_of(first, blunder.kind)[blunder.number])
    return stated


def _square_away(result: Adjustment, first: Network, blunder: Blunder) -> tuple[float, int]:
    """The square form of how far something that had no part is from the solution, and of how many numbers; inf where the solution
    has no place for it."""
    away, spread = _away(result, first, blunder)
    if not spread.any():
        return np.inf, len(away)
    weight = np.atleast_1d(weights_of(first, blunder.kind)[blunder.number])
    given = np.diag(np.divide(1.0, weight, out=np.zeros(len(weight)), where=weight > 0))
    return float(away @ np.linalg.solve(spread + given, away)), len(away)


def _away(result: Adjustment, first: Network, blunder: Blunder) -> tuple[np.ndarray, np.ndarray]:
    """How far something surveyed is from the solution (d,), and the covariance (d, d) of its adjusted value."""
    i = blunder.number
    if blunder.kind == "position":
        return first.centre[i] - antennas(result)[i], position_covariances(result, np.array([i]))[0]
    if blunder.kind == "distance":
        return distance_residuals(first, result.state)[[i]], distance_variances(result)[i].reshape(1, 1)
    return first.point[i] - result.state.point[i], result.point_covariance[i]


def antennas(result: Adjustment) -> np.ndarray:
    """(P, 3) where the antennas are by the solution, local m."""
    state = result.state
    return state.centre + np.einsum("pji,j->pi", state.rotation, state.lever) + state.shift


def weights_of(network: Network, kind: str) -> np.ndarray:
    """Weights of what was surveyed: positions (P, 3), control (N, 3) or distances (D,)."""
    return {"position": network.centre_weight, "control": network.point_weight, "distance": network.distances.weight}[kind]


def _with_weight(network: Network, blunder: Blunder, weight: np.ndarray | float) -> Network:
    """The network in which the observation in question has another weight."""
    weights = weights_of(network, blunder.kind).copy()
    weights[blunder.number] = weight
    if blunder.kind == "position":
        return replace(network, centre_weight=weights)
    if blunder.kind == "distance":
        return replace(network, distances=replace(network.distances, weight=weights))
    return replace(network, point_weight=weights)


def without(network: Network, blunder: Blunder) -> Network:
    """The network that knows nothing of the blunder; a control point stays as a point that a person measured."""
    changed = _with_weight(network, blunder, 0.0)
    return replace(changed, named=np.append(network.named, blunder.number)) if blunder.kind == "control" else changed


def enough_rays(network: Network, rays: Rays, used: np.ndarray) -> np.ndarray:
    """`used` without the rays of points that have neither two rays nor known coordinates; the ends of distances, which are among
    the unknowns, keep all of theirs."""
    known, end = network.point_weight.any(axis=1), np.zeros(len(network.point), bool)
    end[network.kept] = True
    count = np.bincount(rays.point[used], minlength=len(network.point))
    starved = end & ~known & (count < 2)
    return (used | starved[rays.point]) & ((count >= 2) | known | end)[rays.point]


def sufficiently_observed(network: Network, rays: Rays) -> Rays:
    """The rays of points that have enough of them."""
    return rays.take(enough_rays(network, rays, np.ones(len(rays), bool)))


def _tested(kind: str, number: np.ndarray, square: np.ndarray, dof: np.ndarray, limit: float, by_group: bool) -> list[Blunder]:
    size = np.sqrt(square)
    beyond = np.sqrt(_largest_square(limit, np.maximum(dof, 1)))
    unit = _unit(size[dof > 0]) if by_group else 1.0
    far = (dof > 0) & (size > beyond * unit)
    return [Blunder(kind, int(i), float(s / unit)) for i, s in zip(number[far], size[far], strict=True)]


def _unit(size: np.ndarray) -> float:
    return max(1.0, float(np.median(size)) / MEDIAN) if len(size) >= 4 else 1.0


def _control_misfits(result: Adjustment) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    network = result.network
    seen = np.bincount(result.rays.point[result.used], minlength=len(network.point)) > 0
    number = np.flatnonzero(network.point_weight.any(axis=1) & seen)
    rows = [_square(network.point_weight[i], network.point[i] - result.state.point[i], result.point_covariance[i]) for i in number]
    return _columns(number, rows)


def _position_misfits(result: Adjustment) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    network, residual = result.network, position_residuals(result.network, result.state)
    number = np.flatnonzero(network.centre_weight.any(axis=1))
    covariance = position_covariances(result, number)
    rows = [_square(network.centre_weight[i], residual[i], own) for i, own in zip(number, covariance, strict=True)]
    return _columns(number, rows)


def _distance_misfits(result: Adjustment) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    weight, residual = result.network.distances.weight, distance_residuals(result.network, result.state)
    redundancy = 1.0 - weight * distance_variances(result)
    tested = (weight > 0) & (redundancy > CHECKABLE)
    square = weight * residual**2 / np.maximum(redundancy, CHECKABLE)
    return np.flatnonzero(tested), square[tested], np.ones(int(tested.sum()), int)


_MISFITS = {"control": _control_misfits, "position": _position_misfits, "distance": _distance_misfits}


def _columns(number: np.ndarray, rows: list[tuple[float, int]]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    table = np.array(rows).reshape(-1, 2)
    return number, table[:, 0], table[:, 1].astype(int)


def _square(weight: np.ndarray, residual: np.ndarray, covariance: np.ndarray) -> tuple[float, int]:
    """v' Q_vv^-1 v over the combinations that can be tested, and how many these are."""
    root = np.sqrt(weight)
    redundancy, direction = np.linalg.eigh(np.diag((weight > 0).astype(float)) - root[:, None] * covariance * root)
    tested = redundancy > CHECKABLE
    along = direction.T @ (root * residual)
    return float((along[tested] ** 2 / redundancy[tested]).sum()), int(tested.sum())


def _pointing_is_worse(result: Adjustment, blunder: Blunder) -> bool:
    """Whether one of the point's measurements in the photographs explains the contradiction better than its coordinates."""
    own = result.used & (result.rays.point == blunder.number) & surveyed(result.network, result.rays)
    if own.sum() < 2:
        return False
    return float((result.standardised[own] ** 2).sum(axis=1).max()) - 2.0 > blunder.misfit**2 - 3.0


def _largest_square(limit: float, dof: int | np.ndarray) -> float | np.ndarray:
    """Square that chance exceeds as seldom as a normal deviate exceeds +-`limit`: chi-squared of `dof` degrees of freedom.

    Two functions of scipy.special, because importing scipy.stats takes longer than planning a project.
    """
    return chdtri(dof, 2.0 * ndtr(-limit))
