"""Points from the rays of a start, and how well rays of given precision place them."""

import numpy as np
import pytest
from simulated_block import DRONE

from orthomill.tasks.adjustment.model.collinearity import residuals
from orthomill.tasks.adjustment.model.network import Rays, State
from orthomill.tasks.geometry.rotation import rotation_matrix
from orthomill.tasks.orientation.control.ground_points import approximate_points

CAMERA = DRONE.changed(k1=0.0)
CENTRES = np.array([[-40.0, 0.0, 80.0], [0.0, 30.0, 85.0], [45.0, -10.0, 80.0]])
POINT = np.array([5.0, -3.0, 0.0])


def seen(count, sigma=0.0, seed=0):
    """The approximate point from `count` vertical photographs that measure it to `sigma` px, and one that one photograph
    measures."""
    rotation = np.tile(rotation_matrix(0.0, 0.0, 0.0), (3, 1, 1))
    state = State(rotation, CENTRES, np.array([POINT, POINT]), np.array([CAMERA.interior]), np.zeros(3))
    photo = np.arange(count + 1, dtype=np.int32) % count
    number = (np.arange(count + 1) == count).astype(np.int32)
    rays = Rays(number, photo, np.zeros((count + 1, 2)), np.full(count + 1, 1.0))
    computed = -residuals(state, rays, np.zeros(3, int))
    noise = sigma * np.random.default_rng(seed).standard_normal(computed.shape)
    return approximate_points(state, [CAMERA], np.zeros(3, int), Rays(number, photo, computed + noise, rays.sigma), 2)


@pytest.mark.parametrize("count", [2, 3])
def test_exact_rays_meet_in_their_point_and_one_alone_gives_none(count):
    found = seen(count)
    np.testing.assert_allclose(found.point[0], POINT, atol=1e-6)
    assert found.missed[0] < 1e-9 and np.isnan(found.point[1]).all() and np.isnan(found.blur[1])


@pytest.mark.parametrize("count", [2, 3])
def test_the_blur_is_the_scatter_of_points_from_rays_of_that_precision(count):
    """Of rays away from the axis the same pixels are a slightly smaller angle outwards, which is left out."""
    error = np.array([seen(count, 5.0, seed).point[0] - POINT for seed in range(400)])
    assert np.sqrt((error**2).mean()) == pytest.approx(seen(count).blur[0] * 5.0 / CAMERA.c, rel=0.15)
