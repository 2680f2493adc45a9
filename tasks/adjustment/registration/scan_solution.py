"""Least squares of the joint registration: all scans and points together, and the precision of everything adjusted.

The normal matrix of a point is diagonal, because errors of a scanned point are alike in all directions: points are eliminated
first, and what remains has six unknowns per scan. Rotations are corrected about the middle of the points of each scan, where they
are nearly free of correlation with its shift.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from orthomill.schemas.errors import GeometryError
from orthomill.tasks.adjustment.model.robust_weights import huber_weights
from orthomill.tasks.adjustment.registration.scan_network import ScannedPoints, ScanNetwork, ScanState

STEPS = 50
"""Most iterations of one solution; plain ones take three or four, robust ones twice as many."""
NEGLIGIBLE = 1e-4
"""A step is negligible that moves no point by more, in units of its standard error."""
_SINGULAR = 1e-13
"""Least eigenvalue of the normal matrix with unit diagonal, in units of the largest, below which it is singular."""


@dataclass(frozen=True, eq=False)
class ScanPrecision:
    """Cofactors of the unknowns with the stated weights: `scans` (6 S, 6 S) of shifts and rotation vectors `about` (S, 3), `points`
    (P, 3, 3) and `adjusted` (M, 3, 3) of the misfits as computed, along the axes of the control system."""

    scans: np.ndarray
    about: np.ndarray
    points: np.ndarray
    adjusted: np.ndarray


@dataclass(frozen=True, eq=False)
class _ScanNormals:
    """Normal equations with the points eliminated: `matrix` (6 S, 6 S) and `right` (6 S,); of the points the inverse `diagonal`
    (P, 3), `across` (P, 3, 6 S) to the scans and `side` (P, 3); derivatives `lever` (M, 3, 6) of placed points by their scan."""

    matrix: np.ndarray
    right: np.ndarray
    diagonal: np.ndarray
    across: np.ndarray
    side: np.ndarray
    lever: np.ndarray


def solve(network: ScanNetwork, start: ScanState, points: ScannedPoints, huber: float = np.inf) -> tuple[ScanState, int]:
    """The solution from a start nearby, under Huber's weights with a limit of `huber` standard errors, and its iterations.

    Raises GeometryError where points do not determine the scans, or the solution does not converge.
    """
    state, smallest = start, float(points.sigma.min())
    for iteration in range(1, STEPS + 1):
        size = np.linalg.norm(state.misfits(points), axis=1) / points.sigma
        known = np.sqrt(network.weight * (network.control - state.point) ** 2).max(axis=1)
        weighted = replace(network, weight=network.weight * huber_weights(known, huber)[:, None])
        weakened = replace(points, sigma=points.sigma / np.sqrt(huber_weights(size, huber)))
        about = _middles(network, state, points)
        reduced = _reduced(weighted, state, weakened, about)
        scans = _solved(network, reduced)
        moves = reduced.diagonal * (reduced.side - reduced.across @ scans)
        state = state.moved(scans.reshape(-1, 6), moves, about)
        # Robust weights change as long as points move: a hundredth of a standard error decides no test.
        if np.abs(moves).max() <= (NEGLIGIBLE if huber == np.inf else 100.0 * NEGLIGIBLE) * smallest:
            return state, iteration
    raise GeometryError(
        f"The joint registration of the scans did not converge in {STEPS} iterations: too many of the common points contradict "
        "each other; compare the names of the targets in the scans."
    )


def precision_of(network: ScanNetwork, state: ScanState, points: ScannedPoints) -> ScanPrecision:
    """Cofactors at a solution."""
    about = _middles(network, state, points)
    reduced = _reduced(network, state, points, about)
    Q = np.zeros_like(reduced.matrix)
    moving = np.flatnonzero(network.moving)
    Q[np.ix_(moving, moving)] = np.linalg.inv(reduced.matrix[np.ix_(moving, moving)])
    Z = reduced.diagonal[:, :, None] * reduced.across
    ZQ = Z @ Q
    of_points = ZQ @ Z.transpose(0, 2, 1) + reduced.diagonal[:, :, None] * np.eye(3)
    columns = 6 * points.scan[:, None] + np.arange(6)
    own, between = Q[columns[:, :, None], columns[:, None, :]], np.take_along_axis(ZQ[points.point], columns[:, None, :], axis=2)
    turned = reduced.lever.transpose(0, 2, 1)
    # The misfit is the point minus the placed one; point and scan are correlated with -Z Q.
    mixed = between @ turned
    adjusted = of_points[points.point] + reduced.lever @ own @ turned + mixed + mixed.transpose(0, 2, 1)
    return ScanPrecision(Q, about, of_points, adjusted)


def _middles(network: ScanNetwork, state: ScanState, points: ScannedPoints) -> np.ndarray:
    """(S, 3) m: the centroid of the points of each scan, as placed."""
    placed, out = state.placed(points), np.zeros((network.scans, 3))
    np.add.at(out, points.scan, placed)
    return out / np.maximum(np.bincount(points.scan, minlength=network.scans), 1)[:, None]


def _reduced(network: ScanNetwork, state: ScanState, points: ScannedPoints, about: np.ndarray) -> _ScanNormals:
    weight, misfit = points.sigma**-2.0, state.misfits(points)
    arm = state.placed(points) - about[points.scan]
    lever = np.zeros((len(points), 3, 6))
    lever[:, :, :3] = np.eye(3)
    # A rotation vector w moves the placed point by w x arm.
    lever[:, [0, 1, 2], [4, 5, 3]] = arm[:, [2, 0, 1]]
    lever[:, [0, 1, 2], [5, 3, 4]] = -arm[:, [1, 2, 0]]
    known = network.weight.copy()
    side = known * (network.control - state.point)
    np.add.at(known, points.point, np.broadcast_to(weight[:, None], (len(points), 3)))
    np.add.at(side, points.point, -weight[:, None] * misfit)
    # A point that no scan shows any more keeps its place.
    inverse = np.divide(1.0, known, out=np.zeros_like(known), where=known > 0)
    size = 6 * network.scans
    across = np.zeros((network.points, 3, size))
    columns = 6 * points.scan[:, None] + np.arange(6)
    rows = points.point[:, None, None], np.arange(3)[None, :, None], columns[:, None, :]
    np.add.at(across, rows, -weight[:, None, None] * lever)
    matrix, right = np.zeros((size, size)), np.zeros(size)
    np.add.at(matrix, (columns[:, :, None], columns[:, None, :]), weight[:, None, None] * lever.transpose(0, 2, 1) @ lever)
    np.add.at(right, columns, weight[:, None] * np.einsum("mij,mi->mj", lever, misfit))
    flat = across.reshape(-1, size)
    matrix -= flat.T @ (inverse.reshape(-1, 1) * flat)
    right -= flat.T @ (inverse * side).ravel()
    return _ScanNormals(matrix, right, inverse, across, side, lever)


def _solved(network: ScanNetwork, reduced: _ScanNormals) -> np.ndarray:
    """(6 S,) corrections of the scans."""
    moving = np.flatnonzero(network.moving)
    out = np.zeros(len(reduced.right))
    if not len(moving):
        return out
    normal = reduced.matrix[np.ix_(moving, moving)]
    scale = 1.0 / np.sqrt(np.maximum(np.diag(normal), 1e-300))
    scaled = normal * scale[:, None] * scale
    eigenvalues = np.linalg.eigvalsh(scaled) if np.isfinite(scaled).all() else np.zeros(1)
    if eigenvalues[0] <= _SINGULAR * eigenvalues[-1]:
        raise GeometryError(
            "The common points do not determine the place of every scan: some have too few points left, or only such as lie on one "
            "line; measure more targets in them, well distributed."
        )
    out[moving] = scale * cho_solve(cho_factor(scaled), scale * reduced.right[moving])
    return out
