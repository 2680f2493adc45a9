"""The heights of a tile from depth maps whose geometry is known."""

from dataclasses import replace

import numpy as np
import pytest
from village_pair import CELL, normal_case

from orthomill.schemas.raster import MapGrid, Window
from orthomill.schemas.surface import Surface
from orthomill.tasks.densification.canopy import canopy_heights as room
from orthomill.tasks.densification.canopy.canopy_heights import CanopyTile
from orthomill.tasks.densification.canopy.depth_map import STEP
from orthomill.tasks.densification.plan.canopy_jobs import narrow

GRID = MapGrid(west=0.0, north=0.0, cell=CELL, rows=1400, cols=1400)
SURFACE = Surface(grid=GRID, height_low=-20.0, height_high=60.0)
PAIRS = tuple(normal_case(1400).model_copy(update={"name": name}) for name in "abcd")
WINDOW = Window(600, 700, 64, 80)


def level_map(tile: CanopyTile, number: int, height: float) -> np.ndarray:
    piece = tile.pieces[number]
    parallax = piece.pair.c * piece.pair.base / (piece.pair.left_centre[2] - height)
    return np.full(piece.window.shape, parallax, np.float32)


def canopy_heights(tile: CanopyTile, maps: list[np.ndarray]) -> np.ndarray:
    """As the maps arrive: all of them twice."""
    return room.canopy_heights(tile, iter([*maps, *maps]))


def test_level_ground_is_where_three_maps_see_it():
    tile = CanopyTile.of(SURFACE, WINDOW, PAIRS)
    maps = [level_map(tile, number, height) for number, height in enumerate((12.0, 12.6, 40.0, 11.7))]
    found = canopy_heights(tile, maps)
    assert found.shape == WINDOW.shape and found == pytest.approx(12.1, abs=0.01)
    assert np.isnan(canopy_heights(tile, [maps[0], maps[1], maps[2], np.full_like(maps[3], np.nan)])).all()
    assert np.isnan(canopy_heights(tile, [level_map(tile, number, 70.0) for number in range(4)])).all(), "above all of the block"


def test_a_raised_part_stands_where_it_is():
    tile = CanopyTile.of(SURFACE, WINDOW, PAIRS)
    pair, window = PAIRS[0], tile.pieces[0].window
    ground, crown = (level_map(tile, 0, height) for height in (0.0, 10.0))
    # A crown over columns 730 to 750 of the map, seen from the left photograph at its height.
    scale = pair.c / (pair.left_centre[2] - 10.0)
    first, last = (pair.left_col0 + ((col + 0.5) * CELL - pair.left_centre[0]) * scale for col in (729.5, 750.5))
    cols = STEP * (window.col + np.arange(window.width)) + (STEP - 1) / 2
    maps = [np.where((cols >= first) & (cols <= last), crown, ground)] * 4
    high = np.isclose(canopy_heights(tile, maps), 10.0, atol=0.1)
    assert high[:, 31:50].all() and not high[:, :24].any() and not high[:, 57:].any()


def test_what_most_maps_look_through_is_not_there():
    """Three maps agree on a height of 20 m, and nine see the ground below it."""
    tile = CanopyTile.of(SURFACE, WINDOW, tuple(PAIRS[0].model_copy(update={"name": f"pair {k}"}) for k in range(12)))
    few = [level_map(tile, number, 20.0 if number < 3 else 5.0) for number in range(12)]
    most = [level_map(tile, number, 20.0 if number < 7 else 5.0) for number in range(12)]
    assert canopy_heights(tile, few) == pytest.approx(5.0, abs=0.01)
    assert canopy_heights(tile, most) == pytest.approx(20.0, abs=0.01)


def test_leaves_in_front_say_nothing_of_what_they_hide():
    """Nine maps see a crown, at three heights; three see the ground, which the crown hides from the others."""
    tile = CanopyTile.of(SURFACE, WINDOW, tuple(PAIRS[0].model_copy(update={"name": f"pair {k}"}) for k in range(7)))
    maps = [level_map(tile, number, height) for number, height in enumerate((5.0, 5.0, 5.0, 12.0, 16.0, 20.0, 24.0))]
    assert canopy_heights(tile, maps) == pytest.approx(5.0, abs=0.01)


def test_a_window_is_a_window_of_the_whole():
    tile, part = CanopyTile.of(SURFACE, WINDOW, PAIRS), CanopyTile.of(SURFACE, Window(616, 724, 20, 30), PAIRS)
    rng = np.random.default_rng(1)
    noisy = [level_map(tile, number, 5.0) + rng.normal(0, 0.4, tile.pieces[number].window.shape) for number in range(4)]
    cut = [
        values[own.window.within(piece.window).slices] for values, own, piece in zip(noisy, part.pieces, tile.pieces, strict=True)
    ]
    inner = part.window.within(tile.window).slices
    assert np.array_equal(canopy_heights(tile, noisy)[inner], canopy_heights(part, cut), equal_nan=True)


def test_only_narrow_pairs_have_depth_maps():
    wide = [pair.model_copy(update={"base_height": share}) for pair, share in zip(PAIRS, (0.2, 0.35, 0.36, 0.8), strict=True)]
    assert [pair.name for pair in narrow(tuple(wide))] == ["a", "b"]


def test_pixels_from_far_away_do_not_blur_the_map():
    far = tuple(replace_pixel(pair, 4.0) for pair in PAIRS)
    assert CanopyTile.of(SURFACE, WINDOW, far).smooth == 8
    assert CanopyTile.of(SURFACE, WINDOW, PAIRS).smooth == replace(CanopyTile.of(SURFACE, WINDOW, PAIRS)).smooth < 8


def replace_pixel(pair, times: float):
    return pair.model_copy(update={"parallax_low": pair.parallax_low / times, "parallax_high": pair.parallax_high / times})
