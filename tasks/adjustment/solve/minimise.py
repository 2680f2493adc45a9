"""Levenberg-Marquardt on the reduced normal equations, with Huber's weights while the observations may contain blunders.

Rays are weighted one by one, surveyed observations (a position, a control point) as a whole. Source: Brown 1976; Triggs et al.
2000; Nielsen 1999 for the damping.
"""

from dataclasses import dataclass, replace

import numpy as np

from orthomill.schemas.errors import GeometryError
from orthomill.tasks.adjustment.model.collinearity import BEHIND, residual_lengths, residuals
from orthomill.tasks.adjustment.model.datum import PriorFactors, add_prior, prior_cost, prior_factors
from orthomill.tasks.adjustment.model.linearisation import Linear, linearised, structure
from orthomill.tasks.adjustment.model.network import Network, Rays, State
from orthomill.tasks.adjustment.model.robust_weights import huber_cost, huber_losses, huber_weights
from orthomill.tasks.adjustment.solve.bundle_step import BundleStep, step_of
from orthomill.tasks.adjustment.solve.normal_equations import point_corrections, promised_residuals, reduced_normals
from orthomill.tasks.adjustment.solve.normal_inverse import inverse_of
from orthomill.tasks.adjustment.solve.ray_intersection import held_in_front, intersected
from orthomill.tasks.adjustment.solve.whole_block import fitted_whole
from orthomill.tasks.adjustment.sparse.block_cholesky import Structure
from orthomill.tasks.adjustment.sparse.block_matrix import diagonal_places

# Undamped steps converge quadratically: after one of a tenth of a standard error the next is some thousandths of it.
NEGLIGIBLE = 1e-2
"""An undamped step that gains less, in squares of standard errors, is the last."""
KEPT = 1e-3
"""What the residuals lack of those that a step promised, in squares of standard errors, up to which it is the last: the next would
be some hundredths of a standard error."""

# In a curved valley damping that falls too far fails at every other step, so that it falls slowly once a step has failed.
FAST, GENTLE = 0.1, 1.0 / 3.0
"""Factors by which the damping falls after a step: while every step has succeeded, and once one has failed. It grows by 2, 4, 8
(Nielsen 1999)."""

# Here a step is a few billionths of a Gauss-Newton step: no direction of descent is left but rounding.
LARGEST_DAMPING = 1e8
"""Damping beyond which no better step is searched for."""

# Less would let a singular system pass for a determined one as long as its damping is above rounding.
LEAST_DAMPING = 1e-12
"""Damping below which it is set to 0, and from which it grows again."""

UNDETERMINED = (
    "The block is not determined by its observations: a photograph has too few or badly distributed tie points, or an interior "
    "parameter cannot be separated from the positions; fix the interior orientation, or add control points."
)


FAR, NEAR = 1e-4, 0.0
"""Damping of the first step: from starting values, and from the neighbourhood of the minimum, where it would only shorten steps."""

# A small gain of a strongly damped step says only that the step was short.
END_DAMPING = 1e-3
"""Damping up to which a small gain is the end."""

# Where the residuals bend as much as the linear equations do (a tilt that positions and a principal point share), every step
# passes the minimum, and the next one comes back nearly as far: dozens of steps for what two of them tell.
PARALLEL, NEARLY_AS_FAR = 0.9, 0.3
"""Cosine between two steps above which they lie on a line, and the part of the first from which on a second that goes back is
shortened."""


class NotConverged(GeometryError):
    """Observations that pull against each other so that no solution was reached; `photo`: the number of the photograph whose
    measurements alone kept steps short, None where it is no single one."""

    def __init__(self, message: str, photo: int | None = None) -> None:
        super().__init__(message)
        self.photo = photo


@dataclass(frozen=True, eq=False)
class _Bundle:
    """What is minimised: the residuals of the `rays` in the `network`, under Huber's weights with the limit `huber`."""

    network: Network
    rays: Rays
    huber: float


@dataclass(frozen=True, eq=False)
class _Iterate:
    """A solution on the way: its `state` and `cost`, the `damping` of the step that led to it (then: of the next one), how that
    falls, what the step gained, and whether it was the `last` because its residuals are those that the linear equations promised;
    the last two states of which the second cost more, so that the step to it was `refused`; the `correction` (n,) of the step, and
    the `share` of it that was taken."""

    state: State
    cost: float
    damping: float
    ease: float = FAST
    gain: float = np.inf
    last: bool = False
    refused: tuple[State, State] | None = None
    correction: np.ndarray | None = None
    share: float = 1.0


@dataclass(frozen=True, eq=False)
class _Step:
    """A step: the `correction` (n,) of the unknowns of the reduced system, and that of all of the `bundle`."""

    correction: np.ndarray
    bundle: BundleStep

    def share_after(self, before: _Iterate) -> float:
        """The part of the step that ends where the next one would be nothing, by the one `before`: less than 1 where this one turns
        back."""
        last = before.correction
        if last is None:
            return 1.0
        along = float(self.correction @ last) / max(float(last @ last), 1e-300)
        parallel = abs(along) * float(np.linalg.norm(last)) > PARALLEL * float(np.linalg.norm(self.correction))
        # A whole step after a part of one would pass the minimum again, and gain as much as it loses.
        back = along < -NEARLY_AS_FAR or (before.share < 1.0 and along < NEARLY_AS_FAR)
        return before.share / (1.0 - along) if parallel and back else 1.0


def minimise(
    network: Network,
    start: State,
    rays: Rays,
    huber: float = np.inf,
    tolerance: float = 1e-9,
    damping: float = FAR,
    most: int = 100,
) -> tuple[State, int]:
    """Levenberg-Marquardt from `start` with a first `damping`; `huber` in standard errors. Returns the state and the number of
    iterations.

    Stops when a step gains less than `tolerance` of the cost, an undamped one no more than NEGLIGIBLE, or when the residuals after
    it are those that it promised. Iterative reweighting with Huber's weights converges slowly and needs no sharp end: it may stop
    after `most` iterations.

    Every point with rays needs two of them (or prior coordinates). Raises GeometryError when the observations do not determine the
    unknowns, and NotConverged when `most` iterations do not converge.
    """
    bundle = _Bundle(network, rays, huber)
    state = fitted_whole(network, start, huber)
    now, order = _Iterate(state, _cost(bundle, state), damping), None
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
        if then is None or _ended(then, tolerance, len(rays)):
            return (now if then is None else then).state, iteration
        now = replace(then, damping=then.damping * then.ease if then.damping > LEAST_DAMPING else 0.0)
    if np.isfinite(huber) or now.gain <= NEGLIGIBLE:
        return now.state, most
    failure = f"The bundle adjustment did not converge in {most} iterations; check its tie points and starting values."
    raise NotConverged(failure, _obstacle(bundle, now))


def _obstacle(bundle: _Bundle, now: _Iterate) -> int | None:
    """The photograph whose rays make up most of what the last refused step would have cost; None where many share it."""
    if now.refused is None:
        return None
    before, after = (huber_losses(residual_lengths(bundle.network, state, bundle.rays), bundle.huber) for state in now.refused)
    dearer = np.maximum(np.bincount(bundle.rays.photo, after - before, bundle.network.photos), 0.0)
    worst = int(dearer.argmax())
    return worst if 2.0 * dearer[worst] > dearer.sum() else None


def _ended(then: _Iterate, tolerance: float, rays: int) -> bool:
    """Whether a step gained so little that it was the last."""
    # An undamped step is as long as it should be: what it does not gain is not there.
    if then.last or (then.damping <= LEAST_DAMPING and then.gain <= NEGLIGIBLE):
        return True
    return then.gain <= tolerance * then.cost + 1e-15 * rays and then.damping <= END_DAMPING


def _next(bundle: _Bundle, now: _Iterate, linear: Linear, order: Structure, factors: PriorFactors) -> _Iterate | None:
    """The next solution that does not cost more; None where no step of any length does, so that `now` is the minimum.

    Raises GeometryError where the normal equations are singular at any damping.
    """
    damping, growth, ease, refused = now.damping, 2.0, now.ease, now.refused
    while True:
        step = _step(bundle.network, now.state, linear, order, factors, damping)
        share = 1.0 if step is None else step.share_after(now)
        tried = None if step is None else _tried(bundle, now, step.bundle.times(share), ease == GENTLE)
        # At the minimum the cost scatters by its rounding: that is no failure.
        if (tried is not None and tried[1] <= now.cost * (1.0 + 1e-12)) or damping > LARGEST_DAMPING:
            break
        damping, growth, ease = max(damping, LEAST_DAMPING) * growth, 2.0 * growth, GENTLE
        refused = refused if tried is None else (now.state, tried[0])
    if tried is None:
        raise GeometryError(UNDETERMINED)
    if damping > LARGEST_DAMPING:
        return None
    # Weak control (metres, or nearly on a line) determines the motion of the block so poorly that full steps overshoot and damped
    # ones creep. Alone its seven unknowns are found in milliseconds, and the shape of the block needs no further step for it.
    state = fitted_whole(bundle.network, tried[0], bundle.huber)
    cost = tried[1] if state is tried[0] else _cost(bundle, state)
    alone = tried[1] - cost <= NEGLIGIBLE and damping <= LEAST_DAMPING
    last = alone and step is not None and share == 1.0 and _as_promised(bundle, linear, step, state)
    correction = None if step is None else step.correction
    return _Iterate(state, cost, damping, ease, now.cost - cost, last, refused, correction, share)


def _as_promised(bundle: _Bundle, linear: Linear, step: _Step, state: State) -> bool:
    """Whether the residuals of a `state` are those that the linear equations promised: another step would start from the same
    equations, and gain no more than what the residuals lack."""
    promised = promised_residuals(linear, step.correction, step.bundle.point)
    lack = residuals(state, bundle.rays, bundle.network.camera_of) - promised
    return float((linear.weight * (lack**2).sum(axis=1)).sum()) <= KEPT


def _tried(bundle: _Bundle, now: _Iterate, step: BundleStep, again: bool) -> tuple[State, float]:
    """The state to which a step leads, and its cost; `again`: after a failure, points are intersected anew."""
    # The motion of the block first: the linear step may cost less at once, but leads along the curved valley.
    for reached in (step.with_motion(now.state), step.linear(now.state)):
        reached = held_in_front(bundle.network, now.state, reached, bundle.rays)
        if again:
            reached = intersected(bundle.network, reached, bundle.rays, bundle.huber)
        cost = _cost(bundle, reached)
        if cost <= now.cost:
            break
    return reached, cost


def _cost(bundle: _Bundle, state: State) -> float:
    """The weighted square sum, or that of Huber's losses; inf where a point is behind a camera."""
    size = residual_lengths(bundle.network, state, bundle.rays)
    if (size * bundle.rays.sigma >= BEHIND).any():
        return np.inf
    return huber_cost(size, bundle.huber) + prior_cost(bundle.network, state, bundle.huber)


def _step(network: Network, state: State, linear: Linear, order: Structure, factors: PriorFactors, damping: float) -> _Step | None:
    """One damped step; None where the normal equations are singular at this damping."""
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
    return _Step(correction, step_of(network, correction, point_corrections(linear, correction, damping)))
