"""Points whose rays intersect: in front of the cameras, at a distance that the rays determine.

What is far away compared with the base (a skyline behind a street, the horizon of an oblique photograph) is seen along rays that
are parallel within their noise. Such a point may as well be at infinity: its coordinates are not determined, and an adjustment
that estimates them does not converge.
"""

from dataclasses import replace

import numpy as np

from orthomill.tasks.adjustment.model.collinearity import BEHIND, residual_lengths, residuals
from orthomill.tasks.adjustment.model.linearisation import linearised
from orthomill.tasks.adjustment.model.network import Network, Rays, State
from orthomill.tasks.adjustment.model.robust_weights import huber_losses, huber_weights
from orthomill.tasks.adjustment.solve.normal_equations import point_corrections

# At a quarter of the distance the linear law of errors ends: two standard errors farther a point is at twice the distance, the
# same amount nearer at two thirds of it.
UNSURE = 0.25
"""Standard error of a distance, in units of itself, beyond which a point is not determined."""
NEARER, FARTHER = -3.0, 0.75
"""Largest steps of a distance, in units of itself, that are taken in its inverse: to a quarter of the distance, and to four times
it."""


def usable_rays(network: Network, state: State, rays: Rays, used: np.ndarray) -> np.ndarray:
    """(M,) bool: the `used` rays that intersect, of points that have enough of them."""
    return enough_rays(network, rays, intersecting(network, state, rays, used))


def enough_rays(network: Network, rays: Rays, used: np.ndarray) -> np.ndarray:
    """(M,) bool: `used` without the rays of points that have neither two rays nor known coordinates; the ends of distances, which
    are among the unknowns, keep all of theirs."""
    known, end = network.point_weight.any(axis=1), np.zeros(len(network.point), bool)
    end[network.kept] = True
    count = np.bincount(rays.point[used], minlength=len(network.point))
    # Without rays a kept point would leave a singular block in the normal matrix; its rays, even doubtful ones, prevent that.
    starved = end & ~known & (count < 2)
    return (used | starved[rays.point]) & ((count >= 2) | known | end)[rays.point]


def sufficiently_observed(network: Network, rays: Rays) -> Rays:
    """The rays of points that have enough of them."""
    return rays.take(enough_rays(network, rays, np.ones(len(rays), bool)))


def intersecting(network: Network, state: State, rays: Rays, used: np.ndarray) -> np.ndarray:
    """(M,) bool: the `used` rays without those that point away from their point, and without those of points whose distance they do
    not determine, unless a person measured these.

    The standard error of a point is the longest semi-axis of the error ellipsoid of its rays alone, with their stated standard
    errors; its distance is that from the nearest of its projection centres.
    """
    used = used & (np.abs(residuals(state, rays, network.camera_of)).max(axis=1) < BEHIND)
    taken = rays.take(used)
    towards = state.point[taken.point] - state.centre[taken.photo]
    distance = np.maximum(np.linalg.norm(towards, axis=1), 1e-12)
    towards /= distance[:, None]
    across = taken.sigma / state.interior[network.camera_of[taken.photo], 0] * distance
    # Lengths in units of the distance: for points far away the squares of metres would lose digits.
    nearest = np.full(len(state.point), np.inf)
    np.minimum.at(nearest, taken.point, distance)
    weight = (nearest[taken.point] / across) ** 2
    normal = np.zeros((len(state.point), 3, 3))
    for a in range(3):
        for b in range(a, 3):
            # I - d d': a ray determines its point across its direction only.
            part = weight * ((a == b) - towards[:, a] * towards[:, b])
            normal[:, a, b] = np.bincount(taken.point, part, len(state.point))
    weakest = np.linalg.eigvalsh(normal, UPLO="U")[:, 0]
    # What a person measured is a decision of theirs; it is tested later, not dropped silently.
    sure = (weakest * UNSURE**2 > 1.0) | network.pointed
    return used & sure[rays.point]


def held_in_front(network: Network, before: State, after: State, rays: Rays) -> State:
    """The state `after` a step in which no point has jumped past a camera or infinity: those that would have, take the step in the
    inverse of their distance.

    Rays that are nearly parallel determine the inverse of a distance; in the distance itself a linear step overshoots. One such
    point among a hundred thousand would otherwise forbid the step to the whole block.
    """
    past = np.unique(rays.point[np.abs(residuals(after, rays, network.camera_of)).max(axis=1) >= BEHIND])
    past = past[~np.isin(past, network.kept)]
    if not len(past):
        return after
    own = rays.take(np.isin(rays.point, past))
    count = np.bincount(own.point, minlength=len(after.point))[past, None]
    first, then = (
        np.stack([np.bincount(own.point, state.centre[own.photo, k])[past] for k in range(3)], axis=1) / count
        for state in (before, after)
    )
    away = before.point[past] - first
    step = after.point[past] - then - away
    along = ((step * away).sum(axis=1) / np.maximum((away**2).sum(axis=1), 1e-24))[:, None]
    point = after.point.copy()
    point[past] = then + away / (1.0 - np.clip(along, NEARER, FARTHER)) + step - along * away
    return replace(after, point=point)


def intersected(network: Network, state: State, rays: Rays, huber: float) -> State:
    """The state with every point moved by one step towards the intersection of its rays, all else fixed; points that gain nothing
    stay.

    Points with nearly parallel rays follow a photograph that moves, but not in proportion. Where they lag behind, the valley of the
    cost function is curved, and steps along it stay short.
    """
    size = residual_lengths(network, state, rays)
    step = point_corrections(linearised(network, state, rays, huber_weights(size, huber)), np.zeros(network.unknowns))
    # Kept points are unknowns of the reduced system, which has just moved them.
    step[network.kept] = 0.0
    moved = replace(state, point=state.point + step)
    gain = huber_losses(size, huber) - huber_losses(residual_lengths(network, moved, rays), huber)
    better = np.bincount(rays.point, gain, len(state.point)) > 0
    return replace(state, point=np.where((better & ~network.pointed)[:, None], moved.point, state.point))
