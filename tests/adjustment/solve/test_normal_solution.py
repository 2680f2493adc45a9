"""Reduced normal equations, back substitution and inverses: damping, singular points, the S-transformation, closed forms."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import block_diag
from small_network import dense, moved, pattern, prior_alone, small_network

from orthomill.tasks.adjustment.model.datum import add_prior, freedoms
from orthomill.tasks.adjustment.model.linearisation import linearised, structure
from orthomill.tasks.adjustment.model.network import NOT_SHIFTED, Rays, State
from orthomill.tasks.adjustment.solve.normal_equations import (
    SINGULAR,
    _invert,
    point_corrections,
    point_precision_alone,
    reduced_normals,
)
from orthomill.tasks.adjustment.solve.normal_inverse import inverse_of
from orthomill.tasks.adjustment.sparse.block_cholesky import structure_of


def normal_case(depth, base, c, sigma):
    """Two vertical photographs at a distance `base`, and one point halfway between them."""
    network, _, _ = small_network(photos=2, points=1, interior_free=())
    centre = np.array([[0.0, 0.0, depth], [base, 0.0, depth]])
    network = replace(network, shift=NOT_SHIFTED, point_weight=np.zeros((1, 3)))
    interior = np.array([[c, 0, 0, 0, 0, 0, 0, 0]], float)
    state = State(np.tile(np.eye(3), (2, 1, 1)), centre, np.array([[base / 2, 0.0, 0.0]]), interior, np.zeros(3))
    rays = Rays(np.zeros(2, np.int32), np.arange(2, dtype=np.int32), np.zeros((2, 2)), np.full(2, sigma))
    return network, state, rays


@pytest.mark.parametrize(("depth", "base"), [(100.0, 60.0), (1000.0, 600.0), (1000.0, 50.0)])
def test_the_normal_case_has_its_textbook_precision(depth, base):
    c, sigma = 1500.0, 0.3
    network, state, rays = normal_case(depth, base, c, sigma)
    covariance = point_precision_alone(linearised(network, state, rays), network.group_start)[0]
    scale = depth / c
    # Parallax p = B c / Z: sigma_Z = Z^2 / (B c) sqrt(2) sigma. X and Y are means of two rays.
    assert np.sqrt(covariance[2, 2]) == pytest.approx(depth**2 / (base * c) * np.sqrt(2) * sigma)
    assert np.sqrt(covariance[1, 1]) == pytest.approx(scale * sigma / np.sqrt(2))
    assert np.sqrt(covariance[0, 0]) == pytest.approx(scale * sigma / np.sqrt(2)), "halfway between the photographs"
    assert abs(covariance[0, 2]) < 1e-9 * covariance[2, 2]


def test_a_point_alone_has_the_inverse_of_its_own_normal_matrix():
    network, state, rays = small_network(noise=1.0)
    linear = linearised(network, state, rays)
    alone = point_precision_alone(linear, network.group_start)
    for point in (0, 7, 20):
        own = rays.point == point
        B = (linear.jp[own] @ linear.frame[point].T).reshape(-1, 3)
        normal = B.T @ (np.repeat(linear.weight[own], 2)[:, None] * B) + np.diag(network.point_weight[point])
        assert np.allclose(alone[point], np.linalg.inv(normal), rtol=1e-8)


@pytest.mark.parametrize("damping", [1e-3, 1.0])
def test_damped_steps_equal_dense_ones(damping):
    network, state, rays = small_network(noise=1.0)
    state = moved(state, np.random.default_rng(1), 0.1)
    _, normal, right = dense(network, state, rays)
    linear, n = linearised(network, state, rays), network.unknowns
    # Points are damped along and across their rays, in frames of their own.
    turn = block_diag(np.eye(n), *linear.frame)
    framed = turn.T @ normal @ turn
    expected = turn @ np.linalg.solve(framed + damping * np.diag(np.diag(framed)), turn.T @ right)
    normals = reduced_normals(linear, pattern(network, state, rays), damping)
    prior, prior_right = prior_alone(network, state)
    whole = normals.matrix.dense() + prior + damping * np.diag(normals.diagonal + np.diag(prior))
    got = np.linalg.solve(whole, normals.right + prior_right)
    back = point_corrections(linear, got, damping)
    scale = np.sqrt(np.diag(np.linalg.inv(normal)))
    assert np.abs((got - expected[:n]) / scale[:n]).max() < 1e-6
    assert np.abs((back.ravel() - expected[n:]) / scale[n:]).max() < 1e-6


def test_a_point_seen_once_does_not_move_and_adds_nothing_wrong():
    network, state, rays = small_network(free=True)
    single = rays.take((rays.point != 9) | (rays.photo == 0))
    linear = linearised(network, state, single)
    normals = reduced_normals(linear, pattern(network, state, single))
    step = point_corrections(linear, np.full(network.unknowns, 1e-3))
    assert not step[9].any() and step[8].any()
    assert np.isfinite(normals.matrix.values).all()


def test_points_without_rays_stay_where_they_are():
    network, state, rays = small_network(free=True)
    linear = linearised(network, state, rays.take(rays.point != 9))
    assert not point_corrections(linear, np.ones(network.unknowns))[9].any()


def test_a_badly_scaled_point_is_inverted_and_a_singular_one_is_not():
    out = np.empty((3, 3))
    scale = np.array([1.0, 1e-3, 1e-7])
    V = (np.eye(3) + 0.1) * scale[:, None] * scale
    _invert(V, out)
    assert np.allclose(out * scale[:, None] * scale, np.linalg.inv(np.eye(3) + 0.1), rtol=1e-9)
    _invert(np.outer([1.0, 2.0, 3.0], [1.0, 2.0, 3.0]), out)
    assert not out.any() and SINGULAR < 1e-15


def free_network():
    network, state, rays = small_network(photos=8, free=True, interior_free=())
    linear = linearised(network, state, rays)
    order = structure(network, state, linear)
    matrix = reduced_normals(linear, order.pattern).matrix
    add_prior(network, state, matrix)
    return network, state, order, matrix


def test_the_inverse_of_a_free_network_is_that_with_inner_constraints():
    network, state, order, matrix = free_network()
    got = inverse_of(network, state, order, matrix).times(np.eye(len(matrix)))
    N, H = matrix.dense(), freedoms(network, state)
    scale = 1 / np.sqrt(np.diag(N))
    pinv = np.linalg.pinv(N * scale[:, None] * scale, rcond=1e-11, hermitian=True) * scale[:, None] * scale
    unit = np.sqrt(np.diag(pinv))
    assert (np.abs(got - pinv) / np.outer(unit, unit)).max() < 1e-6
    assert np.abs((H / scale[:, None] ** 2).T @ got).max() < 1e-6 * np.abs(H / scale[:, None] ** 2).max() * unit.max()


def test_the_inverse_of_a_free_network_does_not_depend_on_where_it_is_held():
    network, state, order, matrix = free_network()
    other = structure_of(order.pattern, network.photos, np.array([2, 5]))
    first, second = (inverse_of(network, state, each, matrix) for each in (order, other))
    assert set(other.last // 6) >= {2, 5}
    unit = np.sqrt(first.blocks()[0].diagonal())
    difference = first.times(np.eye(len(matrix))) - second.times(np.eye(len(matrix)))
    assert (np.abs(difference) / np.outer(unit, unit)).max() < 1e-8


def test_the_condition_is_found_from_one_row():
    network, state, rays = small_network()
    linear = linearised(network, state, rays)
    order = structure(network, state, linear)
    matrix = reduced_normals(linear, order.pattern).matrix
    add_prior(network, state, matrix)
    _, condition = inverse_of(network, state, order, matrix).blocks()
    N = matrix.dense()
    scale = 1 / np.sqrt(np.diag(N))
    exact = np.linalg.cond(N * scale[:, None] * scale, p=np.inf)
    assert 0.2 * exact < condition <= exact * (1 + 1e-6)


def test_considered_parameters_have_empty_rows_in_the_inverse():
    network, state, rays = small_network(interior_free=(0, 3))
    considered = np.zeros((1, 8), bool)
    considered[0, 0] = True
    network = replace(network, interior=replace(network.interior, considered=considered))
    linear = linearised(network, state, rays)
    order = structure(network, state, linear)
    matrix = reduced_normals(linear, order.pattern).matrix
    add_prior(network, state, matrix)
    whole = inverse_of(network, state, order, matrix).times(np.eye(len(matrix)))
    column = network.interior_columns[0, 0]
    rest = np.arange(len(matrix)) != column
    assert not whole[column].any() and not whole[:, column].any()
    expected = np.linalg.inv(matrix.dense()[np.ix_(rest, rest)])
    unit = np.sqrt(np.diag(expected))
    assert (np.abs(whole[np.ix_(rest, rest)] - expected) / np.outer(unit, unit)).max() < 1e-7
