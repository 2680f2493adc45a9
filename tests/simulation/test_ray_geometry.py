"""Rays through single columns, steps and ramps, whose hits are known in closed form."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from orthomill.schemas.raster import MapGrid, Window
from orthomill.tasks.geometry.view import View
from orthomill.tasks.simulation.flight import BLOCK
from orthomill.tasks.simulation.scene.traversal import (
    NOTHING,
    TOP,
    WALL,
    Ray,
    VerticalColumns,
    columns_of,
    first_hit,
    is_free,
    safe_start,
    widened,
)
from orthomill.tasks.simulation.scene.true_visibility import visibility

CELL = 0.5
SIDE = 8 * BLOCK
WINDOW = Window(0, 0, SIDE, SIDE)


def columns(height: np.ndarray, window: Window = WINDOW) -> VerticalColumns:
    return columns_of(height.astype(np.float32), window, CELL)


def flat(z: float = 10.0) -> VerticalColumns:
    return columns(np.full((SIDE, SIDE), z))


def step(z: float = 6.0, col: int = 40) -> VerticalColumns:
    """Ground at 0 and a plateau from a column on."""
    height = np.zeros((SIDE, SIDE))
    height[:, col:] = z
    return columns(height)


def through(u: float, v: float, z: float, du: float, dv: float, z0: float = 200.0) -> Ray:
    """The ray that passes (u, v) at the height z."""
    return Ray(u - du * (z0 - z), v - dv * (z0 - z), z0, du, dv)


def hit(made: VerticalColumns, ray: Ray):
    """What the ray meets below the highest point of the columns."""
    return first_hit(made, ray, ray.z0 - float(made.highest.max()), ray.z0 + 100.0)


@settings(max_examples=60, deadline=None)
@given(u=st.floats(10, 50), v=st.floats(10, 50), du=st.floats(-1.2, 1.2), dv=st.floats(-1.2, 1.2), z=st.floats(-5, 30))
def test_level_ground_is_hit_at_its_height(u, v, du, dv, z):
    ray = through(u, v, float(np.float32(z)), du, dv)
    kind, s, row, col = hit(flat(z), ray)
    assert kind == TOP and s == pytest.approx(200.0 - z, abs=1e-3)
    assert abs(col + 0.5 - u) <= 0.51 and abs(row + 0.5 - v) <= 0.51


@settings(max_examples=40, deadline=None)
@given(slope_u=st.floats(-0.4, 0.4), slope_v=st.floats(-0.4, 0.4), du=st.floats(-0.8, 0.8), dv=st.floats(-0.8, 0.8))
def test_a_ramp_is_met_as_a_plane(slope_u, slope_v, du, dv):
    """Without the columns' own slopes the hit would be off by up to half a step."""
    v, u = np.mgrid[0:SIDE, 0:SIDE] + 0.5
    ramp = columns(20.0 + CELL * slope_u * (u - 32) + CELL * slope_v * (v - 32))
    ray = through(32.2, 31.7, 20.0 + CELL * slope_u * 0.2 - CELL * slope_v * 0.3, du, dv)
    kind, s, _, _ = hit(ramp, ray)
    expected = 200.0 - (20.0 + CELL * slope_u * 0.2 - CELL * slope_v * 0.3)
    assert kind == TOP and s == pytest.approx(expected, abs=2e-3)


@pytest.mark.parametrize(("z", "kind"), [(3.0, WALL), (6.0005, TOP)])
def test_a_ray_towards_a_plateau_meets_its_wall_or_its_top(z, kind):
    """The ray passes the border u = 40 at the height z, falling one metre per cell."""
    found = hit(step(), through(40.0, 30.3, z, 1.0, 0.0))
    assert found[0] == kind and found[3] == 40
    if kind == WALL:
        assert found[1] == pytest.approx(200.0 - z)


def test_a_wall_is_met_from_every_side():
    height = np.zeros((SIDE, SIDE))
    height[30:34, 30:34] = 9.0
    tower = columns(height)
    for du, dv, u, v in ((1.0, 0.0, 30.0, 32.2), (-1.0, 0.0, 34.0, 32.2), (0.0, 1.0, 32.2, 30.0), (0.0, -1.0, 32.2, 34.0)):
        kind, s, row, col = hit(tower, through(u, v, 4.0, du, dv))
        assert kind == WALL and s == pytest.approx(196.0) and 30 <= row < 34 and 30 <= col < 34


@pytest.mark.parametrize("u", [-30.0, -0.5, SIDE + 0.5])
def test_a_ray_beyond_the_window_meets_nothing(u):
    assert hit(flat(), through(u, 20.0, 10.0, 0.0, 0.1))[0] == NOTHING


def test_blocks_know_their_highest_point_and_that_of_their_neighbours():
    height = np.zeros((SIDE, SIDE))
    height[20, 44] = 7.0
    made = columns(height)
    row, col = 20 // BLOCK, 44 // BLOCK
    assert made.highest[row, col] >= 7.0 and (made.highest >= height.reshape(8, BLOCK, 8, BLOCK).max(axis=(1, 3))).all()
    high = widened(made.highest)
    assert (high[row - 1 : row + 2, col - 1 : col + 2] >= 7.0).all() and (high >= 7.0).sum() == 9


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 500), du=st.floats(-1.0, 1.0), dv=st.floats(-1.0, 1.0))
def test_the_safe_start_comes_before_every_hit(seed, du, dv):
    rng = np.random.default_rng(seed)
    rough = columns(np.where(rng.random((SIDE, SIDE)) < 0.1, rng.uniform(0, 15, (SIDE, SIDE)), 0.0))
    # Not on the border of cells: along it rounding decides about the cell.
    ray = through(32.3, 31.6, 0.0, du, dv)
    start = safe_start(rough, widened(rough.highest), ray, 150.0)
    hit = first_hit(rough, ray, 150.0, 300.0)
    again = first_hit(rough, ray, start, 300.0)
    assert start <= hit[1] + 1e-9 and again == hit


@pytest.mark.parametrize(("distance", "free"), [(1.0, False), (9.0, False), (13.0, True), (30.0, True)])
def test_a_plateau_hides_ground_as_far_as_its_height_reaches(distance, free):
    """A ray that rises 0.5 m per cell clears 6 m after 12 cells."""
    u, dv = 40.0 - distance, 0.0
    ray = through(u, 30.5, 0.0, -2.0, dv)
    assert is_free(step(), ray, 200.0, 150.0) is free


def test_the_points_own_column_hides_nothing():
    height = np.zeros((SIDE, SIDE))
    height[30, 30] = 5.0
    ray = through(30.5, 30.5, 5.0, 0.3, 0.2)
    assert is_free(columns(height), ray, 195.0, 150.0)


def test_any_window_that_holds_the_way_gives_the_same_hit():
    height = np.random.default_rng(3).uniform(0, 4, (SIDE, SIDE))
    part = Window(BLOCK, 2 * BLOCK, 6 * BLOCK, 5 * BLOCK)
    whole, cut = columns(height), columns(height[part.slices], part)
    for du, dv in ((0.3, -0.2), (-0.5, 0.1), (0.0, 0.4)):
        ray = through(32.4, 30.2, 1.0, du, dv)
        first, second = first_hit(whole, ray, 190.0, 300.0), first_hit(cut, ray, 190.0, 300.0)
        assert first[:2] == second[:2] and (first[2] - part.row, first[3] - part.col) == second[2:]


def test_visibility_sets_the_bit_of_every_view():
    """Two views on either side of a wall: each sees its own side, both see the top."""
    from orthomill.schemas.camera import Camera

    camera = Camera(name="c", width=400, height=400, c=200.0)
    grid = MapGrid(west=0.0, north=32.0, cell=CELL, rows=SIDE, cols=SIDE)
    height = np.zeros((SIDE, SIDE), np.float32)
    height[:, 31:33] = 8.0
    views = tuple(View(name, camera, np.eye(3), np.array([x, 16.0, 30.0])) for name, x in (("west", 6.0), ("east", 26.0)))
    seen = visibility(views, grid, Window(24, 0, 16, SIDE), WINDOW, height)
    assert seen.dtype == np.uint32 and (seen[:, 31:33] == 3).all()
    assert (seen[:, 28:31] == 1).all() and (seen[:, 33:36] == 2).all() and (seen[:, :8] == 3).all()
