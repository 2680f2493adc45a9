"""Bundle adjustment: collinearity for every ray, all orientations, points and (if asked) cameras together.

Strategy of `adjust`. (1) A robust solution (Huber); gross blunders go: whole positions and surveyed points first, then rays. (2)
Plain least squares, after which positions and surveyed points are tested, worst first and alone; then every ray by its own
standardised residual (data snooping, the worst ray of a point at a time), and the standard errors of the groups of observations are
estimated from the residuals and the redundancy they really have (variance components), until nothing changes any more. (3) The
covariance of all orientations and cameras is the inverse of the reduced normal matrix; points follow from it.

What a person measured or surveyed (positions, control and its image measurements) keeps the standard errors it came with unless
it contradicts them: then these are enlarged. It is a group of its own, for a matched tie point is often ten times as precise as a
pointing, and a common factor would throw good control out.

Source: Brown 1976; Baarda 1968 for the tests; Triggs et al. 2000.
"""

from dataclasses import dataclass, replace

import numpy as np

from orthomill.schemas.errors import GeometryError
from orthomill.tasks.adjustment.model.adjustment_result import Adjustment, Blunder, Factors, surveyed
from orthomill.tasks.adjustment.model.collinearity import residual_lengths, residuals
from orthomill.tasks.adjustment.model.linearisation import linearised
from orthomill.tasks.adjustment.model.network import Distances, Network, Rays, State
from orthomill.tasks.adjustment.model.robust_weights import spread
from orthomill.tasks.adjustment.solve.minimise import minimise
from orthomill.tasks.adjustment.solve.ray_intersection import intersecting
from orthomill.tasks.adjustment.testing.blunders import (
    enough_rays,
    gross_blunder,
    is_outlier,
    lengths_of_rays,
    ray_blunders,
    reinstated,
    surveyed_blunder,
    weights_of,
    without,
)
from orthomill.tasks.adjustment.testing.covariances import covariance_of, points_and_rays, with_considered
from orthomill.tasks.adjustment.testing.distance_agreement import agreement
from orthomill.tasks.adjustment.testing.variance_components import estimated, settled


@dataclass(frozen=True)
class BlunderTest:
    """When an observation is a blunder: Huber's limit and the rejection limits, in standard errors; and how many rounds are
    allowed. `apart`: the limit for surveyed points and positions on the robust solution, below that of rays (`gross`): a wrong
    coordinate must not take its rays along."""

    huber: float = 2.0
    gross: float = 8.0
    apart: float = 6.0
    limit: float = 4.0
    rounds: int = 15


@dataclass(frozen=True, eq=False)
class _Robust:
    """A robust solution: the network without its gross blunders, the rays that are left, and what it took."""

    network: Network
    state: State
    used: np.ndarray
    blunders: tuple[Blunder, ...]
    iterations: int


def adjust(network: Network, start: State, rays: Rays, test: BlunderTest | None = None) -> Adjustment:
    """The adjusted block with tested observations and honest covariance.

    Raises GeometryError when the block falls apart (too few rays), is not determined, or does not converge.
    """
    test = test or BlunderTest()
    robust = _robust_solution(network, start, rays, test)
    stated, state, used = robust.network, robust.state, robust.used
    blunders, iterations, factors, rounds = list(robust.blunders), robust.iterations, Factors(), 0
    pardoned, cleared = False, set()
    while rounds < test.rounds:
        weighted, scaled_rays = _weighted(stated, factors), replace(rays, sigma=rays.sigma * _by_group(stated, rays, factors))
        used = enough_rays(weighted, scaled_rays, intersecting(weighted, state, scaled_rays, used))
        state, steps = minimise(weighted, state, scaled_rays.take(used))
        iterations += steps
        result = _account(weighted, state, scaled_rays, used, factors)
        found = surveyed_blunder(result, test.limit)
        suspect = surveyed_blunder(result, test.limit, by_group=False) if found is None else None
        if suspect is not None and (suspect.kind, suspect.number) not in cleared:
            steps, wrong = _without_suspect(stated, factors, state, scaled_rays, used, suspect, test.limit)
            iterations += steps
            cleared.add((suspect.kind, suspect.number))
            found = suspect if wrong else None
        if found is not None:
            blunders.append(found)
            stated = without(stated, found)
            used = enough_rays(stated, rays, used)
            continue
        rounds += 1
        fresh, groups = estimated(result)
        bad = ray_blunders(result, _by_group(stated, rays, fresh) / _by_group(stated, rays, factors) * test.limit)
        left = enough_rays(stated, rays, used & ~bad)
        changed, used = bool((left != used).any()), left
        if settled(fresh, factors) and not changed:
            back = stated if pardoned else reinstated(result, blunders, stated, network, test.limit)
            if back is not stated:
                blunders = [b for b in blunders if not _knows(back, b)]
                stated, pardoned = back, True
                continue
            return replace(result, iterations=iterations, rays=rays, factors=fresh, groups=groups, blunders=tuple(blunders))
        factors = fresh
    raise GeometryError(
        f"The blunder tests of the bundle adjustment removed rays in each of {test.rounds} rounds and did not come to an end; the "
        "tie points hold too many wrong matches."
    )


def _without_suspect(
    stated: Network, factors: Factors, state: State, rays: Rays, used: np.ndarray, suspect: Blunder, limit: float
) -> tuple[int, bool]:
    """The iterations, and whether the suspect contradicts the block that is adjusted without it."""
    rest = without(_weighted(stated, factors), suspect)
    used = enough_rays(rest, rays, used)
    state, steps = minimise(rest, state, rays.take(used))
    return steps, is_outlier(_account(rest, state, rays, used, factors), _weighted(stated, factors), suspect, limit)


def _knows(network: Network, blunder: Blunder) -> bool:
    """Whether the network has the observation in question."""
    return bool(np.any(weights_of(network, blunder.kind)[blunder.number]))


def _robust_solution(network: Network, state: State, rays: Rays, test: BlunderTest) -> _Robust:
    """Huber's solution with the spread of each group's residuals as unit, three times, ever sharper; then the gross blunders go."""
    used = np.ones(len(rays), bool)
    network, state, blunders, iterations = _with_agreeing_distances(network, state, rays, test)
    for tolerance in (1e-2, 1e-2, 1e-3):
        used = enough_rays(network, rays, intersecting(network, state, rays, used))
        unit = _units(network, state, rays, used, least=0.1)
        state, steps = minimise(network, state, replace(rays, sigma=rays.sigma * unit).take(used), test.huber, tolerance)
        iterations += steps
    scaled = replace(rays, sigma=rays.sigma * unit).take(used)
    while (found := gross_blunder(network, state, scaled, test.apart)) is not None:
        network = without(network, found)
        blunders.append(found)
        state, steps = minimise(network, state, scaled, test.huber, tolerance)
        iterations += steps
    unit = _units(network, state, rays, used, least=1e-3)
    used = enough_rays(network, rays, used & (residual_lengths(network, state, rays) < test.gross * unit))
    return _Robust(network, state, used, tuple(blunders), iterations)


def _with_agreeing_distances(
    network: Network, state: State, rays: Rays, test: BlunderTest
) -> tuple[Network, State, list[Blunder], int]:
    """The network with the distances that agree with each other where the rays alone put their ends, the state (a free block in
    their scale), the distances that do not, and the iterations."""
    distances = network.distances
    if len(distances) < 2:
        return network, state, [], 0
    used = enough_rays(network, rays, intersecting(network, state, rays, np.ones(len(rays), bool)))
    bare = replace(network, distances=replace(distances, weight=np.zeros(len(distances))))
    scaled = replace(rays, sigma=rays.sigma * _units(bare, state, rays, used, least=0.1)).take(used)
    alone, steps = minimise(bare, state, scaled, test.huber, 1e-2)
    found = agreement(distances.length, distances.sigma, *lengths_of_rays(network, alone, scaled, test.apart), test.limit)
    weight = np.where(found.wrong, 0.0, 1.0 / found.sigma**2)
    network = replace(network, distances=replace(distances, weight=weight))
    if network.free:
        state = replace(alone, centre=alone.centre * found.scale, point=alone.point * found.scale)
    return network, state, [Blunder("distance", int(i), float(found.misfit[i])) for i in np.flatnonzero(found.wrong)], steps


def _units(network: Network, state: State, rays: Rays, used: np.ndarray, least: float) -> np.ndarray:
    """(M,) the spread of the residuals of each ray's group by its stated standard errors; pointings are never taken for better than
    stated."""
    size, by_person = residual_lengths(network, state, rays), surveyed(network, rays)
    ties, pointings = size[used & ~by_person], size[used & by_person]
    tie_unit = max(spread(ties), least) if len(ties) else 1.0
    return np.where(by_person, max(spread(pointings), 1.0) if len(pointings) else 1.0, tie_unit)


def _by_group(network: Network, rays: Rays, factors: Factors) -> np.ndarray:
    """(M,) the factor of each ray's group."""
    return np.where(surveyed(network, rays), factors.pointing, factors.image)


def _weighted(stated: Network, factors: Factors) -> Network:
    """The network with the standard errors of what was surveyed multiplied by their factors."""
    distances = stated.distances
    return replace(
        stated,
        centre_weight=stated.centre_weight / factors.position**2,
        point_weight=stated.point_weight / factors.control**2,
        distances=Distances(distances.ends, distances.length, distances.weight / factors.distance**2),
    )


def _account(network: Network, state: State, rays: Rays, used: np.ndarray, factors: Factors) -> Adjustment:
    """Covariance, redundancy numbers and standardised residuals at the solution."""
    taken = rays.take(used)
    linear = linearised(network, state, taken)
    cofactor = covariance_of(network, state, linear)
    points, adjusted = points_and_rays(network, linear, cofactor)
    if network.considered_columns.any():
        cofactor = with_considered(network, linear, cofactor)
        points, _ = points_and_rays(network, linear, cofactor)
    numbers, standardised = np.full((len(rays), 2), np.nan), np.full((len(rays), 2), np.nan)
    numbers[used] = np.clip(1.0 - adjusted * linear.weight[:, None], 1e-6, 1.0)
    residual = residuals(state, rays, network.camera_of)
    standardised[used] = residual[used] / (taken.sigma[:, None] * np.sqrt(numbers[used]))
    redundancy = _redundancy(network, taken)
    return Adjustment(state, network, rays, used, residual, numbers, standardised, cofactor, points, redundancy, factors)


def _redundancy(network: Network, rays: Rays) -> int:
    eliminated = np.union1d(rays.point, np.flatnonzero(network.point_weight.any(axis=1)))
    points = len(np.setdiff1d(eliminated, network.kept))
    redundancy = 2 * len(rays) + network.prior_observations - network.unknowns + int(network.interior.considered.sum())
    redundancy += network.freedoms - 3 * points
    if redundancy <= 0:
        raise GeometryError(f"The block has {len(rays)} rays, which is not enough to adjust it; more tie points are needed.")
    return redundancy
