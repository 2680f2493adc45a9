"""The height volume of a textured box: heights against truth, tiles against the whole, what jobs read and write."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from memory_runner import MemoryProject
from textured_box import LEVELS, SURFACE, photos, pyramid, scene_block, truth

from orthomill.schemas.job import Job, Raster
from orthomill.schemas.orientation import BLOCK as BLOCK_TABLE
from orthomill.schemas.photo import photo_raster
from orthomill.schemas.raster import Window
from orthomill.tasks.densification.volume.levels import HALO, SIDE, VolumeScene, coarser_window, level_grid
from orthomill.tasks.densification.volume.merged_levels import Sureness
from orthomill.tasks.densification.volume.photograph_choice import PLACE
from orthomill.tasks.densification.volume.volume_plan import volume_height, volume_plan, volume_quality
from orthomill.tasks.densification.volume.volume_tile import SolvedVolume, solve_volume, tile_scratch, volume_tiles
from orthomill.tasks.matching.volume.height_volume import HeightVolume

SETTINGS = HeightVolume(widest=32)


def scene(names: str = "abcd", settings: HeightVolume = SETTINGS) -> VolumeScene:
    return VolumeScene(scene_block(names), photos(names), SURFACE, settings)


def solved(planned: VolumeScene) -> MemoryProject:
    """All levels, run from the plan as the engine would."""
    engine = MemoryProject(64)
    engine.tables[BLOCK_TABLE.path] = planned.block
    for name in planned.block.names:
        for level in range(LEVELS):
            engine.put(photo_raster(name, level), pyramid(name)[level])
    for thing in volume_plan(planned, Sureness(), "densification", "EPSG:2100"):
        engine._take(thing)
    return engine


@pytest.fixture(scope="module")
def engine():
    return solved(scene())


def test_every_level_is_written_with_its_own_grid(engine):
    for level in scene().levels:
        height, quality = engine.rasters[volume_height(level.number)], engine.rasters[volume_quality(level.number)]
        assert height.shape == level.grid.shape and quality.shape == (*level.grid.shape, 4)
        assert engine.written[volume_height(level.number)].all()


def test_ground_and_roof_are_where_they_are(engine):
    error = abs(engine.rasters[volume_height(0)] - truth(SURFACE.grid))
    judged = np.isfinite(truth(SURFACE.grid))
    assert np.isfinite(error[judged]).mean() > 0.99
    assert np.nanmedian(error[judged]) < 0.3
    roof = truth(SURFACE.grid) > 1
    assert (error[roof] < 1.5).mean() > 0.95 and (error[judged & ~roof] < 1.5).mean() > 0.97


def test_quality_says_where_the_heights_are_good(engine):
    cost, margin, coherence, count = np.moveaxis(engine.rasters[volume_quality(0)], -1, 0)
    inner = slice(20, 100), slice(20, 100)
    assert np.median(cost[inner]) < 20 and np.median(margin[inner]) > 10
    assert np.median(coherence[inner]) > 90 and count[inner].max() == 4


def test_a_place_that_one_photograph_shows_has_no_height_but_a_count():
    one = solved(scene("ac"))
    height, quality = one.rasters[volume_height(0)], one.rasters[volume_quality(0)]
    assert np.isfinite(height[quality[..., 3] == 2]).all() and (quality[..., 3] == 2).any()
    assert (quality[..., 3][np.isnan(height)] < 2).all() and (quality[..., 3][np.isnan(height)] == 1).any()


def test_one_photograph_alone_gives_nothing_and_reads_nothing():
    planned = scene("a")
    tile = volume_tiles(planned.levels[-1], planned)[0]
    found = solve_volume(tile, SETTINGS, planned.block)
    assert tile.photos == () and np.isnan(found.height).all() and not found.quality.any()


def test_the_tile_of_the_project_changes_nothing():
    assert SIDE % PLACE == HALO % PLACE == 0
    for thing in volume_plan(scene(), Sureness(), "densification", "EPSG:2100"):
        if isinstance(thing, Job):
            window = thing.writes["height"].window
            assert window.row % SIDE == 0 and window.col % SIDE == 0


def test_pixels_beyond_what_a_tile_reads_do_not_matter():
    planned = scene()
    tile = volume_tiles(planned.levels[0], planned)[0]
    pixels = [pyramid(part.name)[part.level] for part in tile.photos]
    parts = list(zip(tile.photos, pixels, strict=True))
    least = solve_volume(tile, SETTINGS, planned.block, tuple(array[part.window.slices] for part, array in parts))
    whole = tuple(replace(part, window=Window(0, 0, *array.shape[:2])) for part, array in parts)
    most = solve_volume(replace(tile, photos=whole), SETTINGS, planned.block, tuple(pixels))
    assert isinstance(least, SolvedVolume)
    assert np.array_equal(least.height, most.height, equal_nan=True) and np.array_equal(least.quality, most.quality)


def test_a_tile_reads_the_coarser_cells_around_its_own():
    planned = scene()
    coarsest, finer = planned.levels[0], planned.levels[1]
    assert volume_tiles(coarsest, planned)[0].coarser is None
    tile = volume_tiles(finer, planned)[0]
    assert tile.coarser == Window(0, 0, *coarsest.grid.shape)
    assert coarser_window(Window(100, 60, 30, 31), 2, (500, 500)) == Window(48, 28, 19, 20)


def test_work_is_the_window_with_a_halo():
    big = SURFACE.model_copy(update={"grid": SURFACE.grid.model_copy(update={"rows": 700, "cols": 400})})
    planned = VolumeScene(scene_block(), photos(), big, SETTINGS)
    tiles = volume_tiles(planned.levels[-1], planned)
    assert [(tile.row, tile.col) for tile in tiles] == [(r, c) for r in range(3) for c in range(2)]
    middle = tiles[2]
    assert middle.window == Window(SIDE, 0, SIDE, SIDE)
    assert middle.work == Window(SIDE - HALO, 0, SIDE + 2 * HALO, SIDE + HALO)


def test_levels_nest_and_keep_the_parallax_between_heights():
    levels = scene().levels
    assert [level.number for level in levels] == list(range(len(levels) - 1, -1, -1)) and levels[0].count <= SETTINGS.widest
    for coarse, fine in pairwise(levels):
        assert coarse.step == 2 * fine.step and coarse.grid.cell == 2 * fine.grid.cell
        assert coarse.grid == level_grid(fine.grid, 1)
    for level in levels:
        assert level.heights[0] <= SURFACE.height_low and level.heights[-1] >= SURFACE.height_high


def test_a_smaller_step_gives_more_heights_and_levels():
    fine, coarse = scene(settings=HeightVolume(step=0.25, widest=32)), scene(settings=HeightVolume(step=2.0, widest=32))
    assert fine.levels[-1].step * 8 == pytest.approx(coarse.levels[-1].step)
    assert len(fine.levels) > len(coarse.levels)


def test_memory_follows_candidates_and_photographs():
    few, many = scene("ab"), scene("abcd")
    tile, other = (volume_tiles(one.levels[-1], one)[0] for one in (few, many))
    assert 0 < tile_scratch(tile, few) < tile_scratch(other, many)
    wide = scene(settings=HeightVolume(widest=32, mean_heights=256))
    assert tile_scratch(volume_tiles(wide.levels[-1], wide)[0], wide) > tile_scratch(other, many)


def test_a_large_tile_reads_more_photographs_than_a_place_compares():
    grid = SURFACE.grid.model_copy(update={"west": -60.0, "north": 180.0, "rows": 240, "cols": 240})
    settings = HeightVolume(photographs=2, widest=64)
    planned = VolumeScene(scene_block(), photos(), SURFACE.model_copy(update={"grid": grid}), settings)
    tile = volume_tiles(planned.levels[0], planned)[0]
    assert len(tile.photos) > 2
    pixels = tuple(pyramid(part.name)[part.level][part.window.slices] for part in tile.photos)
    found = solve_volume(tile, settings, planned.block, pixels)
    level = tile.level.number
    assert (abs(found.height[70 >> level : 100 >> level, 70 >> level : 100 >> level]) < tile.level.step).mean() > 0.9


def test_jobs_read_the_level_below():
    for thing in volume_plan(scene(), Sureness(), "densification", "EPSG:2100"):
        if isinstance(thing, Job) and thing.function is solve_volume:
            level = thing.params["tile"].level.number
            coarser = thing.reads.get("coarser")
            assert (coarser is None) == (level == scene().levels[0].number)
            assert coarser is None or (isinstance(coarser, Raster) and coarser.name == volume_height(level + 1))


def test_the_coarser_surface_hides_ground_behind_a_wall_from_some_photographs():
    planned = scene("ac")
    tile = volume_tiles(planned.levels[-1], planned)[0]
    coarser = np.zeros(tile.coarser.shape, np.float32)
    coarser[26:34, 25:35] = 14.0
    pixels = tuple(pyramid(part.name)[part.level][part.window.slices] for part in tile.photos)
    found = solve_volume(tile, SETTINGS, planned.block, pixels, coarser)
    # The box stands at 50 to 70 m east; the photographs look from 20 and 104 m east, so that each misses a strip beside it.
    seen = found.quality[60, :, 3]
    assert (seen[30:44] == 2).all() and (seen[46:50] == 1).any() and (seen[70:73] == 1).any() and (seen[80:90] == 2).all()
    assert np.isfinite(found.height[60, 30:90]).all()
