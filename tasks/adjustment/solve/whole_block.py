"""The similarity transformation of the whole block: the one that fits positions, control and distances best, and the one that a
step contains.

Image measurements are invariant to it, and prior information often determines it poorly (the tilt of a strip, control of metres).
Steps in single unknowns follow it badly: all points would have to move along circles together, and a linear step leaves the
circles, which a thousand times more precise image measurements punish. By itself it has seven unknowns and is cheap: it is taken
out of every step and applied as what it is.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from orthomill.schemas.errors import GeometryError
from orthomill.tasks.adjustment.model.datum import (
    distance_residuals,
    position_residuals,
    prior_cost,
    prior_factors,
    vertical_residuals,
)
from orthomill.tasks.adjustment.model.network import Network, State
from orthomill.tasks.geometry.rotation_vector import rotation_of_vector, skew

_IMPOSSIBLE = (
    "Positions, control and photographs contradict each other so much that the block has no place: look for a position or control "
    "point with a wrong coordinate, or for the wrong reference system."
)
# Central differences of 1e-5 have errors of 1e-10 both from curvature and from rounding: smaller steps would follow noise.
STEPS, INCREMENT, NEGLIGIBLE = 20, 1e-5, 1e-10
"""Largest number of Gauss-Newton steps; increments and negligible steps in units of the block's size, radians and logarithms of the
scale."""

# Steps from a nearly singular system ask for anything; they are tried, cost too much and are shortened.
LARGEST = 50.0
"""Logarithm of the largest change of scale: beyond it products of the numbers overflow."""


@dataclass(frozen=True, eq=False)
class WholeMotion:
    """A motion of the whole block: `numbers` (7,) are its shift in units of `size` m, a rotation vector about the point `middle`
    (3,), and the logarithm of its scale."""

    numbers: np.ndarray
    middle: np.ndarray
    size: float

    def linear(self, at: np.ndarray) -> np.ndarray:
        """(n, 3) m: how points `at` (n, 3) move by the linearised motion."""
        lever = at - self.middle
        return self.size * self.numbers[:3] + np.cross(self.numbers[3:6], lever) + self.numbers[6] * lever

    def of(self, state: State, points: np.ndarray) -> State:
        """The state after the motion; of the points, those numbered `points` only."""
        turn, scale = rotation_of_vector(self.numbers[3:6]), np.exp(np.clip(self.numbers[6], -LARGEST, LARGEST))
        moved, point = self.middle + self.size * self.numbers[:3], state.point.copy()
        point[points] = moved + scale * (state.point[points] - self.middle) @ turn.T
        centre = moved + scale * (state.centre - self.middle) @ turn.T
        return replace(state, rotation=state.rotation @ turn.T, centre=centre, point=point)


def motion_in(state: State, centre: np.ndarray, turn: np.ndarray) -> WholeMotion:
    """The motion of the whole block that explains most of a step: corrections (P, 3) m of the projection centres and rotation
    vectors (P, 3) in the image systems."""
    middle, size = _extent(state)
    lever = (state.centre - middle) / size
    # Every photograph shows the motion twice: by how its centre moves, and by how it turns in the world.
    alike = np.broadcast_to(np.eye(3), (len(lever), 3, 3))
    by_centre = np.concatenate([alike, -np.array([skew(one) for one in lever]), lever[:, :, None]], axis=2)
    by_turn = np.concatenate([0.0 * alike, alike, np.zeros((len(lever), 3, 1))], axis=2)
    A = np.concatenate([by_centre, by_turn]).reshape(-1, 7)
    seen = np.concatenate([centre / size, -np.einsum("pji,pj->pi", state.rotation, turn)]).ravel()
    return WholeMotion(np.linalg.lstsq(A, seen, rcond=1e-10)[0], middle, size)


def _extent(state: State) -> tuple[np.ndarray, float]:
    """The centroid (3,) of the projection centres and their mean distance from it, m."""
    # About the centroid and in units of the mean distance from it, the seven parameters are nearly uncorrelated and of one size.
    middle = state.centre.mean(axis=0)
    return middle, max(float(np.linalg.norm(state.centre - middle, axis=1).mean()), 1e-6)


def fitted_whole(network: Network, state: State, huber: float = np.inf) -> State:
    """The state after the transformation that fits the prior information best; unchanged where nothing is gained, or in a free
    network."""
    if network.free:
        return state
    factors = prior_factors(network, state, huber)
    surveyed = np.flatnonzero(network.point_weight.any(axis=1))
    middle, size = _extent(state)

    by_centre = np.sqrt(factors.centre[:, None] * network.centre_weight)
    by_point = np.sqrt(factors.point[surveyed, None] * network.point_weight[surveyed])
    by_vertical, by_distance = np.sqrt(network.vertical_weight)[:, None], np.sqrt(factors.distance * network.distances.weight)
    has_vertical = bool(by_vertical.any())

    def misfits(motion: np.ndarray) -> np.ndarray:
        # Only surveyed points enter the misfits; moving all others in every difference quotient would cost most of the time.
        moved = WholeMotion(motion, middle, size).of(state, surveyed)
        known = [
            by_centre * position_residuals(network, moved),
            by_point * (network.point - moved.point)[surveyed],
            by_vertical * (vertical_residuals(network, moved) if has_vertical else 0.0),
            by_distance * distance_residuals(network, moved),
        ]
        return np.concatenate([part.ravel() for part in known])

    moved = WholeMotion(_best_motion(misfits), middle, size).of(state, np.arange(len(state.point)))
    # Compared with Huber's losses, which the square sums of the iteration only approximate.
    return moved if prior_cost(network, moved, huber) < prior_cost(network, state, huber) else state


def _best_motion(misfits: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """(7,) the motion with the least sum of squares of `misfits`, by Gauss-Newton; the smallest where several are equally good."""
    motion = np.zeros(7)
    now = misfits(motion)
    for _ in range(STEPS):
        moves = INCREMENT * np.eye(7)
        J = np.stack([(misfits(motion + move) - misfits(motion - move)) / (2.0 * INCREMENT) for move in moves], axis=1)
        # The smallest motion: what no observation determines (the tilt about a line of positions) stays as it is.
        try:
            step = np.linalg.lstsq(J, -now, rcond=1e-10)[0]
        except np.linalg.LinAlgError:  # numbers so far apart that products of them overflow
            raise GeometryError(_IMPOSSIBLE) from None
        there = misfits(motion + step)
        while there @ there > now @ now and np.abs(step).max() > NEGLIGIBLE:
            step *= 0.5
            there = misfits(motion + step)
        if np.abs(step).max() <= NEGLIGIBLE:
            return motion
        motion, now = motion + step, there
    return motion
