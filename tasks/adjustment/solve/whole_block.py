"""The similarity transformation of the whole block that fits positions, control and distances best.

Image measurements are invariant to it, and prior information often determines it poorly (the tilt of a strip). Steps in single
unknowns follow it badly: all points would have to move along circles together, and a linear step leaves the circles. By itself it
has seven unknowns and is cheap.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from orthomill.tasks.adjustment.model.datum import (
    distance_residuals,
    position_residuals,
    prior_cost,
    prior_factors,
    vertical_residuals,
)
from orthomill.tasks.adjustment.model.network import Network, State
from orthomill.tasks.geometry.rotation_vector import rotation_of_vector

# Central differences of 1e-5 have errors of 1e-10 both from curvature and from rounding: smaller steps would follow noise.
STEPS, INCREMENT, NEGLIGIBLE = 20, 1e-5, 1e-10
"""Largest number of Gauss-Newton steps; increments and negligible steps in units of the block's size, radians and logarithms of the
scale."""


def fitted_whole(network: Network, state: State, huber: float = np.inf) -> State:
    """The state after the transformation that fits the prior information best; unchanged where nothing is gained, or in a free
    network."""
    if network.free:
        return state
    factors = prior_factors(network, state, huber)
    surveyed = np.flatnonzero(network.point_weight.any(axis=1))
    # About the centroid and in units of the mean distance from it, the seven parameters are nearly uncorrelated and of one size.
    middle = state.centre.mean(axis=0)
    size = max(float(np.linalg.norm(state.centre - middle, axis=1).mean()), 1e-6)

    def misfits(motion: np.ndarray) -> np.ndarray:
        moved = _moved(state, motion, middle, size, surveyed)
        known = [
            np.sqrt(factors.centre[:, None] * network.centre_weight) * position_residuals(network, moved),
            np.sqrt(factors.point[surveyed, None] * network.point_weight[surveyed]) * (network.point - moved.point)[surveyed],
            np.sqrt(network.vertical_weight)[:, None] * vertical_residuals(network, moved),
            np.sqrt(factors.distance * network.distances.weight) * distance_residuals(network, moved),
        ]
        return np.concatenate([part.ravel() for part in known])

    motion = _best_motion(misfits)
    moved = _moved(state, motion, middle, size, np.arange(len(state.point)))
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
        step = np.linalg.lstsq(J, -now, rcond=1e-10)[0]
        there = misfits(motion + step)
        while there @ there > now @ now and np.abs(step).max() > NEGLIGIBLE:
            step *= 0.5
            there = misfits(motion + step)
        if np.abs(step).max() <= NEGLIGIBLE:
            return motion
        motion, now = motion + step, there
    return motion


def _moved(state: State, motion: np.ndarray, middle: np.ndarray, size: float, points: np.ndarray) -> State:
    """Shift (in units of `size`), rotation vector and logarithm of the scale applied to all photographs and to `points`."""
    turn, scale = rotation_of_vector(motion[3:6]), np.exp(motion[6])
    # Only surveyed points enter the misfits; moving all others in every difference quotient would cost most of the time.
    point = state.point.copy()
    point[points] = middle + size * motion[:3] + scale * (state.point[points] - middle) @ turn.T
    centre = middle + size * motion[:3] + scale * (state.centre - middle) @ turn.T
    return replace(state, rotation=state.rotation @ turn.T, centre=centre, point=point)
