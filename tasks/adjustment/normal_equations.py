"""Normal equations of a bundle with the points eliminated (Schur's complement), and the way back to points and their precision.

A point touches only the photographs that see it, so that its 3 x 3 block is inverted on the spot and its part of the reduced
system added; nothing of the size (points x photos) is ever stored. All sums over pairs of rays are bilinear: rays need not be
merged by photo or camera before.

Source: Brown 1976, "The bundle adjustment: progress and prospects"; Triggs et al. 2000, section 6.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit

from tasks.adjustment.collinearity import derivatives, misclosures
from tasks.adjustment.network import Network, Rays, State, ray_columns


@dataclass(frozen=True, eq=False)
class Linear:
    """A linearised bundle: derivatives `jg` (M, 2, k), `jp` (M, 2, 3), `columns` (M, k), misclosures (M, 2), `weight` (M,) 1/px^2,
    `first` (N + 1,), and the points' own prior: weights and misclosures (N, 3)."""

    first: np.ndarray
    columns: np.ndarray
    jg: np.ndarray
    jp: np.ndarray
    misclosure: np.ndarray
    weight: np.ndarray
    point_weight: np.ndarray
    point_misclosure: np.ndarray


def linearised(network: Network, state: State, rays: Rays, factor: np.ndarray | float = 1.0) -> Linear:
    """The observations linearised at `state`; `factor` (M,) are robust factors of the weights."""
    columns = ray_columns(network, rays)
    jg, jp = derivatives(state, rays, network.camera_of)
    used = (columns >= 0).any(axis=0)
    return Linear(
        rays.first(len(state.point)),
        np.ascontiguousarray(columns[:, used]),
        np.ascontiguousarray(jg[:, :, used]),
        jp,
        misclosures(state, rays, network.camera_of),
        factor / rays.sigma**2,
        network.point_weight,
        network.point - state.point,
    )


@njit(cache=True)
def _invert(V, out):
    """Inverse of a symmetric 3 x 3 matrix; zero (a point that does not move) when it is singular."""
    c00 = V[1, 1] * V[2, 2] - V[1, 2] * V[1, 2]
    c01 = V[0, 2] * V[1, 2] - V[0, 1] * V[2, 2]
    c02 = V[0, 1] * V[1, 2] - V[0, 2] * V[1, 1]
    det = V[0, 0] * c00 + V[0, 1] * c01 + V[0, 2] * c02
    if det <= 1e-18 * V[0, 0] * V[1, 1] * V[2, 2] or det <= 0.0:
        out[:] = 0.0
        return
    out[0, 0], out[0, 1], out[0, 2] = c00 / det, c01 / det, c02 / det
    out[1, 1] = (V[0, 0] * V[2, 2] - V[0, 2] * V[0, 2]) / det
    out[1, 2] = (V[0, 1] * V[0, 2] - V[0, 0] * V[1, 2]) / det
    out[2, 2] = (V[0, 0] * V[1, 1] - V[0, 1] * V[0, 1]) / det
    out[1, 0], out[2, 0], out[2, 1] = out[0, 1], out[0, 2], out[1, 2]


@njit(cache=True)
def _point_block(point, first, jp, misclosure, weight, prior_weight, prior_misclosure, damping, V, right):
    V[:] = 0.0
    for a in range(3):
        V[a, a] = prior_weight[point, a]
        right[a] = prior_weight[point, a] * prior_misclosure[point, a]
    for i in range(first[point], first[point + 1]):
        for k in range(2):
            for a in range(3):
                right[a] += weight[i] * jp[i, k, a] * misclosure[i, k]
                for b in range(3):
                    V[a, b] += weight[i] * jp[i, k, a] * jp[i, k, b]
    for a in range(3):
        V[a, a] *= 1.0 + damping


@njit(cache=True)
def _cross(i, jg, jp, weight, W):
    """W (k, 3): the block between the unknowns of ray i and its point."""
    for a in range(jg.shape[2]):
        for b in range(3):
            W[a, b] = weight[i] * (jg[i, 0, a] * jp[i, 0, b] + jg[i, 1, a] * jp[i, 1, b])


@njit(cache=True)
def _reduced(first, columns, jg, jp, misclosure, weight, prior_weight, prior_misclosure, damping, unknowns):
    normal = np.zeros((unknowns, unknowns))
    right = np.zeros(unknowns)
    diagonal = np.zeros(unknowns)
    k = jg.shape[2]
    V, inverse, vb, y = np.empty((3, 3)), np.empty((3, 3)), np.empty(3), np.empty(3)
    longest = 0
    for point in range(len(first) - 1):
        longest = max(longest, first[point + 1] - first[point])
    W, Z = np.empty((longest, k, 3)), np.empty((longest, k, 3))
    for point in range(len(first) - 1):
        start, stop = first[point], first[point + 1]
        if start == stop:
            continue
        _point_block(point, first, jp, misclosure, weight, prior_weight, prior_misclosure, damping, V, vb)
        _invert(V, inverse)
        y[:] = inverse @ vb
        for i in range(start, stop):
            _cross(i, jg, jp, weight, W[i - start])
            for a in range(k):
                for b in range(3):
                    Z[i - start, a, b] = (
                        W[i - start, a, 0] * inverse[0, b] + W[i - start, a, 1] * inverse[1, b] + W[i - start, a, 2] * inverse[2, b]
                    )
        for i in range(start, stop):
            for a in range(k):
                ca = columns[i, a]
                if ca < 0:
                    continue
                right[ca] += weight[i] * (jg[i, 0, a] * misclosure[i, 0] + jg[i, 1, a] * misclosure[i, 1])
                right[ca] -= W[i - start, a, 0] * y[0] + W[i - start, a, 1] * y[1] + W[i - start, a, 2] * y[2]
                for b in range(k):
                    if columns[i, b] >= 0:
                        term = weight[i] * (jg[i, 0, a] * jg[i, 0, b] + jg[i, 1, a] * jg[i, 1, b])
                        normal[ca, columns[i, b]] += term
                        if a == b:
                            diagonal[ca] += term
                for j in range(start, stop):
                    for b in range(k):
                        cb = columns[j, b]
                        if cb >= 0:
                            normal[ca, cb] -= (
                                Z[i - start, a, 0] * W[j - start, b, 0]
                                + Z[i - start, a, 1] * W[j - start, b, 1]
                                + Z[i - start, a, 2] * W[j - start, b, 2]
                            )
    return normal, right, diagonal


@njit(cache=True)
def _back(first, columns, jg, jp, misclosure, weight, prior_weight, prior_misclosure, damping, correction):
    out = np.zeros((len(first) - 1, 3))
    V, inverse, vb, W = np.empty((3, 3)), np.empty((3, 3)), np.empty(3), np.empty((jg.shape[2], 3))
    for point in range(len(first) - 1):
        if first[point] == first[point + 1]:
            continue
        _point_block(point, first, jp, misclosure, weight, prior_weight, prior_misclosure, damping, V, vb)
        _invert(V, inverse)
        for i in range(first[point], first[point + 1]):
            _cross(i, jg, jp, weight, W)
            for a in range(jg.shape[2]):
                if columns[i, a] >= 0:
                    for b in range(3):
                        vb[b] -= W[a, b] * correction[columns[i, a]]
        out[point] = inverse @ vb
    return out


@njit(cache=True)
def _precision(first, columns, jg, jp, misclosure, weight, prior_weight, prior_misclosure, cofactor):
    points = np.zeros((len(first) - 1, 3, 3))
    adjusted = np.zeros((len(weight), 2))
    k = jg.shape[2]
    V, inverse, vb, W = np.empty((3, 3)), np.empty((3, 3)), np.empty(3), np.empty((k, 3))
    longest = 0
    for point in range(len(first) - 1):
        longest = max(longest, first[point + 1] - first[point])
    Z, QZ = np.empty((longest, k, 3)), np.empty((longest, k, 3))
    for point in range(len(first) - 1):
        start, stop = first[point], first[point + 1]
        if start == stop:
            continue
        _point_block(point, first, jp, misclosure, weight, prior_weight, prior_misclosure, 0.0, V, vb)
        _invert(V, inverse)
        for i in range(start, stop):
            _cross(i, jg, jp, weight, W)
            Z[i - start] = W @ inverse
        Q = inverse.copy()
        for i in range(start, stop):
            for a in range(k):
                QZ[i - start, a] = 0.0
                ca = columns[i, a]
                if ca < 0:
                    continue
                for j in range(start, stop):
                    for b in range(k):
                        if columns[j, b] >= 0:
                            q = cofactor[ca, columns[j, b]]
                            for d in range(3):
                                QZ[i - start, a, d] += q * Z[j - start, b, d]
                for d in range(3):
                    for e in range(3):
                        Q[d, e] += Z[i - start, a, d] * QZ[i - start, a, e]
        points[point] = Q
        for i in range(start, stop):
            for m in range(2):
                total = 0.0
                for a in range(k):
                    if columns[i, a] < 0:
                        continue
                    for b in range(k):
                        if columns[i, b] >= 0:
                            total += jg[i, m, a] * cofactor[columns[i, a], columns[i, b]] * jg[i, m, b]
                    for d in range(3):
                        total -= 2.0 * jg[i, m, a] * QZ[i - start, a, d] * jp[i, m, d]
                for d in range(3):
                    for e in range(3):
                        total += jp[i, m, d] * Q[d, e] * jp[i, m, e]
                adjusted[i, m] = total
    return points, adjusted


def _arrays(linear: Linear) -> tuple[np.ndarray, ...]:
    return (
        linear.first,
        linear.columns,
        linear.jg,
        linear.jp,
        linear.misclosure,
        linear.weight,
        linear.point_weight,
        linear.point_misclosure,
    )


def reduced_normals(linear: Linear, unknowns: int, damping: float = 0.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Reduced normal matrix (n, n), right-hand side (n,), and the diagonal (n,) before the points were eliminated (for damping)."""
    return _reduced(*_arrays(linear), damping, unknowns)


def point_corrections(linear: Linear, correction: np.ndarray, damping: float = 0.0) -> np.ndarray:
    """Corrections (N, 3) of the points that belong to the corrections (n,) of the other unknowns; 0 for points without rays."""
    return _back(*_arrays(linear), damping, correction)


def point_precision(linear: Linear, cofactor: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Covariance (N, 3, 3) of the points with the effect of orientation and cameras, and the variances (M, 2) px^2 of the computed
    image coordinates, from the covariance (n, n) of the other unknowns."""
    return _precision(*_arrays(linear), cofactor)
