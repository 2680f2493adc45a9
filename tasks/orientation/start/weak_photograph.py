"""The most poorly determined photograph of a block, which can keep the whole block from converging.

With all points fixed, the rays of a photograph alone tell how precisely they determine it. A photograph determined many times worse
than the others (a handful of rays in a corner of the frame) is set aside where the block cannot be adjusted with it, and where its
known position contradicts it: so few rays do not outweigh a position.
"""

import numpy as np

from orthomill.tasks.adjustment.model.linearisation import linearised
from orthomill.tasks.adjustment.model.network import Network, Rays, State
from orthomill.tasks.adjustment.testing.adjustment_result import Adjustment

WEAK = 5.0
"""A photograph is poorly determined when its standard error is larger than the median of the block by this factor."""
AWAY = "They put it far from its known position."


def weakest(network: Network, state: State, rays: Rays) -> int | None:
    """The number of the most poorly determined photograph; None where none is much worse than the others."""
    loose = _looseness(network, state, rays)
    worst = int(np.argmax(loose))
    return worst if loose[worst] > WEAK * np.median(loose) else None


def away_from_its_position(result: Adjustment, aside: np.ndarray) -> int | None:
    """The number of the most poorly determined photograph if its position was excluded as contradicting the block, before the
    adjustment (`aside` (P,) bool) or by it; None otherwise, and in a free network, which uses no positions."""
    if result.network.free:
        return None
    weak = weakest(result.network, result.state, result.rays.take(result.used))
    away = aside.copy()
    away[[blunder.number for blunder in result.blunders if blunder.kind == "position"]] = True
    return weak if weak is not None and away[weak] else None


def _looseness(network: Network, state: State, rays: Rays) -> np.ndarray:
    """(P,) standard errors of the projection centres relative to the distance to their points, from their own rays to fixed points;
    inf where these do not determine a photograph."""
    linear, loose = linearised(network, state, rays), np.full(network.photos, np.inf)
    away = np.linalg.norm(state.point[rays.point] - state.centre[rays.photo], axis=1)
    for photo in range(network.photos):
        own = rays.photo == photo
        A = (linear.jg[own, :, :6] * np.sqrt(linear.weight[own])[:, None, None]).reshape(-1, 6)
        # Columns of length 1: metres and radians differ by the flying height, and the rank would depend on the units.
        length = np.maximum(np.linalg.norm(A, axis=0), 1e-300)
        _, size, axes = np.linalg.svd(A / length, full_matrices=False)
        # Six unknowns need three points; below a relative singular value of 1e-9 the rays leave one of them open.
        if len(size) == 6 and size[-1] > 1e-9 * size[0]:
            sigma = np.linalg.norm(axes / size[:, None], axis=0) / length
            loose[photo] = np.linalg.norm(sigma[:3]) / np.median(away[own])
    return loose


def set_aside(name: str, rays: int, failure: str) -> str:
    """The sentence about a photograph that was excluded so that the block can be adjusted."""
    return (
        f"{name} was set aside, because only {rays} tie points in a small part of its frame determine it "
        f"({failure[0].lower()}{failure[1:].rstrip('.')}). More overlap, or photographs with more texture, would let it "
        "join."
    )


def obstructing(name: str, rays: int) -> str:
    """The sentence about a photograph whose measurements kept the block from converging."""
    return (
        f"{name} was set aside, because the block cannot be adjusted with it: its {rays} measurements contradict the others more "
        "at every step. Look whether it shows what its neighbours show, and was taken with the same camera."
    )
