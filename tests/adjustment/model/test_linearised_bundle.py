"""The linearised bundle: frames along the rays, robust weights, kept points, and the pattern of its normal matrix."""

from dataclasses import replace

import numpy as np
import pytest
from small_network import small_network

from orthomill.tasks.adjustment.model.collinearity import derivatives
from orthomill.tasks.adjustment.model.linearisation import linearised, seen_pattern, structure
from orthomill.tasks.adjustment.model.network import NOT_SHIFTED, Rays


def pairs_of(pattern):
    return set(zip(pattern.rows.tolist(), pattern.partner.tolist(), strict=True))


def test_frames_are_orthonormal_with_the_third_axis_along_the_mean_ray():
    network, state, rays = small_network(free=True)
    frame = linearised(network, state, rays).frame
    assert np.allclose(frame @ frame.transpose(0, 2, 1), np.eye(3), atol=1e-12)
    away = state.point[rays.point] - state.centre[rays.photo]
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    mean = np.array([away[rays.point == point].mean(axis=0) for point in range(len(state.point))])
    mean /= np.linalg.norm(mean, axis=1, keepdims=True)
    assert np.abs((frame[:, :, 2] * mean).sum(axis=1)) == pytest.approx(np.ones(len(mean)))


def test_surveyed_points_and_points_without_rays_keep_the_axes_of_the_world():
    network, state, rays = small_network()
    rays = rays.take(rays.point != 9)
    frame = linearised(network, state, rays).frame
    assert (frame[[0, 1, 2, 3, 9]] == np.eye(3)).all() and not np.allclose(frame[8], np.eye(3))


def test_point_derivatives_are_those_of_the_world_in_the_frame_of_the_point():
    network, state, rays = small_network(free=True)
    _, jp = derivatives(state, rays, network.camera_of)
    linear = linearised(network, state, rays)
    assert np.allclose(linear.jp @ linear.frame[rays.point].transpose(0, 2, 1), jp, atol=1e-10)
    along = np.abs(linear.jp[:, :, 2]).max()
    assert along < 0.6 * np.abs(linear.jp[:, :, :2]).max(), "moving along the mean ray shows least"


def test_robust_factors_scale_the_weights_of_rays_and_surveyed_points():
    network, state, rays = small_network()
    factor, point_factor = np.linspace(0.1, 1.0, len(rays)), np.linspace(0.2, 1.0, len(state.point))
    plain, robust = linearised(network, state, rays), linearised(network, state, rays, factor, point_factor)
    assert robust.weight == pytest.approx(factor * plain.weight)
    assert robust.point_weight == pytest.approx(point_factor[:, None] * plain.point_weight)
    assert (network.point_weight[:4] == 1 / 0.02**2).all(), "the network itself is unchanged"


def test_a_kept_point_is_a_column_instead_of_a_point():
    network, state, rays = small_network()
    linear = linearised(replace(network, kept=np.array([2, 8])), state, rays)
    own = np.isin(rays.point, [2, 8])
    _, jp = derivatives(state, rays, network.camera_of)
    assert not linear.jp[own].any() and np.allclose(linear.jg[own][:, :, 6 + len(network.estimated) :], jp[own])
    assert not linear.jg[~own][:, :, 6 + len(network.estimated) :].any() and not linear.point_weight[2].any()
    assert network.point_weight[2].all(), "the network itself is unchanged"


def test_photographs_have_a_block_if_they_share_a_point():
    network, state, _ = small_network(interior_free=())
    network = replace(network, shift=NOT_SHIFTED)
    point, photo = np.array([0, 0, 1, 1, 2, 2], np.int32), np.array([0, 1, 1, 2, 0, 1], np.int32)
    rays = Rays(point, photo, np.zeros((6, 2)), np.ones(6))
    pattern = seen_pattern(linearised(network, state, rays), network.group_start)
    assert pairs_of(pattern) == {(0, 0), (1, 1), (2, 2), (3, 3), (0, 1), (1, 2)}


def test_a_camera_has_a_block_with_all_of_its_photographs():
    network, state, rays = small_network(photos=4, interior_free=(0,))
    pattern = seen_pattern(linearised(network, state, rays), replace(network, shift=NOT_SHIFTED).group_start)
    assert {(photo, 4) for photo in range(4)} <= pairs_of(pattern)


def test_prior_information_adds_blocks_to_the_structure_only():
    network, state, rays = small_network(interior_free=())
    linear = linearised(network, state, rays)
    seen, whole = seen_pattern(linear, network.group_start), structure(network, state, linear).pattern
    assert pairs_of(whole) - pairs_of(seen) == {(photo, 4) for photo in range(4)}


def test_the_datum_of_a_free_network_is_defined_by_photographs_far_apart():
    network, state, rays = small_network(photos=4, free=True, interior_free=())
    last = structure(network, state, linearised(network, state, rays)).last
    first, second = np.unique(last // 6)[[0, -1]]
    apart = np.linalg.norm(state.centre[:, None] - state.centre, axis=2)
    assert {0, 1, 2, 3} == set(last // 6) or apart[first, second] > 0.9 * apart.max()
