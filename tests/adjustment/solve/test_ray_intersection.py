"""Which points their rays determine."""

from dataclasses import replace

import numpy as np
import pytest
from small_network import moved, small_network

from orthomill.tasks.adjustment.model.collinearity import BEHIND, residual_lengths
from orthomill.tasks.adjustment.model.network import Rays
from orthomill.tasks.adjustment.solve.ray_intersection import UNSURE, held_in_front, intersected, intersecting


def test_a_point_counts_while_its_distance_is_better_known_than_a_quarter():
    network, state, _ = small_network(free=True)
    network = replace(network, centre_weight=np.zeros_like(network.centre_weight))
    centre, base = state.centre, 40.0
    state = replace(state, rotation=np.tile(np.eye(3), (4, 1, 1)))
    pair = Rays(np.array([0, 0], np.int32), np.array([0, 1], np.int32), np.zeros((2, 2)), np.full(2, 0.5))
    middle = 0.5 * (centre[0] + centre[1])
    # Two rays with direction errors s that meet under the angle a: the distance is off by about s / (a / sqrt(2)) of itself.
    limit = UNSURE * base / (np.sqrt(2.0) * 0.5 / state.interior[0, 0])
    for share, known in ((0.9, True), (1.1, False)):
        state.point[0] = middle - np.array([0.0, 0.0, share * limit])
        assert (intersecting(network, state, pair, np.ones(2, bool)) == known).all()
    state.point[0] = middle - np.array([0.0, 0.0, 1e14])
    assert not intersecting(network, state, pair, np.ones(2, bool)).any()
    assert intersecting(replace(network, named=np.array([0])), state, pair, np.ones(2, bool)).all()
    state.point[0] = middle + np.array([0.0, 0.0, 50.0])
    assert not intersecting(replace(network, named=np.array([0])), state, pair, np.ones(2, bool)).any()


def test_points_move_to_the_intersection_of_their_rays_and_none_gets_worse():
    network, state, rays = small_network(3, noise=1.0)
    start = replace(state, point=moved(state, np.random.default_rng(3), 2.0).point)
    there = intersected(network, start, rays, np.inf)
    first, then = (np.bincount(rays.point, residual_lengths(network, s, rays) ** 2) for s in (start, there))
    assert (then <= first * (1 + 1e-12)).all()
    own = ~network.pointed
    assert then[own].sum() < 0.01 * first[own].sum()
    assert (there.point[network.pointed] == start.point[network.pointed]).all()
    assert (there.centre == start.centre).all()


@pytest.mark.parametrize("depth", [-1e9, -150.0, 20.0])
def test_a_point_that_jumps_past_a_camera_or_infinity_stays_in_front(depth):
    network, state, rays = small_network(3)
    network = replace(network, point_weight=np.zeros_like(network.point_weight))
    away = state.point[7] - state.centre.mean(axis=0)
    # A depth below 0 is that of a point which a step has taken past all cameras; 20 m is in front of them, and left alone.
    jumped = replace(state, point=state.point.copy())
    jumped.point[7] = state.centre.mean(axis=0) + away / np.linalg.norm(away) * depth
    held = held_in_front(network, state, jumped, rays)
    assert residual_lengths(network, held, rays).max() < BEHIND
    assert (held.point[7] == jumped.point[7]).all() == (depth > 0)
    assert (np.delete(held.point, 7, axis=0) == np.delete(state.point, 7, axis=0)).all()


def test_a_step_past_infinity_goes_to_four_times_the_distance_at_most():
    network, state, rays = small_network(5)
    away = state.point[9] - state.centre.mean(axis=0)
    beyond = replace(state, point=state.point.copy())
    # All cameras jump ahead of the point, which steps 100 times its distance away: the rays see it from behind.
    beyond.point[9] = state.point[9] + 100.0 * away
    turned = replace(beyond, rotation=beyond.rotation * [[[1.0], [-1.0], [-1.0]]])
    held = held_in_front(network, state, turned, rays.take(rays.point == 9))
    assert held.point[9] == pytest.approx(state.centre.mean(axis=0) + 4.0 * away)
