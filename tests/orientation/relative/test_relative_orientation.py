"""Checks 8 to 11 of sources/epipolar.md, and the robust start."""

import numpy as np
import pytest
from published_pairs import KEA, VOLOS, C, kea_case, matches

from orthomill.schemas.errors import GeometryError
from orthomill.tasks.adjustment.solve.mixed_model import solve_mixed
from orthomill.tasks.geometry.rotation import rotation_matrix
from orthomill.tasks.orientation.relative.relative_forms import (
    DependentOrientation,
    FiveRotations,
    dependent_form,
    derived_precision,
    five_rotation_form,
    from_exterior,
    smallest_rotation,
)
from orthomill.tasks.orientation.relative.relative_orientation import GeneralOrientation, orient_dependent, orient_robust


@pytest.mark.parametrize("truth", [VOLOS, KEA])
def test_noise_free_pairs_are_recovered_from_zero_starts(truth):
    relative = orient_dependent(matches(truth, 100, 1), C, C)
    assert np.abs(relative.solution.model.unknowns - truth).max() < 1e-9
    assert relative.solution.iterations <= 6


def test_sigma0_and_standard_errors_are_honest():
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
        FiveRotations(C, 1.1 * C, 0.02, -0.03, 0.04, 0.01, -0.02),
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


@pytest.mark.parametrize("truth", [VOLOS, KEA])
def test_five_rotations_say_the_same_as_the_dependent_form(truth):
    observations = matches(truth, 200, 4, 0.17)
    five = solve_mixed(FiveRotations(C, C), observations)
    dependent = solve_mixed(DependentOrientation(C, C), observations)
    assert five.iterations <= 6 and five.sigma0 == pytest.approx(dependent.sigma0, rel=1e-9)
    again = dependent_form(five.model.base, five.model.rotation, C, C)
    assert np.abs(again.unknowns - dependent.model.unknowns).max() < 1e-9
    back = five_rotation_form(dependent.model.base, dependent.model.rotation, C, C)
    assert np.abs(back.unknowns - five.model.unknowns).max() < 1e-9


def test_five_rotations_begin_with_the_published_parallax_equation():
    observations = matches(VOLOS, 50, 6)
    observations[:, 3] = observations[:, 1]
    x1, y1, x2, y2 = observations.T
    F, A, _ = FiveRotations(C, C).evaluate(observations)
    published = np.column_stack([-x1, x2, x1 * y1 / C, -x2 * y2 / C, C + y2**2 / C])
    assert np.abs(F).max() < 1e-6
    assert np.abs(np.abs(A / C) - np.abs(published)).max() < 1e-9 * C
    assert (np.sign(A * published).min(axis=0) == np.sign(A * published).max(axis=0)).all()


def test_the_smallest_rotation_is_a_rotation_onto_the_other_vector():
    rng = np.random.default_rng(1)
    for first, second in rng.standard_normal((20, 2, 3)):
        first, second = first / np.linalg.norm(first), second / np.linalg.norm(second)
        R = smallest_rotation(first, second)
        assert np.allclose(R @ R.T, np.eye(3), atol=1e-10) and np.linalg.det(R) > 0
        assert np.allclose(R @ first, second, atol=1e-10)
        assert np.isclose(np.arccos((np.trace(R) - 1) / 2), np.arccos(first @ second), atol=1e-6)


def test_relative_orientation_follows_from_exterior_orientation_with_its_precision():
    rng = np.random.default_rng(8)
    exterior = np.array([4e5, 4.3e6, 1100, 0.02, -0.01, 3.0, 4e5 - 580, 4.3e6 + 40, 1105, 0.01, 0.03, 3.05])
    base, rotation = from_exterior(exterior)
    left, right = rotation_matrix(*exterior[3:6]), rotation_matrix(*exterior[9:12])
    assert np.allclose(base, left @ (exterior[6:9] - exterior[:3]) / np.linalg.norm(exterior[6:9] - exterior[:3]))
    assert np.allclose(rotation, right @ left.T)
    scatter = rng.standard_normal((12, 12)) * np.tile([0.05, 0.05, 0.05, 1e-4, 1e-4, 1e-4], 2)[:, None]
    covariance = scatter @ scatter.T

    def form(b, R):
        return dependent_form(b, R, C, C).unknowns

    values, own = derived_precision(exterior, covariance, form)
    drawn = np.array([form(*from_exterior(exterior + scatter @ rng.standard_normal(12))) for _ in range(4000)])
    assert np.allclose(values, form(base, rotation))
    assert (
        np.abs(
            np.cov(drawn.T) / np.sqrt(np.outer(np.diag(own), np.diag(own))) - own / np.sqrt(np.outer(np.diag(own), np.diag(own)))
        ).max()
        < 0.1
    )
    together = np.block([[np.eye(3), np.zeros((3, 3)), np.eye(3), np.zeros((3, 3))], [np.zeros((3, 12))]] * 2)
    assert np.abs(derived_precision(exterior, together.T @ together, form)[1]).max() < 1e-8


def test_redundancy_numbers_say_which_error_of_a_match_would_be_found():
    observations = matches(VOLOS, 288, 12, 0.17)
    solution = solve_mixed(DependentOrientation(C, C), observations)
    assert solution.redundancy_number.sum() == pytest.approx(solution.redundancy, abs=1e-6)
    assert 0.9 < np.std(solution.standardised) < 1.1
    smallest = solution.detectable[:, 3]
    assert 0.17 * 4.13 < np.median(smallest) < 0.17 * 4.13 * 1.6
    with_error = observations.copy()
    with_error[40, 3] += 1.3 * smallest[40]
    assert np.abs(solve_mixed(solution.model, with_error).standardised).argmax() == 40


def test_weights_of_the_matches_reach_the_covariance():
    rng = np.random.default_rng(3)
    ratios = []
    for seed in range(30):
        observations = matches(VOLOS, 200, seed)
        sigma = np.repeat(np.where(rng.random(200) < 0.5, 0.05, 0.6)[:, None], 4, axis=1)
        solution = solve_mixed(DependentOrientation(C, C), observations + sigma * rng.standard_normal((200, 4)), sigma=sigma)
        assert 0.8 < solution.sigma0 < 1.2
        ratios.append((solution.model.unknowns - VOLOS) / solution.standard_errors)
    assert 0.75 < np.std(ratios) < 1.25
    equal = solve_mixed(DependentOrientation(C, C), observations + sigma * rng.standard_normal((200, 4)))
    assert (solution.standard_errors < 0.5 * equal.standard_errors).all()
