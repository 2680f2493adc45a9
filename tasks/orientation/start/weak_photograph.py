"""The photograph that hangs on the fewest and worst spread tie points: it can keep a whole block from converging.

With all points held where they are, the rays of a photograph alone tell how well they fix it. A photograph that is fixed many times
worse than the others (a handful of rays in a corner of the frame) is set aside where the block cannot be adjusted with it, and
where its known position contradicts it: so few rays do not outvote a position.
"""

import numpy as np

from orthomill.tasks.adjustment.model.adjustment_result import Adjustment
from orthomill.tasks.adjustment.model.linearisation import linearised
from orthomill.tasks.adjustment.model.network import Network, Rays, State

WEAK = 5.0
"""A photograph is weak when its rays fix it so many times worse than they do the middle one of the block."""
AWAY = "They put it far from its known position."


def weakest(network: Network, state: State, rays: Rays) -> int | None:
    """The number of the photograph that its `rays` fix worst; None where none is much worse than the others."""
    loose = _looseness(network, state, rays)
    worst = int(np.argmax(loose))
    return worst if loose[worst] > WEAK * np.median(loose) else None


def away_from_its_position(result: Adjustment, aside: np.ndarray) -> int | None:
    """The number of the weakest photograph if its position took no part because it contradicts the block: set `aside` (P,) bool
    before the adjustment, or by it; else None, and in a free network, which uses no positions."""
    if result.network.free:
        return None
    weak = weakest(result.network, result.state, result.rays.take(result.used))
    away = aside.copy()
    away[[blunder.number for blunder in result.blunders if blunder.kind == "position"]] = True
    return weak if weak is not None and away[weak] else None


def _looseness(network: Network, state: State, rays: Rays) -> np.ndarray:
    """(P,) standard errors of the projection centres in units of the distance to their points, from their own rays to held points;
    inf where these do not fix a photograph."""
    linear, loose = linearised(network, state, rays), np.full(network.photos, np.inf)
    away = np.linalg.norm(state.point[rays.point] - state.centre[rays.photo], axis=1)
    for photo in range(network.photos):
        own = rays.photo == photo
        A = (linear.jg[own, :, :6] * np.sqrt(linear.weight[own])[:, None, None]).reshape(-1, 6)
        length = np.maximum(np.linalg.norm(A, axis=0), 1e-300)
        _, size, axes = np.linalg.svd(A / length, full_matrices=False)
        if len(size) == 6 and size[-1] > 1e-9 * size[0]:
            sigma = np.linalg.norm(axes / size[:, None], axis=0) / length
            loose[photo] = np.linalg.norm(sigma[:3]) / np.median(away[own])
    return loose


def set_aside(name: str, rays: int, failure: str) -> str:
    """The sentence about a photograph without which the block can be adjusted."""
    return (
        f"{name} was set aside, for only {rays} tie points in a small part of its frame hold it "
        f"({failure[0].lower()}{failure[1:].rstrip('.')}). More overlap, or photographs with more texture, would let it "
        "join."
    )
