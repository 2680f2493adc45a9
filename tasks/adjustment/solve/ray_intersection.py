"""Points whose rays meet: before the cameras, at a distance that follows from the rays and is not lost in their noise.

What is far away compared with the base (a skyline behind a street, the horizon of an oblique photograph) is seen along rays that
are parallel but for noise. Such a point is as well at infinity, its coordinates are not determined, and an adjustment that looks
for them does not come to an end.
"""

from dataclasses import replace

import numpy as np

from orthomill.tasks.adjustment.model.collinearity import BEHIND, residual_lengths, residuals
from orthomill.tasks.adjustment.model.linearisation import linearised
from orthomill.tasks.adjustment.model.network import Network, Rays, State
from orthomill.tasks.adjustment.model.robust_weights import huber_losses, huber_weights
from orthomill.tasks.adjustment.solve.normal_equations import point_corrections

UNSURE = 0.25
"""A point whose distance has a larger standard error, in units of itself, is not determined: beyond this the linear law of errors
says nothing about it."""


def intersecting(network: Network, state: State, rays: Rays, used: np.ndarray) -> np.ndarray:
    """(M,) bool: the `used` rays without those that look away from their point, and without those of points whose distance they
    do not determine. Points that a person measured keep the latter.

    A point's standard error is the longest axis of the error ellipsoid of its rays alone, with their stated standard errors; its
    distance is that from the nearest of its projection centres.
    """
    used = used & (np.abs(residuals(state, rays, network.camera_of)).max(axis=1) < BEHIND)
    taken = rays.take(used)
    towards = state.point[taken.point] - state.centre[taken.photo]
    distance = np.maximum(np.linalg.norm(towards, axis=1), 1e-12)
    towards /= distance[:, None]
    across = taken.sigma / state.interior[network.camera_of[taken.photo], 0] * distance
    # Lengths in units of the distance, so that points far away lose no digits.
    nearest = np.full(len(state.point), np.inf)
    np.minimum.at(nearest, taken.point, distance)
    weight = (nearest[taken.point] / across) ** 2
    normal = np.zeros((len(state.point), 3, 3))
    for a in range(3):
        for b in range(a, 3):
            part = weight * ((a == b) - towards[:, a] * towards[:, b])
            normal[:, a, b] = np.bincount(taken.point, part, len(state.point))
    weakest = np.linalg.eigvalsh(normal, UPLO="U")[:, 0]
    sure = (weakest * UNSURE**2 > 1.0) | network.pointed
    return used & sure[rays.point]


def intersected(network: Network, state: State, rays: Rays, huber: float) -> State:
    """The state with every point moved by a step towards where its rays meet, all else held; points that gain nothing stay.

    Points whose rays hardly meet follow a photograph that moves, but not in proportion: where they are left behind, the valley that
    it moves in is curved, and steps along it stay short.
    """
    size = residual_lengths(network, state, rays)
    step = point_corrections(linearised(network, state, rays, huber_weights(size, huber)), np.zeros(network.unknowns))
    step[network.kept] = 0.0
    moved = replace(state, point=state.point + step)
    gain = huber_losses(size, huber) - huber_losses(residual_lengths(network, moved, rays), huber)
    better = np.bincount(rays.point, gain, len(state.point)) > 0
    return replace(state, point=np.where((better & ~network.pointed)[:, None], moved.point, state.point))
