"""The linearised bundle, and the pattern of its reduced normal matrix.

Derivatives are stored ray by ray; the unknowns that they belong to are the same for all rays of a photograph, and stored once.
"""

from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array, vstack

from orthomill.kernels.kernel_compilation import njit
from orthomill.tasks.adjustment.model.collinearity import EXTERIOR, derivatives, residuals
from orthomill.tasks.adjustment.model.network import Network, Rays, State, ray_columns
from orthomill.tasks.adjustment.sparse.block_cholesky import Structure, structure_of
from orthomill.tasks.adjustment.sparse.block_matrix import Pattern, pattern_of


class Linear(NamedTuple):
    """A linearised bundle, as kernels take it.

    `first` (N + 1,): rays first[i] to first[i + 1] belong to point i. Derivatives `jg` (M, 2, k) by the unknowns columns[row],
    with `row` (M,) and `columns` (T, k), -1 for none; `jp` (M, 2, 3) by the point in its own `frame` (N, 3, 3; columns are axes).
    `residual` (M, 2) px and `weight` (M,) 1/px^2 of the rays; `point_weight` and `point_residual` (N, 3) of the prior information
    on the points, m.
    """

    first: np.ndarray
    row: np.ndarray
    columns: np.ndarray
    jg: np.ndarray
    jp: np.ndarray
    residual: np.ndarray
    weight: np.ndarray
    point_weight: np.ndarray
    point_residual: np.ndarray
    frame: np.ndarray


def linearised(
    network: Network, state: State, rays: Rays, factor: np.ndarray | float = 1.0, point_factor: np.ndarray | float = 1.0
) -> Linear:
    """The observations linearised at `state`; `factor` (M,) and `point_factor` (N,) are robust factors of the weights of rays and
    of surveyed points."""
    row, columns = ray_columns(network, rays)
    jg, jp = derivatives(state, rays, network.camera_of, network.estimated)
    if len(network.variation):
        # A photograph's own parameter acts as that of its camera does.
        varying = EXTERIOR + np.searchsorted(network.estimated, network.variation.parameters)
        jg = np.concatenate([jg, jg[:, :, varying]], axis=2)
    point_weight = network.point_weight * np.broadcast_to(point_factor, len(network.point))[:, None]
    if len(network.kept):
        # A kept point is an unknown of the reduced system: its derivatives move there, and nothing is left to eliminate.
        kept = columns[row, jg.shape[2]] >= 0
        jg = np.concatenate([jg, np.where(kept[:, None, None], jp, 0.0)], axis=2)
        jp[kept] = 0.0
        point_weight[network.kept] = 0.0
    frame = _frames(state, rays, point_weight.any(axis=1))
    _turn(jp, rays.point, frame)
    return Linear(
        rays.first(len(state.point)),
        row,
        columns,
        jg,
        jp,
        residuals(state, rays, network.camera_of),
        factor / rays.sigma**2,
        point_weight,
        network.point - state.point,
        frame,
    )


def _frames(state: State, rays: Rays, surveyed: np.ndarray) -> np.ndarray:
    """(N, 3, 3) two axes across the mean ray of every point and one along it; the world's axes for points without rays and for
    `surveyed` (N,) ones, whose prior weights refer to these."""
    away = state.point[rays.point] - state.centre[rays.photo]
    away /= np.maximum(np.linalg.norm(away, axis=1, keepdims=True), 1e-12)
    along = np.stack([np.bincount(rays.point, away[:, k], len(state.point)) for k in range(3)], axis=1)
    length = np.linalg.norm(along, axis=1)
    own = ~surveyed & (length > 0)
    along = along[own] / length[own, None]
    # Householder's reflection maps the third axis of the world to the ray or against it, whichever is farther: no cancellation.
    mirror = along + np.where(along[:, 2:] < 0, -1.0, 1.0) * (0.0, 0.0, 1.0)
    frames = np.tile(np.eye(3), (len(length), 1, 1))
    frames[own] -= 2.0 * mirror[:, :, None] * mirror[:, None, :] / (mirror**2).sum(axis=1)[:, None, None]
    return frames


@njit()
def _turn(jp, point, frame):
    """Turns derivatives by the point in the world into those in its frame, in place."""
    for i in range(len(jp)):
        F = frame[point[i]]
        for k in range(2):
            a, b, c = jp[i, k, 0], jp[i, k, 1], jp[i, k, 2]
            for d in range(3):
                jp[i, k, d] = a * F[0, d] + b * F[1, d] + c * F[2, d]


def structure(network: Network, state: State, linear: Linear) -> Structure:
    """The blocks of the reduced normal matrix of a bundle, prior information included, and their order of elimination.

    In a free network two photographs far apart come last: the datum is defined there (see `inverse_of`).
    """
    start = network.group_start
    seen = _cliques(linear, start)
    pattern = pattern_of(start, vstack([seen, network.prior_cliques.astype(seen.dtype)], format="csr"))
    last = _ends(state) if network.free else np.zeros(0, np.int64)
    return structure_of(pattern, network.photos, last)


def _ends(state: State) -> np.ndarray:
    """The numbers of two photographs far apart, ascending."""
    # A datum on neighbours would let the rest of a long strip swing on a short lever, and the factors lose digits.
    one = np.linalg.norm(state.centre - state.centre.mean(axis=0), axis=1).argmax()
    other = np.linalg.norm(state.centre - state.centre[one], axis=1).argmax()
    return np.unique([one, other])


def seen_pattern(linear: Linear, start: np.ndarray) -> Pattern:
    """The blocks of the groups (see `Pattern`) that observe common points."""
    return pattern_of(start, _cliques(linear, start))


def _cliques(linear: Linear, start: np.ndarray) -> csr_array:
    """(N, G): the groups on which the rays of every point depend."""
    owner = np.append(np.repeat(np.arange(len(start) - 1), np.diff(start)), -1)
    groups = owner[linear.columns]
    first, members = _touched(linear.first, linear.row, groups, len(start) - 1)
    return csr_array((np.ones(len(members), np.int32), members, first), shape=(len(linear.first) - 1, len(start) - 1))


@njit()
def _touched(first, row, groups, count):
    """The groups of every point, point after point, and where those of each point begin."""
    mark = np.full(count, -1)
    starts = np.zeros(len(first), np.int64)
    members = np.empty(max(len(row), 1), np.int32)
    filled = 0
    for point in range(len(first) - 1):
        for i in range(first[point], first[point + 1]):
            for a in range(groups.shape[1]):
                g = groups[row[i], a]
                if g >= 0 and mark[g] != point:
                    mark[g] = point
                    # Grown by doubling: a bound beforehand would be (rays x 17), much more than is filled.
                    if filled == len(members):
                        members = np.concatenate((members, np.empty(len(members), np.int32)))
                    members[filled] = g
                    filled += 1
        starts[point + 1] = filled
    return starts, members[:filled]
