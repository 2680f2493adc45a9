"""The scene is what its settings say, and the same in any tiling."""

from dataclasses import replace

import numpy as np
import pytest
from small_block import FLIGHT, scene, site, whole

from orthomill.schemas.errors import GeometryError
from orthomill.schemas.raster import Window
from orthomill.schemas.truth import Material
from orthomill.tasks.simulation.flight import FlightSettings, scene_grid, scene_settings
from orthomill.tasks.simulation.scene.ground_texture import WATER_COLOUR, painted_window
from orthomill.tasks.simulation.scene.layout import building_clearance, ground_at, height_bounds, road_clearance, scene_bounds
from orthomill.tasks.simulation.scene.scene import surface_window
from orthomill.tasks.simulation.scene.settlement import scene_of
from orthomill.tasks.simulation.scene.sunlight import SUN_ELEVATION, _sweep_shadow

FULL = FlightSettings(2009, 230.0, 153.353, 96.0, 6800.0, 582.0, 0.6, 2, 3)


def full_scene():
    return scene_of(scene_settings(FULL, 220))


def test_the_full_scene_has_what_was_promised():
    town = full_scene()
    west, south, east, north = scene_bounds(town.settings)
    x, y = np.meshgrid(np.arange(west, east, 10.0), np.arange(south, north, 10.0))
    z = ground_at(town, x.ravel(), y.ravel())
    slope = np.hypot(*np.gradient(z.reshape(x.shape), 10.0))
    tops = town.buildings.eaves + town.buildings.rise - ground_at(town, town.buildings.x, town.buildings.y)
    assert len(town.buildings) == 220 and len(town.trees) > 1000
    assert z.min() > 5.0 and z.max() < 150.0
    assert 0.45 < slope.max() < 0.62 and np.median(slope) < 0.06
    assert tops.min() >= 4.0 and 18.0 < tops.max() < 27.0
    assert 60 < (town.buildings.rise > 0).sum() < 160


def test_buildings_keep_off_roads_and_trees_keep_off_walls():
    town = full_scene()
    houses = town.buildings
    for p, q in ((-1, -1), (-1, 1), (1, -1), (1, 1)):
        x = houses.x + p * houses.half_length * houses.cos - q * houses.half_width * houses.sin
        y = houses.y + p * houses.half_length * houses.sin + q * houses.half_width * houses.cos
        assert road_clearance(town, x, y).min() > 0.0
    assert (building_clearance(houses, town.trees[:, 0], town.trees[:, 1]) > town.trees[:, 2]).all()


def test_a_seed_decides_everything():
    other = scene_of(replace(site().scene, seed=7))
    again = scene_of.__wrapped__(site().scene)
    assert np.array_equal(again.buildings.table, scene().buildings.table) and np.array_equal(again.trees, scene().trees)
    assert not np.array_equal(other.buildings.table, scene().buildings.table)


def test_the_pixel_size_moves_nothing():
    assert scene_settings(replace(FLIGHT, pixel_um=15.0), 20) == site().scene


def test_too_many_buildings_are_refused():
    with pytest.raises(GeometryError, match=r"room for \d+ buildings only, but 900 were requested"):
        scene_of(replace(site().scene, buildings=900))


def test_tiles_fit_together():
    part = Window(311, 405, 170, 203)
    tile = painted_window(scene(), site().grid, part)
    assert np.array_equal(tile.surface.height, whole().surface.height[part.slices])
    assert np.array_equal(tile.surface.material, whole().surface.material[part.slices])
    assert np.array_equal(tile.surface.building, whole().surface.building[part.slices])
    assert np.array_equal(tile.colours, whole().colours[part.slices])


def test_the_window_agrees_with_the_formula_of_the_ground():
    grid, surface = site().grid, whole().surface
    bare = np.argwhere(np.isin(surface.material, (Material.OPEN_GROUND, Material.FIELD, Material.ROAD)))[::997]
    x, y = grid.centres(Window(0, 0, *grid.shape))
    assert np.allclose(surface.height[bare[:, 0], bare[:, 1]], ground_at(scene(), x[bare[:, 1]], y[bare[:, 0]]), atol=1e-5)


def test_roofs_are_planes_on_upright_walls():
    grid, surface = site().grid, whole().surface
    houses = scene().buildings
    x, y = grid.centres(Window(0, 0, *grid.shape))
    for number in range(1, len(houses) + 1):
        row, col = np.nonzero(surface.building == number)
        _, _, cos, sin, _, width, eaves, rise = houses.table[number - 1]
        q = (y[row] - houses.y[number - 1]) * cos - (x[col] - houses.x[number - 1]) * sin
        assert np.allclose(surface.height[row, col], eaves + rise * (1.0 - np.abs(q) / width), atol=1e-4)
        ground = ground_at(scene(), x[col], y[row])
        assert (surface.height[row, col] - ground).min() > 2.9


def test_the_pond_is_level_and_without_texture():
    wet = whole().surface.material == Material.WATER
    assert wet.sum() > 500
    assert np.ptp(whole().surface.height[wet]) == 0.0
    assert (whole().colours[wet] == np.array(WATER_COLOUR, np.uint8)).all()


def test_open_ground_has_fine_texture_everywhere():
    grey = whole().colours.astype(np.float64).mean(axis=2)
    open_ground = np.isin(whole().surface.material, (Material.OPEN_GROUND, Material.FIELD, Material.ROAD))
    rows, cols = grey.shape[0] // 12 * 12, grey.shape[1] // 12 * 12
    blocks = grey[:rows, :cols].reshape(rows // 12, 12, cols // 12, 12)
    bare = open_ground[:rows, :cols].reshape(rows // 12, 12, cols // 12, 12).all(axis=(1, 3))
    assert blocks.std(axis=(1, 3))[bare].min() > 3.0


@pytest.mark.parametrize("cell", [0.25, 1.0])
def test_other_cells_show_the_same_scene(cell):
    grid = scene_grid(site().scene, cell)
    centre = Window(int(100 / cell), int(100 / cell), int(60 / cell), int(60 / cell))
    coarse = surface_window(scene(), grid, centre).height.mean()
    half = whole().surface.height[200:320, 200:320].mean()
    assert coarse == pytest.approx(half, abs=0.15)


def test_height_bounds_hold():
    low, high = height_bounds(scene(), scene_bounds(site().scene))
    assert low < whole().surface.height.min() and whole().surface.height.max() < high


def test_shadows_agree_with_a_plain_walk_to_the_sun():
    generator = np.random.default_rng(3)
    height = generator.uniform(0.0, 1.0, (40, 50)).astype(np.float32)
    height[20:25, 30:34] += 9.0
    drop = 0.5 * np.sqrt(2.0) * np.tan(SUN_ELEVATION)
    fast = np.empty(height.shape, np.float32)
    _sweep_shadow(height, drop, fast)
    for row, col in np.ndindex(height.shape):
        reach = min(40 - row, 50 - col)
        bound = max((height[row + k, col + k] - k * drop for k in range(1, reach)), default=-np.inf)
        assert fast[row, col] == pytest.approx(np.clip((bound - height[row, col] - 0.1) / 0.7, 0.0, 1.0), abs=1e-5)
