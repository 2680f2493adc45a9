"""Where ground points are looked for, how exposures are drawn, and the published surface in closed form."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from small_block import FLIGHT, scene, site

from benchmarks.matching.dissertation_pair import right_window
from benchmarks.matching.dissertation_surface import (
    BASE,
    FLYING_HEIGHT,
    STATION_X,
    C,
    PublishedPhoto,
    heights,
    intersected,
    projected,
    surface_points,
    true_matches,
)
from orthomill.schemas.errors import GeometryError
from orthomill.schemas.raster import MapGrid, Window
from orthomill.schemas.truth import Material
from orthomill.tasks.geometry.view import view_of
from orthomill.tasks.simulation.flight import BLOCK, CENTRE, PLAIN, camera_of, exposure, orientations, seen_window, views
from orthomill.tasks.simulation.surveying import farthest_first, find_place, lattice, search_window

GRID = MapGrid(west=1000.0, north=2000.0, cell=0.5, rows=180, cols=180)
ALL = Window(0, 0, 180, 180)


def cells(material: int = Material.OPEN_GROUND, seen: int = 0b111) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Level ground of one material that three photos see."""
    shape = (180, 180)
    return np.full(shape, 30.0, np.float32), np.full(shape, material, np.uint8), np.full(shape, seen, np.uint32)


def place(node, made):
    return find_place(node, GRID, ALL, made)


def test_the_place_nearest_to_the_node_is_taken():
    found = place((1045.25, 1954.75), cells())
    assert found.xyz == (1045.25, 1954.75, 30.0) and found.photos == (0, 1, 2)


def test_more_photos_are_worth_a_longer_way():
    made = cells(seen=0b11)
    made[2][20:60, 20:60] = 0b1111
    found = place((1060.0, 1940.0), made)
    assert found.photos == (0, 1, 2, 3)
    x, y, _ = found.xyz
    assert 1010.0 < x < 1030.0 and 1970.0 < y < 1990.0


def test_places_are_clear_of_everything_by_six_metres():
    made = cells()
    made[1][80:100, 80:100] = Material.ROOF
    x, y, _ = place((1045.0, 1955.0), made).xyz
    outside = max(abs(x - 1045.0), abs(y - 1955.0))
    assert 5.0 + 6.0 <= outside < 5.0 + 8.0


@pytest.mark.parametrize("material", [Material.ROAD, Material.TREE, Material.WATER, Material.ROOF])
def test_only_open_ground_holds_points(material):
    with pytest.raises(GeometryError, match=r"No open ground within 45 m of \(1045, 1955\) is seen by two photos; request fewer"):
        place((1045.0, 1955.0), cells(material))


def test_ground_that_one_photo_alone_sees_holds_no_point():
    with pytest.raises(GeometryError, match="seen by two photos"):
        place((1045.0, 1955.0), cells(seen=0b100))


def test_steep_ground_holds_no_point():
    made = cells()
    made[0][:, :90] = (30.0 + 0.5 * np.arange(90, 0, -1)[None, :] * 0.5).astype(np.float32)
    assert place((1005.0, 1955.0), made).xyz[0] > 1045.0


@pytest.mark.parametrize("count", [1, 4, 9, 16, 30])
def test_the_lattice_has_as_many_nodes_as_asked_for_inside_the_block(count):
    nodes = np.array(lattice(FLIGHT, count))
    assert nodes.shape == (count, 2) and len(np.unique(nodes, axis=0)) == count
    side = FLIGHT.frame_mm / 1000.0 * FLIGHT.scale
    assert np.abs(nodes[:, 0] - CENTRE[0]).max() <= side and np.abs(nodes[:, 1] - CENTRE[1]).max() <= side


@settings(max_examples=30, deadline=None)
@given(st.integers(2, 25), st.integers(0, 999))
def test_farthest_points_come_first_and_all_come_once(count, seed):
    points = np.random.default_rng(seed).uniform(0, 100, (count, 2))
    order = farthest_first(points)
    assert sorted(order) == list(range(count))
    for k in range(1, count):
        reach = np.hypot(*(points[:, None] - points[None, order[:k]]).transpose(2, 0, 1)).min(axis=1)
        assert reach[order[k]] == pytest.approx(reach.max())


def test_the_search_window_is_centred_on_the_node():
    assert search_window(GRID, (1045.25, 1954.75)) == Window(0, 0, 180, 180)
    assert search_window(GRID, (1000.25, 1999.75)) == Window(0, 0, 90, 90), "clipped to the grid"


@pytest.mark.parametrize("number", range(6))
def test_exposures_stay_within_their_ranges_and_repeat(number):
    film = exposure(FLIGHT, number)
    assert film == exposure(FLIGHT, number) and film.number == number
    assert all(0.84 * 0.97 <= gain <= 1.12 * 1.03 for gain in film.gain) and np.ptp(film.gain) <= 0.06 * 1.12
    assert -6.0 <= film.offset <= 10.0 and 0.08 <= film.vignetting <= 0.24


def test_photos_differ_in_their_exposure_and_seeds_in_their_flights():
    assert len({exposure(FLIGHT, number).gain for number in range(6)}) == 6
    assert orientations(FLIGHT)[0].centre != orientations(replace(FLIGHT, seed=7))[0].centre


@pytest.mark.parametrize(("field", "value"), [("base_m", 200.0), ("side_overlap", 0.3), ("scale", 4000.0), ("strips", 3)])
def test_the_flight_plan_moves_the_projection_centres(field, value):
    """Without their scatter, centres are base, strip distance and flying height from the middle of the block."""
    flight = replace(FLIGHT, **{field: value})
    centres = np.array([one.centre for one in orientations(flight)]).reshape(flight.strips, flight.photos_per_strip, 3)
    scatter = 4.0 * 7.0 * flight.height / 1043.0
    assert np.abs(np.abs(np.diff(centres[..., 0], axis=1)) - flight.base_m).max() < scatter
    assert np.abs(np.diff(centres[..., 1].mean(axis=1)) - flight.strip_distance).max() < scatter
    assert np.abs(centres[..., 2] - PLAIN - flight.height).max() < scatter


def test_the_camera_scales_with_its_pixels():
    fine, coarse = camera_of(replace(FLIGHT, pixel_um=48.0)), camera_of(FLIGHT)
    assert fine.c == pytest.approx(2 * coarse.c) and fine.x0 == pytest.approx(2 * coarse.x0)
    assert fine.lens == coarse.lens and fine.width == pytest.approx(2 * coarse.width, abs=1)


@pytest.mark.parametrize("pixels", [Window(0, 0, 64, 64), Window(250, 300, 100, 40)])
def test_the_seen_window_holds_all_ground_of_the_pixels(pixels):
    grid, photo = site().grid, views(FLIGHT)[2]
    window = seen_window(photo, scene(), grid, pixels)
    assert window.row % BLOCK == 0 and window.col % BLOCK == 0
    col, row = np.meshgrid([pixels.col, pixels.col + pixels.width - 1.0], [pixels.row, pixels.row + pixels.height - 1.0])
    for z in (20.0, 60.0):
        ground = photo.at_height(np.column_stack([col.ravel(), row.ravel()]), z)
        cols, rows = grid.pixel(ground[:, 0], ground[:, 1])
        assert (cols >= window.col - 1).all() and (cols <= window.col + window.width).all()
        assert (rows >= window.row - 1).all() and (rows <= window.row + window.height).all()
    assert view_of(orientations(FLIGHT)[2], camera_of(FLIGHT)).name == photo.name


@settings(max_examples=40, deadline=None)
@given(x=st.floats(10100, 11000), y=st.floats(9300, 10700))
def test_projection_and_intersection_invert_each_other(x, y):
    ground = np.array([[x, y, float(heights(np.array([x]), np.array([y]))[0])]])
    left, right = (projected(ground, photo) for photo in PublishedPhoto)
    assert np.allclose(intersected(left, right), ground, atol=1e-6)
    assert np.allclose(surface_points(left, PublishedPhoto.LEFT), ground, atol=1e-5)
    assert np.allclose(true_matches(left), right, atol=1e-6)


def test_the_parallax_is_base_times_scale():
    ground = np.array([[10552.0, 10000.0, 100.0]])
    left, right = (projected(ground, photo) for photo in PublishedPhoto)
    assert (left - right)[0, 0] * 0.02116694275722 == pytest.approx(C * BASE / (FLYING_HEIGHT - 100.0))
    assert left[0, 1] == right[0, 1] and STATION_X[1] - STATION_X[0] == BASE


@pytest.mark.parametrize("margin", [0, 12])
def test_the_right_window_holds_the_matches_of_every_left_pixel(margin):
    left = Window(5000, 6000, 40, 60)
    found = right_window(left, margin)
    col, row = np.meshgrid(np.arange(6000.0, 6060.0), np.arange(5000.0, 5040.0))
    match = true_matches(np.column_stack([col.ravel(), row.ravel()]))
    assert (match[:, 0] >= found.col + margin).all() and (match[:, 0] <= found.col + found.width - 1 - margin).all()
    assert (match[:, 1] >= found.row + margin).all() and (match[:, 1] <= found.row + found.height - 1 - margin).all()
