"""Normal equations of a bundle with the points eliminated (Schur complement), and back substitution to points and their precision.

A point is connected only with the photographs that see it, so that its 3 x 3 block is inverted immediately and its contribution
added to the reduced system. Nothing of the size (points x photographs) is ever stored, and of (photographs x photographs) only the
blocks of those that share points. The blocks that the rays of a point share (their camera) are merged before pairs are summed. The
direct part of the rays, without regard to their points, is summed by photograph. Kept points are not eliminated: they are columns
like those of a photograph.

A point is eliminated in a frame of its own, with one axis along its mean ray. Rays to a far point are nearly parallel: in world
coordinates its block would be almost singular, and its contribution a small difference of large numbers, as large as what
determines an unstable block (the tilt of a strip). Along and across the ray the block is only badly scaled, which costs no digits.

Source: Brown 1976, "The bundle adjustment: progress and prospects"; Triggs et al. 2000, section 6.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from orthomill.kernels.kernel_compilation import njit
from orthomill.tasks.adjustment.model.linearisation import Linear, seen_pattern
from orthomill.tasks.adjustment.sparse.block_matrix import BlockMatrix, Pattern, summed

# Relative to the diagonal: a block that is only badly scaled, that of a far point along and across its ray, is not singular.
SINGULAR = 1e-18
"""Determinant of a point's block in units of the product of its diagonal, below which it is singular."""


@dataclass(frozen=True, eq=False)
class Normals:
    """Reduced normal equations: `matrix`, `right` (n,), and the `diagonal` (n,) before the points were eliminated (for damping)."""

    matrix: BlockMatrix
    right: np.ndarray
    diagonal: np.ndarray


class Cross(NamedTuple):
    """The blocks between one point and the groups that its rays depend on, reused from point to point: `groups`, the `place` (G,)
    where each begins in W (3, m), -1 for all others, and Z (3, m) = V^-1 W with the block V of the point itself."""

    place: np.ndarray
    groups: np.ndarray
    W: np.ndarray
    Z: np.ndarray


@njit()
def _invert(V, out):
    """Inverse of a symmetric 3 x 3 matrix; zero (a point that does not move) where it is singular."""
    c00 = V[1, 1] * V[2, 2] - V[1, 2] * V[1, 2]
    c01 = V[0, 2] * V[1, 2] - V[0, 1] * V[2, 2]
    c02 = V[0, 1] * V[1, 2] - V[0, 2] * V[1, 1]
    det = V[0, 0] * c00 + V[0, 1] * c01 + V[0, 2] * c02
    if det <= SINGULAR * V[0, 0] * V[1, 1] * V[2, 2] or det <= 0.0:
        out[:] = 0.0
        return
    out[0, 0], out[0, 1], out[0, 2] = c00 / det, c01 / det, c02 / det
    out[1, 1] = (V[0, 0] * V[2, 2] - V[0, 2] * V[0, 2]) / det
    out[1, 2] = (V[0, 1] * V[0, 2] - V[0, 0] * V[1, 2]) / det
    out[2, 2] = (V[0, 0] * V[1, 1] - V[0, 1] * V[0, 1]) / det
    out[1, 0], out[2, 0], out[2, 1] = out[0, 1], out[0, 2], out[1, 2]


@njit()
def _point_block(point, linear, damping, V, right):
    """Writes the damped block V (3, 3) of a point and its right-hand side (3,), prior information included."""
    # In scalars: as elements of V every one of the sums would be loaded and stored again for every ray.
    weight, prior = linear.point_weight[point], linear.point_residual[point]
    v00, v11, v22, v01, v02, v12 = weight[0], weight[1], weight[2], 0.0, 0.0, 0.0
    r0, r1, r2 = weight[0] * prior[0], weight[1] * prior[1], weight[2] * prior[2]
    for i in range(linear.first[point], linear.first[point + 1]):
        for k in range(2):
            x, y, z, lack = linear.jp[i, k, 0], linear.jp[i, k, 1], linear.jp[i, k, 2], linear.residual[i, k]
            wx, wy, wz = linear.weight[i] * x, linear.weight[i] * y, linear.weight[i] * z
            r0, r1, r2 = r0 + wx * lack, r1 + wy * lack, r2 + wz * lack
            v00, v01, v02 = v00 + wx * x, v01 + wx * y, v02 + wx * z
            v11, v12, v22 = v11 + wy * y, v12 + wy * z, v22 + wz * z
    right[0], right[1], right[2] = r0, r1, r2
    V[0, 0], V[1, 1], V[2, 2] = v00 * (1.0 + damping), v11 * (1.0 + damping), v22 * (1.0 + damping)
    V[0, 1], V[0, 2], V[1, 2] = v01, v02, v12
    V[1, 0], V[2, 0], V[2, 1] = v01, v02, v12


@njit()
def _no_cross(linear, start):
    """An empty `Cross` with room for the point that is connected with most unknowns; every group begins at start[g]."""
    longest, width = 0, 0
    for point in range(len(linear.first) - 1):
        longest = max(longest, linear.first[point + 1] - linear.first[point])
    for g in range(len(start) - 1):
        width = max(width, start[g + 1] - start[g])
    most = min(longest * linear.columns.shape[1] * width, start[-1])
    groups = len(start) - 1
    return Cross(np.full(groups, -1), np.empty(groups, np.int64), np.empty((3, most)), np.empty((3, most)))


@njit()
def _merge(point, linear, pattern, cross):
    """Fills groups, places and W with those of a point; `place` has to be -1 everywhere. Returns the number of groups and m."""
    count, m = 0, 0
    for i in range(linear.first[point], linear.first[point + 1]):
        for a in range(linear.columns.shape[1]):
            column = linear.columns[linear.row[i], a]
            if column < 0:
                continue
            g = pattern.owner[column]
            if cross.place[g] < 0:
                cross.place[g], cross.groups[count] = m, g
                count += 1
                width = pattern.start[g + 1] - pattern.start[g]
                cross.W[:, m : m + width] = 0.0
                m += width
            at = np.uint64(cross.place[g] + column - pattern.start[g])
            for b in range(3):
                cross.W[b, at] += linear.weight[i] * (
                    linear.jg[i, 0, a] * linear.jp[i, 0, b] + linear.jg[i, 1, a] * linear.jp[i, 1, b]
                )
    return count, m


@njit()
def _carry(inverse, cross, m):
    """Z = V^-1 W in the first m columns."""
    for b in range(3):
        for a in range(m):
            cross.Z[b, a] = inverse[b, 0] * cross.W[0, a] + inverse[b, 1] * cross.W[1, a] + inverse[b, 2] * cross.W[2, a]


@njit()
def _clear(cross, count):
    """Resets the places of the first `count` groups: a fill of all groups for every point would cost (points x groups)."""
    for n in range(count):
        cross.place[cross.groups[n]] = -1


@njit()
def _direct(linear):
    """The part of the rays without regard to their points: normal matrices (T, k, k) and right-hand sides (T, k)."""
    k = linear.columns.shape[1]
    normal, right = np.zeros((len(linear.columns), k, k)), np.zeros((len(linear.columns), k))
    for i in range(len(linear.row)):
        t = linear.row[i]
        for a in range(k):
            x, y = linear.weight[i] * linear.jg[i, 0, a], linear.weight[i] * linear.jg[i, 1, a]
            right[t, a] += x * linear.residual[i, 0] + y * linear.residual[i, 1]
            for b in range(k):
                normal[t, a, b] += x * linear.jg[i, 0, b] + y * linear.jg[i, 1, b]
    return normal, right


@njit()
def _eliminate(linear, pattern, damping, values, right):
    """Subtracts the contributions W' V^-1 W and W' V^-1 v of the points from the normal matrix and the right-hand side."""
    V, inverse, v, y = np.empty((3, 3)), np.empty((3, 3)), np.empty(3), np.empty(3)
    cross, start = _no_cross(linear, pattern.start), pattern.start
    for point in range(len(linear.first) - 1):
        if linear.first[point] == linear.first[point + 1]:
            continue
        _point_block(point, linear, damping, V, v)
        _invert(V, inverse)
        # A point with a singular block does not move; its rays still count with the point as a constant.
        if inverse[0, 0] == 0.0:
            continue
        for a in range(3):
            y[a] = inverse[a, 0] * v[0] + inverse[a, 1] * v[1] + inverse[a, 2] * v[2]
        count, m = _merge(point, linear, pattern, cross)
        _carry(inverse, cross, m)
        for n in range(count):
            g = cross.groups[n]
            at = cross.place[g]
            for a in range(start[g + 1] - start[g]):
                right[start[g] + a] -= cross.W[0, at + a] * y[0] + cross.W[1, at + a] * y[1] + cross.W[2, at + a] * y[2]
            _subtract_row(g, pattern, cross, values)
        _clear(cross, count)


@njit()
def _subtract_row(g, pattern, cross, values):
    """Subtracts W' Z from the blocks of group g with the groups of the point."""
    W, Z, at = cross.W, cross.Z, np.uint64(cross.place[g])
    end = at + np.uint64(pattern.start[g + 1] - pattern.start[g])
    for s in range(pattern.first[g], pattern.first[g + 1]):
        h = pattern.partner[s]
        if cross.place[h] < 0:
            continue
        # Unsigned: of an index that may be negative every single access asks whether it counts from the end.
        other, base = np.uint64(cross.place[h]), np.uint64(pattern.offset[s])
        width = np.uint64(pattern.start[h + 1] - pattern.start[h])
        for a in range(at, end):
            z0, z1, z2 = Z[0, a], Z[1, a], Z[2, a]
            for b in range(width):
                values[base + b] -= z0 * W[0, other + b] + z1 * W[1, other + b] + z2 * W[2, other + b]
            base += width


@njit()
def _back(linear, damping, correction):
    """Back substitution: corrections (N, 3) of the points in their frames, V^-1 (v - W x)."""
    out = np.zeros((len(linear.first) - 1, 3))
    V, inverse, v = np.empty((3, 3)), np.empty((3, 3)), np.empty(3)
    for point in range(len(linear.first) - 1):
        if linear.first[point] == linear.first[point + 1]:
            continue
        _point_block(point, linear, damping, V, v)
        _invert(V, inverse)
        for i in range(linear.first[point], linear.first[point + 1]):
            for n in range(2):
                moved = 0.0
                for a in range(linear.columns.shape[1]):
                    if linear.columns[linear.row[i], a] >= 0:
                        moved += linear.jg[i, n, a] * correction[linear.columns[linear.row[i], a]]
                for b in range(3):
                    v[b] -= linear.weight[i] * moved * linear.jp[i, n, b]
        for a in range(3):
            out[point, a] = inverse[a, 0] * v[0] + inverse[a, 1] * v[1] + inverse[a, 2] * v[2]
    return out


@njit()
def _promised(linear, correction, local):
    """The residuals (M, 2) less what corrections (n,) and those of the points in their frames, `local` (N, 3), explain of them."""
    out = np.empty((len(linear.row), 2))
    for point in range(len(linear.first) - 1):
        for i in range(linear.first[point], linear.first[point + 1]):
            for n in range(2):
                moved = 0.0
                for a in range(linear.columns.shape[1]):
                    if linear.columns[linear.row[i], a] >= 0:
                        moved += linear.jg[i, n, a] * correction[linear.columns[linear.row[i], a]]
                for b in range(3):
                    moved += linear.jp[i, n, b] * local[point, b]
                out[i, n] = linear.residual[i, n] - moved
    return out


@njit()
def _precision(linear, pattern, values, direct, adjusted):
    """Covariances (N, 3, 3) of the points in their frames; `values` hold the covariance of the other unknowns. Writes the variances
    (M, 2) of the computed image coordinates into `adjusted`, for which `direct` (T, k, k) holds its parts at linear.columns, or
    none where `adjusted` has no rows."""
    points = np.zeros((len(linear.first) - 1, 3, 3))
    V, inverse, v = np.empty((3, 3)), np.empty((3, 3)), np.empty(3)
    cross = _no_cross(linear, pattern.start)
    QZ = np.empty(cross.Z.shape)
    for point in range(len(linear.first) - 1):
        if linear.first[point] == linear.first[point + 1]:
            continue
        _point_block(point, linear, 0.0, V, v)
        _invert(V, inverse)
        count, m = _merge(point, linear, pattern, cross)
        _carry(inverse, cross, m)
        _multiply(pattern, values, cross, (count, m), QZ)
        # Q_pp = V^-1 + Z Q Z': the precision of the intersection, and that of orientation and cameras carried over.
        Q = inverse.copy()
        for a in range(m):
            for d in range(3):
                for e in range(3):
                    Q[d, e] += cross.Z[d, a] * QZ[e, a]
        points[point] = Q
        if adjusted.shape[0] > 0:
            for i in range(linear.first[point], linear.first[point + 1]):
                for n in range(2):
                    adjusted[i, n] = _adjusted_variance(i, n, linear, direct, pattern, cross.place, (Q, QZ))
        _clear(cross, count)
    return points


@njit()
def _multiply(pattern, values, cross, size, QZ):
    """QZ (3, m) = Z Q over the `size` = (count, m) groups of a point; only the upper half of Q is stored."""
    count, m = size
    Z = cross.Z
    QZ[:, :m] = 0.0
    for n in range(count):
        g = cross.groups[n]
        at, height = np.uint64(cross.place[g]), np.uint64(pattern.start[g + 1] - pattern.start[g])
        for s in range(pattern.first[g], pattern.first[g + 1]):
            h = pattern.partner[s]
            if cross.place[h] < 0:
                continue
            other, base = np.uint64(cross.place[h]), np.uint64(pattern.offset[s])
            width = np.uint64(pattern.start[h + 1] - pattern.start[h])
            for a in range(at, at + height):
                x, y, z = 0.0, 0.0, 0.0
                for b in range(width):
                    q = values[base + b]
                    x, y, z = x + q * Z[0, other + b], y + q * Z[1, other + b], z + q * Z[2, other + b]
                QZ[0, a] += x
                QZ[1, a] += y
                QZ[2, a] += z
                if h != g:
                    x, y, z = Z[0, a], Z[1, a], Z[2, a]
                    for b in range(width):
                        q = values[base + b]
                        QZ[0, other + b] += q * x
                        QZ[1, other + b] += q * y
                        QZ[2, other + b] += q * z
                base += width


@njit()
def _adjusted_variance(i, n, linear, direct, pattern, place, of_point):
    """Variance of coordinate n of ray i as computed from the adjusted unknowns: A Q A' + 2 A Q_xp B' + B Q_pp B', with the
    covariance `of_point` = (Q_pp, -Q_px) and Q_xp = -(QZ)'."""
    Q, QZ = of_point
    t, total = linear.row[i], 0.0
    for a in range(linear.columns.shape[1]):
        column = linear.columns[t, a]
        if column < 0:
            continue
        part = 0.0
        for b in range(linear.columns.shape[1]):
            part += direct[t, a, b] * linear.jg[i, n, b]
        total += linear.jg[i, n, a] * part
        at = place[pattern.owner[column]] + column - pattern.start[pattern.owner[column]]
        for d in range(3):
            total -= 2.0 * linear.jg[i, n, a] * QZ[d, at] * linear.jp[i, n, d]
    for d in range(3):
        for e in range(3):
            total += linear.jp[i, n, d] * Q[d, e] * linear.jp[i, n, e]
    return total


def reduced_normals(linear: Linear, pattern: Pattern, damping: float = 0.0) -> Normals:
    """The reduced normal equations in the blocks of `pattern`; of the prior information only that on the points is included."""
    pieces, sides = _direct(linear)
    matrix = BlockMatrix.zero(pattern)
    # A photograph without rays has no piece; a row of a kept point exists only for the rays that see it.
    there = np.bincount(linear.row, minlength=len(pieces)) > 0
    matrix.add(linear.columns[there], pieces[there])
    right, diagonal = summed(linear.columns, sides, len(matrix)), matrix.diagonal()
    _eliminate(linear, pattern, damping, matrix.values, right)
    return Normals(matrix, right, diagonal)


def point_corrections(linear: Linear, correction: np.ndarray, damping: float = 0.0) -> np.ndarray:
    """Corrections (N, 3) of the points by back substitution of the corrections (n,) of the other unknowns; 0 without rays."""
    return (linear.frame @ _back(linear, damping, correction)[:, :, None])[:, :, 0]


def promised_residuals(linear: Linear, correction: np.ndarray, points: np.ndarray) -> np.ndarray:
    """The residuals (M, 2) px that the linear equations promise after corrections (n,) of the reduced system and those (N, 3) of
    the points."""
    return np.asarray(_promised(linear, correction, (linear.frame.swapaxes(1, 2) @ points[:, :, None])[:, :, 0]))


def point_precision(linear: Linear, cofactor: BlockMatrix) -> tuple[np.ndarray, np.ndarray]:
    """Covariance (N, 3, 3) of the points, the uncertainty of orientation and cameras included, and variances (M, 2) px^2 of the
    computed image coordinates, from the covariance of the other unknowns, which has blocks for all groups that share a point."""
    adjusted = np.zeros((len(linear.row), 2))
    return _precise_points(linear, cofactor, cofactor.pieces(linear.columns), adjusted), adjusted


def point_covariances(linear: Linear, cofactor: BlockMatrix) -> np.ndarray:
    """The covariance of `point_precision` alone, in half its time."""
    return _precise_points(linear, cofactor, np.zeros((0, 0, 0)), np.zeros((0, 2)))


def _precise_points(linear: Linear, cofactor: BlockMatrix, direct: np.ndarray, adjusted: np.ndarray) -> np.ndarray:
    points = _precision(linear, cofactor.pattern, cofactor.values, direct, adjusted)
    return linear.frame @ points @ linear.frame.swapaxes(1, 2)


def point_precision_alone(linear: Linear, start: np.ndarray) -> np.ndarray:
    """Covariance (N, 3, 3) of the points with orientation and cameras free of error; `start` as in `Pattern`."""
    return point_covariances(linear, BlockMatrix.zero(seen_pattern(linear, start)))
