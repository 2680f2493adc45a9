"""Levenberg-Marquardt on the reduced normal equations, with Huber's weights while the observations may contain blunders.

Rays are weighted one by one, surveyed observations (a position, a control point) as a whole. Source: Brown 1976; Triggs et al.
2000; Nielsen 1999 for the damping.
"""

from dataclasses import dataclass, replace

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

# In a curved valley damping that falls too far fails at every other step, so that it falls slowly once a step has failed.
FAST, GENTLE = 0.1, 1.0 / 3.0
"""Factors by which the damping falls after a step: while every step has succeeded, and once one has failed. It grows by 2, 4, 8
(Nielsen 1999)."""

# Here a step is a few billionths of a Gauss-Newton step: no direction of descent is left but rounding.
LARGEST_DAMPING = 1e8
"""Damping beyond which no better step is searched for."""

# Less would let a singular system pass for a determined one as long as its damping is above rounding.
LEAST_DAMPING = 1e-9
"""Damping below which it is set to 0, and from which it grows again."""

UNDETERMINED = (
    "The block is not determined by its observations: a photograph has too few or badly distributed tie points, or an interior "
    "parameter cannot be separated from the positions; fix the interior orientation, or add control points."
)


# A small gain of a strongly damped step says only that the step was short.
END_DAMPING = 1e-3
"""Damping up to which a small gain is the end."""


@dataclass(frozen=True, eq=False)
class _Bundle:
    """What is minimised: the residuals of the `rays` in the `network`, under Huber's weights with the limit `huber`."""

    network: Network
    rays: Rays
    huber: float


@dataclass(frozen=True, eq=False)
class _Iterate:
    """A solution on the way: its `state` and `cost`, the `damping` of the step that led to it (then: of the next one), how that
    falls, and what the step gained."""

    state: State
    cost: float
    damping: float = 1e-4
    ease: float = FAST
    gain: float = np.inf


def minimise(
    network: Network, start: State, rays: Rays, huber: float = np.inf, tolerance: float = 1e-9, most: int = 100
) -> tuple[State, int]:
    """Levenberg-Marquardt from `start`; `huber` in standard errors. Returns the state and the number of iterations.

    Stops when a step gains less than `tolerance` of the cost. Iterative reweighting with Huber's weights converges slowly and needs
    no sharp end: it may stop after `most` iterations. Poorly determined blocks (a short strip without control) move slowly along a
    curved valley; they may stop where a step gains no more than NEGLIGIBLE.

    Every point with rays needs two of them (or prior coordinates). Raises GeometryError when the observations do not determine the
    unknowns, or when `most` iterations do not converge.
    """
    bundle = _Bundle(network, rays, huber)
    state = fitted_whole(network, start, huber)
    now, order = _Iterate(state, _cost(bundle, state)), None
    for iteration in range(1, most + 1):
        factors = prior_factors(network, now.state, huber)
        linear = linearised(
            network, now.state, rays, huber_weights(residual_lengths(network, now.state, rays), huber), factors.point
        )
        # Steps change values only, so that the pattern and its dissection are those of the first one.
        order = order or structure(network, now.state, linear)
        then = _next(bundle, now, linear, order, factors)
        # By far the largest table: two of them at a time would decide how large a block fits into memory.
        del linear
        if then is None or (then.gain <= tolerance * then.cost + 1e-15 * len(rays) and then.damping <= END_DAMPING):
            return (now if then is None else then).state, iteration
        now = replace(then, damping=then.damping * then.ease if then.damping > LEAST_DAMPING else 0.0)
    if np.isfinite(huber) or now.gain <= NEGLIGIBLE:
        return now.state, most
    raise GeometryError(f"The bundle adjustment did not converge in {most} iterations; check its tie points and starting values.")


def _next(bundle: _Bundle, now: _Iterate, linear: Linear, order: Structure, factors: PriorFactors) -> _Iterate | None:
    """The next solution that does not cost more; None where no step of any length does, so that `now` is the minimum.

    Raises GeometryError where the normal equations are singular at any damping.
    """
    damping, growth, ease = now.damping, 2.0, now.ease
    while True:
        trial = _moved(bundle.network, now.state, linear, order, factors, damping)
        if trial is not None and ease == GENTLE:
            trial = intersected(bundle.network, trial, bundle.rays, bundle.huber)
        cost = np.inf if trial is None else _cost(bundle, trial)
        # At the minimum the cost scatters by its rounding: that is no failure.
        if cost <= now.cost * (1.0 + 1e-12) or damping > LARGEST_DAMPING:
            break
        damping, growth, ease = max(damping, LEAST_DAMPING) * growth, 2.0 * growth, GENTLE
    if trial is None:
        raise GeometryError(UNDETERMINED)
    if damping > LARGEST_DAMPING:
        return None
    if growth > 2.0:
        # A failed step is the sign of a curved valley, most often that of a block that moves as a whole.
        trial = fitted_whole(bundle.network, trial, bundle.huber)
        cost = _cost(bundle, trial)
    return _Iterate(trial, cost, damping, ease, now.cost - cost)


def _cost(bundle: _Bundle, state: State) -> float:
    """The weighted square sum, or that of Huber's losses; inf where a point is behind a camera."""
    size = residual_lengths(bundle.network, state, bundle.rays)
    if (size * bundle.rays.sigma >= BEHIND).any():
        return np.inf
    return huber_cost(size, bundle.huber) + prior_cost(bundle.network, state, bundle.huber)


def _moved(network: Network, state: State, linear: Linear, order: Structure, factors: PriorFactors, damping: float) -> State | None:
    """The state after one damped step; None where the normal equations are singular at this damping."""
    normals = reduced_normals(linear, order.pattern, damping)
    # Marquardt's damping in units of the diagonal, that of the whole system: the reduced one is smaller by what the points explain.
    matrix, eliminated = normals.matrix, normals.diagonal - normals.matrix.diagonal()
    right = normals.right + add_prior(network, state, matrix, factors)
    matrix.values[diagonal_places(order.pattern)] += damping * (matrix.diagonal() + eliminated)
    try:
        # In a free network with inner constraints, so that steps neither drift nor turn the block.
        correction = inverse_of(network, state, order, matrix).times(right[:, None])[:, 0]
    except np.linalg.LinAlgError:
        return None
    return _corrected(network, state, correction, point_corrections(linear, correction, damping))


def _corrected(network: Network, state: State, correction: np.ndarray, points: np.ndarray) -> State:
    """The state after corrections (n,) of the unknowns of the reduced system and (N, 3) of the points."""
    photo = correction[: 6 * network.photos].reshape(-1, 6)
    turned = np.array([rotation_of_vector(w) @ R for w, R in zip(photo[:, 3:], state.rotation, strict=True)])
    interior = state.interior.copy()
    interior[network.interior.free] += correction[6 * network.photos : 6 * network.photos + int(network.interior.free.sum())]
    shift = state.shift + correction[network.shift_columns] if network.shift else state.shift
    lever = state.lever + correction[network.lever_columns] if len(network.lever_columns) else state.lever
    points[network.kept] = correction[network.kept_columns]
    return State(turned, state.centre + photo[:, :3], state.point + points, interior, shift, lever)
