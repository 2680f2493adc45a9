"""Acceptance checks 8 to 11 of the methods page, and the robust start."""

import numpy as np
import pytest

from schemas.errors import GeometryError
from tasks.geometry.rotation import rotation_matrix
from tasks.orientation.relative import DependentOrientation, GeneralOrientation, orient_dependent, orient_robust

VOLOS = (0.0382, -0.0084, *np.radians([0.9721, 0.6725, 1.8082]))
KEA = (-0.0450, -0.0085, *np.radians([1.6902, -0.0555, -2.5862]))
C = 153.353 / 0.064


def matches(truth, count, seed, noise=0.0, base_height=582 / 1029, c=C):
    """(count, 4) image coordinates over the common part of a pair with 60 % overlap, gentle relief."""
    rng = np.random.default_rng(seed)
    depth = -1 / base_height * (1 + 0.05 * rng.standard_normal(count))
    reach = 0.75 / base_height
    points = np.column_stack([rng.uniform(1 - reach, reach, count), rng.uniform(-reach, reach, count), depth])
    R = rotation_matrix(*truth[2:])
    turned = (points - [1, truth[0], truth[1]]) @ R.T
    ideal = np.hstack([-c * points[:, :2] / points[:, 2:], -c * turned[:, :2] / turned[:, 2:]])
    return ideal + noise * rng.standard_normal(ideal.shape)


@pytest.mark.parametrize("truth", [VOLOS, KEA])
def test_noise_free_pairs_are_recovered_from_zero_starts(truth):
    relative = orient_dependent(matches(truth, 100, 1), C, C)
    assert np.abs(relative.solution.model.unknowns - truth).max() < 1e-9
    assert relative.solution.iterations <= 6


def test_sigma0_and_standard_errors_are_honest():
    from tasks.adjustment.mixed_model import solve_mixed

    ratios, sigmas = [], []
    for seed in range(40):
        solution = solve_mixed(DependentOrientation(C, C), matches(VOLOS, 1062, seed, 0.17))
        ratios.append((solution.model.unknowns - VOLOS) / solution.standard_errors)
        sigmas.append(solution.sigma0)
    assert np.abs(np.array(sigmas) - 0.17).max() < 0.02
    assert abs(np.mean(sigmas) / 0.17 - 1) < 0.03
    assert (np.abs(ratios) < 3).mean() >= 0.97
    assert 0.8 < np.std(ratios) < 1.2


def test_five_matches_are_exact_and_four_are_refused():
    five = orient_dependent(matches(VOLOS, 5, 3), C, C).solution
    assert five.redundancy == 0 and np.isnan(five.sigma0)
    assert np.abs(five.residuals).max() < 1e-6
    with pytest.raises(GeometryError, match="4 matches"):
        orient_dependent(matches(VOLOS, 4, 3), C, C)


@pytest.mark.parametrize(
    "model",
    [
        DependentOrientation(C, 1.1 * C, 0.04, -0.01, 0.02, 0.03, -0.05),
        GeneralOrientation(C, 1.1 * C, np.array([0.3, 0.9, 0.1]) / np.sqrt(0.91), rotation_matrix(0.3, -0.2, 1.5)),
    ],
)
def test_analytic_derivatives_equal_numeric_ones(model):
    observations = matches(VOLOS, 20, 5)
    _, A, B = model.evaluate(observations)
    step = 1e-6
    for k in range(5):
        move = np.zeros(5)
        move[k] = step
        numeric = (model.moved(move).evaluate(observations)[0] - model.moved(-move).evaluate(observations)[0]) / (2 * step)
        assert np.abs(numeric - A[:, k]).max() < 1e-6 * np.abs(A[:, k]).max()
    for k in range(4):
        move = np.zeros(4)
        move[k] = 1e-2
        numeric = (model.evaluate(observations + move)[0] - model.evaluate(observations - move)[0]) / 2e-2
        assert np.abs(numeric - B[:, k]).max() < 1e-6 * np.abs(B).max()


def test_published_rejection_removes_all_gross_errors_and_few_good_matches():
    observations = matches(VOLOS, 1096, 11, 0.17)
    rng = np.random.default_rng(5)
    observations[-18:, 3] += rng.choice([-1, 1], 18) * rng.uniform(5, 20, 18)
    relative = orient_dependent(observations, C, C)
    assert not relative.kept[-18:].any()
    assert relative.kept[:-18].mean() > 0.97
    parallax = np.abs(relative.solution.residuals[:, (1, 3)])
    assert parallax.max() <= 2.67 * relative.solution.sigma0


def kea_case(seed):
    observations = matches(KEA, 154, 100 + seed, 0.2, 829 / 1525, 152.52 / 0.049)
    rng = np.random.default_rng(seed)
    observations[36:, 2:] += rng.uniform(-190, 190, (118, 2))
    return observations


def test_published_rejection_is_helpless_against_a_majority_of_blunders():
    c = 152.52 / 0.049
    assert orient_dependent(kea_case(1), c, c).solution.sigma0 > 5


@pytest.mark.parametrize("seed", range(6))
def test_robust_start_finds_36_right_matches_among_154(seed):
    c = 152.52 / 0.049
    relative = orient_robust(kea_case(seed), c, c)
    assert relative.kept[:36].mean() > 0.9
    assert relative.kept[36:].sum() <= 8
    R = rotation_matrix(*KEA[2:])
    turn = np.degrees(np.arccos(np.clip((np.trace(R @ relative.solution.model.rotation.T) - 1) / 2, -1, 1)))
    assert turn < 0.3
