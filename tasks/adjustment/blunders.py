"""Which observations contradict all others: rays one by one, positions and surveyed points as a whole.

A ray is tested by its standardised residuals (data snooping). A position or a surveyed point is tested by the square form of its
misfit with the covariance of that misfit; it is measured in units of its group's usual misfit where that is larger than stated,
so that optimistic standard errors make no blunders of good points. The worst goes first and alone, for a blunder spoils its
neighbours; what it leaves must still hold the block.

Source: Baarda 1968.
"""

from dataclasses import replace

import numpy as np
from scipy.special import chdtri, ndtr

from tasks.adjustment.datum import position_misclosures, prior_sizes
from tasks.adjustment.minimise import sizes
from tasks.adjustment.network import NO_DISTANCES, Network, Rays, State
from tasks.adjustment.normal_equations import linearised, point_corrections, point_precision
from tasks.adjustment.result import Adjustment, Blunder, surveyed
from tasks.adjustment.variance_components import position_covariance

CHECKABLE = 0.02
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


def surveyed_blunder(result: Adjustment, limit: float) -> Blunder | None:
    """The position or surveyed point that contradicts the rest most, beyond `limit` standard errors (of a single number)."""
    found = [*_tested("control", *_control_misfits(result), limit), *_tested("position", *_position_misfits(result), limit)]
    found = [blunder for blunder in found if blunder.kind == "position" or not _pointing_is_worse(result, blunder)]
    return worst_of(result.network, found)


def gross_blunder(network: Network, state: State, rays: Rays, limit: float) -> Blunder | None:
    """The same on a robust solution: positions by their plain misfit, surveyed points by what their own rays say without the
    coordinates (a precise coordinate would drag its rays along, and these would look wrong).

    A surveyed point whose rays do not meet has a wrong pointing, which is a matter of the rays.
    """
    centres = np.flatnonzero(network.centre_weight.any(axis=1))
    found = _far("position", centres, prior_sizes(network, state).centre[centres], limit)
    return worst_of(network, found + _far("control", *_apart(network, state, rays, limit), limit))


def _far(kind: str, number: np.ndarray, size: np.ndarray, limit: float) -> list[Blunder]:
    unit = _unit(size)
    return [Blunder(kind, int(i), float(s)) for i, s in zip(number, size, strict=True) if s > limit * unit]


def _apart(network: Network, state: State, rays: Rays, limit: float) -> tuple[np.ndarray, np.ndarray]:
    """Surveyed points (n,) whose rays meet, and how far these meet from the given coordinates, in standard errors."""
    rays = rays.take(network.point_weight.any(axis=1)[rays.point])
    count = np.bincount(rays.point, minlength=len(network.point))
    rays = rays.take(count[rays.point] >= 2)
    bare = replace(network, point_weight=np.zeros_like(network.point_weight), kept=network.kept[:0], distances=NO_DISTANCES)
    nothing = np.zeros(bare.unknowns)
    for _ in range(6):
        state = replace(state, point=state.point + point_corrections(linearised(bare, state, rays), nothing))
    covariance, _ = point_precision(linearised(bare, state, rays), np.zeros((bare.unknowns, bare.unknowns)))
    worst = np.zeros(len(network.point))
    np.maximum.at(worst, rays.point, sizes(bare, state, rays))
    number = np.flatnonzero((count >= 2) & (worst < limit) & (worst > 0.0))
    away, weight = (network.point - state.point)[number], network.point_weight[number]
    given = np.divide(1.0, weight, out=np.zeros_like(weight), where=weight > 0)
    spread = covariance[number] + given[:, None] * np.eye(3)
    return number, np.sqrt(np.maximum(np.einsum("ni,nij,nj->n", away, np.linalg.inv(spread), away), 0.0))


def worst_of(network: Network, found: list[Blunder]) -> Blunder | None:
    """The largest misfit, if the rest still holds the block without it and it stands out clearly where few are left."""
    ranked = sorted(found, key=lambda blunder: -blunder.misfit)
    left = int(network.centre_weight.any(axis=1).sum() + network.point_weight.any(axis=1).sum()) - 1
    if not ranked or left < 3:
        return None
    if left < 5 and len(ranked) > 1 and ranked[0].misfit < CLEAR * ranked[1].misfit:
        return None
    return ranked[0]


def acquitted(result: Adjustment, blunders: list[Blunder], stated: Network, first: Network, limit: float) -> Network:
    """The `stated` network with those blunders put back (weights of the `first` network) that agree with the final solution: they
    were thrown out while something else, a camera constant, was still wrong."""
    misclosure = first.centre - (antennas(result))
    for blunder in blunders:
        i, position = blunder.number, blunder.kind == "position"
        weight = (first.centre_weight if position else first.point_weight)[i]
        away = misclosure[i] if position else first.point[i] - result.state.point[i]
        spread = position_covariance(result, i) if position else result.point_covariance[i]
        given = np.diag(np.divide(1.0, weight, out=np.zeros(3), where=weight > 0))
        square = away @ np.linalg.solve(spread + given, away)
        if square < _largest_square(limit, 3) and (position or spread.any()):
            stated = _put_back(stated, first, blunder)
    return stated


def antennas(result: Adjustment) -> np.ndarray:
    """(P, 3) where the antennas are by the solution, local m."""
    state = result.state
    return state.centre + np.einsum("pji,j->pi", state.rotation, state.lever) + state.shift


def _put_back(stated: Network, first: Network, blunder: Blunder) -> Network:
    if blunder.kind == "position":
        weight = stated.centre_weight.copy()
        weight[blunder.number] = first.centre_weight[blunder.number]
        return replace(stated, centre_weight=weight)
    weight = stated.point_weight.copy()
    weight[blunder.number] = first.point_weight[blunder.number]
    return replace(stated, point_weight=weight)


def without(network: Network, blunder: Blunder) -> Network:
    """The network that knows nothing of the blunder; a control point stays as a point that a person measured."""
    if blunder.kind == "position":
        weight = network.centre_weight.copy()
        weight[blunder.number] = 0.0
        return replace(network, centre_weight=weight)
    weight = network.point_weight.copy()
    weight[blunder.number] = 0.0
    return replace(network, point_weight=weight, named=np.append(network.named, blunder.number))


def enough_rays(network: Network, rays: Rays, used: np.ndarray) -> np.ndarray:
    """`used` without the rays of points that have neither two rays nor known coordinates."""
    count = np.bincount(rays.point[used], minlength=len(network.point))
    return used & ((count >= 2) | network.point_weight.any(axis=1))[rays.point]


def _tested(kind: str, number: np.ndarray, square: np.ndarray, dof: np.ndarray, limit: float) -> list[Blunder]:
    size = np.sqrt(square)
    beyond = np.sqrt(_largest_square(limit, np.maximum(dof, 1)))
    unit = _unit(size[dof > 0])
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
    network, misclosure = result.network, position_misclosures(result.network, result.state)
    number = np.flatnonzero(network.centre_weight.any(axis=1))
    rows = [_square(network.centre_weight[i], misclosure[i], position_covariance(result, i)) for i in number]
    return _columns(number, rows)


def _columns(number: np.ndarray, rows: list[tuple[float, int]]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    table = np.array(rows).reshape(-1, 2)
    return number, table[:, 0], table[:, 1].astype(int)


def _square(weight: np.ndarray, misclosure: np.ndarray, covariance: np.ndarray) -> tuple[float, int]:
    """v' Q_vv^-1 v over the combinations that can be tested, and how many these are."""
    root = np.sqrt(weight)
    redundancy, direction = np.linalg.eigh(np.diag((weight > 0).astype(float)) - root[:, None] * covariance * root)
    tested = redundancy > CHECKABLE
    along = direction.T @ (root * misclosure)
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
