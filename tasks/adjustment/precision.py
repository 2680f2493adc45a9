"""Covariance of everything that was adjusted: orientations, cameras, shift, lever arm and kept points jointly; other points one by
one.

The covariance of the reduced system is the inverse of its normal matrix; in a free network with respect to the inner constraints.
Parameters that keep their value (considered, Schmidt 1966) lend their uncertainty to all others.
"""

import numpy as np
from scipy.linalg import block_diag, cho_factor, cho_solve

from schemas.errors import GeometryError
from tasks.adjustment.datum import prior_normals
from tasks.adjustment.minimise import UNDETERMINED, held, scaled
from tasks.adjustment.network import Network, State
from tasks.adjustment.normal_equations import Linear, point_precision, reduced_normals

WORST_CONDITION = 1e15


def covariance_of(network: Network, state: State, linear: Linear) -> np.ndarray:
    """(n, n): the inverse of the reduced normal matrix; with respect to the inner constraints in a free network.

    Considered parameters have no part in it (zero rows); `with_considered` adds theirs. Raises GeometryError.
    """
    normal = reduced_normals(linear, network.unknowns)[0] + prior_normals(network, state)[0]
    held(network, normal, np.zeros(len(normal)))
    matrix, scale, H = scaled(network, state, normal)
    cofactor = (inverse_of(matrix) - H @ H.T) * scale[:, None] * scale
    considered = network.considered_columns
    cofactor[considered], cofactor[:, considered] = 0.0, 0.0
    return cofactor


def inverse_of(matrix: np.ndarray) -> np.ndarray:
    """Inverse of a symmetric positive matrix with unit diagonal; its condition is judged by the norms of matrix and inverse."""
    try:
        inverse = cho_solve(cho_factor(matrix), np.eye(len(matrix)), overwrite_b=True)
    except (np.linalg.LinAlgError, ValueError):
        raise GeometryError(UNDETERMINED) from None
    if not np.isfinite(inverse).all() or np.abs(matrix).sum(axis=0).max() * np.abs(inverse).sum(axis=0).max() > WORST_CONDITION:
        raise GeometryError(UNDETERMINED)
    return inverse


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
        chosen = np.flatnonzero(free & (np.diag(weight) > 0))
        inside = np.isin(chosen, np.flatnonzero(considered))
        scale = 1.0 / np.sqrt(np.maximum(np.diag(weight)[chosen], 1e-300))
        covariance = np.linalg.inv(weight[np.ix_(chosen, chosen)] * scale[:, None] * scale) * scale[:, None] * scale
        blocks.append(covariance[np.ix_(inside, inside)])
    return block_diag(*blocks)


def points_and_rays(network: Network, linear: Linear, cofactor: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Covariance (N, 3, 3) of all points, kept ones too, and variances (M, 2) px^2 of the computed image coordinates."""
    points, adjusted = point_precision(linear, cofactor)
    for point, columns in zip(network.kept, network.kept_columns, strict=True):
        points[point] = cofactor[np.ix_(columns, columns)]
    return points, adjusted
