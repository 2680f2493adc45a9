"""The steps of a bundle adjustment after the robust solution, each from one state to the next."""

from dataclasses import replace

import numpy as np
from scipy.special import ndtr

from orthomill.tasks.adjustment.explained_control import OTHERS, is_explained, is_group, with_explained_control
from orthomill.tasks.adjustment.model.collinearity import residual_lengths
from orthomill.tasks.adjustment.model.surveyed_observations import Blunder, SurveyedKind, has_weight, without
from orthomill.tasks.adjustment.progress import Progress
from orthomill.tasks.adjustment.solve.minimise import NEAR, minimise
from orthomill.tasks.adjustment.solve.ray_intersection import enough_rays, usable_rays
from orthomill.tasks.adjustment.testing.adjustment_result import Adjustment, surveyed
from orthomill.tasks.adjustment.testing.ray_blunders import ray_blunders
from orthomill.tasks.adjustment.testing.solution_precision import precise_solution
from orthomill.tasks.adjustment.testing.surveyed_blunders import is_outlier, surveyed_blunder, with_reinstated
from orthomill.tasks.adjustment.testing.variance_components import converged, estimated_factors, image_factor_without

# They bend photographs as well as their points, and rays that are right look wrong beside them.
UNBENT = 0.95
"""Rays that reduce the standard error of all rays by more must go alone before others are tested."""


def plain_solution(now: Progress) -> Progress:
    """Least squares with the present weights and observations, and its precision."""
    network, rays = now.weighted_network, now.weighted_rays
    # Points may have moved to where their rays no longer intersect; they would make the normal equations singular.
    used = usable_rays(network, now.state, rays, now.used)
    state, steps = minimise(network, now.state, rays.take(used), damping=NEAR)
    result = precise_solution(network, state, rays, used, now.factors)
    return replace(now, state=state, used=used, iterations=now.iterations + steps, result=result, changed=False)


def without_surveyed_blunder(now: Progress) -> Progress:
    """Rejects the surveyed observation that contradicts the rest most, if any does; contradicting control is explained as a whole,
    by blunders or by the standard errors of all of it."""
    now, found = _worst(now, tuple(SurveyedKind))
    if found is not None and found.kind == SurveyedKind.CONTROL and is_group(now):
        now = now if is_explained(now) else with_explained_control(now, now.weighted_rays.take(now.used), np.inf)
        # What explains the control may leave it as it is: others can be wrong beside it.
        now, found = (now, None) if now.changed else _worst(now, OTHERS)
    if found is not None:
        now = now.without(found)
    return replace(now, used=enough_rays(now.network, now.rays, now.used)) if now.changed else now


def _worst(now: Progress, kinds: tuple[SurveyedKind, ...]) -> tuple[Progress, Blunder | None]:
    """The observation of these `kinds` that contradicts the rest most, examined where only its stated standard error says so."""
    found = surveyed_blunder(now.solution, now.test.limit, kinds=kinds)
    if found is not None:
        return now, found
    return _examined(now, surveyed_blunder(now.solution, now.test.limit, by_group=False, kinds=kinds))


def _examined(now: Progress, suspect: Blunder | None) -> tuple[Progress, Blunder | None]:
    """The suspect if it contradicts the solution without it, else None.

    A blunder enlarges the usual misfit of its group and can hide in that unit. One that exceeds only its stated standard error is
    therefore a suspect: the block is adjusted without it once, and its misfit compared with those of the others there.
    """
    if suspect is None or (suspect.kind, suspect.number) in now.confirmed:
        return now, None
    # Each suspect costs one more solution, and is examined only once.
    rest, steps = _solution_without(now, suspect)
    confirmed = now.confirmed | {(suspect.kind, suspect.number)}
    now = replace(now, confirmed=confirmed, iterations=now.iterations + steps)
    return now, suspect if is_outlier(rest, now.weighted_network, suspect, now.test.limit) else None


def _solution_without(now: Progress, suspect: Blunder) -> tuple[Adjustment, int]:
    """The plain solution without one observation, and its iterations."""
    network, rays = without(now.weighted_network, suspect), now.weighted_rays
    used = enough_rays(network, rays, now.used)
    state, steps = minimise(network, now.state, rays.take(used), damping=NEAR)
    return precise_solution(network, state, rays, used, now.factors), steps


def with_variance_components(now: Progress) -> Progress:
    """The standard errors of the groups, estimated from the last solution."""
    estimated, groups = estimated_factors(now.solution)
    # A round is counted here, not per removed observation: their number is bounded by the observations themselves.
    stable = converged(estimated, now.factors)
    return replace(now, estimated=estimated, groups=groups, rounds=now.rounds + 1, changed=not stable)


def without_ray_blunders(now: Progress) -> Progress:
    """Rejects the worst ray of every point whose standardised residual is too large, by the standard errors that the rays left
    yield; a point that has lost a ray waits for the next solution. So few rays as exceed the limit by chance change nothing."""
    solution, left, waiting = now.solution, now.used, _bent_by_coordinates(now)
    least = UNBENT * now.estimated.image
    while now.estimated.image >= least:
        # The residuals are standardised with the old factors; the quotient turns the limit into units of the new ones.
        limit = now.by_group(now.estimated) / now.by_group(now.factors) * now.test.limit
        worst = left & ray_blunders(solution, limit) & ~waiting[now.rays.point]
        if not worst.any():
            break
        # Blunders hide behind the standard error that they enlarge: each sweep finds those that the last one has uncovered, and
        # none of them needs a solution of its own.
        waiting[now.rays.point[worst]] = True
        left = enough_rays(now.network, now.rays, left & ~worst)
        now = replace(now, estimated=replace(now.estimated, image=image_factor_without(solution, now.used & ~left)))
    # Rays about the limit would otherwise be found one by one, each by the small shift that the last one caused.
    chance = 4.0 * ndtr(-now.test.limit) * left.sum()
    return replace(now, used=left, changed=now.changed or bool((left != now.used).sum() > chance))


def _bent_by_coordinates(now: Progress) -> np.ndarray:
    """(N,) bool: surveyed points whose coordinates turned out worse than the solution took them for: they have bent their rays,
    which are tested in the next one."""
    grown = now.estimated.control > now.factors.control and not converged(now.estimated, now.factors)
    return np.asarray(now.network.point_weight.any(axis=1)) & grown


def settled(now: Progress) -> Progress:
    """The last solution, computed anew where rays were rejected after it."""
    if (now.used == now.solution.used).all():
        return now
    return with_variance_components(plain_solution(reweighted(now)))


def reweighted(now: Progress) -> Progress:
    """The estimated standard errors become those of the next solution."""
    return replace(now, factors=now.estimated)


def with_reinstated_blunders(now: Progress) -> Progress:
    """Reinstates, once, the surveyed observations and their rays that agree with the solution although they were rejected."""
    # Once: what contradicts the block again would otherwise be rejected and reinstated without end.
    if now.reinstated:
        return now
    # With the limit of the test itself: what was rejected early, with a camera constant still wrong, gets the same trial as the
    # rest.
    network = with_reinstated(now.network, now.solution, now.blunders, now.first, now.test.limit)
    used = now.used | _agreeing_pointings(now)
    if network is now.network and (used == now.used).all():
        return now
    blunders = tuple(blunder for blunder in now.blunders if not has_weight(network, blunder))
    return replace(now, network=network, used=used, blunders=blunders, reinstated=True, changed=True)


def _agreeing_pointings(now: Progress) -> np.ndarray:
    """(M,) bool: rejected rays of surveyed points that agree with the solution: beside a wrong one they looked wrong, too."""
    rejected = surveyed(now.network, now.rays) & ~now.used
    return rejected & (residual_lengths(now.weighted_network, now.state, now.weighted_rays) < now.test.limit)


def final_result(now: Progress) -> Adjustment:
    """The result of the last solution with everything that was found on the way to it."""
    return replace(
        now.solution, iterations=now.iterations, rays=now.rays, factors=now.estimated, groups=now.groups, blunders=now.blunders
    )
