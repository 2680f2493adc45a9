"""The pieces of a layout against their definitions: relief, pond, roads, town, buildings, trees and vehicles."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from small_block import FLIGHT, scene, site

from orthomill.schemas.raster import MapGrid, Window
from orthomill.schemas.truth import Material
from orthomill.tasks.simulation.scene.ground_texture import PaintedWindow, flat_mosaic
from orthomill.tasks.simulation.scene.layout import (
    STREET_SPACING,
    Buildings,
    HouseColumn,
    Pond,
    SceneSettings,
    Town,
    building_clearance,
    ground_at,
    height_bounds,
    pond_blend,
    pond_distance,
    road_clearance,
    terrain_factors,
)
from orthomill.tasks.simulation.scene.scene import PARCEL, SurfaceWindow, parcel_at, surface_window
from orthomill.tasks.simulation.scene.settlement import TREE_TOP, scene_of, wood_centre
from orthomill.tasks.simulation.scene.sunlight import limited_slope
from orthomill.tasks.simulation.scene.vehicles import FIRST_NUMBER, vehicles_of, with_vehicles

POND = Pond(100.0, 50.0, 40.0, 20.0, 7.0)
TOWN = Town(10.0, -20.0, 200.0, np.radians(30.0), 3.0)


@settings(max_examples=60, deadline=None)
@given(x=st.floats(-1e3, 1e3), y=st.floats(-1e3, 1e3))
def test_the_towns_axes_and_the_world_invert_each_other(x, y):
    u, v = TOWN.local(np.array(x), np.array(y))
    back = TOWN.world(u, v)
    assert np.allclose(back, (x, y), atol=1e-9)
    assert np.hypot(u, v) == pytest.approx(np.hypot(x - 10.0, y + 20.0), abs=1e-9)


@settings(max_examples=60, deadline=None)
@given(angle=st.floats(0, 6.3), share=st.floats(0.0, 3.0))
def test_the_pond_is_an_ellipse_with_a_smooth_shore(angle, share):
    x, y = np.array([100.0 + 40.0 * share * np.cos(angle)]), np.array([50.0 + 20.0 * share * np.sin(angle)])
    assert pond_distance(POND, x, y)[0] == pytest.approx(share, abs=1e-9)
    blend = pond_blend(POND, x, y)[0]
    # On the shore itself rounding decides which side of it a place lies.
    assert 0.0 <= blend <= 1.0 and (blend < 1e-9 or share > 1.0) and (blend == 1.0 or share < 1.7 + 1e-9)


def test_the_water_is_level_and_the_ground_away_from_it_is_the_relief():
    shown, pond = scene(), scene().pond
    assert np.allclose(ground_at(shown, pond.x + np.array([0.0, 3.0]), pond.y + np.array([0.0, -2.0])), pond.level)
    x, y = np.array([pond.x + 2.0 * pond.a]), np.array([pond.y])
    fx, fy = terrain_factors(shown, x, y)
    assert ground_at(shown, x, y) == pytest.approx((fx * fy).sum(axis=0))


def test_relief_is_the_sum_of_its_waves_and_hills():
    """Against the formulas written out, away from the pond."""
    shown = scene()
    s, rng = shown.settings, np.random.default_rng(4)
    x, y = rng.uniform(s.west, s.east, 50), rng.uniform(s.south, s.north, 50)
    z = 27.0 + 22.0 * s.scale * (y - s.south) / (s.north - s.south)
    for amplitude, kx, ky, phase in shown.waves:
        z = z + amplitude * np.sin(kx * (x - s.west) + ky * (y - s.south) + phase)
    for hx, hy, height, sx, sy in shown.hills:
        z = z + height * np.exp(-0.5 * (((x - hx) / sx) ** 2 + ((y - hy) / sy) ** 2))
    fx, fy = terrain_factors(shown, x, y)
    assert np.allclose((fx * fy).sum(axis=0), z, atol=1e-9)


def test_streets_are_where_the_net_of_the_town_has_them():
    shown = scene()
    town = shown.town
    u = np.array([0.0, town.street_half_width + 1.0, 0.5 * STREET_SPACING[0]])
    x, y = town.world(u, np.full(3, 0.5 * STREET_SPACING[1]))
    roads_only = replace(shown, town=replace(town, radius=0.0))
    country = road_clearance(roads_only, x, y)
    found = road_clearance(shown, x, y)
    assert found[0] == pytest.approx(min(-town.street_half_width, country[0]))
    assert (found[1] == pytest.approx(min(1.0, country[1])) and found[2] > 20.0) or country[2] < 20.0


@pytest.mark.parametrize("road", [0, 1, 2])
def test_the_centre_line_of_a_road_is_inside_it_with_its_slope(road):
    shown = scene()
    s, along_x = shown.settings, bool(shown.roads.along_x[road])
    along = np.linspace(*((s.west, s.east) if along_x else (s.south, s.north)), 200)
    across, slope = shown.roads.centre_line(road, along)
    assert np.allclose(np.gradient(across, along)[2:-2], slope[2:-2], atol=2e-3)
    x, y = (along, across) if along_x else (across, along)
    assert (road_clearance(shown, x, y) <= -shown.roads.half_width[road] + 1e-6).all()


HOUSE = Buildings(*(np.array([value]) for value in (20.0, 30.0, np.cos(0.5), np.sin(0.5), 8.0, 5.0, 12.0, 3.0)))


@settings(max_examples=60, deadline=None)
@given(p=st.floats(-30, 30), q=st.floats(-30, 30))
def test_the_distance_from_a_house_is_that_from_its_rectangle(p, q):
    cos, sin = np.cos(0.5), np.sin(0.5)
    x, y = np.array([20.0 + p * cos - q * sin]), np.array([30.0 + p * sin + q * cos])
    outside = np.hypot(max(abs(p) - 8.0, 0.0), max(abs(q) - 5.0, 0.0))
    found = building_clearance(HOUSE, x, y)[0]
    if outside > 1e-9:
        assert found == pytest.approx(outside, abs=1e-9)
    else:
        assert found == pytest.approx(max(abs(p) - 8.0, abs(q) - 5.0), abs=1e-9)


def test_columns_of_the_table_are_named_in_its_order():
    row = HOUSE.table[0]
    assert len(row) == len(HouseColumn) == 8
    for column in HouseColumn:
        assert row[column] == getattr(HOUSE, column.name.lower())[0]


@pytest.mark.parametrize(
    ("height", "scale", "top"), [(1043.0, 1.0, 25.0), (260.75, 0.25, 12.0), (700.0, 700 / 1043, 25 * 700 / 1043)]
)
def test_relief_and_roofs_follow_the_flying_height(height, scale, top):
    made = SceneSettings(1, 0.0, 0.0, 100.0, 200.0, height, 5)
    assert made.scale == pytest.approx(scale) and made.roof_top == pytest.approx(top)
    assert made.place(0.25, 0.5) == (25.0, 100.0)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_any_seed_makes_a_scene_that_keeps_its_rules(seed):
    made = scene_of(replace(site().scene, seed=seed))
    houses, trees = made.buildings, made.trees
    assert len(houses) == 20
    tops = trees[:, 3] - made.tree_feet
    assert tops.min() >= 4.0 and tops.max() <= TREE_TOP
    assert (building_clearance(houses, trees[:, 0], trees[:, 1]) > trees[:, 2]).all()
    assert (pond_distance(made.pond, trees[:, 0], trees[:, 1]) > 1.0).all()
    assert (road_clearance(made, houses.x, houses.y) > houses.half_width).all()
    assert np.allclose(houses.cos**2 + houses.sin**2, 1.0)
    assert (houses.half_length >= 7.0).all() and (houses.rise >= 0.0).all()


def test_in_a_closed_wood_crowns_touch_and_nothing_else_changes():
    bare, settings_of = scene(), replace(site().scene, wood=24.0)
    made, (x, y) = scene_of(settings_of), wood_centre(settings_of)
    away = np.hypot(made.trees[:, 0] - x, made.trees[:, 1] - y)
    assert np.array_equal(made.buildings.table, bare.buildings.table)
    beside = away > 24.0 + 5.0
    assert {tuple(tree) for tree in made.trees[beside]} <= {tuple(tree) for tree in bare.trees}
    wood, feet = made.trees[away <= 24.0], made.tree_feet[away <= 24.0]
    apart = np.hypot(*(wood[:, None, :2] - wood[None, :, :2]).transpose(2, 0, 1)) + 1e9 * np.eye(len(wood))
    assert len(wood) > 20 and np.median(apart.min(axis=0)) < wood[:, 2].min() * 2 and (wood[:, 3] - feet).max() <= TREE_TOP


def test_bounds_of_a_part_hold_what_is_in_it():
    shown, grid = scene(), site().grid
    for window in (Window(100, 100, 80, 90), Window(500, 300, 40, 200)):
        height = surface_window(shown, grid, window).height
        x, y = grid.centres(window)
        low, high = height_bounds(shown, (float(x[0]), float(y[-1]), float(x[-1]), float(y[0])))
        assert low < height.min() and height.max() < high


@settings(max_examples=60, deadline=None)
@given(x=st.floats(4.0e5, 4.1e5), y=st.floats(4.35e6, 4.36e6), seed=st.integers(0, 999))
def test_every_point_belongs_to_one_field(x, y, seed):
    col, row, border = parcel_at(seed, x, y)
    assert 0.0 <= border <= 0.5 * min(PARCEL[:2]) + 1e-6
    if border > 0.2:
        assert parcel_at(seed, x + 0.1, y - 0.1)[:2] == (col, row)


@pytest.mark.parametrize(
    ("before", "here", "after", "slope"),
    [(1.0, 2.0, 4.0, 1.5), (1.0, 2.0, 20.0, 1.0), (-9.0, 2.0, 2.5, 0.5), (-9.0, 2.0, 20.0, 0.0)],
)
def test_slopes_do_not_cross_walls(before, here, after, slope):
    assert limited_slope(before, here, after, 3.0) == slope


def test_the_mosaic_is_flat_at_large_scale_and_rough_at_small():
    mosaic = flat_mosaic().astype(float)
    rows, cols = (side // 160 * 160 for side in mosaic.shape)
    blocks = mosaic[:rows, :cols].reshape(rows // 160, 160, cols // 160, 160)
    means = blocks.mean(axis=(1, 3))
    assert means.mean() == pytest.approx(110.0, abs=6.0) and means.std() < 6.0
    assert blocks.std(axis=(1, 3)).mean() > 15.0


def ground(rows: int = 60, cols: int = 80, material: Material = Material.ROAD) -> tuple[MapGrid, Window, PaintedWindow]:
    grid = MapGrid(west=0.0, north=30.0, cell=0.5, rows=rows, cols=cols)
    surface = SurfaceWindow(
        np.full((rows, cols), 5.0, np.float32), np.full((rows, cols), material, np.uint8), np.zeros((rows, cols), np.uint16)
    )
    return grid, Window(0, 0, rows, cols), PaintedWindow(surface, np.full((rows, cols, 3), 100, np.uint8))


CAR = np.array([[20.0, 15.0, 1.0, 0.0, 2.2, 0.95, 1.5, 200.0, 40.0, 20.0]])


def test_a_vehicle_lifts_its_cells_and_paints_them():
    grid, window, painted = ground()
    driven = with_vehicles(painted, grid, window, CAR)
    x, y = grid.centres(window)
    inside = (np.abs(x[None, :] - 20.0) <= 2.2) & (np.abs(y[:, None] - 15.0) <= 0.95)
    assert inside.sum() > 20
    assert np.array_equal(driven.surface.height, np.where(inside, 6.5, 5.0).astype(np.float32))
    assert np.array_equal(driven.surface.building, np.where(inside, FIRST_NUMBER, 0))
    assert set(driven.colours[inside][:, 0].tolist()) == {200, 70}, "the windscreen is dark"
    assert (driven.colours[~inside] == 100).all() and (painted.surface.height == 5.0).all(), "the input is not changed"


def test_vehicles_are_hidden_by_crowns_and_absent_far_away():
    grid, window, painted = ground(material=Material.TREE)
    assert np.array_equal(with_vehicles(painted, grid, window, CAR).surface.height, painted.surface.height)
    grid, window, painted = ground()
    far = CAR + np.array([[500.0, *[0.0] * 9]])
    assert np.array_equal(with_vehicles(painted, grid, window, far).colours, painted.colours)


def test_two_vehicles_at_one_place_are_not_stacked():
    grid, window, painted = ground()
    assert with_vehicles(painted, grid, window, np.vstack([CAR, CAR])).surface.height.max() == 6.5


@pytest.mark.parametrize("photo", [0, 1, 5])
def test_vehicles_are_on_roads_and_streets(photo):
    shown = scene()
    vehicles = vehicles_of(shown, photo)
    assert vehicles.shape[1] == 10 and np.array_equal(vehicles, vehicles_of(shown, photo))
    assert (road_clearance(shown, vehicles[:, 0], vehicles[:, 1]) < 0.5).mean() > 0.95
    assert np.allclose(np.hypot(vehicles[:, 2], vehicles[:, 3]), 1.0)
    assert set(vehicles[:, 6].tolist()) <= {1.5, 2.3, 3.3} and FLIGHT.strips * FLIGHT.photos_per_strip == 6
