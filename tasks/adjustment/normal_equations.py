"""Normal equations of a bundle with the points eliminated (Schur's complement), and the way back to points and their precision.

A point touches only the photographs that see it, so that its 3 x 3 block is inverted on the spot and its part of the reduced
system added; nothing of the size (points x photos) is ever stored. What the rays of a point have in common (their camera) is
merged before pairs are summed: the cost of a point grows with the square of the unknowns it touches, and only the upper half of
the matrix is summed. Kept points are not eliminated: they are columns like a photograph's.

A point is eliminated in a frame of its own, with one axis along its mean ray. Rays to a far point are nearly parallel: in world
coordinates its block would be all but singular and what is left of its rays a small difference of large numbers, as large as what
holds a weak block (the tilt of a strip). Along and across the ray the block is only badly scaled, which costs nothing.

Source: Brown 1976, "The bundle adjustment: progress and prospects"; Triggs et al. 2000, section 6.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit

from tasks.adjustment.collinearity import derivatives, misclosures
from tasks.adjustment.network import Network, Rays, State, ray_columns


@dataclass(frozen=True, eq=False)
class Linear:
    """A linearised bundle: derivatives `jg` (M, 2, k), `jp` (M, 2, 3) by the point in its own `frame` (N, 3, 3; columns are axes),
    `columns` (M, k), misclosures (M, 2), `weight` (M,) 1/px^2, `first` (N + 1,), and the points' own prior: weights and misclosures
    (N, 3)."""

    first: np.ndarray
    columns: np.ndarray
    jg: np.ndarray
    jp: np.ndarray
    misclosure: np.ndarray
    weight: np.ndarray
    point_weight: np.ndarray
    point_misclosure: np.ndarray
    frame: np.ndarray


def linearised(
    network: Network, state: State, rays: Rays, factor: np.ndarray | float = 1.0, point_factor: np.ndarray | float = 1.0
) -> Linear:
    """The observations linearised at `state`; `factor` (M,) and `point_factor` (N,) are robust factors of the weights of rays and
    of surveyed points."""
    columns = ray_columns(network, rays)
    jg, jp = derivatives(state, rays, network.camera_of)
    point_weight = network.point_weight * np.broadcast_to(point_factor, len(network.point))[:, None]
    if len(network.kept):
        kept = columns[:, 14] >= 0
        jg = np.concatenate([jg, np.where(kept[:, None, None], jp, 0.0)], axis=2)
        jp = np.where(kept[:, None, None], 0.0, jp)
        point_weight[network.kept] = 0.0
    frame = _frames(state, rays, point_weight.any(axis=1))
    return Linear(
        rays.first(len(state.point)),
        columns,
        jg,
        jp @ frame[rays.point],
        misclosures(state, rays, network.camera_of),
        factor / rays.sigma**2,
        point_weight,
        network.point - state.point,
        frame,
    )


def _frames(state: State, rays: Rays, surveyed: np.ndarray) -> np.ndarray:
    """(N, 3, 3) two axes across the mean ray of every point and one along it; the world's axes for points without rays and for
    `surveyed` (N,) ones, whose prior is known in these."""
    away = state.point[rays.point] - state.centre[rays.photo]
    away /= np.maximum(np.linalg.norm(away, axis=1, keepdims=True), 1e-12)
    along = np.stack([np.bincount(rays.point, away[:, k], len(state.point)) for k in range(3)], axis=1)
    length = np.linalg.norm(along, axis=1)
    own = ~surveyed & (length > 0)
    along = along[own] / length[own, None]
    # Householder's mirror takes the third axis of the world to the ray (or against it, whichever is farther).
    mirror = along + np.where(along[:, 2:] < 0, -1.0, 1.0) * (0.0, 0.0, 1.0)
    frames = np.tile(np.eye(3), (len(length), 1, 1))
    frames[own] -= 2.0 * mirror[:, :, None] * mirror[:, None, :] / (mirror**2).sum(axis=1)[:, None, None]
    return frames


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
def _merged(start, stop, columns, jg, jp, weight, place, own, W):
    """The different unknowns `own` (m,) that rays start to stop touch and their blocks W (m, 3) with the point; returns m.

    `place` (n,) is -1 everywhere before and holds the positions in `own` afterwards.
    """
    m = 0
    for i in range(start, stop):
        for a in range(columns.shape[1]):
            column = columns[i, a]
            if column < 0:
                continue
            at = place[column]
            if at < 0:
                at = m
                place[column], own[m] = m, column
                W[m, 0], W[m, 1], W[m, 2] = 0.0, 0.0, 0.0
                m += 1
            for b in range(3):
                W[at, b] += weight[i] * (jg[i, 0, a] * jp[i, 0, b] + jg[i, 1, a] * jp[i, 1, b])
    return m


@njit(cache=True)
def _direct(start, stop, columns, jg, misclosure, weight, normal, right, diagonal):
    """Adds what the rays say without regard to their point; upper half."""
    for i in range(start, stop):
        for a in range(columns.shape[1]):
            ca = columns[i, a]
            if ca < 0:
                continue
            right[ca] += weight[i] * (jg[i, 0, a] * misclosure[i, 0] + jg[i, 1, a] * misclosure[i, 1])
            diagonal[ca] += weight[i] * (jg[i, 0, a] * jg[i, 0, a] + jg[i, 1, a] * jg[i, 1, a])
            for b in range(a, columns.shape[1]):
                cb = columns[i, b]
                if cb >= 0:
                    normal[min(ca, cb), max(ca, cb)] += weight[i] * (jg[i, 0, a] * jg[i, 0, b] + jg[i, 1, a] * jg[i, 1, b])


@njit(cache=True)
def _longest(first):
    longest = 0
    for point in range(len(first) - 1):
        longest = max(longest, first[point + 1] - first[point])
    return longest


@njit(cache=True)
def _reduced(first, columns, jg, jp, misclosure, weight, prior_weight, prior_misclosure, damping, unknowns):
    normal = np.zeros((unknowns, unknowns))
    right = np.zeros(unknowns)
    diagonal = np.zeros(unknowns)
    V, inverse, vb, y, z = np.empty((3, 3)), np.empty((3, 3)), np.empty(3), np.empty(3), np.empty(3)
    most = _longest(first) * jg.shape[2]
    place, own, W = np.full(unknowns, -1), np.empty(most, np.int64), np.empty((most, 3))
    for point in range(len(first) - 1):
        start, stop = first[point], first[point + 1]
        if start == stop:
            continue
        _point_block(point, first, jp, misclosure, weight, prior_weight, prior_misclosure, damping, V, vb)
        _invert(V, inverse)
        for a in range(3):
            y[a] = inverse[a, 0] * vb[0] + inverse[a, 1] * vb[1] + inverse[a, 2] * vb[2]
        _direct(start, stop, columns, jg, misclosure, weight, normal, right, diagonal)
        m = _merged(start, stop, columns, jg, jp, weight, place, own, W)
        for a in range(m):
            ca = own[a]
            place[ca] = -1
            right[ca] -= W[a, 0] * y[0] + W[a, 1] * y[1] + W[a, 2] * y[2]
            for b in range(3):
                z[b] = W[a, 0] * inverse[0, b] + W[a, 1] * inverse[1, b] + W[a, 2] * inverse[2, b]
            for b in range(a, m):
                cb = own[b]
                normal[min(ca, cb), max(ca, cb)] -= z[0] * W[b, 0] + z[1] * W[b, 1] + z[2] * W[b, 2]
    for a in range(unknowns):
        for b in range(a):
            normal[a, b] = normal[b, a]
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
    V, inverse, vb = np.empty((3, 3)), np.empty((3, 3)), np.empty(3)
    most = _longest(first) * k
    place, own, W = np.full(len(cofactor), -1), np.empty(most, np.int64), np.empty((most, 3))
    Z, QZ = np.empty((most, 3)), np.empty((most, 3))
    for point in range(len(first) - 1):
        start, stop = first[point], first[point + 1]
        if start == stop:
            continue
        _point_block(point, first, jp, misclosure, weight, prior_weight, prior_misclosure, 0.0, V, vb)
        _invert(V, inverse)
        m = _merged(start, stop, columns, jg, jp, weight, place, own, W)
        for a in range(m):
            for b in range(3):
                Z[a, b] = W[a, 0] * inverse[0, b] + W[a, 1] * inverse[1, b] + W[a, 2] * inverse[2, b]
                QZ[a, b] = 0.0
        for a in range(m):
            for b in range(m):
                q = cofactor[own[a], own[b]]
                for d in range(3):
                    QZ[a, d] += q * Z[b, d]
        Q = inverse.copy()
        for a in range(m):
            for d in range(3):
                for e in range(3):
                    Q[d, e] += Z[a, d] * QZ[a, e]
        points[point] = Q
        for i in range(start, stop):
            for n in range(2):
                total = 0.0
                for a in range(k):
                    ca = columns[i, a]
                    if ca < 0:
                        continue
                    for b in range(a, k):
                        if columns[i, b] >= 0:
                            twice = 1.0 if a == b else 2.0
                            total += twice * jg[i, n, a] * cofactor[ca, columns[i, b]] * jg[i, n, b]
                    for d in range(3):
                        total -= 2.0 * jg[i, n, a] * QZ[place[ca], d] * jp[i, n, d]
                for d in range(3):
                    for e in range(3):
                        total += jp[i, n, d] * Q[d, e] * jp[i, n, e]
                adjusted[i, n] = total
        for a in range(m):
            place[own[a]] = -1
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
    return (linear.frame @ _back(*_arrays(linear), damping, correction)[:, :, None])[:, :, 0]


def point_precision(linear: Linear, cofactor: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Covariance (N, 3, 3) of the points with the effect of orientation and cameras, and the variances (M, 2) px^2 of the computed
    image coordinates, from the covariance (n, n) of the other unknowns."""
    points, adjusted = _precision(*_arrays(linear), cofactor)
    return linear.frame @ points @ linear.frame.swapaxes(1, 2), adjusted
