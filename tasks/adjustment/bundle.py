"""Bundle adjustment: collinearity for every ray, all orientations, points and (if asked) cameras together.

Strategy. (1) `minimise`: Levenberg-Marquardt on the reduced normal equations, with Huber's weights while blunders may be about.
(2) `adjust`: robust solution first; gross blunders go; then plain least squares, after which every ray is tested by its own
standardised residual (data snooping, the worst ray of a point at a time) and the standard error of the image measurements is
estimated from the residuals and the redundancy they really have (a variance component), until neither changes anything.
(3) The covariance of all orientations and cameras is the inverse of the reduced normal matrix; points follow from it.

What a person measured or surveyed (positions, control and its image measurements) keeps the standard errors it came with unless
it contradicts them: then these are enlarged. It is a group of its own, for a matched tie point is often ten times as precise as a
pointing, and a common factor would throw good control out.

Source: Brown 1976; Baarda 1968 for the tests; Triggs et al. 2000.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag, cho_factor, cho_solve

from schemas.errors import GeometryError
from tasks.adjustment.collinearity import BEHIND, misclosures
from tasks.adjustment.datum import freedoms, position_misclosures, prior_cost, prior_normals
from tasks.adjustment.network import Network, Rays, State
from tasks.adjustment.normal_equations import Linear, linearised, point_corrections, point_precision, reduced_normals
from tasks.adjustment.robust import huber_cost, huber_weights, spread
from tasks.geometry.rotation_vector import rotation_of_vector

NEGLIGIBLE = 1e-3
"""A step that gains less, in squares of standard errors, moves no unknown by more than some hundredths of its standard error."""


@dataclass(frozen=True)
class BlunderTest:
    """When a ray is a blunder: Huber's limit and the rejection limits, in standard errors; and how many rounds are allowed."""

    huber: float = 2.0
    gross: float = 8.0
    limit: float = 4.0
    rounds: int = 15


@dataclass(frozen=True, eq=False)
class Factors:
    """Estimated by stated standard error, per group of observations: tie points in the photographs, surveyed points in the
    photographs, GNSS positions, coordinates of surveyed points."""

    image: float = 1.0
    pointing: float = 1.0
    position: float = 1.0
    control: float = 1.0


@dataclass(frozen=True, eq=False)
class Adjustment:
    """The adjusted block. `used` (M,) marks the rays that took part, `residual` (M, 2) px observed minus computed of all rays,
    `redundancy_number`
    (M, 2) and `standardised` (M, 2) are NaN for rays that did not. `cofactor` (n, n) is the covariance of the unknowns of the
    reduced system,
    `point_covariance` (N, 3, 3) m^2. `factors`: estimated by stated standard errors of image measurements, positions and
    control."""

    state: State
    network: Network
    rays: Rays
    used: np.ndarray
    residual: np.ndarray
    redundancy_number: np.ndarray
    standardised: np.ndarray
    cofactor: np.ndarray
    point_covariance: np.ndarray
    redundancy: int
    factors: Factors
    iterations: int

    @property
    def sigma0_px(self) -> float:
        """Standard error of a typical coordinate of a tie point, estimated from the residuals."""
        ties = self.used & ~surveyed(self.network, self.rays)
        return float(self.factors.image * np.sqrt(np.mean(self.rays.sigma[ties if ties.any() else self.used] ** 2)))

    def exterior_covariance(self, photo: int) -> np.ndarray:
        """(6, 6) of X, Y, Z and the three rotations in the image system, m and radians."""
        return self.cofactor[6 * photo : 6 * photo + 6, 6 * photo : 6 * photo + 6]


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
    state, damping = start, 1e-4
    cost = _cost(network, state, rays, huber)
    for iteration in range(1, most + 1):
        factor = huber_weights(_sizes(network, state, rays), huber)
        linear = linearised(network, state, rays, factor)
        while True:
            trial = _moved(network, state, linear, damping)
            trial_cost = np.inf if trial is None else _cost(network, trial, rays, huber)
            if trial_cost <= cost * (1.0 + 1e-12) or damping > 1e8:
                break
            damping = max(damping, 1e-7) * 10.0
        if damping > 1e8:
            if trial is None:
                raise GeometryError(_UNDETERMINED)
            return state, iteration
        gain, state, cost = cost - trial_cost, trial, trial_cost
        if gain <= tolerance * cost + 1e-15 * len(rays) and damping <= 1e-3:
            return state, iteration
        damping = damping * 0.1 if damping > 1e-9 else 0.0
    if np.isfinite(huber) or gain <= NEGLIGIBLE:
        return state, most
    raise GeometryError(f"The bundle adjustment did not converge in {most} iterations; look at its tie points and starting values.")


def adjust(network: Network, start: State, rays: Rays, test: BlunderTest | None = None) -> Adjustment:
    """The adjusted block with tested rays and honest covariance.

    Raises GeometryError when the block falls apart (too few rays), is not determined, or does not converge.
    """
    test = test or BlunderTest()
    stated_sigma, used = rays.sigma, _enough_rays(network, rays, np.ones(len(rays), bool))
    state, iterations, used = _robust_start(network, start, rays, used, test)
    factors, stated = Factors(), network
    for _ in range(test.rounds):
        state, steps = minimise(network, state, rays.take(used))
        iterations += steps
        result = _account(network, state, rays, used, factors)
        factors, again = _factors(result)
        bad = _blunders(result, _by_group(stated, rays, factors) / _by_group(stated, rays, result.factors) * test.limit)
        used = _enough_rays(network, rays, used & ~bad)
        if not again and not bad.any():
            return replace(result, iterations=iterations, rays=replace(rays, sigma=stated_sigma))
        rays = replace(rays, sigma=stated_sigma * _by_group(stated, rays, factors))
        network = replace(
            stated, centre_weight=stated.centre_weight / factors.position**2, point_weight=stated.point_weight / factors.control**2
        )
    raise GeometryError(
        f"The blunder tests of the bundle adjustment removed rays in each of {test.rounds} rounds and did not come to an end; the "
        "tie points hold too many wrong matches."
    )


def _robust_start(network: Network, state: State, rays: Rays, used: np.ndarray, test: BlunderTest) -> tuple[State, int, np.ndarray]:
    """Huber's solution with the spread of each group's residuals as unit, three times, ever sharper; then the gross blunders go."""
    iterations = 0
    for tolerance in (1e-2, 1e-3, 1e-4):
        unit = _units(network, state, rays, used, least=0.1)
        state, steps = minimise(network, state, replace(rays, sigma=rays.sigma * unit).take(used), test.huber, tolerance)
        iterations += steps
    unit = _units(network, state, rays, used, least=1e-3)
    return state, iterations, _enough_rays(network, rays, used & (_sizes(network, state, rays) < test.gross * unit))


def _units(network: Network, state: State, rays: Rays, used: np.ndarray, least: float) -> np.ndarray:
    """(M,) the spread of the residuals of each ray's group by its stated standard errors; pointings are never taken for better than
    stated."""
    size, by_person = _sizes(network, state, rays), surveyed(network, rays)
    ties, pointings = size[used & ~by_person], size[used & by_person]
    tie_unit = max(spread(ties), least) if len(ties) else 1.0
    return np.where(by_person, max(spread(pointings), 1.0) if len(pointings) else 1.0, tie_unit)


def surveyed(network: Network, rays: Rays) -> np.ndarray:
    """(M,) which rays point at surveyed points."""
    return network.point_weight.any(axis=1)[rays.point]


def _by_group(network: Network, rays: Rays, factors: Factors) -> np.ndarray:
    """(M,) the factor of each ray's group."""
    return np.where(surveyed(network, rays), factors.pointing, factors.image)


def _sizes(network: Network, state: State, rays: Rays) -> np.ndarray:
    return np.linalg.norm(misclosures(state, rays, network.camera_of), axis=1) / rays.sigma


def _cost(network: Network, state: State, rays: Rays, huber: float) -> float:
    size = _sizes(network, state, rays)
    if (size * rays.sigma >= BEHIND).any():
        return np.inf
    return huber_cost(size, huber) + prior_cost(network, state)


def _moved(network: Network, state: State, linear: Linear, damping: float) -> State | None:
    """The state after one damped step; None where the normal equations are singular at this damping."""
    normal, right, diagonal = reduced_normals(linear, network.unknowns, damping)
    prior, prior_right = prior_normals(network, state)
    normal += prior
    normal[np.diag_indices_from(normal)] += damping * (diagonal + np.diag(prior))
    right = _held(network, normal, right + prior_right)
    correction = _solve(network, state, normal, right)
    if correction is None:
        return None
    return _corrected(network, state, correction, point_corrections(linear, correction, damping))


def _held(network: Network, normal: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Cuts the considered parameters off the normal equations, so that their corrections are zero."""
    considered = network.considered_columns
    normal[considered] = 0.0
    normal[:, considered] = 0.0
    normal[considered, considered] = 1.0
    return np.where(considered, 0.0, right)


def _corrected(network: Network, state: State, correction: np.ndarray, points: np.ndarray) -> State:
    photo = correction[: 6 * network.photos].reshape(-1, 6)
    turned = np.array([rotation_of_vector(w) @ R for w, R in zip(photo[:, 3:], state.rotation, strict=True)])
    interior = state.interior.copy()
    interior[network.interior.free] += correction[6 * network.photos : 6 * network.photos + int(network.interior.free.sum())]
    shift = state.shift + correction[-3:] if network.shift else state.shift
    return State(turned, state.centre + photo[:, :3], state.point + points, interior, shift)


def _scaled(network: Network, state: State, normal: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The normal matrix with unit diagonal, the scale (n,), and the unit freedoms (n, 7 or 0) that inner constraints hold."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(normal), 1e-300))
    scaled = normal * scale[:, None] * scale
    if not network.free:
        return scaled, scale, np.zeros((len(scale), 0))
    H = np.linalg.qr(freedoms(network, state) / scale[:, None])[0]
    return scaled + H @ H.T, scale, H


def _solve(network: Network, state: State, normal: np.ndarray, right: np.ndarray) -> np.ndarray | None:
    scaled, scale, _ = _scaled(network, state, normal)
    try:
        return scale * cho_solve(cho_factor(scaled), scale * right)
    except (np.linalg.LinAlgError, ValueError):
        return None


_UNDETERMINED = (
    "The block is not determined by its observations: a photograph hangs on too few or badly spread tie points, or an interior "
    "parameter cannot be told from the positions; hold the interior orientation fixed, or give control."
)


def covariance_of(network: Network, state: State, linear: Linear) -> np.ndarray:
    """(n, n): the inverse of the reduced normal matrix; with respect to the inner constraints in a free network.

    Considered parameters have no part in it (zero rows); `with_considered` adds theirs. Raises GeometryError.
    """
    normal = reduced_normals(linear, network.unknowns)[0] + prior_normals(network, state)[0]
    _held(network, normal, np.zeros(len(normal)))
    scaled, scale, H = _scaled(network, state, normal)
    if not np.isfinite(scaled).all() or np.linalg.cond(scaled) > 1e15:
        raise GeometryError(_UNDETERMINED)
    cofactor = (np.linalg.inv(scaled) - H @ H.T) * scale[:, None] * scale
    considered = network.considered_columns
    cofactor[considered], cofactor[:, considered] = 0.0, 0.0
    return cofactor


def with_considered(network: Network, linear: Linear, cofactor: np.ndarray) -> np.ndarray:
    """The covariance (n, n) with the uncertainty of the considered parameters carried into all others.

    The unknowns move by -Q N_uk per unit of a considered parameter; its own covariance is the prior one. Source: Schmidt 1966.
    """
    considered = network.considered_columns
    if not considered.any():
        return cofactor
    normal = reduced_normals(linear, network.unknowns)[0]
    move = -cofactor @ normal[:, considered]
    move[considered] = np.eye(int(considered.sum()))
    return cofactor + move @ _considered_covariance(network) @ move.T


def _considered_covariance(network: Network) -> np.ndarray:
    """Prior covariance (k, k) of the considered parameters, camera by camera, in the order of their columns."""
    blocks = []
    for free, considered, weight in zip(network.interior.free, network.interior.considered, network.interior.weight, strict=True):
        chosen = np.flatnonzero(free)
        inside = np.isin(chosen, np.flatnonzero(considered))
        scale = 1.0 / np.sqrt(np.maximum(np.diag(weight)[chosen], 1e-300))
        covariance = np.linalg.inv(weight[np.ix_(chosen, chosen)] * scale[:, None] * scale) * scale[:, None] * scale
        blocks.append(covariance[np.ix_(inside, inside)])
    return block_diag(*blocks)


def _account(network: Network, state: State, rays: Rays, used: np.ndarray, factors: Factors) -> Adjustment:
    """Covariance, redundancy numbers and standardised residuals at the solution."""
    taken = rays.take(used)
    linear = linearised(network, state, taken)
    cofactor = covariance_of(network, state, linear)
    _, adjusted = point_precision(linear, cofactor)
    cofactor = with_considered(network, linear, cofactor)
    points, _ = point_precision(linear, cofactor)
    numbers, standardised = np.full((len(rays), 2), np.nan), np.full((len(rays), 2), np.nan)
    numbers[used] = np.clip(1.0 - adjusted * linear.weight[:, None], 1e-6, 1.0)
    residual = misclosures(state, rays, network.camera_of)
    standardised[used] = residual[used] / (taken.sigma[:, None] * np.sqrt(numbers[used]))
    return Adjustment(
        state, network, rays, used, residual, numbers, standardised, cofactor, points, _redundancy(network, taken), factors, 0
    )


def _redundancy(network: Network, rays: Rays) -> int:
    points = len(np.unique(np.concatenate([rays.point, np.flatnonzero(network.point_weight.any(axis=1))])))
    redundancy = 2 * len(rays) + network.prior_observations - network.unknowns + int(network.interior.considered.sum())
    redundancy += 7 * network.free - 3 * points
    if redundancy <= 0:
        raise GeometryError(f"The block has {len(rays)} rays, which is not enough to adjust it; more tie points are needed.")
    return redundancy


def _factors(result: Adjustment) -> tuple[Factors, bool]:
    """Estimated by stated standard errors, and whether they differ from those used by more than 1 %."""
    by_person, old = surveyed(result.network, result.rays), result.factors
    square, redundancy = _image_share(result, result.used & ~by_person)
    image = old.image * float(np.sqrt(square / redundancy)) if redundancy > 0 else old.image
    pointing = _enlarged(old.pointing, *_image_share(result, result.used & by_person))
    position = _enlarged(old.position, *_position_share(result))
    control = _enlarged(old.control, *_control_share(result))
    new = Factors(max(image, 1e-6), pointing, position, control)
    pairs = ((new.image, old.image), (pointing, old.pointing), (position, old.position), (control, old.control))
    return new, any(abs(a / b - 1.0) > 0.01 for a, b in pairs)


def _image_share(result: Adjustment, chosen: np.ndarray) -> tuple[float, float]:
    """Weighted square sum and redundancy of the image measurements of the rays `chosen`."""
    square = (result.residual[chosen] ** 2 / result.rays.sigma[chosen][:, None] ** 2).sum()
    return float(square), float(result.redundancy_number[chosen].sum())


def _position_share(result: Adjustment) -> tuple[float, float]:
    """Weighted square sum and redundancy of the GNSS positions."""
    weight, photos = result.network.centre_weight, result.network.photos
    variance = np.diag(result.cofactor)[: 6 * photos].reshape(-1, 6)[:, :3].copy()
    if result.network.shift:
        for photo in range(photos):
            for axis in range(3):
                variance[photo, axis] += result.cofactor[axis - 3, axis - 3] + 2.0 * result.cofactor[6 * photo + axis, axis - 3]
    square = (weight * position_misclosures(result.network, result.state) ** 2).sum()
    return float(square), float(((weight > 0) - weight * variance)[weight > 0].sum())


def _control_share(result: Adjustment) -> tuple[float, float]:
    """Weighted square sum and redundancy of the coordinates of the control points."""
    weight = result.network.point_weight
    variance = np.diagonal(result.point_covariance, axis1=1, axis2=2)
    square = (weight * (result.network.point - result.state.point) ** 2).sum()
    return float(square), float((1.0 - weight * variance)[weight > 0].sum())


def _enlarged(old: float, square: float, redundancy: float) -> float:
    """Standard errors are enlarged only where three or more redundant numbers contradict them by more than chance (about 99.9
    %)."""
    if redundancy < 3.0:
        return old
    factor = old * np.sqrt(square / redundancy)
    return float(max(factor, 1.0)) if factor > 1.0 + 2.2 / np.sqrt(redundancy) else 1.0


def _blunders(result: Adjustment, limit: np.ndarray) -> np.ndarray:
    """The worst ray of every point whose standardised residual is beyond its `limit` (M,): one at a time, for a blunder spoils its
    neighbours."""
    worst = np.nan_to_num(np.abs(result.standardised).max(axis=1))
    highest = np.zeros(len(result.state.point))
    np.maximum.at(highest, result.rays.point, worst)
    return (worst > limit) & (worst == highest[result.rays.point])


def _enough_rays(network: Network, rays: Rays, used: np.ndarray) -> np.ndarray:
    """`used` without the rays of points that have neither two rays nor known coordinates."""
    count = np.bincount(rays.point[used], minlength=len(network.point))
    return used & ((count >= 2) | network.point_weight.any(axis=1))[rays.point]
