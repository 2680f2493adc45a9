"""Light, colours of tops and walls, the lens and the film, each against its formula on surfaces that are known."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from small_block import FLIGHT, scene, site

from orthomill.schemas.camera import Camera
from orthomill.schemas.raster import MapGrid, Window
from orthomill.schemas.truth import Material
from orthomill.tasks.geometry.view import View
from orthomill.tasks.simulation.flight import BLOCK, FlightExposure
from orthomill.tasks.simulation.rendering import HALO, Film, _object_keys, _wall_colour, blur, cast, expose
from orthomill.tasks.simulation.scene.ground_texture import PaintedWindow
from orthomill.tasks.simulation.scene.scene import SurfaceWindow
from orthomill.tasks.simulation.scene.sunlight import AMBIENT, SUN, SUN_ELEVATION, light_on
from orthomill.tasks.simulation.scene.true_visibility import occlusion_reach
from orthomill.tasks.simulation.simulated_tiles import sight_window

CELL, SIDE = 0.5, 16 * BLOCK
GRID = MapGrid(west=408000.0, north=4357000.0, cell=CELL, rows=SIDE, cols=SIDE)
WINDOW = Window(0, 0, SIDE, SIDE)
CAMERA = Camera(name="c", width=100, height=100, c=100.0)
ABOVE = View("p", CAMERA, np.eye(3), np.array([408032.0, 4356968.0, 70.0]))
"""30 m above ground at 40 m: pixels of 0.3 m"""


def painted(height=None, colours=None, building=None, material=None) -> PaintedWindow:
    """Level ground at 40 m of one grey value, and what is changed of it."""
    shape = (SIDE, SIDE)
    surface = SurfaceWindow(
        np.full(shape, 40.0, np.float32) if height is None else height.astype(np.float32),
        np.full(shape, Material.WATER, np.uint8) if material is None else material,
        np.zeros(shape, np.uint16) if building is None else building,
    )
    return PaintedWindow(surface, np.full((*shape, 3), 120, np.uint8) if colours is None else colours)


def light_of(made: PaintedWindow, view: View = ABOVE) -> np.ndarray:
    return cast(scene(), view, Window(20, 20, 60, 60), (GRID, WINDOW, made))


def test_one_colour_stays_one_colour():
    """Water has no detail below the cells, so that the colours of the scene arrive unchanged."""
    assert np.allclose(light_of(painted()), 120.0, atol=1e-3)


def test_detail_is_added_below_the_cells_of_all_but_water():
    near = replace(ABOVE, camera=CAMERA.model_copy(update={"c": 400.0}))
    field = painted(material=np.full((SIDE, SIDE), Material.FIELD, np.uint8))
    rough = light_of(field, near)
    assert np.allclose(light_of(field), 120.0, atol=1e-3), "pixels larger than half a cell show no more than the cells"
    assert np.allclose(light_of(painted(), near), 120.0, atol=1e-3)
    assert rough.mean() == pytest.approx(120.0, abs=6.0) and 2.0 < rough.std() < 25.0


def test_a_ramp_of_colours_is_interpolated():
    ramp = np.repeat((40 + np.arange(SIDE))[None, :, None], SIDE, axis=0).repeat(3, axis=2).astype(np.uint8)
    found = light_of(painted(colours=ramp))[..., 0]
    east = ABOVE.at_height(np.column_stack([np.arange(20.0, 80.0), np.full(60, 50.0)]), 40.0)[:, 0]
    expected = 40 + (east - GRID.west) / CELL - 0.5
    assert np.allclose(found[30], expected, atol=0.02)


def test_colours_of_a_roof_do_not_bleed_into_the_ground():
    building = np.zeros((SIDE, SIDE), np.uint16)
    building[40:80, 40:80] = 60001
    colours = np.full((SIDE, SIDE, 3), 50, np.uint8)
    colours[building > 0] = 250
    found = light_of(painted(colours=colours, building=building))
    values = np.unique(np.rint(found[..., 0] / 50.0))
    assert set(values.tolist()) <= {1.0, 2.0, 3.0, 4.0, 5.0}, "mixtures come from the four rays of a pixel only"
    assert ((np.abs(found - 50) < 0.1) | (np.abs(found - 250) < 0.1)).mean() > 0.9


def test_keys_identify_objects_and_cells_with_other_neighbours():
    building, material = np.zeros((8, 9), np.uint16), np.full((8, 9), Material.FIELD, np.uint8)
    building[2:4, 3:5], material[6, 6] = 7, Material.TREE
    keys, mixed = _object_keys(material, building)
    assert set(np.unique(keys).tolist()) == {0, 7, 1 << 20} and keys[6, 6] == 1 << 20
    assert mixed[1, 2] and mixed[2, 3] and mixed[5, 5] and not mixed[4, 7] and not mixed[0].any()


def wall_at(x: float, y: float, below_top: float = 0.1) -> np.ndarray:
    """Colour at a point of the walls of a house of 16 x 10 m about the origin, along the axes."""
    out = np.zeros(3, np.float32)
    _wall_colour(np.array([0.0, 0.0, 1.0, 0.0, 8.0, 5.0, 12.0, 3.0]), 4, 2009, x, y, below_top, out)
    return out


@pytest.mark.parametrize(("x", "y", "normal"), [(1.0, -5.0, (0, -1)), (1.0, 5.0, (0, 1)), (8.0, 1.0, (1, 0)), (-8.0, 1.0, (-1, 0))])
def test_walls_are_lit_according_to_their_direction(x, y, normal):
    """Compared with the north wall, which has ambient light only."""
    light = AMBIENT + (1 - AMBIENT) * max(normal[0] * SUN[0] + normal[1] * SUN[1], 0.0) / SUN[2]
    assert np.allclose(wall_at(x, y) / wall_at(1.0, 5.0), light / AMBIENT, rtol=1e-5)


def test_walls_have_windows_on_every_floor():
    heights = np.arange(0.05, 9.3, 0.1)
    dark = np.array([wall_at(0.0, -5.0, below)[0] < 0.6 * wall_at(0.0, -5.0)[0] for below in heights])
    assert np.array_equal(dark, (heights / 3.1 % 1.0 > 0.25) & (heights / 3.1 % 1.0 < 0.72))


@settings(max_examples=25, deadline=None)
@given(gx=st.floats(-0.5, 0.5), gy=st.floats(-0.5, 0.5))
def test_light_on_a_slope_follows_lambert(gx, gy):
    y, x = np.mgrid[0:12, 0:12] * CELL
    height = (gx * x - gy * y).astype(np.float32)
    found = light_on(height, CELL)[3:-4, 3:-4]
    facing = (SUN[2] - gx * SUN[0] - gy * SUN[1]) / np.sqrt(1 + gx * gx + gy * gy)
    assert np.allclose(found, AMBIENT + (1 - AMBIENT) * max(facing, 0.0) / SUN[2], atol=2e-3)


def test_the_shadow_of_a_tower_points_away_from_the_sun():
    height = np.zeros((60, 60), np.float32)
    height[40:42, 40:42] = 5.0
    found = light_on(height, CELL)
    length = 5.0 / np.tan(SUN_ELEVATION) / np.sqrt(2.0) / CELL
    diagonal = np.array([found[40 - k, 40 - k] for k in range(2, 20)])
    dark = np.flatnonzero(diagonal < 0.9)
    assert dark[0] == 0 and dark[-1] + 2 == pytest.approx(length, abs=1.6)
    assert found[45, 45] == pytest.approx(1.0, abs=1e-5) and diagonal[0] == pytest.approx(AMBIENT, abs=0.05)


@settings(max_examples=20, deadline=None)
@given(sigma=st.floats(0.2, 1.5), value=st.floats(0, 255))
def test_the_lens_keeps_the_light(sigma, value):
    light = np.full((9, 11, 3), value, np.float32)
    assert np.allclose(blur(light, sigma), np.float32(value), rtol=1e-5)
    point = np.zeros((9, 9, 1), np.float32)
    point[4, 4] = 1.0
    spread = blur(point, sigma)[:, :, 0]
    assert spread.sum() == pytest.approx(1.0, rel=1e-5) and np.allclose(spread, spread.T) and spread.shape == (5, 5)


@settings(max_examples=25, deadline=None)
@given(gain=st.floats(0.7, 1.2), offset=st.floats(-10, 10), falloff=st.floats(0.0, 0.3), grey=st.floats(20, 150))
def test_the_film_follows_its_formula(gain, offset, falloff, grey):
    film = Film(FlightExposure(1, (gain, gain, gain), offset, falloff), 0.0, FLIGHT.seed)
    found = expose(np.full((100, 100, 3), grey, np.float32), film, ABOVE, Window(0, 0, 100, 100)).astype(float)
    row, col = np.mgrid[0:100, 0:100] - 49.5
    expected = offset + gain * (1 - falloff * (row**2 + col**2) / (2 * 49.5**2)) * grey
    assert np.abs(found[..., 0] - np.clip(expected, 0, 255)).max() <= 0.51


def test_noise_depends_on_photo_seed_and_band_but_not_on_the_window():
    light = np.full((40, 40, 3), 100.0, np.float32)
    film = Film(FlightExposure(1, (1.0, 1.0, 1.0), 0.0, 0.0), 3.0, 5)
    whole = expose(light, film, ABOVE, Window(10, 20, 40, 40))
    part = expose(light[:10, :15], film, ABOVE, Window(22, 33, 10, 15))
    assert np.array_equal(part, whole[12:22, 13:28])
    for other in (replace(film, seed=6), replace(film, exposure=replace(film.exposure, number=2))):
        assert not np.array_equal(expose(light, other, ABOVE, Window(10, 20, 40, 40)), whole)
    assert not np.array_equal(whole[..., 0], whole[..., 1]) and HALO == 2


def test_sight_windows_are_aligned_and_reach_as_far_as_occlusion():
    core = Window(301, 333, 50, 70)
    wide = sight_window(site(), core)
    reach = occlusion_reach((ABOVE,), scene())
    assert wide.row % BLOCK == wide.col % BLOCK == 0 and wide.row < core.row and wide.col < core.col
    assert 20.0 < reach < 200.0 and (core.row - wide.row) * CELL > 10.0
