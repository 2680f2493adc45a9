"""The look-up by cells against all triangles one by one; light and shadow on a few triangles."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from orthomill.tasks.simulation.portal.portal_casting import (
    NO_TRIANGLE,
    cells_of,
    central_boxes,
    facets_of,
    lit_all,
    nearest,
    open_sky,
    shade_of,
)


def plain_nearest(facets, origin, ray):
    """Every triangle by the linear system of the intersection."""
    best = (NO_TRIANGLE, np.inf)
    for i, (corner, along, above) in enumerate(zip(facets.corner, facets.along, facets.above, strict=True)):
        A = np.column_stack([along, above, -ray])
        if abs(np.linalg.det(A)) < 1e-15:
            continue
        u, v, t = np.linalg.solve(A, origin - corner)
        if u >= 0 and v >= 0 and u + v <= 1 and 1e-6 < t < best[1]:
            best = (i, t)
    return best


@given(st.integers(0, 10**6))
@settings(max_examples=25, deadline=None)
def test_a_ray_meets_what_it_meets_among_all_triangles(seed):
    generator = np.random.default_rng(seed)
    vertices = generator.uniform(-1, 1, (60, 3)) * (1.5, 1.5, 1.0) - (0, 0, 2.5)
    triangles = generator.integers(0, 60, (40, 3)).astype(np.int32)
    triangles = triangles[[len(set(row)) == 3 for row in triangles.tolist()]]
    facets = facets_of(vertices, triangles)
    cells = cells_of(*central_boxes(vertices, triangles), (-1.0, -1.0, 1.0, 1.0), 0.13)
    for x, y in generator.uniform(-0.9, 0.9, (12, 2)):
        ray = np.array([x, -y, -1.0])
        hit, far, share, other = nearest(cells, facets.corner, facets.along, facets.above, x, y, np.zeros(3), ray)
        expected = plain_nearest(facets, np.zeros(3), ray)
        assert hit == expected[0]
        if hit != NO_TRIANGLE:
            assert far == pytest.approx(expected[1])
            place = facets.corner[hit] + share * facets.along[hit] + other * facets.above[hit]
            assert place == pytest.approx(far * ray)


def test_a_triangle_that_reaches_behind_the_camera_may_be_anywhere():
    vertices = np.array([[-1.0, -1, 1], [3, -1, -4], [-3, -1, -4], [0, 0, 5], [1, 0, 5], [0, 1, 5]])
    low, high = central_boxes(vertices, np.array([[0, 1, 2], [3, 4, 5]], np.int32))
    assert (low[0] == -np.inf).all() and (high[0] == np.inf).all()
    assert (low[1] > high[1]).all(), "what is wholly behind is nowhere"


def test_a_roof_shades_what_is_below_it():
    roof = np.array([[-1.0, -1, 2], [1, -1, 2], [1, 1, 2], [-1, 1, 2]])
    triangles = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    facets = facets_of(roof, triangles)
    shade = shade_of(roof, triangles, np.array([0.6, 0.0, 0.8]), 0.1)
    places = np.array([[0.0, 0, 0], [-1.5, 0, 0], [-2.6, 0, 0], [0, 0, 2.5]])
    assert lit_all(shade, facets.corner, facets.along, facets.above, places).tolist() == [True, False, True, True]


def test_an_open_field_sees_the_whole_sky_and_a_pit_little():
    side = 5.0
    ground = np.array([[-side, -side, 0], [side, -side, 0], [side, side, 0], [-side, side, 0.0]])
    up = np.tile([0.0, 0.0, 1.0], (4, 1))
    assert open_sky(ground, np.array([[0, 1, 2], [0, 2, 3]], np.int32), up) == pytest.approx(np.ones(4), abs=0.05)
    cover = ground + np.array([0, 0, 0.1])
    both, triangles = np.vstack([ground * 0.5, cover]), np.array([[0, 1, 2], [4, 5, 6], [4, 6, 7]], np.int32)
    assert (open_sky(both, triangles, np.vstack([up, up]))[:4] < 0.1).all()
