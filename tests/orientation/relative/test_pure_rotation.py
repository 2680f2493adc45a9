"""The pure rotation test: exact, robust, blind to nothing that has parallax, and the same photograph given twice."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from orthomill.tasks.geometry.rotation import rotation_matrix
from orthomill.tasks.orientation.relative.pure_rotation import pure_rotation

C_LEFT, C_RIGHT = 1200.0, 1500.0


def rotated(angles, count=80, noise=0.0, base=(0.0, 0.0, 0.0), seed=1):
    """(count, 4) matches of a camera that rotated by `angles` and moved by `base`, over points at depths of 5 to 15."""
    rng = np.random.default_rng(seed)
    rays = np.column_stack([rng.uniform(-0.35, 0.35, count), rng.uniform(-0.3, 0.3, count), -np.ones(count)])
    points = rays * rng.uniform(5, 15, count)[:, None]
    turned = (points - base) @ rotation_matrix(*angles).T
    ideal = np.hstack([-C_LEFT * points[:, :2] / points[:, 2:], -C_RIGHT * turned[:, :2] / turned[:, 2:]])
    return ideal + noise * rng.standard_normal(ideal.shape)


@settings(deadline=None, max_examples=25)
@given(st.tuples(st.floats(-0.3, 0.3), st.floats(-0.3, 0.3), st.floats(-3, 3)))
def test_exact_matches_give_the_rotation(angles):
    found = pure_rotation(rotated(angles), C_LEFT, C_RIGHT, 3.0)
    assert found.kept.all() and not found.same
    np.testing.assert_allclose(found.rotation, rotation_matrix(*angles), atol=1e-9)


def test_two_thirds_of_wrong_matches_do_no_harm():
    observations = rotated((0.05, -0.1, 0.3), 150, noise=0.3)
    observations[50:, 2:] += np.random.default_rng(2).uniform(50, 300, (100, 2))
    found = pure_rotation(observations, C_LEFT, C_RIGHT, 3.0)
    assert found.kept[:50].mean() > 0.9 and found.kept[50:].sum() <= 3
    angle = np.arccos((np.trace(found.rotation @ rotation_matrix(0.05, -0.1, 0.3).T) - 1) / 2)
    assert np.degrees(angle) < 0.05


def test_parallax_is_not_taken_for_a_rotation():
    found = pure_rotation(rotated((0.05, 0.0, 0.1), base=(1.5, 0.0, 0.0)), C_LEFT, C_RIGHT, 3.0)
    assert found.kept.mean() < 0.3


def test_far_points_of_a_small_base_look_like_a_rotation():
    """A base of 1/10 000 of the distance gives a parallax of a tenth of a pixel: below the threshold."""
    assert pure_rotation(rotated((0, 0, 0.1), base=(5e-4, 0, 0)), C_LEFT, C_RIGHT, 3.0).kept.all()


def test_the_threshold_is_in_pixels_of_the_right_image():
    observations = rotated((0.02, 0.01, 0.0))
    observations[7, 2] += 5.0
    kept = [pure_rotation(observations, C_LEFT, C_RIGHT, threshold).kept[7] for threshold in (3.0, 8.0)]
    assert kept == [False, True]


@pytest.mark.parametrize(("shift", "same"), [(0.0, True), (0.02, True), (0.3, False)])
def test_the_same_photograph_has_the_same_coordinates(shift, same):
    own = rotated((0, 0, 0))
    found = pure_rotation(np.hstack([own[:, :2], own[:, :2] + shift]), C_LEFT, C_LEFT, 3.0)
    assert found.kept.all() and found.same is same


def test_the_seed_makes_it_repeatable():
    observations = rotated((0.1, 0.2, 0.3), noise=1.5)
    first, second = (pure_rotation(observations, C_LEFT, C_RIGHT, 3.0) for _ in range(2))
    np.testing.assert_array_equal(first.rotation, second.rotation)
    np.testing.assert_array_equal(first.kept, second.kept)
