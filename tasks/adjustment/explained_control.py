"""Control that contradicts a block: single points are rejected, or the standard errors of all of them enlarged.

Both steps compare what can explain the contradiction (testing/control_explanation.py): on the robust solution, for which the
control is loosened first so that it neither bends the block nor drags its rays, and on a plain one.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from orthomill.tasks.adjustment.model.common_position_errors import with_common_errors
from orthomill.tasks.adjustment.model.network import Network, Rays, State
from orthomill.tasks.adjustment.model.surveyed_observations import Blunder, SurveyedKind
from orthomill.tasks.adjustment.progress import Progress
from orthomill.tasks.adjustment.solve.minimise import NEAR, minimise
from orthomill.tasks.adjustment.testing.control_explanation import MOST, Explanation, explained
from orthomill.tasks.adjustment.testing.control_in_block import as_weighted, control_in_block
from orthomill.tasks.adjustment.testing.gross_blunders import control_misfits

FEWEST = 3
"""Control points that show anything about each other; of fewer, each is compared with the positions alone."""
ROUGH = 1e-3
"""Gain in units of the cost at which the reweighted solution stops."""
OTHERS = (SurveyedKind.POSITION, SurveyedKind.DISTANCE)
"""Kinds of observations that are no control"""


def is_group(now: Progress) -> bool:
    """Whether the control points are enough to be judged together."""
    return _count(now.first) >= FEWEST


def with_explained_control(now: Progress, rays: Rays, huber: float) -> Progress:
    """The solution with explained control; `rays`: those that it used, with its standard errors, `huber` its limit (inf: none)."""
    misfit = control_misfits(now.network, now.state, rays, np.inf)
    # So loose that no point exceeds its standard errors, and none has Huber's weights: the solution is linear in the coordinates.
    loose = replace(now, factors=replace(now.factors, control=max(1.0, float(np.nanmax(misfit, initial=1.0)))))
    # Many positions with one error in common would overrule control that agrees with each of them.
    network, state = with_common_errors(now.network, now.state)
    state, steps, weighted, tempered = _loosened(replace(loose, network=network, state=state), rays, huber)
    # Least squares to the last digit: what is left to gain would look like contradictions of the control.
    state, more = minimise(weighted, state, tempered, damping=NEAR)
    # Points whose rays do not intersect have a wrong pointing, and say nothing of the coordinates. Only now, because control that
    # is not loose bends the rays of its neighbours.
    placed = np.isfinite(control_misfits(now.network, state, rays, now.test.gross_surveyed))
    found, size = _explanation(now, state, weighted, tempered, np.where(placed[:, None], now.network.point_weight, 0.0))
    state = replace(state, shift=now.state.shift)
    return _with_explanation(replace(now, state=state, iterations=now.iterations + steps + more), found, size)


def without_unmet(network: Network, state: State, rays: Rays, limit: float) -> tuple[Network, Rays]:
    """The network and the rays without those surveyed points whose rays do not meet within `limit` standard errors, if others hold
    the block.

    Beside control that is loose, a wrong pointing of hundreds of pixels weighs more than the scale of the block, which shrinks to a
    point: there its rays meet.
    """
    seen = np.bincount(rays.point, minlength=len(network.point))
    known = network.point_weight.any(axis=1) & (seen > 0)
    unmet = known & (seen >= 2) & ~np.isfinite(control_misfits(network, state, rays, limit))
    if not network.centre_weight.any() and (known & ~unmet).sum() < FEWEST:
        return network, rays
    return replace(network, point_weight=np.where(unmet[:, None], 0.0, network.point_weight)), rays.take(~unmet[rays.point])


def _loosened(loose: Progress, rays: Rays, huber: float) -> tuple[State, int, Network, Rays]:
    """The solution with loosened control, its iterations, and the network and rays with their weights in it."""
    everything, limit = loose.weighted_network, loose.test.gross_surveyed
    network, met = without_unmet(everything, loose.state, rays, limit)
    # Reweighting needs no sharp end: its weights stay, and least squares with them follow.
    state, steps = minimise(network, loose.state, met, huber, ROUGH)
    # Rays that control had bent before it was loose meet now.
    again = without_unmet(everything, state, rays, limit)
    if len(again[1]) > len(met):
        network, met = again
        state, more = minimise(network, state, met, huber, ROUGH)
        steps += more
    return state, steps, *as_weighted(network, state, met, huber)


def _explanation(
    now: Progress, state: State, weighted: Network, rays: Rays, stated: np.ndarray
) -> tuple[Explanation, dict[int, float]]:
    """What explains the control at the solution `state` of `weighted` observations, and the wrong points with their misfits there,
    in standard errors."""
    number, equations = control_in_block(weighted, state, rays, stated)
    rejected = sum(blunder.kind == SurveyedKind.CONTROL for blunder in now.blunders)
    found = explained(equations, _count(now.first) // MOST - rejected)
    size = np.sqrt((weighted.point_weight * (weighted.point - state.point) ** 2).sum(axis=1))
    return found, {int(i): float(size[i]) for i in number[found.wrong]}


def _with_explanation(now: Progress, found: Explanation, wrong: Mapping[int, float]) -> Progress:
    now = replace(now, explained=_count(now.network) - len(wrong))
    if found.factor != now.factors.control:
        now = replace(now, factors=replace(now.factors, control=found.factor), changed=True)
    for i, size in wrong.items():
        now = now.without(Blunder(SurveyedKind.CONTROL, i, size))
    return now


def is_explained(now: Progress) -> bool:
    """Whether the present control points have been judged already."""
    return _count(now.network) == now.explained


def _count(network: Network) -> int:
    """The number of control points that take part."""
    return int(network.point_weight.any(axis=1).sum())
