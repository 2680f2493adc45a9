"""Data snooping of rays: one per point at a time, by standardised residuals that are standard normal."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import kstest
from small_network import dense, more_control, small_network, surveyed_noise

from orthomill.tasks.adjustment.model.reliability import NONCENTRALITY
from orthomill.tasks.adjustment.solve.minimise import minimise
from orthomill.tasks.adjustment.testing.adjustment_result import AS_STATED
from orthomill.tasks.adjustment.testing.ray_blunders import ray_blunders
from orthomill.tasks.adjustment.testing.solution_precision import precise_solution


def solved(network, state, rays, used=None):
    used = np.ones(len(rays), bool) if used is None else used
    state, _ = minimise(network, state, rays.take(used))
    return precise_solution(network, state, rays, used, AS_STATED)


def told(standardised, point, points=3):
    """What the test sees of a result."""
    return SimpleNamespace(
        standardised=np.array(standardised, float),
        rays=SimpleNamespace(point=np.array(point)),
        state=SimpleNamespace(point=np.zeros((points, 3))),
    )


def test_the_worst_ray_of_every_point_is_rejected_if_it_exceeds_its_limit():
    result = told([[5, 0], [0, -6], [1, 1], [4.5, 0], [np.nan, np.nan]], [0, 0, 1, 2, 2])
    assert list(ray_blunders(result, np.full(5, 4.0))) == [False, True, False, True, False]
    assert list(ray_blunders(result, np.array([4.0, 7.0, 4.0, 5.0, 4.0]))) == [False] * 5


@pytest.fixture(scope="module")
def noisy():
    network, state, rays = small_network(seed=8, photos=6, points=150, noise=1.0)
    return surveyed_noise(more_control(network, 6), np.random.default_rng(8)), state, rays


def test_standardised_residuals_are_baardas_w(noisy):
    network, state, rays = noisy
    result = solved(network, state, rays)
    A, normal, _ = dense(network, result.state, rays)
    sigma = np.repeat(rays.sigma, 2)
    r = 1 - np.einsum("ij,jk,ik->i", A, np.linalg.inv(normal), A) / sigma**2
    assert result.redundancy_number.ravel() == pytest.approx(r, abs=1e-4)
    assert result.standardised.ravel() == pytest.approx(result.residual.ravel() / (sigma * np.sqrt(r)), rel=1e-3, abs=1e-3)


def test_standardised_residuals_of_good_rays_are_standard_normal(noisy):
    result = solved(*noisy)
    w = result.standardised.ravel()
    assert w.std() == pytest.approx(1.0, abs=0.05)
    assert kstest(w, "norm").pvalue > 0.01


@pytest.mark.parametrize("axis", [0, 1])
def test_a_single_error_is_largest_at_its_own_ray(noisy, axis):
    network, state, rays = noisy
    clean = solved(network, state, rays)
    for i in (40, 333, 780):
        xy = rays.xy.copy()
        xy[i, axis] += 8.0 * rays.sigma[i]
        result = solved(network, state, replace(rays, xy=xy))
        assert ray_blunders(result, np.full(len(rays), 4.0))[i]
        # The share of the error that its own residual shows is the redundancy number.
        shown = (result.residual - clean.residual)[i, axis] / (8.0 * rays.sigma[i])
        assert shown == pytest.approx(clean.redundancy_number[i, axis], rel=0.02)


def test_an_error_of_the_detectable_size_shifts_w_by_the_noncentrality(noisy):
    network, state, rays = noisy
    clean = solved(network, state, rays)
    i = 500
    xy = rays.xy.copy()
    xy[i, 0] += clean.detectable[i, 0]
    moved = solved(network, state, replace(rays, xy=xy)).standardised[i, 0] - clean.standardised[i, 0]
    assert moved == pytest.approx(NONCENTRALITY, rel=0.02)


def test_rays_that_took_no_part_have_a_residual_and_no_test(noisy):
    network, state, rays = noisy
    used = np.arange(len(rays)) % 7 > 0
    result = solved(network, state, rays, used)
    assert np.isfinite(result.residual).all()
    assert np.isnan(result.standardised[~used]).all() and np.isfinite(result.standardised[used]).all()
    assert not ray_blunders(result, np.zeros(len(rays)))[~used].any()
