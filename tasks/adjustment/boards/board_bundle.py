"""Self-calibrating bundle adjustment of photographs of boards.

Strategy. (1) Levenberg-Marquardt on the normal equations of photographs, boards and interior parameters; corners of uncertain
boards are eliminated like the points of any bundle. Huber's weights, with the spread of the residuals as unit, limit the influence
of wrong corners. (2) Gross blunders are rejected; then plain least squares, and corners whose standardised residual is too large
are rejected, until none is left. (3) sigma0 from the residuals and the redundancy; the covariance is sigma0^2 N^-1.

An observation depends on one photograph, one board and the interior orientation only: the normal matrix is summed from blocks, not
from a matrix of observations by unknowns. The reduced system is small (6 unknowns per photograph) and solved by Cholesky.

Source: Brown 1976; Baarda 1968; Kawka 2021, S11 and S12 (sources/calibration.md).
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from orthomill.schemas.errors import GeometryError
from orthomill.tasks.adjustment.boards.board_network import PARAMETERS, BoardCorners, BoardNetwork, BoardState
from orthomill.tasks.adjustment.boards.board_projection import BEHIND, derivatives, residuals
from orthomill.tasks.adjustment.model.linearisation import Linear, seen_pattern
from orthomill.tasks.adjustment.model.robust_weights import huber_cost, huber_weights, spread
from orthomill.tasks.adjustment.solve.normal_equations import point_corrections, point_precision, reduced_normals
from orthomill.tasks.adjustment.sparse.block_matrix import BlockMatrix, Pattern
from orthomill.tasks.geometry.rotation_vector import rotation_of_vector

# Rounding of the sums of some thousand observations; boards seen from one direction stay below it.
_SINGULAR = 1e-13
"""Least eigenvalue of the normal matrix with unit diagonal, in units of the largest, below which it is singular."""
_ROUNDING = 1e-15
"""Least eigenvalue that rounding leaves of a zero, in the same units."""
# A step that gains s0^2 / 100 moves no unknown by more than a tenth of its standard error; the next one is quadratically smaller.
_NEGLIGIBLE = 1e-2
"""Gain, in units of sigma0 squared, at which the adjustment has converged."""
_UNDETERMINED = (
    "The chessboards do not determine the camera: all photographs see them from nearly the same direction, or too few corners are "
    "left; photograph them tilted in different directions, turned by 90 degrees, and over the whole frame."
)


@dataclass(frozen=True)
class CornerTest:
    """Limits of the blunder test of corners: Huber's, the gross one, and that of the standardised residual, in standard errors;
    `floor` px is the least unit, so that corners free of noise are not tested against rounding; `rounds` of rejection."""

    huber: float = 2.5
    gross: float = 8.0
    limit: float = 4.2
    floor: float = 1e-4
    rounds: int = 12


@dataclass(frozen=True, eq=False)
class BoardAdjustment:
    """The adjusted calibration. `used` (M,) marks the corners that took part; `residual` (M, 2) px, observed minus computed, is
    that of all; `standardised` (M, 2) is NaN for corners that took no part. `covariance` (n, n) of the unknowns in the order of
    the network's columns, sigma0 included; `sigma0` px; `iterations` of the robust and the first plain solution; `rounds` of
    rejection after that; `correlated`: the factor in the covariance for corners that err together, 1 for independent ones;
    `doubted` (17, 17): the covariance of the interior parameters with the doubt of the lens model; None: no such doubt."""

    network: BoardNetwork
    state: BoardState
    corners: BoardCorners
    used: np.ndarray
    residual: np.ndarray
    standardised: np.ndarray
    covariance: np.ndarray
    sigma0: float
    redundancy: int
    iterations: int
    rounds: int = 0
    correlated: float = 1.0
    doubted: np.ndarray | None = None

    def with_correlated_corners(self, factor: float) -> "BoardAdjustment":
        """With standard errors `factor` times as large, as corners of one photograph err together."""
        return replace(self, covariance=factor**2 * self.covariance, correlated=factor)

    def with_interior_covariance(self, covariance: np.ndarray) -> "BoardAdjustment":
        """With another covariance (17, 17) of the interior parameters in the order of PARAMETERS, those that are fixed included."""
        columns = self.network.interior_columns
        known = np.flatnonzero(columns >= 0)
        own = self.covariance.copy()
        own[np.ix_(columns[known], columns[known])] = covariance[np.ix_(known, known)]
        return replace(self, covariance=own, doubted=covariance)

    @property
    def interior_covariance(self) -> np.ndarray:
        """(17, 17) in the order of PARAMETERS; zero rows for parameters that are fixed beyond doubt."""
        if self.doubted is not None:
            return self.doubted
        columns = self.network.interior_columns
        known = np.flatnonzero(columns >= 0)
        out = np.zeros((len(PARAMETERS), len(PARAMETERS)))
        out[np.ix_(known, known)] = self.covariance[np.ix_(columns[known], columns[known])]
        return out

    @property
    def correlation(self) -> np.ndarray:
        """(n, n) of all unknowns."""
        scale = 1.0 / np.sqrt(np.maximum(np.diag(self.covariance), 1e-300))
        return self.covariance * scale[:, None] * scale

    @property
    def rms(self) -> float:
        """Root mean square length of the residual vectors of the corners used, px (the figure that OpenCV reports)."""
        return float(np.sqrt((self.residual[self.used] ** 2).sum(axis=1).mean()))


def minimise(
    network: BoardNetwork, start: BoardState, corners: BoardCorners, test: CornerTest | None = None, most: int = 100
) -> tuple[BoardState, int]:
    """Levenberg-Marquardt from `start`; with a `test` under Huber's weights, and then with a looser end. Returns the state and the
    number of iterations. Raises GeometryError when the corners do not determine the unknowns, or `most` iterations do not
    converge."""
    state, damping = start, 1e-4
    for iteration in range(1, most + 1):
        unit = np.inf if test is None else _unit(state, corners, test)
        # The unit follows the residuals: starting values from homographies are off by tens of pixels.
        limit = np.inf if test is None else test.huber * unit
        cost = _cost(network, state, corners, limit)
        linear = _linearised(network, state, corners, limit)
        trial, trial_cost, damping = _step(network, state, corners, linear, (limit, cost, damping))
        if trial is None:
            return state, iteration
        gain, state = cost - trial_cost, trial
        redundancy = max(2 * len(corners) - network.unweighted, 1)
        enough = _NEGLIGIBLE * trial_cost / redundancy if test is None else 0.01 * trial_cost
        rounding = 1e-14 * len(corners)
        if trial_cost <= rounding or (gain <= enough + rounding and damping <= 1e-2):
            return state, iteration
        damping = damping * 0.1 if damping > 1e-9 else 0.0
    raise GeometryError(
        f"The calibration from chessboards did not converge in {most} iterations; photograph boards tilted in "
        "different directions and over the whole frame."
    )


def _step(
    network: BoardNetwork, state: BoardState, corners: BoardCorners, linear: Linear, place: tuple[float, float, float]
) -> tuple[BoardState | None, float, float]:
    """The next state that does not cost more, its cost, and its damping; None when every step costs more. `place` = (limit, cost,
    damping) of the present one."""
    limit, cost, damping = place
    trial, trial_cost = None, np.inf
    while damping <= 1e8:
        trial = _moved(network, state, linear, damping)
        trial_cost = np.inf if trial is None else _cost(network, trial, corners, limit)
        if trial_cost <= cost * (1.0 + 1e-12):
            return trial, trial_cost, damping
        # Below 1e-7 damping changes nothing: growing from there spares a dozen useless solutions.
        damping = max(damping, 1e-7) * 10.0
    if trial is None:
        raise GeometryError(_UNDETERMINED)
    return None, cost, damping


def _unit(state: BoardState, corners: BoardCorners, test: CornerTest) -> float:
    """The spread of the residuals, px."""
    return max(spread(np.linalg.norm(residuals(state, corners), axis=1)), test.floor)


def _cost(network: BoardNetwork, state: BoardState, corners: BoardCorners, limit: float) -> float:
    """Huber's losses of the corners and the square sum of the prior information, px^2; inf with a corner behind its camera."""
    miss = residuals(state, corners)
    if not np.isfinite(miss).all() or (np.abs(miss) >= BEHIND).any():
        return np.inf
    known = float((_prior_weight(network) * _prior_miss(network, state) ** 2).sum())
    return (
        huber_cost(np.linalg.norm(miss, axis=1), limit) + known + _bend_weight(network) * float((_bends(network, state) ** 2).sum())
    )


def _prior_weight(network: BoardNetwork) -> np.ndarray:
    """(3,) px^2/m^2: weights of the nominal corner coordinates where an image coordinate has weight 1."""
    sigma = np.array(network.local_sigma)
    return np.divide(network.image_sigma, sigma, out=np.zeros(3), where=sigma > 0) ** 2


def _prior_miss(network: BoardNetwork, state: BoardState) -> np.ndarray:
    return network.local[None] - state.local


def _bend_weight(network: BoardNetwork) -> float:
    """px^2/m^2: weight of a flat board where an image coordinate has weight 1."""
    return (network.image_sigma / network.bend_sigma) ** 2 if network.bends else 0.0


def _bends(network: BoardNetwork, state: BoardState) -> np.ndarray:
    """(K S,) m: the bends that are unknowns."""
    return state.bend.value.ravel() if network.bends and state.bend is not None else np.empty(0)


def _flattened(network: BoardNetwork, normal: np.ndarray) -> np.ndarray:
    """The normal matrix with the observations that boards are flat."""
    columns = network.bend_columns.ravel()
    normal[columns, columns] += _bend_weight(network)
    return normal


def _linearised(network: BoardNetwork, state: BoardState, corners: BoardCorners, limit: float = np.inf) -> Linear:
    """The linearised bundle: every corner of exact boards is a point without derivatives, so that nothing is eliminated; corners of
    uncertain boards are points with prior coordinates.

    Raises ValueError where the corners of uncertain boards are not in order.
    """
    row, columns = network.columns_of(corners)
    by_unknowns, by_corner = derivatives(state, corners)
    miss = residuals(state, corners)
    # Known bends have derivatives, and no columns.
    by_unknowns, touched = by_unknowns[:, :, : columns.shape[1]], (columns >= 0).any(axis=0)
    weight = huber_weights(np.linalg.norm(miss, axis=1), limit)
    if network.uncertain:
        first, by_corner, prior, prior_miss = _uncertain_corners(network, state, corners, by_corner)
    else:
        prior = prior_miss = np.zeros((len(corners), 3))
        first, by_corner = np.arange(len(corners) + 1), np.zeros_like(by_corner)
    return Linear(
        first.astype(np.int64),
        row,
        np.ascontiguousarray(columns[:, touched]),
        np.ascontiguousarray(by_unknowns[:, :, touched]),
        by_corner,
        miss,
        weight,
        prior,
        prior_miss,
        np.tile(np.eye(3), (len(first) - 1, 1, 1)),
    )


def _uncertain_corners(
    network: BoardNetwork, state: BoardState, corners: BoardCorners, by_corner: np.ndarray
) -> tuple[np.ndarray, ...]:
    """`first` of the corners as points, their derivatives, prior weights and prior residuals."""
    boards, count = state.local.shape[:2]
    point = corners.board * count + corners.corner
    if (np.diff(point) < 0).any():
        raise ValueError("corners of uncertain boards have to come board after board, corner after corner")
    weights = _prior_weight(network)
    # A coordinate without error keeps its value: without derivatives, and with a weight of 1 that keeps its block regular.
    fixed = weights == 0
    prior = np.broadcast_to(np.where(fixed, 1.0, weights), (boards * count, 3)).copy()
    prior_miss = np.where(fixed, 0.0, _prior_miss(network, state)).reshape(-1, 3)
    first = np.searchsorted(point, np.arange(boards * count + 1))
    return first, np.where(fixed, 0.0, by_corner), prior, prior_miss


def _pattern(network: BoardNetwork, linear: Linear) -> Pattern:
    return seen_pattern(linear, network.group_start)


def _moved(network: BoardNetwork, state: BoardState, linear: Linear, damping: float) -> BoardState | None:
    """The state after one damped step; None where the normal equations are singular at this damping."""
    normals = reduced_normals(linear, _pattern(network, linear), damping)
    normal, right = _flattened(network, normals.matrix.dense()), normals.right.copy()
    right[network.bend_columns.ravel()] -= _bend_weight(network) * _bends(network, state)
    normal[np.diag_indices_from(normal)] += damping * normals.diagonal
    scale = 1.0 / np.sqrt(np.maximum(np.diag(normal), 1e-300))
    try:
        correction = scale * cho_solve(cho_factor(normal * scale[:, None] * scale), scale * right)
    except (np.linalg.LinAlgError, ValueError):
        return None
    points = point_corrections(linear, correction, damping) if network.uncertain else None
    return _corrected(network, state, correction, points)


def _corrected(network: BoardNetwork, state: BoardState, correction: np.ndarray, points: np.ndarray | None) -> BoardState:
    # Column -1, for what is fixed, is the zero at the end.
    padded = np.append(correction, 0.0)
    photo, board = padded[network.photo_columns], padded[network.board_columns]
    local = state.local if points is None else state.local + points.reshape(state.local.shape)
    return BoardState(
        rotation=_turned(state.rotation, photo[:, 3:]),
        centre=state.centre + photo[:, :3],
        turn=_turned(state.turn, board[:, 3:]),
        shift=state.shift + board[:, :3],
        local=local,
        interior=state.interior + padded[network.interior_columns],
        lens=state.lens,
        bend=state.bend.moved(padded[network.bend_columns]) if network.bends and state.bend is not None else state.bend,
    )


def _turned(rotations: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    return np.array([rotation_of_vector(w) @ R for w, R in zip(vectors, rotations, strict=True)])


def adjust(network: BoardNetwork, start: BoardState, corners: BoardCorners, test: CornerTest | None = None) -> BoardAdjustment:
    """The adjusted calibration with tested corners and its covariance.

    Corners of uncertain boards have to come board after board, corner after corner. Raises GeometryError when the corners do not
    determine the unknowns, or the adjustment does not converge.
    """
    test = test or CornerTest()
    state, iterations = minimise(network, start, corners, test)
    # With the spread of all corners as unit: up to half of them may be wrong.
    size = np.linalg.norm(residuals(state, corners), axis=1)
    used = size <= test.gross * max(spread(size), test.floor)
    for rounds in range(test.rounds):
        state, steps = minimise(network, state, corners.take(used))
        iterations += 0 if rounds else steps
        result = replace(_tested(network, state, corners, used, iterations), rounds=rounds)
        bad = np.nan_to_num(np.abs(result.standardised).max(axis=1), nan=0.0) > test.limit
        # Nearly perfect corners have standardised residuals of mere rounding.
        bad &= np.abs(result.residual).max(axis=1) > test.floor
        if not bad.any():
            break
        used = used & ~bad
    return result


def _tested(network: BoardNetwork, state: BoardState, corners: BoardCorners, used: np.ndarray, iterations: int) -> BoardAdjustment:
    """Covariance, redundancy and standardised residuals at the solution."""
    taken = corners.take(used)
    linear = _linearised(network, state, taken)
    pattern = _pattern(network, linear)
    normal = _flattened(network, reduced_normals(linear, pattern).matrix.dense())
    cofactor = _inverse(normal, _geometry_columns(network))
    _, adjusted = point_precision(linear, BlockMatrix.of(pattern, cofactor))
    redundancy = 2 * len(taken) - network.unweighted
    if redundancy <= 0:
        raise GeometryError(_UNDETERMINED)
    sigma0 = float(np.sqrt(_cost(network, state, taken, np.inf) / redundancy))
    # Of all corners, rejected ones included: reports show where those are.
    residual, standardised = residuals(state, corners), np.full((len(corners), 2), np.nan)
    standardised[used] = residual[used] / (max(sigma0, 1e-12) * np.sqrt(np.clip(1.0 - adjusted, 1e-3, None)))
    return BoardAdjustment(
        network, state, corners, used, residual, standardised, sigma0**2 * cofactor, sigma0, redundancy, iterations
    )


def _geometry_columns(network: BoardNetwork) -> np.ndarray:
    """(n,) bool: the unknowns that the geometry of the photographs has to determine. The coefficients of a radial curve replace
    each other (those of a quotient of polynomials to the twelfth digit) without any harm to the curve."""
    radial = [PARAMETERS.index(name) for name in ("k2", "k3", "k4", "k5", "k6")]
    own = network.interior_columns[radial]
    out = np.ones(network.unknowns, bool)
    out[own[own >= 0]] = False
    return out


def _inverse(normal: np.ndarray, judged: np.ndarray) -> np.ndarray:
    """Inverse of the normal matrix. Raises GeometryError where it is singular within rounding for the unknowns `judged` (n,)."""
    # By its eigenvalues, because a Cholesky factor of a nearly singular matrix exists and gives huge, arbitrary standard errors.
    scale = 1.0 / np.sqrt(np.maximum(np.diag(normal), 1e-300))
    scaled = normal * scale[:, None] * scale
    if not np.isfinite(scaled).all():
        raise GeometryError(_UNDETERMINED)
    least = np.linalg.eigvalsh(scaled[np.ix_(judged, judged)])
    if least[0] < _SINGULAR * least[-1]:
        raise GeometryError(_UNDETERMINED)
    values, vectors = np.linalg.eigh(scaled)
    values = np.maximum(values, _ROUNDING * values[-1])
    return (vectors / values) @ vectors.T * scale[:, None] * scale
