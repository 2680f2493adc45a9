"""Blocks, fronts and selected inverse against dense matrices: random patterns, and bundles of every kind."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse import csr_array

from orthomill.tasks.adjustment.model.collinearity import residuals
from orthomill.tasks.adjustment.model.datum import add_prior, freedoms
from orthomill.tasks.adjustment.model.linearisation import linearised, structure
from orthomill.tasks.adjustment.model.network import NOT_SHIFTED, Distances, Interior, Network, Rays, State, common_shift
from orthomill.tasks.adjustment.solve.normal_equations import reduced_normals
from orthomill.tasks.adjustment.solve.normal_inverse import inverse_of
from orthomill.tasks.adjustment.sparse.block_cholesky import factorised, structure_of
from orthomill.tasks.adjustment.sparse.block_matrix import BlockMatrix, diagonal_places, pattern_of
from orthomill.tasks.adjustment.testing.covariances import covariance_of, points_and_rays, points_elsewhere, with_considered
from orthomill.tasks.geometry.rotation import rotation_matrix

CAMERAS = np.array([[1000.0, 3.0, -2.0, -0.05, 0.02, -0.01, 1e-3, -5e-4], [900.0, 0.0, 1.0, 0.02, 0.0, 0.0, 0.0, 0.0]])
SIGMA = np.array([5.0, 2.0, 2.0, 0.01, 0.01, 0.01, 1e-3, 1e-3])


def strips(seed, rows=2, per=22, apart=False, free=False, considered=False, antenna=False, distances=False):
    """Photographs in strips, each point in those nearby only, two cameras alternating; `apart`: no point connects the strips."""
    rng = np.random.default_rng(seed)
    photos = rows * per
    centre = np.array([(25.0 * i, (400.0 if apart else 45.0) * j, 100.0) for j in range(rows) for i in range(per)])
    centre += rng.normal(0, 3, centre.shape)
    rotation = np.array([rotation_matrix(*(0.1 * rng.standard_normal(2)), k) for k in rng.uniform(0, 6, photos)])
    point = np.repeat(centre, 12, axis=0) + rng.uniform(-30, 30, (12 * photos, 3)) - [0, 0, 100]
    near = np.linalg.norm((point[:, None] - centre)[:, :, :2], axis=2) < 45
    seen = np.argwhere(near & (near.sum(axis=1) > 1)[:, None]).astype(np.int32)
    state = State(rotation, centre, point, CAMERAS.copy(), np.zeros(3), np.array([[0.1, 0.2, -0.1]]) * antenna)
    camera_of = np.arange(photos) % 2
    rays = Rays(seen[:, 0].copy(), seen[:, 1].copy(), np.zeros((len(seen), 2)), rng.uniform(0.2, 0.6, len(seen)))
    rays = replace(rays, xy=-residuals(state, rays, camera_of) + 0.3 * rng.standard_normal((len(rays), 2)))
    mask = np.zeros((2, 8), bool)
    mask[0, [0, 1, 3]], mask[1, [0, 3]] = True, True
    weight = np.array([np.diag(own / SIGMA**2) for own in mask])
    fixed = np.zeros_like(mask)
    fixed[0, 0] = considered
    known = np.zeros(point.shape)
    known[::40] = 0.0 if free else 1 / 0.02**2
    ends = rng.choice(np.unique(rays.point), (3, 2), replace=False) if distances else np.zeros((0, 2), np.int64)
    length = np.linalg.norm(point[ends[:, 0]] - point[ends[:, 1]], axis=1)
    network = Network(
        camera_of,
        Interior(CAMERAS, weight, mask, fixed),
        centre,
        np.full(centre.shape, 0.0 if free else 1 / 0.1**2),
        point,
        known,
        np.full(photos, 0.0 if free else 10.0),
        shift=common_shift(photos) if antenna else NOT_SHIFTED,
        free=free,
        lever=state.lever,
        lever_weight=np.full(3, 1 / 0.05**2 if antenna else 0.0),
        kept=np.unique(ends),
        distances=Distances(ends, length, np.full(len(length), 1 / 0.01**2)),
    )
    return network, state, rays


KINDS = {
    "GNSS and control": {},
    "free": {"free": True},
    "free with distances": {"free": True, "distances": True},
    "two components": {"apart": True},
    "antenna and distances": {"antenna": True, "distances": True},
    "considered": {"considered": True},
    "one strip": {"rows": 1, "per": 40, "free": True},
    "few photographs": {"rows": 1, "per": 5},
}


def dense_inverse(network, state, matrix):
    """The whole matrix, inner constraints added, inverted; one step of refinement in extended precision."""
    N, cut = matrix.dense(), network.considered_columns
    N[cut], N[:, cut], N[cut, cut] = 0.0, 0.0, 1.0
    scale = 1 / np.sqrt(np.diag(N))
    H = np.linalg.qr(freedoms(network, state) / scale[:, None])[0] if network.free else np.zeros((len(N), 0))
    A = (N * scale[:, None] * scale + H @ H.T).astype(np.longdouble)
    Q = np.linalg.inv(A.astype(float)).astype(np.longdouble)
    Q = (Q + Q @ (np.eye(len(N)) - A @ Q) - H @ H.T).astype(float) * scale[:, None] * scale
    Q[cut], Q[:, cut] = 0.0, 0.0
    return Q


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", range(3))
def test_corrections_and_covariance_equal_the_dense_ones(kind, seed):
    network, state, rays = strips(seed, **KINDS[kind])
    linear = linearised(network, state, rays)
    order = structure(network, state, linear)
    normals = reduced_normals(linear, order.pattern)
    right = normals.right + add_prior(network, state, normals.matrix)
    expected = dense_inverse(network, state, normals.matrix)
    unit = np.sqrt(np.maximum(np.diag(expected), 1e-30))
    assert len(order.steps) > 3 or network.photos < 12
    got = inverse_of(network, state, order, normals.matrix).times(right[:, None])[:, 0]
    assert np.abs((got - expected @ right) / unit).max() < 1e-9 * np.abs(expected @ right / unit).max()
    cofactor = covariance_of(network, state, linear)
    blocks = BlockMatrix.of(order.pattern, expected)
    difference = BlockMatrix(order.pattern, np.abs(cofactor.blocks.values - blocks.values)).scaled(1 / unit)
    assert difference.values.max() < 1e-9
    assert (np.abs(cofactor.times(np.eye(len(unit))) - expected) / np.outer(unit, unit)).max() < 1e-9
    far = np.array([0, 4, 6 * network.photos - 2, len(unit) - 1])
    assert (np.abs(cofactor.joint(far) - expected[np.ix_(far, far)]) / np.outer(unit, unit)[np.ix_(far, far)]).max() < 1e-9


def by_point(linear, own, point):
    """Derivatives (2 m, 3) of the rays `own` by their point in the world."""
    return linear.jp[own].reshape(-1, 3) @ linear.frame[point].T


@pytest.mark.parametrize("kind", KINDS)
def test_precision_of_points_and_rays_equals_the_dense_one(kind):
    network, state, rays = strips(7, **KINDS[kind])
    linear = linearised(network, state, rays)
    cofactor = with_considered(network, linear, covariance_of(network, state, linear))
    points, adjusted = points_and_rays(network, linear, cofactor)
    Q = cofactor.times(np.eye(len(cofactor)))
    for point in [*np.unique(rays.point)[::60], *network.kept]:
        own = np.flatnonzero(rays.point == point)
        J, columns = linear.jg[own], linear.columns[linear.row[own]]
        A = np.zeros((len(own), 2, len(Q)))
        for a, wanted, at in zip(A, J, columns, strict=True):
            a[:, at[at >= 0]] = wanted[:, at >= 0]
        A, B, P = A.reshape(-1, len(Q)), by_point(linear, own, point), np.repeat(linear.weight[own], 2)
        V = B.T @ (P[:, None] * B) + np.diag(linear.point_weight[point])
        if V.any():
            move = -np.linalg.solve(V, B.T @ (P[:, None] * A))
            expected, whole = np.linalg.inv(V) + move @ Q @ move.T, A + B @ move
            variance = np.diag(whole @ Q @ whole.T + B @ np.linalg.inv(V) @ B.T)
        else:
            kept = network.kept_columns[np.searchsorted(network.kept, point)]
            expected, variance = Q[np.ix_(kept, kept)], np.diag(A @ Q @ A.T)
        assert np.allclose(points[point], expected, rtol=1e-7, atol=1e-9 * np.abs(expected).max())
        assert np.allclose(adjusted[own].ravel(), variance, rtol=1e-7)


def test_a_photograph_without_rays_is_determined_by_its_position_alone():
    network, state, rays = strips(5)
    rays = rays.take(rays.photo != 3)
    rays = rays.take(np.bincount(rays.point)[rays.point] > 1)
    linear = linearised(network, state, rays)
    normals = reduced_normals(linear, structure(network, state, linear).pattern)
    add_prior(replace(network, vertical_weight=np.zeros(network.photos)), state, normals.matrix)
    assert np.allclose(normals.matrix.pieces(18 + np.arange(6)), np.diag([100.0, 100.0, 100.0, 0.0, 0.0, 0.0]))


def test_points_that_took_no_part_may_connect_photographs_without_common_points():
    network, state, rays = strips(3)
    cofactor = covariance_of(network, state, linearised(network, state, rays))
    pair = np.array([0, network.photos - 1], np.int32)
    middle = state.centre[pair].mean(axis=0) - [0, 0, 100]
    other = replace(state, point=middle[None])
    single = replace(network, point=np.zeros((1, 3)), point_weight=np.zeros((1, 3)))
    own = Rays(np.zeros(2, np.int32), pair, np.zeros((2, 2)), np.full(2, 0.3))
    linear = linearised(single, other, own)
    J = np.zeros((2, 2, len(cofactor)))
    for a, g, at in zip(J, linear.jg, linear.columns[linear.row], strict=True):
        a[:, at[at >= 0]] = g[:, at >= 0]
    B, P = by_point(linear, np.arange(2), 0), np.repeat(linear.weight, 2)
    V = np.linalg.inv(B.T @ (P[:, None] * B))
    move = V @ B.T @ (P[:, None] * J.reshape(4, -1))
    expected = V + move @ cofactor.times(move.T)
    assert not np.isfinite(cofactor.blocks.pieces(6 * pair)).all()
    assert np.allclose(points_elsewhere(linear, cofactor)[0], expected, rtol=1e-8, atol=1e-10 * np.abs(expected).max())


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 10**6), groups=st.integers(1, 70), others=st.integers(0, 6), links=st.integers(0, 160))
def test_any_pattern_is_solved_and_inverted(seed, groups, others, links):
    rng = np.random.default_rng(seed)
    total = groups + others
    near = rng.integers(0, groups, links)
    pairs = np.column_stack([near, np.minimum(near + rng.integers(0, 4, links), groups - 1)])
    pairs = np.vstack([pairs, rng.integers(0, total, (links // 4, 2))])
    cliques = csr_array((np.ones(pairs.size), pairs.ravel(), 2 * np.arange(len(pairs) + 1)), shape=(len(pairs), total))
    start = np.concatenate([[0], np.cumsum(rng.integers(1, 7, total))])
    matrix = BlockMatrix.zero(pattern_of(start, cliques))
    half = rng.standard_normal((len(matrix),) * 2)
    matrix.add_product(half, half)
    matrix.values[diagonal_places(matrix.pattern)] += matrix.row_sums()
    last = np.unique(rng.integers(0, groups, rng.integers(0, 3)))
    factors = factorised(structure_of(matrix.pattern, groups, last), matrix)
    inverse = np.linalg.inv(matrix.dense())
    right = rng.standard_normal((len(matrix), 2))
    assert np.allclose(factors.solve(right), inverse @ right, rtol=1e-9, atol=1e-12 * np.abs(inverse).max())
    expected = BlockMatrix.of(matrix.pattern, inverse)
    assert np.allclose(factors.selected_inverse().values, expected.values, rtol=1e-9, atol=1e-12 * np.abs(inverse).max())


def test_a_long_strip_stays_sparse():
    photos = 600
    pairs = np.column_stack([np.arange(photos - 2), np.arange(1, photos - 1), np.arange(2, photos)])
    cliques = csr_array((np.ones(pairs.size), pairs.ravel(), 3 * np.arange(len(pairs) + 1)), shape=(len(pairs), photos))
    order = structure_of(pattern_of(6 * np.arange(photos + 1), cliques), photos, np.zeros(0, np.int64))
    assert max(len(step.columns) for step in order.steps) <= 6 * 20
