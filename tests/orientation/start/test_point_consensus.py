"""The largest set of rays of a point that meet."""

import numpy as np
import pytest
from simulated_block import looking

from orthomill.tasks.orientation.start.point_consensus import PointRays, _agreeing, consensus


def rays_of(points, centres, wrong, rng, tolerance=0.002):
    """Rays of all `centres` to all points; those of `wrong` (point, photograph) are off by a twentieth of the distance along the
    base."""
    rotation = np.array([looking((0.0, 0.0, -1.0), (0.0, 1.0, 0.0))] * len(centres))
    seen = np.einsum("pij,npj->npi", rotation, points[:, None] - centres[None])
    ideal = seen[:, :, :2] / -seen[:, :, 2:] + 1e-4 * rng.standard_normal((len(points), len(centres), 2))
    for n, p in wrong:
        ideal[n, p, 0] += 0.05
    inward = np.concatenate([ideal, -np.ones((*ideal.shape[:2], 1))], axis=2)
    direction = np.einsum("npi,pij->npj", inward, rotation)
    direction /= np.linalg.norm(direction, axis=2, keepdims=True)
    count = len(points) * len(centres)
    photo = np.tile(np.arange(len(centres)), len(points))
    first = np.arange(0, count + 1, len(centres))
    return PointRays(
        first, centres[photo], direction.reshape(-1, 3), rotation, photo, ideal.reshape(-1, 2), np.full(count, tolerance)
    )


@pytest.mark.slow
def test_a_wrong_ray_along_the_base_is_the_one_that_disagrees():
    rng = np.random.default_rng(3)
    centres = np.column_stack([20.0 * np.arange(4), np.zeros(4), np.full(4, 80.0)])
    points = rng.uniform((-10, -20, -5), (70, 20, 5), (30, 3))
    wrong = [(n, int(rng.integers(4))) for n in range(30)]
    place, count, agree = consensus(rays_of(points, centres, wrong, rng))
    right = np.ones((30, 4), bool)
    right[tuple(np.transpose(wrong))] = False
    assert (agree.reshape(30, 4) == right).all() and (count == 3).all()
    assert np.abs(place - points).max() < 0.2


def test_two_rays_are_no_agreement():
    rng = np.random.default_rng(4)
    centres = np.column_stack([20.0 * np.arange(3), np.zeros(3), np.full(3, 80.0)])
    _, count, agree = consensus(rays_of(np.array([[20.0, 5, 0]]), centres, [(0, 1)], rng))
    assert count[0] == 2 and not agree.any()


def test_the_kernel_agrees_with_its_plain_twin():
    rng = np.random.default_rng(5)
    centres = rng.uniform((-30, -30, 70), (30, 30, 90), (6, 3))
    points = rng.uniform((-20, -20, -5), (20, 20, 5), (20, 3))
    rays = rays_of(points, centres, [(n, n % 6) for n in range(20)], rng)
    count, place = _agreeing(rays)
    plain_count, plain_place = _agreeing.py_func(rays)
    assert (count == plain_count).all() and np.allclose(place, plain_place)


def test_rays_that_meet_behind_their_photographs_are_no_point():
    rng = np.random.default_rng(6)
    centres = np.column_stack([20.0 * np.arange(3), np.zeros(3), np.full(3, 80.0)])
    rays = rays_of(np.array([[20.0, 0, 0]]), centres, [], rng)
    _, count, agree = consensus(rays._replace(direction=-rays.direction))
    assert count[0] == 0 and not agree.any()
