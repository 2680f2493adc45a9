"""Windows for planning: whatever a photograph or an epipolar image shows of a map window lies inside of its window."""

import numpy as np
import pytest
from epipolar_projection import epipolar_pixels
from hypothesis import given, settings
from hypothesis import strategies as st
from tiny_block import EAST, FLYING, HEIGHT, NORTH, views

from orthomill.schemas.camera import Camera
from orthomill.schemas.raster import MapGrid, Window
from orthomill.tasks.geometry.epipolar_window import box_corners, greatest_parallax, left_pixels, node_window, nodes_shape
from orthomill.tasks.geometry.footprint import ground_bounds, ground_outline, photo_window
from orthomill.tasks.geometry.normal_case import HeightRange, epipolar_view, in_order, normal_case
from orthomill.tasks.geometry.rotation import rotation_matrix
from orthomill.tasks.geometry.view import View

GRID = MapGrid(west=EAST - 300, north=NORTH + 300, cell=2.0, rows=300, cols=300)
PLACE = st.integers(0, 270)
SIDE = st.integers(1, 30)
HEIGHTS = st.tuples(st.floats(0, 60), st.floats(0, 60)).map(sorted)
ATTITUDE = st.tuples(st.floats(-0.4, 0.4), st.floats(-0.4, 0.4), st.floats(-3, 3))
SETTINGS = settings(deadline=None, max_examples=60)
IDEAL = Camera(name="i", width=480, height=460, c=700.0)


def inside_of(window, low, high, count=200):
    """Points anywhere in the box over a map window."""
    rng = np.random.default_rng(1)
    x = GRID.west + GRID.cell * (window.col + window.width * rng.random(count))
    y = GRID.north - GRID.cell * (window.row + window.height * rng.random(count))
    return np.column_stack([x, y, low + (high - low) * rng.random(count)])


@SETTINGS
@given(PLACE, PLACE, SIDE, SIDE, HEIGHTS, ATTITUDE)
def test_every_pixel_that_shows_the_cells_is_in_the_window(row, col, height, width, heights, attitude):
    window = Window(row, col, height, width)
    view = View("v", views()["a2"].camera, rotation_matrix(*attitude), np.array([EAST, NORTH, HEIGHT + FLYING]))
    pixels = view.project(inside_of(window, *heights))
    pixels = pixels[view.contains(pixels)]
    found = photo_window(view, GRID, window, *heights)
    assert found.empty or (found.row >= 0 and found.row + found.height <= 460 and found.col + found.width <= 480)
    if len(pixels):
        assert (pixels >= [found.col, found.row]).all()
        assert (pixels <= [found.col + found.width - 1, found.row + found.height - 1]).all()


def test_a_photograph_that_looks_elsewhere_needs_nothing():
    view = views()["a1"]
    far = GRID.model_copy(update={"west": EAST + 5e4})
    assert photo_window(view, far, Window(0, 0, 10, 10), 40, 60).empty
    up = View("up", IDEAL, rotation_matrix(np.pi, 0, 0), view.centre)
    assert photo_window(up, GRID, Window(100, 100, 10, 10), 40, 60).empty


def test_a_wider_margin_makes_a_wider_window():
    view, window = views()["a2"], Window(140, 140, 5, 5)
    narrow, wide = (photo_window(view, GRID, window, 45, 55, margin) for margin in (0, 6))
    assert (wide.width, wide.height) == (narrow.width + 12, narrow.height + 12)


@SETTINGS
@given(ATTITUDE, HEIGHTS, st.lists(st.tuples(st.floats(0, 479), st.floats(0, 459), st.floats(0, 1)), min_size=5, max_size=20))
def test_all_ground_that_a_photograph_shows_is_in_its_bounds(attitude, heights, places):
    view = View("v", IDEAL, rotation_matrix(*attitude), np.array([EAST, NORTH, HEIGHT + FLYING]))
    col, row, share = np.array(places).T
    low, high = heights
    ground = view.at_height(np.column_stack([col, row]), low + (high - low) * share)
    west, south, east, north = ground_bounds(view, low, high)
    assert (ground[:, :2] >= [west - 1e-6, south - 1e-6]).all() and (ground[:, :2] <= [east + 1e-6, north + 1e-6]).all()


def test_bounds_of_a_vertical_photograph_are_its_frame_at_scale():
    view = View("v", IDEAL, np.eye(3), np.array([1000.0, 2000.0, 700.0]))
    assert ground_bounds(view, 0.0, 350.0) == pytest.approx((1000 - 239.5, 2000 - 229.5, 1000 + 239.5, 2000 + 229.5))


def test_box_corners_are_the_outer_edges_of_the_cells():
    corners = box_corners(GRID, Window(10, 20, 3, 4), 5.0, 9.0)
    assert corners.shape == (8, 3)
    assert set(corners[:, 0]) == {GRID.west + 40, GRID.west + 48} and set(corners[:, 1]) == {GRID.north - 20, GRID.north - 26}
    assert set(corners[:, 2]) == {5.0, 9.0}


@pytest.fixture(scope="module")
def pair_and_left():
    left, right = in_order(views()["a1"], views()["a2"])
    pair = normal_case(left, right, HeightRange(30.0, 70.0))
    return pair, epipolar_view(pair, "left", left)


def test_left_pixels_agree_with_the_epipolar_view(pair_and_left):
    pair, left = pair_and_left
    points = inside_of(Window(100, 100, 60, 60), 30, 70)
    np.testing.assert_allclose(left_pixels(pair, points), epipolar_pixels(left, points), atol=1e-8)
    behind = np.array(pair.left_centre) + 50 * np.array(pair.rotation)[2]
    assert np.isnan(left_pixels(pair, behind[None])).all()


@SETTINGS
@given(PLACE, PLACE, SIDE, SIDE, HEIGHTS, st.integers(1, 9))
def test_every_node_that_may_show_the_box_is_in_the_window(pair_and_left, row, col, height, width, heights, step):
    pair, _ = pair_and_left
    window = Window(row, col, height, width)
    found = node_window(pair, step, box_corners(GRID, window, *heights), margin=0)
    rows, cols = nodes_shape(pair, step)
    nodes = left_pixels(pair, inside_of(window, *heights))[:, ::-1] / step
    nodes = nodes[((nodes >= 0) & (nodes <= [rows - 1, cols - 1])).all(axis=1)]
    assert (nodes >= [found.row, found.col]).all() if len(nodes) else True
    assert (nodes <= [found.row + found.height - 1, found.col + found.width - 1]).all() if len(nodes) else True


@SETTINGS
@given(PLACE, PLACE, SIDE, SIDE, HEIGHTS)
def test_a_box_up_to_the_camera_needs_the_nodes_of_the_ground_that_is_searched(pair_and_left, row, col, height, width, heights):
    """What is farther than the greatest parallax is in the window, although the box reaches to the cameras and behind them."""
    pair, _ = pair_and_left
    window = Window(row, col, height, width)
    box = heights[0], FLYING + HEIGHT + heights[1] - 60.0
    found = node_window(pair, 1, box_corners(GRID, window, *box), margin=0)
    points = inside_of(window, *box)
    depth = (np.array(pair.left_centre) - points) @ np.array(pair.rotation)[2]
    far = depth > pair.base * pair.c / greatest_parallax(pair)
    nodes = left_pixels(pair, points[far])[:, ::-1]
    rows, cols = nodes_shape(pair, 1)
    nodes = nodes[((nodes >= 0) & (nodes <= [rows - 1, cols - 1])).all(axis=1)]
    assert (nodes >= [found.row, found.col]).all() if len(nodes) else True
    assert (nodes <= [found.row + found.height - 1, found.col + found.width - 1]).all() if len(nodes) else True


def test_a_box_up_to_the_camera_needs_no_more_nodes_than_one_to_the_nearest_ground_that_is_searched(pair_and_left):
    pair, _ = pair_and_left
    window, camera = Window(140, 140, 5, 5), FLYING + HEIGHT
    nearest = camera - pair.base * pair.c / greatest_parallax(pair)
    high, low = (node_window(pair, 1, box_corners(GRID, window, 40.0, top)) for top in (camera - 5.0, nearest + 1.0))
    assert not high.empty
    assert (high.width, high.height) <= (low.width + 2, low.height + 2)


def test_a_box_behind_the_camera_has_no_nodes(pair_and_left):
    pair, _ = pair_and_left
    assert node_window(pair, 4, box_corners(GRID, Window(140, 140, 3, 3), 400.0, 600.0)).empty


def test_an_incomplete_last_step_has_a_node(pair_and_left):
    pair, _ = pair_and_left
    odd = pair.model_copy(update={"rows": 21, "left_cols": 20})
    assert nodes_shape(odd, 5) == (5, 4) and nodes_shape(odd, 1) == (21, 20)


def test_the_outline_of_a_vertical_photograph_is_its_frame_on_the_ground():
    view = View("v", IDEAL, np.eye(3), np.array([EAST, NORTH, HEIGHT + 700.0]))
    outline = np.array(ground_outline(view, HEIGHT))
    # A ground pixel of a metre: from the middle of the first pixel to that of the last.
    assert np.ptp(outline, axis=0) == pytest.approx([479.0, 459.0], abs=0.01)
    assert outline.mean(axis=0) == pytest.approx([EAST, NORTH], abs=1.0)


def test_a_view_above_the_horizon_has_no_outline():
    view = View("v", IDEAL, rotation_matrix(1.5, 0.0, 0.0), np.array([EAST, NORTH, HEIGHT + 700.0]))
    assert ground_outline(view, HEIGHT) == ()
