"""Derivatives against numeric ones; the reduced normal equations against dense least squares; precision against a dense inverse."""

from dataclasses import replace

import numpy as np
import pytest
from small_network import dense, moved, pattern, prior_alone, small_network

from orthomill.schemas.errors import GeometryError
from orthomill.tasks.adjustment.bundle import BlunderTest, adjust
from orthomill.tasks.adjustment.model.collinearity import derivatives, residuals
from orthomill.tasks.adjustment.model.datum import add_prior, freedoms, prior_cost
from orthomill.tasks.adjustment.model.linearisation import linearised
from orthomill.tasks.adjustment.model.network import NOT_SHIFTED
from orthomill.tasks.adjustment.solve.minimise import minimise
from orthomill.tasks.adjustment.solve.normal_equations import point_corrections, point_covariances, point_precision, reduced_normals
from orthomill.tasks.adjustment.testing.covariances import covariance_of, with_considered
from orthomill.tasks.geometry.rotation import rotation_matrix
from orthomill.tasks.geometry.rotation_vector import angles_from_vector, rotation_of_vector, vector_of_rotation


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
        return -residuals(replace(state, rotation=rotation, centre=centre, interior=interior), rays, network.camera_of)

    for k, h in enumerate(steps):
        numeric = (at(k, h) - at(k, -h)) / (2 * h)
        assert np.abs(numeric - jg[:, :, k]).max() <= 1e-6 * max(np.abs(jg[:, :, k]).max(), 1.0)
    for k in range(3):
        move = 1e-3 * np.eye(3)[k]
        numeric = (
            -(
                residuals(replace(state, point=state.point + move), rays, network.camera_of)
                - residuals(replace(state, point=state.point - move), rays, network.camera_of)
            )
            / 2e-3
        )
        assert np.abs(numeric - jp[:, :, k]).max() < 1e-6 * np.abs(jp).max()


def test_reduced_system_and_back_substitution_equal_dense_least_squares():
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
    assert (point_covariances(linear, cofactor.blocks) == points).all()
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


def test_blunders_are_found_and_the_stated_sigma_is_corrected():
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
        shift=NOT_SHIFTED,
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
    from orthomill.tasks.geometry.rotation import angles as angles_of

    assert np.allclose((np.array(angles_of(rotation_of_vector(w) @ R)) - angles), by_vector @ w, rtol=1e-4, atol=1e-10)
    assert np.allclose(vector_of_rotation(rotation_of_vector(np.array([0.3, -1.0, 2.0]))), [0.3, -1.0, 2.0])


def test_points_near_the_horizon_do_not_hide_what_determines_a_poorly_determined_block():
    """Rays that intersect at seconds of arc: eliminating their points must leave no negative information about the photographs."""
    network, state, rays = small_network()
    far = replace(state, point=state.centre.mean(axis=0) + 3e6 * (state.point - state.centre.mean(axis=0)))
    ahead = np.abs(residuals(far, rays, network.camera_of)).max(axis=1) < 1e4
    count = np.bincount(rays.point[ahead], minlength=len(state.point))
    rays = rays.take(ahead & (count[rays.point] >= 2))
    reduced = reduced_normals(linearised(network, far, rays), pattern(network, far, rays)).matrix.dense()
    normal = reduced[: 6 * network.photos, : 6 * network.photos]
    size = np.sqrt(np.diag(normal).max())
    assert np.linalg.eigvalsh(normal / size**2).min() > -1e-13
