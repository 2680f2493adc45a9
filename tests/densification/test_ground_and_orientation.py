"""Heights and standard errors of nodes where they can be written down."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from village_pair import STEP, all_nodes, level_nodes, level_pair, parallax_of

from orthomill.schemas.raster import Window
from orthomill.tasks.densification.ground_intersection import nodes_on_ground, orientation_sigma


def at_places(pair, table):
    """Heights' standard errors at the nine places of the pair, from left image pixels on level ground."""
    pair = pair.model_copy(update={"height_sigmas": tuple(table)})
    col, row = np.meshgrid([0, (pair.left_cols - 1) / 2, pair.left_cols - 1], [0, (pair.rows - 1) / 2, pair.rows - 1])
    scale = pair.base / parallax_of(pair, 0.0)
    x, y = pair.left_centre[0] + (col - pair.left_col0) * scale, pair.left_centre[1] + (pair.row0 - row) * scale
    return pair, x, y, np.zeros(x.shape)


@settings(max_examples=40, deadline=None)
@given(z=st.floats(-20.0, 55.0), row=st.integers(0, 20), col=st.integers(0, 20))
def test_nodes_of_level_ground_lie_on_it(z, row, col):
    pair, window = level_pair(), Window(row, col, 3, 4)
    ground = nodes_on_ground(pair, level_nodes(pair, z, window), window, STEP)
    assert ground.z == pytest.approx(z, abs=1e-3)
    scale = pair.base / float(np.float32(parallax_of(pair, z)))
    x = pair.left_centre[0] + (STEP * (col + np.arange(4)) - pair.left_col0) * scale
    y = pair.left_centre[1] + (pair.row0 - STEP * (row + np.arange(3))) * scale
    assert np.allclose(ground.x, x[None, :], atol=1e-6) and np.allclose(ground.y, y[:, None], atol=1e-6)


def test_an_error_of_the_parallax_moves_the_height_by_its_standard_error():
    pair, window = level_pair(), Window(5, 5, 1, 1)
    nodes = level_nodes(pair, 20.0, window, sigma=0.3)
    higher = nodes.copy()
    higher[..., 0] += 0.3
    low, high = (nodes_on_ground(pair, n, window, STEP) for n in (nodes, higher))
    assert high.z[0, 0] - low.z[0, 0] == pytest.approx(low.sigma[0, 0], rel=1e-3)


def test_matching_and_orientation_errors_add_as_variances():
    window = Window(0, 0, 2, 2)
    with_rows = level_pair(row_sigma=0.4)
    plain = nodes_on_ground(level_pair(), level_nodes(level_pair(), 0.0, window, 0.3), window, STEP).sigma
    both = nodes_on_ground(with_rows, level_nodes(with_rows, 0.0, window, 0.3), window, STEP).sigma
    assert both == pytest.approx(plain * 5.0 / 3.0, rel=1e-5)


def test_nodes_without_a_match_or_before_the_camera_have_no_ground():
    pair, window = level_pair(), Window(0, 0, 1, 3)
    nodes = level_nodes(pair, 0.0, window)
    nodes[0, 0, 0], nodes[0, 1, 0] = np.nan, -5.0
    ground = nodes_on_ground(pair, nodes, window, STEP)
    assert np.isnan(ground.z[0, :2]).all() and np.isnan(ground.sigma[0, :2]).all() and np.isfinite(ground.z[0, 2])


def test_the_nodes_of_a_window_are_those_of_the_whole():
    pair = level_pair()
    whole, part = all_nodes(pair), Window(7, 3, 5, 6)
    nodes = level_nodes(pair, 5.0, whole)
    nodes[..., 0] += np.random.default_rng(0).normal(0, 3, nodes.shape[:2]).astype(np.float32)
    one, every = nodes_on_ground(pair, nodes[part.slices], part, STEP), nodes_on_ground(pair, nodes, whole, STEP)
    for name in ("x", "y", "z", "sigma"):
        assert np.array_equal(getattr(one, name), getattr(every, name)[part.slices]), name


def test_the_orientation_part_is_exact_at_its_nine_places():
    table = np.arange(1.0, 10.0)
    pair, x, y, z = at_places(level_pair(), table)
    assert orientation_sigma(pair, x, y, z).ravel() == pytest.approx(table, abs=1e-9)


def test_the_inverse_of_the_orientation_part_is_linear_between_places():
    table = np.array([4.0, 4.0 / 3.0, 0.8] * 3)
    pair, x, y, z = at_places(level_pair(), table)
    quarter = x[:, 0] + 0.25 * (x[:, 2] - x[:, 0])
    assert orientation_sigma(pair, quarter, y[:, 0], z[:, 0]) == pytest.approx(2.0, abs=1e-9)


def test_an_exact_orientation_adds_nothing():
    pair, x, y, z = at_places(level_pair(), np.zeros(9))
    assert orientation_sigma(pair, x, y, z).max() < 1e-6


def test_the_orientation_part_is_constant_beyond_the_image():
    pair, x, y, z = at_places(level_pair(), np.arange(1.0, 10.0))
    far = orientation_sigma(pair, x + 5000.0 * np.sign(x - x[1, 1]), y, z)
    assert far == pytest.approx(np.arange(1.0, 10.0).reshape(3, 3), abs=1e-6)


def test_without_a_covariance_the_orientation_part_is_zero_where_there_is_a_height():
    z = np.array([1.0, np.nan])
    assert np.array_equal(orientation_sigma(level_pair(), z, z, z), [0.0, np.nan], equal_nan=True)
    pair = level_pair(height_sigmas=(0.5,) * 9)
    assert np.array_equal(np.isnan(orientation_sigma(pair, np.zeros(2), np.zeros(2), z)), [False, True])
