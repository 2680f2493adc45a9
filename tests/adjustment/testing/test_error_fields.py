"""Correlated image errors: the form of the fields, their effect against dense algebra, and what is found with and without them."""

from dataclasses import replace

import numpy as np
import pytest
from small_network import dense, small_network

from orthomill.tasks.adjustment.bundle import adjust
from orthomill.tasks.adjustment.testing.adjustment_result import CorrelatedErrors
from orthomill.tasks.adjustment.testing.error_field_precision import with_correlated_errors
from orthomill.tasks.adjustment.testing.error_fields import TERMS, correlated_errors, field_basis, weighted_rays

FRAME = np.array([1500.0, 1300.0])


def sizes(network):
    return np.tile(FRAME, (network.photos, 1))


def with_fields(rays, rng, rms, common):
    """The rays displaced by smooth fields: those of all photographs the same, or each its own."""
    coefficients = rms / np.sqrt(TERMS) * rng.standard_normal((1 if common else rays.photo.max() + 1, 2, TERMS))
    basis = field_basis(rays.xy, np.tile(FRAME, (len(rays), 1)))
    return replace(rays, xy=rays.xy + np.einsum("mkt,mt->mk", coefficients[rays.photo * (not common)], basis))


def test_fields_are_orthonormal_over_the_frame():
    nodes, weights = np.polynomial.legendre.leggauss(6)
    x, y = (v.ravel() for v in np.meshgrid(nodes, nodes))
    basis = field_basis(np.column_stack([x, y]) * FRAME / 2, np.tile(FRAME, (36, 1)))
    product = np.einsum("ma,m,mb->ab", basis, np.outer(weights, weights).ravel() / 4, basis)
    assert np.allclose(product, np.eye(TERMS), atol=1e-12)


@pytest.mark.parametrize("along_a_strip", [False, True], ids=["all see all", "along a strip"])
@pytest.mark.parametrize("share", [0.0, 0.4, 1.0])
def test_covariances_equal_those_of_dense_algebra(share, along_a_strip):
    network, state, rays = small_network(photos=6 if along_a_strip else 4, noise=1.0)
    if along_a_strip:
        # Each point in three neighbours: the first photographs and the last have none in common.
        rays = rays.take((rays.photo >= rays.point % 4) & (rays.photo < rays.point % 4 + 3))
    result = adjust(network, state, rays)
    got = with_correlated_errors(result, CorrelatedErrors(0.5, share, 100.0, 0.5), sizes(network))
    rays = weighted_rays(result)
    A, normal, _ = dense(result.network, result.state, rays)
    basis, photos = field_basis(rays.xy, np.tile(FRAME, (len(rays), 1))), network.photos
    B = np.zeros((len(rays), 2, photos, 2, TERMS))
    for k in range(2):
        B[np.arange(len(rays)), k, rays.photo, k] = basis
    effect = np.linalg.solve(normal, A.T @ (np.repeat(1 / rays.sigma**2, 2)[:, None] * B.reshape(len(A), -1)))
    C = 0.5**2 / TERMS * np.kron((1 - share) * np.eye(photos) + share, np.eye(2 * TERMS))
    added, n = effect @ C @ effect.T, network.unknowns
    assert np.allclose(got.cofactor.variances - result.cofactor.variances, np.diag(added)[:n], rtol=1e-4)
    # Of any two unknowns, also without common points.
    spread = got.cofactor.times(np.eye(n)) - result.cofactor.times(np.eye(n))
    assert np.allclose(spread, added[:n, :n], rtol=1e-3, atol=1e-4 * np.abs(added[:n, :n]).max())
    points = np.array([added[i : i + 3, i : i + 3] for i in range(n, len(added), 3)])
    assert np.allclose(got.point_covariance - result.point_covariance, points, rtol=1e-3, atol=1e-3 * np.abs(points).max())
    assert got.correlated.share == share and got.state is result.state


def repeated(rms, common, seeds):
    """Adjustments of the same block with new noise and new fields, nothing known of the interior orientation."""
    network, state, exact = small_network(photos=6, points=150, interior_free=(0, 1, 2, 3))
    interior, frame = replace(network.interior, weight=np.zeros((1, 8, 8))), sizes(network)
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        known = network.point + np.where(network.point_weight > 0, 0.02, 0.0) * rng.standard_normal(network.point.shape)
        centre = network.centre + 0.1 * rng.standard_normal(network.centre.shape)
        rays = replace(exact, xy=exact.xy + exact.sigma[:, None] * rng.standard_normal(exact.xy.shape))
        own = replace(network, interior=interior, point=known, centre=centre)
        result = adjust(own, state, with_fields(rays, rng, rms, common) if rms else rays)
        yield result, correlated_errors(result, frame), frame


def spread_of_c(results):
    """Root mean square of the errors of c, in their standard errors."""
    variances = [r.cofactor.variances[r.network.interior_columns[0, 0]] for r in results]
    errors = [r.state.interior[0, 0] - 1000.0 for r in results]
    return float(np.sqrt(np.mean(np.square(errors) / variances)))


@pytest.mark.parametrize("common", [False, True])
def test_fields_are_found_and_standard_errors_cover_them(common):
    before, after, rms, shares = [], [], [], []
    for result, errors, frame in repeated(0.5, common, 12):
        before.append(result)
        after.append(with_correlated_errors(result, errors, frame))
        rms.append(errors.rms_px)
        shares.append(errors.share)
    assert spread_of_c(before) > 2.0
    assert 0.7 < spread_of_c(after) < 1.35
    assert np.isclose(np.median(rms), 0.5, rtol=0.25)
    assert np.mean(shares) > 0.8 if common else np.mean(shares) < 0.2


def test_white_noise_has_no_correlated_errors():
    assert [errors for _, errors, _ in repeated(0.0, False, 12)] == [None] * 12
