"""The robust solution of a bundle: Huber's weights in the unit of the observed residuals, then rejection of gross blunders.

Distances are compared with each other first, because the scale of a free block depends on them. Then three solutions with Huber's
weights; gross blunders are removed from it, first whole positions, surveyed points and distances, then single rays.
"""

from dataclasses import replace

import numpy as np

from orthomill.tasks.adjustment.explained_control import OTHERS, is_group, with_explained_control, without_unmet
from orthomill.tasks.adjustment.model.collinearity import residual_lengths
from orthomill.tasks.adjustment.model.datum import prior_factors
from orthomill.tasks.adjustment.model.linearisation import linearised
from orthomill.tasks.adjustment.model.network import Network, Rays, State
from orthomill.tasks.adjustment.model.robust_weights import huber_weights, spread
from orthomill.tasks.adjustment.model.surveyed_observations import Blunder, SurveyedKind
from orthomill.tasks.adjustment.progress import BlunderTest, Progress
from orthomill.tasks.adjustment.solve.minimise import minimise
from orthomill.tasks.adjustment.solve.normal_equations import point_corrections
from orthomill.tasks.adjustment.solve.ray_intersection import enough_rays, usable_rays
from orthomill.tasks.adjustment.testing.adjustment_result import surveyed
from orthomill.tasks.adjustment.testing.distance_agreement import agreement
from orthomill.tasks.adjustment.testing.gross_blunders import (
    STEPS,
    gross_blunder,
    lengths_of_rays,
    pointing_spread,
    surveyed_factors,
    well_pointed,
)

# The unit changes as the block improves: the first two solutions need no sharp end.
TOLERANCES = (1e-2, 1e-2, 1e-3)
"""Gains in units of the cost at which the three robust solutions stop."""


def robust_solution(network: Network, start: State, rays: Rays, test: BlunderTest) -> Progress:
    """The robust solution from the `start`, without its gross blunders. Raises GeometryError as `minimise` does."""
    now = _with_agreeing_distances(Progress(network, rays, test, network, start, np.ones(len(rays), bool)))
    for tolerance in TOLERANCES:
        now, scaled = _huber_solution(now, tolerance)
    return _with_usual_factors(_without_gross_rays(_without_gross_surveyed(now, scaled)), scaled)


def _huber_solution(now: Progress, tolerance: float) -> tuple[Progress, Rays]:
    """The solution with Huber's weights, and the rays that it used with standard errors in the unit of their group's residuals."""
    used = usable_rays(now.network, now.state, now.rays, now.used)
    # The floor keeps rays of a nearly perfect start from being scaled until all others look wrong.
    unit = _units(now.network, now.state, now.rays, used, least=0.1)
    scaled = replace(now.rays, sigma=now.rays.sigma * unit).take(used)
    state, steps = minimise(now.network, now.state, scaled, now.test.huber, tolerance)
    return replace(now, state=state, used=used, iterations=now.iterations + steps), scaled


def _without_gross_surveyed(now: Progress, scaled: Rays) -> Progress:
    """The solution without gross blunders among the surveyed observations, the worst removed first."""
    while (found := _gross_blunder(now, scaled)) is not None:
        if found.kind == SurveyedKind.CONTROL and is_group(now):
            now = with_explained_control(now, scaled, now.test.huber)
        else:
            now = now.without(found)
        network, met = without_unmet(now.weighted_network, now.state, scaled, now.test.gross_surveyed)
        state, steps = minimise(network, now.state, met, now.test.huber, TOLERANCES[-1])
        state = _with_unmet(now.weighted_network, state, scaled, met, now.test.huber)
        now = replace(now, state=state, iterations=now.iterations + steps)
    return now


def _with_unmet(network: Network, state: State, rays: Rays, met: Rays, huber: float) -> State:
    """The state with the surveyed points that have `rays` but took no part (`met`) placed by their coordinates and by those of
    their rays that agree with these."""
    unmet = np.setdiff1d(rays.point, met.point)
    if not len(unmet):
        return state
    own, point = rays.take(np.isin(rays.point, unmet)), state.point.copy()
    point[unmet] = network.point[unmet]
    state = replace(state, point=point)
    for _ in range(STEPS):
        factor = prior_factors(network, state, huber).point
        linear = linearised(network, state, own, huber_weights(residual_lengths(network, state, own), huber), factor)
        step = point_corrections(linear, np.zeros(network.unknowns))
        point = state.point.copy()
        point[unmet] += step[unmet]
        state = replace(state, point=point)
    return state


def _gross_blunder(now: Progress, scaled: Rays) -> Blunder | None:
    """The worst gross blunder; control that was explained once keeps what explains it."""
    kinds = OTHERS if now.explained else tuple(SurveyedKind)
    return gross_blunder(now.weighted_network, now.state, scaled, now.test.gross_surveyed, kinds)


def _without_gross_rays(now: Progress) -> Progress:
    """The same solution; rays with gross residuals, and points that have too few rays without them, are not used."""
    unit = _units(now.weighted_network, now.state, now.rays, now.used, least=1e-3)
    size, by_person = residual_lengths(now.network, now.state, now.rays), surveyed(now.network, now.rays)
    # Coordinates that are wrong but not yet found must not take their rays with them.
    pulled = spread(size[now.used & by_person]) if (now.used & by_person).any() else 0.0
    good = size < now.test.gross * np.where(by_person, np.maximum(unit, pulled), unit)
    scaled = replace(now.rays, sigma=now.rays.sigma * unit).take(now.used)
    good |= by_person & well_pointed(now.network, now.state, scaled, now.test.gross)[now.rays.point]
    return replace(now, used=enough_rays(now.network, now.rays, now.used & good))


def _with_usual_factors(now: Progress, scaled: Rays) -> Progress:
    """The same solution with the standard errors that its residuals show.

    Control that is stated to centimetres but good to metres would bend the block in the first solution without Huber's weights.
    """
    surveyed_ones = surveyed_factors(now.network, now.state, scaled, now.test.gross_surveyed)
    if now.explained:
        surveyed_ones = replace(surveyed_ones, control=now.factors.control)
    unit, by_person = _units(now.network, now.state, now.rays, now.used, least=0.1), surveyed(now.network, now.rays)
    image, pointing = (float(unit[own].max(initial=0.0)) or 1.0 for own in (~by_person, by_person))
    return replace(now, factors=replace(surveyed_ones, image=image, pointing=pointing))


def _with_agreeing_distances(now: Progress) -> Progress:
    """The distances that agree with each other where the rays alone put their ends; a free block is scaled by them."""
    network, distances, test = now.network, now.network.distances, now.test
    if len(distances) < 2:
        return now
    alone, scaled, steps = _without_distances(now)
    found = agreement(distances.length, distances.sigma, *lengths_of_rays(network, alone, scaled, test.gross_surveyed), test.limit)
    weight = np.where(found.wrong, 0.0, 1.0 / found.sigma**2)
    blunders = tuple(Blunder(SurveyedKind.DISTANCE, int(i), float(found.misfit[i])) for i in np.flatnonzero(found.wrong))
    now = replace(now, network=replace(network, distances=replace(distances, weight=weight)), blunders=blunders, iterations=steps)
    if not network.free:
        return now
    # Without any distance the scale of a free block is arbitrary: every distance would look wrong by the same factor.
    return replace(now, state=replace(alone, centre=alone.centre * found.scale, point=alone.point * found.scale))


def _without_distances(now: Progress) -> tuple[State, Rays, int]:
    """The robust solution of the rays alone, the rays that it used, and its iterations."""
    network, distances = now.network, now.network.distances
    used = usable_rays(network, now.state, now.rays, now.used)
    bare = replace(network, distances=replace(distances, weight=np.zeros(len(distances))))
    scaled = replace(now.rays, sigma=now.rays.sigma * _units(bare, now.state, now.rays, used, least=0.1)).take(used)
    alone, steps = minimise(bare, now.state, scaled, now.test.huber, TOLERANCES[0])
    return alone, scaled, steps


def _units(network: Network, state: State, rays: Rays, used: np.ndarray, least: float) -> np.ndarray:
    """(M,) the spread of the residuals of each ray's group, in stated standard errors; at least 1 for pointings."""
    size, by_person = residual_lengths(network, state, rays), surveyed(network, rays)
    ties, pointings = size[used & ~by_person], size[used & by_person]
    tie_unit = max(spread(ties), least) if len(ties) else 1.0
    # Coordinates that are wrong pull their rays, of which their own intersections know nothing; without any, nothing else is known.
    alone = pointing_spread(network, state, rays.take(used)) if len(pointings) else 1.0
    pointing_unit = alone if np.isfinite(alone) else spread(pointings)
    # Pointings are few: by chance they may agree much better than stated, and the next one would be rejected for that.
    return np.where(by_person, max(pointing_unit, 1.0), tie_unit)
