"""Normal equations of a bundle with the points eliminated (Schur's complement), and the way back to points and their precision.

A point touches only the photographs that see it, so that its 3 x 3 block is inverted on the spot and its part of the reduced
system added; nothing of the size (points x photos) is ever stored, and of (photos x photos) only the blocks of those that share
points. What the rays of a point have in common (their camera) is merged before pairs are summed. What rays say without regard to
their point is summed by photograph. Kept points are not eliminated: they are columns like a photograph's.

A point is eliminated in a frame of its own, with one axis along its mean ray. Rays to a far point are nearly parallel: in world
coordinates its block would be all but singular and what is left of its rays a small difference of large numbers, as large as what
holds a weak block (the tilt of a strip). Along and across the ray the block is only badly scaled, which costs nothing.

Source: Brown 1976, "The bundle adjustment: progress and prospects"; Triggs et al. 2000, section 6.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit

from orthomill.tasks.adjustment.model.linearisation import Linear, seen_pattern
from orthomill.tasks.adjustment.sparse.block_matrix import BlockMatrix, Pattern, summed


@dataclass(frozen=True, eq=False)
class Normals:
    """Reduced normal equations: `matrix`, `right` (n,), and the `diagonal` (n,) before the points were eliminated (for damping)."""

    matrix: BlockMatrix
    right: np.ndarray
    diagonal: np.ndarray


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
def _point_block(point, first, jp, residual, weight, prior_weight, prior_residual, damping, V, right):
    V[:] = 0.0
    for a in range(3):
        V[a, a] = prior_weight[point, a]
        right[a] = prior_weight[point, a] * prior_residual[point, a]
    for i in range(first[point], first[point + 1]):
        for k in range(2):
            for a in range(3):
                right[a] += weight[i] * jp[i, k, a] * residual[i, k]
                for b in range(3):
                    V[a, b] += weight[i] * jp[i, k, a] * jp[i, k, b]
    for a in range(3):
        V[a, a] *= 1.0 + damping


@njit(cache=True)
def _merged(begin, end, row, columns, jg, jp, weight, start, owner, place, own, W):
    """The different groups `own` (count,) that rays begin to end touch; `place` (G,) says where in W (3, m) their blocks with the
    point begin, and is -1 everywhere before. Returns count and m."""
    count, m = 0, 0
    for i in range(begin, end):
        for a in range(columns.shape[1]):
            column = columns[row[i], a]
            if column < 0:
                continue
            g = owner[column]
            if place[g] < 0:
                place[g], own[count] = m, g
                count += 1
                width = start[g + 1] - start[g]
                W[:, m : m + width] = 0.0
                m += width
            at = place[g] + column - start[g]
            for b in range(3):
                W[b, at] += weight[i] * (jg[i, 0, a] * jp[i, 0, b] + jg[i, 1, a] * jp[i, 1, b])
    return count, m


@njit(cache=True)
def _most(first, start, columns):
    """The most unknowns that a point can touch."""
    longest, width = 0, 0
    for point in range(len(first) - 1):
        longest = max(longest, first[point + 1] - first[point])
    for g in range(len(start) - 1):
        width = max(width, start[g + 1] - start[g])
    return min(longest * columns.shape[1] * width, start[-1])


@njit(cache=True)
def _direct(row, columns, jg, residual, weight):
    """What the rays say without regard to their point: normal matrices (T, k, k) and right-hand sides (T, k)."""
    k = columns.shape[1]
    normal, right = np.zeros((len(columns), k, k)), np.zeros((len(columns), k))
    for i in range(len(row)):
        t = row[i]
        for a in range(k):
            x, y = weight[i] * jg[i, 0, a], weight[i] * jg[i, 1, a]
            right[t, a] += x * residual[i, 0] + y * residual[i, 1]
            for b in range(k):
                normal[t, a, b] += x * jg[i, 0, b] + y * jg[i, 1, b]
    return normal, right


@njit(cache=True)
def _eliminate(
    first, row, columns, jg, jp, residual, weight, prior_weight, prior_residual, damping,
    start, block_first, partner, offset, owner, values, right,
):  # fmt: skip
    """Takes what the points explain off the normal matrix and the right-hand side."""
    V, inverse, vb, y = np.empty((3, 3)), np.empty((3, 3)), np.empty(3), np.empty(3)
    most = _most(first, start, columns)
    place, own = np.full(len(start) - 1, -1), np.empty(len(start) - 1, np.int64)
    W, Z = np.empty((3, most)), np.empty((3, most))
    for point in range(len(first) - 1):
        begin, end = first[point], first[point + 1]
        if begin == end:
            continue
        _point_block(point, first, jp, residual, weight, prior_weight, prior_residual, damping, V, vb)
        _invert(V, inverse)
        if inverse[0, 0] == 0.0:
            continue
        for a in range(3):
            y[a] = inverse[a, 0] * vb[0] + inverse[a, 1] * vb[1] + inverse[a, 2] * vb[2]
        count, m = _merged(begin, end, row, columns, jg, jp, weight, start, owner, place, own, W)
        for b in range(3):
            for a in range(m):
                Z[b, a] = inverse[b, 0] * W[0, a] + inverse[b, 1] * W[1, a] + inverse[b, 2] * W[2, a]
        for n in range(count):
            g = own[n]
            at = place[g]
            for a in range(start[g + 1] - start[g]):
                right[start[g] + a] -= W[0, at + a] * y[0] + W[1, at + a] * y[1] + W[2, at + a] * y[2]
            for s in range(block_first[g], block_first[g + 1]):
                other = place[partner[s]]
                if other < 0:
                    continue
                width = start[partner[s] + 1] - start[partner[s]]
                for a in range(start[g + 1] - start[g]):
                    z0, z1, z2, base = Z[0, at + a], Z[1, at + a], Z[2, at + a], offset[s] + a * width
                    for b in range(width):
                        values[base + b] -= z0 * W[0, other + b] + z1 * W[1, other + b] + z2 * W[2, other + b]
        for n in range(count):
            place[own[n]] = -1


@njit(cache=True)
def _back(first, row, columns, jg, jp, residual, weight, prior_weight, prior_residual, damping, correction):
    out = np.zeros((len(first) - 1, 3))
    V, inverse, vb = np.empty((3, 3)), np.empty((3, 3)), np.empty(3)
    for point in range(len(first) - 1):
        if first[point] == first[point + 1]:
            continue
        _point_block(point, first, jp, residual, weight, prior_weight, prior_residual, damping, V, vb)
        _invert(V, inverse)
        for i in range(first[point], first[point + 1]):
            for n in range(2):
                moved = 0.0
                for a in range(columns.shape[1]):
                    if columns[row[i], a] >= 0:
                        moved += jg[i, n, a] * correction[columns[row[i], a]]
                for b in range(3):
                    vb[b] -= weight[i] * moved * jp[i, n, b]
        for a in range(3):
            out[point, a] = inverse[a, 0] * vb[0] + inverse[a, 1] * vb[1] + inverse[a, 2] * vb[2]
    return out


@njit(cache=True)
def _precision(
    first, row, columns, jg, jp, residual, weight, prior_weight, prior_residual,
    start, block_first, partner, offset, owner, values, direct,
):  # fmt: skip
    points = np.zeros((len(first) - 1, 3, 3))
    adjusted = np.zeros((len(row), 2))
    k = columns.shape[1]
    V, inverse, vb = np.empty((3, 3)), np.empty((3, 3)), np.empty(3)
    most = _most(first, start, columns)
    place, own = np.full(len(start) - 1, -1), np.empty(len(start) - 1, np.int64)
    W, Z, QZ = np.empty((3, most)), np.empty((3, most)), np.empty((3, most))
    for point in range(len(first) - 1):
        begin, end = first[point], first[point + 1]
        if begin == end:
            continue
        _point_block(point, first, jp, residual, weight, prior_weight, prior_residual, 0.0, V, vb)
        _invert(V, inverse)
        count, m = _merged(begin, end, row, columns, jg, jp, weight, start, owner, place, own, W)
        for b in range(3):
            for a in range(m):
                Z[b, a] = inverse[b, 0] * W[0, a] + inverse[b, 1] * W[1, a] + inverse[b, 2] * W[2, a]
                QZ[b, a] = 0.0
        for n in range(count):
            g = own[n]
            at = place[g]
            for s in range(block_first[g], block_first[g + 1]):
                h = partner[s]
                other = place[h]
                if other < 0:
                    continue
                width = start[h + 1] - start[h]
                for a in range(start[g + 1] - start[g]):
                    base = offset[s] + a * width
                    for d in range(3):
                        total, z = 0.0, Z[d, at + a]
                        for b in range(width):
                            total += values[base + b] * Z[d, other + b]
                        QZ[d, at + a] += total
                        if h != g:
                            for b in range(width):
                                QZ[d, other + b] += values[base + b] * z
        Q = inverse.copy()
        for d in range(3):
            for e in range(3):
                for a in range(m):
                    Q[d, e] += Z[d, a] * QZ[e, a]
        points[point] = Q
        for i in range(begin, end):
            t = row[i]
            for n in range(2):
                total = 0.0
                for a in range(k):
                    column = columns[t, a]
                    if column < 0:
                        continue
                    part = 0.0
                    for b in range(k):
                        part += direct[t, a, b] * jg[i, n, b]
                    total += jg[i, n, a] * part
                    at = place[owner[column]] + column - start[owner[column]]
                    for d in range(3):
                        total -= 2.0 * jg[i, n, a] * QZ[d, at] * jp[i, n, d]
                for d in range(3):
                    for e in range(3):
                        total += jp[i, n, d] * Q[d, e] * jp[i, n, e]
                adjusted[i, n] = total
        for n in range(count):
            place[own[n]] = -1
    return points, adjusted


def reduced_normals(linear: Linear, pattern: Pattern, damping: float = 0.0) -> Normals:
    """The reduced normal equations in the blocks of `pattern`, without what is known beforehand but for the points."""
    pieces, sides = _direct(linear.row, linear.columns, linear.jg, linear.residual, linear.weight)
    matrix = BlockMatrix.zero(pattern)
    there = np.bincount(linear.row, minlength=len(pieces)) > 0
    matrix.add(linear.columns[there], pieces[there])
    right, diagonal = summed(linear.columns, sides, len(matrix)), matrix.diagonal()
    _eliminate(*linear.arrays, damping, *pattern.arrays, matrix.values, right)
    return Normals(matrix, right, diagonal)


def point_corrections(linear: Linear, correction: np.ndarray, damping: float = 0.0) -> np.ndarray:
    """Corrections (N, 3) of the points that belong to the corrections (n,) of the other unknowns; 0 for points without rays."""
    return (linear.frame @ _back(*linear.arrays, damping, correction)[:, :, None])[:, :, 0]


def point_precision(linear: Linear, cofactor: BlockMatrix) -> tuple[np.ndarray, np.ndarray]:
    """Covariance (N, 3, 3) of the points with the effect of orientation and cameras, and the variances (M, 2) px^2 of the computed
    image coordinates, from the covariance of the other unknowns; it has blocks for all that see a point together."""
    points, adjusted = _precision(*linear.arrays, *cofactor.pattern.arrays, cofactor.values, cofactor.pieces(linear.columns))
    return linear.frame @ points @ linear.frame.swapaxes(1, 2), adjusted


def point_precision_alone(linear: Linear, start: np.ndarray) -> np.ndarray:
    """Covariance (N, 3, 3) of the points when orientation and cameras are taken for exact; `start` as in `Pattern`."""
    return point_precision(linear, BlockMatrix.zero(seen_pattern(linear, start)))[0]
