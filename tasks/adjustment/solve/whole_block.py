"""The similarity transformation of the whole block: the one that fits positions, control and distances best, and the one that a
step contains.

Image measurements are invariant to it, and prior information often determines it poorly (the tilt of a strip, control of metres).
Steps in single unknowns follow it badly: all points would have to move along circles together, and a linear step leaves the
circles, which a thousand times more precise image measurements punish. By itself it has seven unknowns and is cheap: it is taken
out of every step and applied as what it is.
"""

from dataclasses import dataclass, replace

import numpy as np

from orthomill.schemas.errors import GeometryError
from orthomill.tasks.adjustment.model.datum import (
    antennas,
    distance_residuals,
    position_residuals,
    prior_cost,
    prior_factors,
    vertical_residuals,
)
from orthomill.tasks.adjustment.model.network import Network, State
from orthomill.tasks.geometry.rotation_vector import motion_derivatives, rotation_of_vector, skew

_IMPOSSIBLE = (
    "Positions, control and photographs contradict each other so much that the block has no place: look for a position or control "
    "point with a wrong coordinate, or for the wrong reference system."
)
STEPS, NEGLIGIBLE = 20, 1e-10
"""Largest number of Gauss-Newton steps; negligible steps in units of the block's size, radians and logarithms of the scale."""

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
    # Every photograph shows the motion twice: by how its centre moves, and by how it turns in the world.
    by_centre = motion_derivatives((state.centre - middle) / size)
    by_turn = np.zeros_like(by_centre)
    by_turn[:, :, 3:6] = np.eye(3)
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
    moved = state
    for motion in _best_motions(_Known.of(network, state, huber), state):
        moved = motion.of(moved, np.arange(len(state.point)))
    # Compared with Huber's losses, which the square sums of the iteration only approximate.
    return moved if prior_cost(network, moved, huber) < prior_cost(network, state, huber) else state


@dataclass(frozen=True, eq=False)
class _Known:
    """What is known of a block, with the roots of the weights of positions (P, 3), of the points `surveyed` (n,) (n, 3), of
    verticals (P, 1) and of distances (D,)."""

    network: Network
    surveyed: np.ndarray
    by_centre: np.ndarray
    by_point: np.ndarray
    by_vertical: np.ndarray
    by_distance: np.ndarray

    @classmethod
    def of(cls, network: Network, state: State, huber: float) -> "_Known":
        factors = prior_factors(network, state, huber)
        distances = network.distances
        # Only these points enter the misfits; moving all others at every step would cost most of the time.
        known = np.array(network.point_weight.any(axis=1))
        known[distances.ends.ravel()] = True
        return cls(
            network,
            np.flatnonzero(known),
            np.sqrt(factors.centre[:, None] * network.centre_weight),
            np.sqrt(factors.point[known, None] * network.point_weight[known]),
            np.sqrt(network.vertical_weight)[:, None],
            np.sqrt(factors.distance * distances.weight),
        )

    def misfits(self, state: State) -> np.ndarray:
        """(r,) what is known minus what the state says, in standard errors."""
        parts = [
            self.by_centre * position_residuals(self.network, state),
            self.by_point * (self.network.point - state.point)[self.surveyed],
            self.by_vertical * vertical_residuals(self.network, state) if self.by_vertical.any() else np.zeros(0),
            self.by_distance * distance_residuals(self.network, state),
        ]
        return np.concatenate([part.ravel() for part in parts])

    def derivatives(self, state: State, middle: np.ndarray, size: float) -> np.ndarray:
        """(r, 7) derivatives of the misfits by the numbers of a motion of the state."""
        arm = antennas(self.network, replace(state, shift=np.zeros_like(state.shift))) - state.centre
        position = motion_derivatives(state.centre - middle)
        position[:, :, 3:6] -= skew(arm)  # a lever arm turns with the block and does not grow with it
        first, second = self.network.distances.ends.T
        distance = np.zeros((len(self.by_distance), 7))
        distance[:, 6] = np.linalg.norm(state.point[second] - state.point[first], axis=1)
        parts = [
            self.by_centre[:, :, None] * position,
            self.by_point[:, :, None] * motion_derivatives(state.point[self.surveyed] - middle),
            self.by_vertical[:, :, None] * self._tilts(state) if self.by_vertical.any() else np.zeros((0, 7)),
            self.by_distance[:, None] * distance,
        ]
        J = -np.concatenate([part.reshape(-1, 7) for part in parts])
        J[:, :3] *= size
        return J

    def _tilts(self, state: State) -> np.ndarray:
        """(P, 3, 7) derivatives of the negative residuals of verticals."""
        tilts = np.zeros((len(state.rotation), 3, 7))
        tilts[:, :, 3:6] = -skew(self.network.up) @ state.rotation @ skew(np.array([0.0, 0.0, 1.0]))
        return tilts


def _best_motions(known: _Known, state: State) -> list[WholeMotion]:
    """The motions, one after the other, that take a state to the least sum of squares of what is known, by Gauss-Newton; the
    smallest ones where several are equally good."""
    motions: list[WholeMotion] = []
    now = known.misfits(state)
    for _ in range(STEPS):
        middle, size = _extent(state)
        # The smallest motion: what no observation determines (the tilt about a line of positions) stays as it is.
        try:
            step = np.linalg.lstsq(known.derivatives(state, middle, size), -now, rcond=1e-10)[0]
        except np.linalg.LinAlgError:  # numbers so far apart that products of them overflow
            raise GeometryError(_IMPOSSIBLE) from None
        then = WholeMotion(step, middle, size).of(state, known.surveyed)
        there = known.misfits(then)
        while there @ there > now @ now and np.abs(step).max() > NEGLIGIBLE:
            step = 0.5 * step
            then = WholeMotion(step, middle, size).of(state, known.surveyed)
            there = known.misfits(then)
        if np.abs(step).max() <= NEGLIGIBLE:
            break
        motions.append(WholeMotion(step, middle, size))
        state, now = then, there
    return motions
