"""Self-calibrating bundle adjustment of photographs of boards.

Strategy. (1) Levenberg-Marquardt on the normal equations of photos, boards and interior parameters; corners of uncertain boards are
eliminated corner by corner as the points of any bundle are. Huber's weights, with the spread of the residuals as their unit, keep
wrong corners from pulling. (2) Gross blunders go; then plain least squares, and corners whose standardised residual is too
large go, until none is left. (3) sigma0 from the residuals and the redundancy; covariance is sigma0^2 N^-1.

An observation touches one photo, one board and the interior only: the normal matrix is summed from blocks, never from a matrix of
observations by unknowns. What is left after elimination is small (6 per photo) and is solved by Cholesky.

Source: Brown 1976; Baarda 1968; Kawka 2021, S11 and S12 (methods/calibration.md).
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

_SINGULAR = 1e-13
"""Least eigenvalue of the normal matrix with unit diagonal, below which double precision solves nothing."""
_NEGLIGIBLE = 1e-2
"""A gain in squares of sigma0: the last step moved no unknown by more than a tenth of its standard error, and the next one, as
steps
shrink quadratically, would move it by far less."""
_UNDETERMINED = (
    "The chessboards do not determine the camera: all photographs see them from nearly the same direction, or too few corners are "
    "left; photograph them tilted in different directions, turned by 90 degrees, and over the whole frame."
)


@dataclass(frozen=True)
class CornerTest:
    """When a corner is wrong: Huber's limit, gross limit and limit of the standardised residual, in standard errors; `floor` px
    is the least unit, so that corners free of noise are not tested against rounding."""

    huber: float = 2.5
    gross: float = 8.0
    limit: float = 4.2
    floor: float = 1e-4
    rounds: int = 12


@dataclass(frozen=True, eq=False)
class BoardAdjustment:
    """The adjusted calibration. `used` (M,) marks the corners that took part; `residual` (M, 2) px observed minus computed of all;
    `standardised` (M, 2) is NaN for those that did not. `covariance` (n, n) of the unknowns in the order of the network's columns,
    sigma0 included; `sigma0` px; `iterations` until all corners were adjusted, robustly first; `rounds` of rejections after
    that."""

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

    @property
    def interior_covariance(self) -> np.ndarray:
        """(10, 10) in the order of PARAMETERS; zero rows for parameters that were held."""
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
        """Root mean square length of the residual vectors of the corners used, px (what OpenCV reports)."""
        return float(np.sqrt((self.residual[self.used] ** 2).sum(axis=1).mean()))


def minimise(
    network: BoardNetwork, start: BoardState, corners: BoardCorners, test: CornerTest | None = None, most: int = 100
) -> tuple[BoardState, int]:
    """Levenberg-Marquardt from `start`; with `test` under Huber's weights, which stops early. Returns the state and the number of
    iterations. Raises GeometryError when the corners do not determine the unknowns, or when `most` iterations are not enough."""
    state, damping = start, 1e-4
    for iteration in range(1, most + 1):
        unit = np.inf if test is None else _unit(state, corners, test)
        limit = np.inf if test is None else test.huber * unit
        cost = _cost(network, state, corners, limit)
        linear = _linearised(network, state, corners, limit)
        trial, trial_cost, damping = _step(network, state, corners, linear, (limit, cost, damping))
        if trial is None:
            return state, iteration
        gain, state = cost - trial_cost, trial
        redundancy = max(2 * len(corners) - network.unknowns, 1)
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
    """The next state that does not cost more, its cost, and the damping it took; None when every step costs more."""
    limit, cost, damping = place
    trial, trial_cost = None, np.inf
    while damping <= 1e8:
        trial = _moved(network, state, linear, damping)
        trial_cost = np.inf if trial is None else _cost(network, trial, corners, limit)
        if trial_cost <= cost * (1.0 + 1e-12):
            return trial, trial_cost, damping
        damping = max(damping, 1e-7) * 10.0
    if trial is None:
        raise GeometryError(_UNDETERMINED)
    return None, cost, damping


def _unit(state: BoardState, corners: BoardCorners, test: CornerTest) -> float:
    return max(spread(np.linalg.norm(residuals(state, corners), axis=1)), test.floor)


def _cost(network: BoardNetwork, state: BoardState, corners: BoardCorners, limit: float) -> float:
    miss = residuals(state, corners)
    if not np.isfinite(miss).all() or (np.abs(miss) >= BEHIND).any():
        return np.inf
    return huber_cost(np.linalg.norm(miss, axis=1), limit) + float(
        (_prior_weight(network) * _prior_miss(network, state) ** 2).sum()
    )


def _prior_weight(network: BoardNetwork) -> np.ndarray:
    """(3,) px^2/m^2: weights of a board's corner when an image coordinate has weight 1."""
    sigma = np.array(network.local_sigma)
    return np.divide(network.image_sigma, sigma, out=np.zeros(3), where=sigma > 0) ** 2


def _prior_miss(network: BoardNetwork, state: BoardState) -> np.ndarray:
    return network.local[None] - state.local


def _linearised(network: BoardNetwork, state: BoardState, corners: BoardCorners, limit: float = np.inf) -> Linear:
    """Corners of exact boards stand alone, so that nothing is eliminated; those of uncertain boards are points of the bundle."""
    row, columns = network.columns_of(corners)
    by_unknowns, by_corner = derivatives(state, corners)
    miss = residuals(state, corners)
    touched = (columns >= 0).any(axis=0)
    weight = huber_weights(np.linalg.norm(miss, axis=1), limit)
    if not network.uncertain:
        groups, prior, prior_miss = len(corners), np.zeros((len(corners), 3)), np.zeros((len(corners), 3))
        first, by_corner = np.arange(groups + 1), np.zeros_like(by_corner)
    else:
        boards, count = state.local.shape[:2]
        point = corners.board * count + corners.corner
        if (np.diff(point) < 0).any():
            raise ValueError("corners of uncertain boards come board after board, corner after corner")
        first = np.searchsorted(point, np.arange(boards * count + 1))
        weights = _prior_weight(network)
        held = weights == 0
        by_corner = np.where(held, 0.0, by_corner)
        prior = np.broadcast_to(np.where(held, 1.0, weights), (boards * count, 3)).copy()
        prior_miss = np.where(held, 0.0, _prior_miss(network, state)).reshape(-1, 3)
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


def _pattern(network: BoardNetwork, linear: Linear) -> Pattern:
    return seen_pattern(linear, network.group_start)


def _moved(network: BoardNetwork, state: BoardState, linear: Linear, damping: float) -> BoardState | None:
    """The state after one damped step; None where the normal equations are singular at this damping."""
    normals = reduced_normals(linear, _pattern(network, linear), damping)
    normal, right = normals.matrix.dense(), normals.right
    normal[np.diag_indices_from(normal)] += damping * normals.diagonal
    scale = 1.0 / np.sqrt(np.maximum(np.diag(normal), 1e-300))
    try:
        correction = scale * cho_solve(cho_factor(normal * scale[:, None] * scale), scale * right)
    except (np.linalg.LinAlgError, ValueError):
        return None
    points = point_corrections(linear, correction, damping) if network.uncertain else None
    return _corrected(network, state, correction, points)


def _corrected(network: BoardNetwork, state: BoardState, correction: np.ndarray, points: np.ndarray | None) -> BoardState:
    padded = np.append(correction, 0.0)
    photo, board = padded[network.photo_columns], padded[network.board_columns]
    local = state.local if points is None else state.local + points.reshape(state.local.shape)
    return BoardState(
        _turned(state.rotation, photo[:, 3:]), state.centre + photo[:, :3], _turned(state.turn, board[:, 3:]),
        state.shift + board[:, :3], local, state.interior + padded[network.interior_columns],
    )  # fmt: skip


def _turned(rotations: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    return np.array([rotation_of_vector(w) @ R for w, R in zip(vectors, rotations, strict=True)])


def adjust(network: BoardNetwork, start: BoardState, corners: BoardCorners, test: CornerTest | None = None) -> BoardAdjustment:
    """The adjusted calibration with tested corners and its covariance.

    Corners of uncertain boards have to come board after board, corner after corner. Raises GeometryError when the corners do not
    determine the unknowns, or the adjustment does not converge.
    """
    test = test or CornerTest()
    state, iterations = minimise(network, start, corners, test)
    size = np.linalg.norm(residuals(state, corners), axis=1)
    used = size <= test.gross * max(spread(size), test.floor)
    for rounds in range(test.rounds):
        state, steps = minimise(network, state, corners.take(used))
        iterations += 0 if rounds else steps
        result = replace(_account(network, state, corners, used, iterations), rounds=rounds)
        bad = np.nan_to_num(np.abs(result.standardised).max(axis=1), nan=0.0) > test.limit
        bad &= np.abs(result.residual).max(axis=1) > test.floor
        if not bad.any():
            break
        used = used & ~bad
    return result


def _account(network: BoardNetwork, state: BoardState, corners: BoardCorners, used: np.ndarray, iterations: int) -> BoardAdjustment:
    """Covariance, redundancy and standardised residuals at the solution."""
    taken = corners.take(used)
    linear = _linearised(network, state, taken)
    pattern = _pattern(network, linear)
    cofactor = _inverse(reduced_normals(linear, pattern).matrix.dense())
    _, adjusted = point_precision(linear, BlockMatrix.of(pattern, cofactor))
    redundancy = 2 * len(taken) - network.unknowns
    if redundancy <= 0:
        raise GeometryError(_UNDETERMINED)
    sigma0 = float(np.sqrt(_cost(network, state, taken, np.inf) / redundancy))
    residual, standardised = residuals(state, corners), np.full((len(corners), 2), np.nan)
    standardised[used] = residual[used] / (max(sigma0, 1e-12) * np.sqrt(np.clip(1.0 - adjusted, 1e-3, None)))
    return BoardAdjustment(
        network, state, corners, used, residual, standardised, sigma0**2 * cofactor, sigma0, redundancy, iterations
    )


def _inverse(normal: np.ndarray) -> np.ndarray:
    """Inverse of the normal matrix. Raises GeometryError where it has none worth the name."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(normal), 1e-300))
    scaled = normal * scale[:, None] * scale
    if not np.isfinite(scaled).all():
        raise GeometryError(_UNDETERMINED)
    values, vectors = np.linalg.eigh(scaled)
    if values[0] < _SINGULAR * values[-1]:
        raise GeometryError(_UNDETERMINED)
    return (vectors / values) @ vectors.T * scale[:, None] * scale
