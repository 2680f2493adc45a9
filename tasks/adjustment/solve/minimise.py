"""Levenberg-Marquardt on the reduced normal equations, with Huber's weights while blunders may be about.

Rays lose their pull one by one; what was surveyed (a position, a control point) loses it as a whole. Source: Brown 1976; Triggs et
al. 2000.
"""

import numpy as np

from orthomill.schemas.errors import GeometryError
from orthomill.tasks.adjustment.model.collinearity import BEHIND, residual_lengths
from orthomill.tasks.adjustment.model.datum import PriorFactors, add_prior, prior_cost, prior_factors
from orthomill.tasks.adjustment.model.linearisation import Linear, linearised, structure
from orthomill.tasks.adjustment.model.network import Network, Rays, State
from orthomill.tasks.adjustment.model.robust_weights import huber_cost, huber_weights
from orthomill.tasks.adjustment.solve.normal_equations import point_corrections, reduced_normals
from orthomill.tasks.adjustment.solve.normal_inverse import inverse_of
from orthomill.tasks.adjustment.solve.ray_intersection import intersected
from orthomill.tasks.adjustment.solve.whole_block import fitted_whole
from orthomill.tasks.adjustment.sparse.block_cholesky import Structure
from orthomill.tasks.adjustment.sparse.block_matrix import diagonal_places
from orthomill.tasks.geometry.rotation_vector import rotation_of_vector

NEGLIGIBLE = 1e-3
"""A step that gains less, in squares of standard errors, moves no unknown by more than some hundredths of its standard error."""

EASE, GENTLE = 0.1, 1.0 / 3.0
"""How the damping shrinks after a step: fast while every step succeeds, gently once one failed, for in a curved valley damping that
falls too far fails at every other step. It grows by 2, 4, 8 (Nielsen 1999)."""

UNDETERMINED = (
    "The block is not determined by its observations: a photograph hangs on too few or badly spread tie points, or an interior "
    "parameter cannot be told from the positions; hold the interior orientation fixed, or give control."
)


def minimise(
    network: Network, start: State, rays: Rays, huber: float = np.inf, tolerance: float = 1e-9, most: int = 100
) -> tuple[State, int]:
    """Levenberg-Marquardt from `start`; `huber` in standard errors. Returns the state and the number of iterations.

    Stops when a step gains less than `tolerance` of the cost. Reweighting with Huber's weights converges slowly and needs no sharp
    end: it may stop after `most` iterations. Weak blocks (a short strip without control) creep along a curved valley; there the
    end is where a step gains NEGLIGIBLE.

    Every point with rays needs two of them (or a prior). Raises GeometryError when the observations do not determine the unknowns,
    or when `most` iterations do not converge.
    """
    state, damping, ease = fitted_whole(network, start, huber), 1e-4, EASE
    cost, order = _cost(network, state, rays, huber), None
    for iteration in range(1, most + 1):
        factors, growth = prior_factors(network, state, huber), 2.0
        linear = linearised(network, state, rays, huber_weights(residual_lengths(network, state, rays), huber), factors.point)
        order = order or structure(network, state, linear)
        while True:
            trial = _moved(network, state, linear, order, factors, damping)
            if trial is not None and ease == GENTLE:
                trial = intersected(network, trial, rays, huber)
            trial_cost = np.inf if trial is None else _cost(network, trial, rays, huber)
            if trial_cost <= cost * (1.0 + 1e-12) or damping > 1e8:
                break
            damping, growth, ease = max(damping, 1e-9) * growth, 2.0 * growth, GENTLE
        if damping > 1e8:
            if trial is None:
                raise GeometryError(UNDETERMINED)
            return state, iteration
        if growth > 2.0:
            trial = fitted_whole(network, trial, huber)
            trial_cost = _cost(network, trial, rays, huber)
        del linear  # the largest table by far: the next one is not to stand beside it
        gain, state, cost = cost - trial_cost, trial, trial_cost
        if gain <= tolerance * cost + 1e-15 * len(rays) and damping <= 1e-3:
            return state, iteration
        damping = damping * ease if damping > 1e-9 else 0.0
    if np.isfinite(huber) or gain <= NEGLIGIBLE:
        return state, most
    raise GeometryError(f"The bundle adjustment did not converge in {most} iterations; look at its tie points and starting values.")


def _cost(network: Network, state: State, rays: Rays, huber: float) -> float:
    size = residual_lengths(network, state, rays)
    if (size * rays.sigma >= BEHIND).any():
        return np.inf
    return huber_cost(size, huber) + prior_cost(network, state, huber)


def _moved(network: Network, state: State, linear: Linear, order: Structure, factors: PriorFactors, damping: float) -> State | None:
    """The state after one damped step; None where the normal equations are singular at this damping."""
    normals = reduced_normals(linear, order.pattern, damping)
    matrix, eliminated = normals.matrix, normals.diagonal - normals.matrix.diagonal()
    right = normals.right + add_prior(network, state, matrix, factors)
    matrix.values[diagonal_places(order.pattern)] += damping * (matrix.diagonal() + eliminated)
    try:
        correction = inverse_of(network, state, order, matrix).times(right[:, None])[:, 0]
    except np.linalg.LinAlgError:
        return None
    return _corrected(network, state, correction, point_corrections(linear, correction, damping))


def _corrected(network: Network, state: State, correction: np.ndarray, points: np.ndarray) -> State:
    photo = correction[: 6 * network.photos].reshape(-1, 6)
    turned = np.array([rotation_of_vector(w) @ R for w, R in zip(photo[:, 3:], state.rotation, strict=True)])
    interior = state.interior.copy()
    interior[network.interior.free] += correction[6 * network.photos : 6 * network.photos + int(network.interior.free.sum())]
    shift = state.shift + correction[network.shift_columns] if network.shift else state.shift
    lever = state.lever + correction[network.lever_columns] if len(network.lever_columns) else state.lever
    points[network.kept] = correction[network.kept_columns]
    return State(turned, state.centre + photo[:, :3], state.point + points, interior, shift, lever)
