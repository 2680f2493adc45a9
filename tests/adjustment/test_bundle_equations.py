"""Derivatives against numeric ones; the reduced normal equations against dense least squares; precision against a dense inverse."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.sparse import csr_array

from schemas.errors import GeometryError
from tasks.adjustment.block_matrix import BlockMatrix, pattern_of
from tasks.adjustment.bundle import BlunderTest, adjust
from tasks.adjustment.collinearity import derivatives, misclosures
from tasks.adjustment.datum import add_prior, freedoms, prior_cost
from tasks.adjustment.linearisation import linearised, structure
from tasks.adjustment.minimise import minimise
from tasks.adjustment.network import Interior, Network, Rays, State, ray_columns
from tasks.adjustment.normal_equations import point_corrections, point_precision, reduced_normals
from tasks.adjustment.precision import covariance_of, with_considered
from tasks.geometry.rotation import rotation_matrix
from tasks.geometry.rotation_vector import angles_from_vector, rotation_of_vector, vector_of_rotation

INTERIOR_VALUES = np.array([1000.0, 3.0, -2.0, -0.05, 0.02, -0.01, 1e-3, -5e-4])


def small_network(seed=0, photos=4, points=30, noise=0.0, free=False, interior_free=(0, 1, 3)):
    """Photos over uneven ground, each point in all of them; GNSS on every photo unless free, control on the first four points."""
    rng = np.random.default_rng(seed)
    rotation = np.array([rotation_matrix(*(0.05 * rng.standard_normal(3) + [0, 0, k])) for k in rng.uniform(0, 6, photos)])
    centre = np.column_stack([40 * (np.arange(photos) % 2), 40 * (np.arange(photos) // 2), 100 + rng.normal(0, 3, photos)])
    point = np.column_stack([rng.uniform(-10, 50, (points, 2)), rng.normal(0, 6, points)])
    state = State(rotation, centre, point, INTERIOR_VALUES[None], np.zeros(3))
    index = np.repeat(np.arange(points), photos).astype(np.int32), np.tile(np.arange(photos), points).astype(np.int32)
    camera_of = np.zeros(photos, np.int64)
    rays = Rays(*index, np.zeros((points * photos, 2)), rng.uniform(0.2, 0.6, points * photos))
    rays = replace(
        rays, xy=-misclosures(state, rays, camera_of) + noise * rays.sigma[:, None] * rng.standard_normal((len(rays), 2))
    )
    mask = np.isin(np.arange(8), interior_free)[None]
    weight = np.zeros((1, 8, 8))
    weight[0][np.ix_(mask[0], mask[0])] = np.diag(1 / np.array([2.0, 1, 1, 0.01, 0.01, 0.01, 1e-3, 1e-3])[mask[0]] ** 2)
    known = np.zeros((points, 3))
    known[:4] = 0 if free else 1 / 0.02**2
    network = Network(
        camera_of,
        Interior(INTERIOR_VALUES[None], weight, mask, np.zeros_like(mask)),
        centre,
        np.full((photos, 3), 0 if free else 1 / 0.1**2),
        point,
        known,
        np.zeros(photos),
        shift=not free,
        free=free,
    )
    return network, state, rays


def moved(state, rng, size=1.0):
    turned = np.array([rotation_of_vector(0.01 * size * rng.standard_normal(3)) @ R for R in state.rotation])
    return replace(
        state,
        rotation=turned,
        centre=state.centre + size * rng.standard_normal(state.centre.shape),
        point=state.point + size * rng.standard_normal(state.point.shape),
    )


def test_analytic_derivatives_equal_numeric_ones():
    network, state, rays = small_network()
    jg, jp = derivatives(state, rays, network.camera_of)
    steps = [1e-3] * 3 + [1e-6] * 3 + [1e-3] * 3 + [1e-6] * 5

    def at(k, h):
        rotation, centre, interior = state.rotation.copy(), state.centre.copy(), state.interior.copy()
        if k < 3:
            centre[:, k] += h
        elif k < 6:
            rotation = np.array([rotation_of_vector(h * np.eye(3)[k - 3]) @ R for R in rotation])
        else:
            interior[:, k - 6] += h
        return -misclosures(replace(state, rotation=rotation, centre=centre, interior=interior), rays, network.camera_of)

    for k, h in enumerate(steps):
        numeric = (at(k, h) - at(k, -h)) / (2 * h)
        assert np.abs(numeric - jg[:, :, k]).max() <= 1e-6 * max(np.abs(jg[:, :, k]).max(), 1.0)
    for k in range(3):
        move = 1e-3 * np.eye(3)[k]
        numeric = (
            -(
                misclosures(replace(state, point=state.point + move), rays, network.camera_of)
                - misclosures(replace(state, point=state.point - move), rays, network.camera_of)
            )
            / 2e-3
        )
        assert np.abs(numeric - jp[:, :, k]).max() < 1e-6 * np.abs(jp).max()


def pattern(network, state, rays):
    return structure(network, state, linearised(network, state, rays)).pattern


def prior_alone(network, state):
    """Normal matrix and right-hand side of what is known beforehand."""
    whole = pattern_of(network.group_start, csr_array(np.ones((1, len(network.group_start) - 1))))
    matrix = BlockMatrix.zero(whole)
    right = add_prior(network, state, matrix)
    return matrix.dense(), right


def dense(network, state, rays):
    """The whole design matrix, plain NumPy: unknowns of the reduced system first, then the points."""
    (row, columns), (jg, jp) = ray_columns(network, rays), derivatives(state, rays, network.camera_of)
    n, N = network.unknowns, len(state.point)
    A = np.zeros((len(rays), 2, n + 3 * N))
    for i in range(len(rays)):
        for a, column in enumerate(columns[row[i]]):
            if column >= 0:
                A[i, :, column] = jg[i, :, a]
        A[i, :, n + 3 * rays.point[i] : n + 3 * rays.point[i] + 3] = jp[i]
    A = A.reshape(-1, n + 3 * N)
    P = np.repeat(1 / rays.sigma**2, 2)
    normal, right = A.T @ (P[:, None] * A), A.T @ (P * misclosures(state, rays, network.camera_of).ravel())
    prior, prior_right = prior_alone(network, state)
    normal[:n, :n] += prior
    right[:n] += prior_right
    normal[n:, n:] += np.diag(network.point_weight.ravel())
    right[n:] += (network.point_weight * (network.point - state.point)).ravel()
    return A, normal, right


def test_reduced_system_and_way_back_equal_dense_least_squares():
    network, state, rays = small_network(noise=1.0)
    state = moved(state, np.random.default_rng(1), 0.1)
    _, normal, right = dense(network, state, rays)
    expected = np.linalg.solve(normal, right)
    linear = linearised(network, state, rays)
    normals = reduced_normals(linear, pattern(network, state, rays))
    right = normals.right + add_prior(network, state, normals.matrix)
    got = np.linalg.solve(normals.matrix.dense(), right)
    scale = np.sqrt(np.diag(np.linalg.inv(normal)))
    assert (np.abs(got - expected[: network.unknowns]) / scale[: network.unknowns]).max() < 1e-5
    back = point_corrections(linear, got).ravel()
    assert (np.abs(back - expected[network.unknowns :]) / scale[network.unknowns :]).max() < 1e-5


def test_precision_equals_the_dense_inverse():
    network, state, rays = small_network()
    A, normal, _ = dense(network, state, rays)
    inverse, n = np.linalg.inv(normal), network.unknowns
    linear = linearised(network, state, rays)
    cofactor = covariance_of(network, state, linear)
    assert np.allclose(cofactor.variances, np.diag(inverse)[:n], rtol=1e-5)
    points, adjusted = point_precision(linear, cofactor.blocks)
    assert np.allclose(points[7], inverse[n + 21 : n + 24, n + 21 : n + 24], rtol=1e-4, atol=1e-12)
    assert np.allclose(adjusted.ravel(), np.einsum("ij,jk,ik->i", A, inverse, A), rtol=1e-4)


def test_prior_normals_are_the_derivatives_of_the_prior_cost():
    network, state, _ = small_network()
    network = replace(network, vertical_weight=np.full(network.photos, 50.0))
    state = moved(state, np.random.default_rng(2), 0.3)
    _, right = prior_alone(network, state)
    for k in range(3):
        move = np.zeros(3)
        move[k] = 1e-6
        numeric = []
        for sign in (1, -1):
            rotation = state.rotation.copy()
            rotation[1] = rotation_of_vector(sign * move) @ rotation[1]
            numeric.append(prior_cost(network, replace(state, rotation=rotation)))
        assert np.isclose(-0.5 * (numeric[0] - numeric[1]) / 2e-6, right[6 + 3 + k], rtol=1e-5, atol=1e-6)


def test_noise_free_block_is_recovered_from_far_starts():
    network, truth, rays = small_network()
    state, iterations = minimise(network, moved(truth, np.random.default_rng(4), 4.0), rays)
    assert np.abs(state.centre - truth.centre).max() < 1e-6
    assert np.abs(state.point - truth.point).max() < 1e-6
    assert iterations < 30


def test_free_network_keeps_shape_and_has_the_seven_freedoms():
    network, truth, rays = small_network(free=True, interior_free=())
    linear = linearised(network, truth, rays)
    reduced = reduced_normals(linear, pattern(network, truth, rays)).matrix.dense()
    H = freedoms(network, truth)
    assert np.abs(reduced @ H).max() < 1e-6 * np.abs(reduced).max() * np.abs(H).max()
    state, _ = minimise(network, moved(truth, np.random.default_rng(5), 1.0), rays)
    lengths = [np.linalg.norm(s.centre[0] - s.centre[3]) / np.linalg.norm(s.centre[1] - s.centre[2]) for s in (state, truth)]
    assert np.isclose(*lengths, rtol=1e-6)
    cofactor = covariance_of(network, truth, linear).times(np.eye(network.unknowns))
    assert np.linalg.matrix_rank(cofactor * np.sqrt(np.outer(np.diag(reduced), np.diag(reduced))), tol=1e-6) == network.unknowns - 7


def test_without_datum_the_rank_defect_is_an_error():
    network, truth, rays = small_network(free=True, interior_free=())
    with pytest.raises(GeometryError, match="not determined"):
        covariance_of(replace(network, free=False), truth, linearised(network, truth, rays))


def test_blunders_are_found_and_the_stated_sigma_is_put_right():
    network, truth, rays = small_network(seed=3, points=150, noise=2.0)
    rng = np.random.default_rng(9)
    bad = rng.choice(len(rays), 25, replace=False)
    xy = rays.xy.copy()
    xy[bad] += rng.choice([-1, 1], (25, 2)) * rng.uniform(10, 200, (25, 2))
    result = adjust(network, moved(truth, rng, 0.5), replace(rays, xy=xy), BlunderTest())
    assert not result.used[bad].any()
    assert result.used.sum() > 0.97 * (len(rays) - 25)
    assert 1.8 < result.factors.image < 2.2
    error = (result.state.centre - truth.centre).ravel() / np.sqrt(
        np.concatenate([np.diag(result.exterior_covariance(p))[:3] for p in range(4)])
    )
    assert np.abs(error).max() < 4


def test_considered_camera_constant_moves_the_block_as_its_covariance_says():
    network, truth, rays = small_network(seed=2, interior_free=(0, 3))
    considered = np.zeros((1, 8), bool)
    considered[0, 0] = True
    network = replace(network, interior=replace(network.interior, considered=considered))
    linear, column = linearised(network, truth, rays), network.interior_columns[0, 0]
    estimated = covariance_of(network, truth, linear)
    total = with_considered(network, linear, estimated).times(np.eye(network.unknowns))
    sigma = np.sqrt(total[column, column])
    assert np.isclose(sigma, 2.0)
    step = 0.05
    interior = truth.interior.copy()
    interior[0, 0] += step
    state, _ = minimise(network, replace(truth, interior=interior), rays, tolerance=1e-14)
    assert state.interior[0, 0] == interior[0, 0]
    moved_by = (state.centre - truth.centre) / step
    expected = np.array([total[6 * photo : 6 * photo + 3, column] for photo in range(network.photos)]) / sigma**2
    assert np.abs(moved_by - expected).max() < 0.02 * np.abs(expected).max()
    assert (np.diag(total) >= estimated.variances - 1e-15).all()


def test_redundancy_numbers_sum_to_the_redundancy():
    network, truth, rays = small_network(seed=1, noise=1.0)
    network = replace(
        network,
        centre_weight=np.zeros((4, 3)),
        shift=False,
        point_weight=network.point_weight * 1e6,
        interior=replace(network.interior, free=np.zeros((1, 8), bool), weight=np.zeros((1, 8, 8))),
    )
    result = adjust(network, truth, rays, BlunderTest(limit=50))
    assert np.isclose(np.nansum(result.redundancy_number), result.redundancy, atol=0.05)


@pytest.mark.parametrize("angles", [(0.1, -0.2, 3.0), (1.5, 0.3, -1.0)])
def test_rotation_vectors_and_angles_move_together(angles):
    R = rotation_matrix(*angles)
    by_vector = angles_from_vector(R)
    w = np.array([1e-6, -2e-6, 3e-6])
    from tasks.geometry.rotation import angles as angles_of

    assert np.allclose((np.array(angles_of(rotation_of_vector(w) @ R)) - angles), by_vector @ w, rtol=1e-4, atol=1e-10)
    assert np.allclose(vector_of_rotation(rotation_of_vector(np.array([0.3, -1.0, 2.0]))), [0.3, -1.0, 2.0])


def test_points_near_the_horizon_do_not_drown_what_holds_a_weak_block():
    """Rays that meet at seconds of arc: eliminating their points must leave no negative information about the photographs."""
    network, state, rays = small_network()
    far = replace(state, point=state.centre.mean(axis=0) + 3e6 * (state.point - state.centre.mean(axis=0)))
    ahead = np.abs(misclosures(far, rays, network.camera_of)).max(axis=1) < 1e4
    count = np.bincount(rays.point[ahead], minlength=len(state.point))
    rays = rays.take(ahead & (count[rays.point] >= 2))
    reduced = reduced_normals(linearised(network, far, rays), pattern(network, far, rays)).matrix.dense()
    normal = reduced[: 6 * network.photos, : 6 * network.photos]
    size = np.sqrt(np.diag(normal).max())
    assert np.linalg.eigvalsh(normal / size**2).min() > -1e-13
