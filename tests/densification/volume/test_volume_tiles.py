"""The height volume of a textured box: heights against truth, tiles against the whole, what jobs read and write."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from memory_runner import MemoryProject
from textured_box import LEVELS, SURFACE, photos, pyramid, scene_block, truth

from orthomill.pipeline.engine.graph import PROCESS_BYTES
from orthomill.pipeline.engine.running import Options as RunOptions
from orthomill.schemas.job import Job, Raster
from orthomill.schemas.memory import MIB
from orthomill.schemas.observations import GROUND_POINTS, GroundPoints
from orthomill.schemas.orientation import BLOCK as BLOCK_TABLE
from orthomill.schemas.photo import photo_raster
from orthomill.schemas.raster import Window
from orthomill.tasks.densification.plan.volume_jobs import volume_height, volume_plan, volume_quality
from orthomill.tasks.densification.settings.guide_settings import ConfidenceLimits
from orthomill.tasks.densification.volume import volume_tile
from orthomill.tasks.densification.volume.levels import HALO, SIDE, VolumeScene, coarser_window, level_grid
from orthomill.tasks.densification.volume.photograph_choice import PLACE
from orthomill.tasks.densification.volume.quality import SPREAD_UNIT, STRETCH_UNIT, Band
from orthomill.tasks.densification.volume.volume_square import solve_square
from orthomill.tasks.densification.volume.volume_tile import SolvedVolume, VolumeTile, solve_volume, tile_memory, volume_tiles
from orthomill.tasks.matching.volume.volume_settings import HeightVolume

SETTINGS = HeightVolume(widest=32)


def scene(names: str = "abcd", settings: HeightVolume = SETTINGS) -> VolumeScene:
    return VolumeScene(scene_block(names), photos(names), SURFACE, settings)


def no_points() -> GroundPoints:
    """Without tie points the terrain is flat, at the mean height of the block."""
    return GroundPoints(*(np.zeros(0) for _ in range(9)))


def flat(tile: VolumeTile, height: float = 0.0) -> np.ndarray:
    return np.full(tile.places.shape, height, np.float32)


def solved(planned: VolumeScene) -> MemoryProject:
    """All levels, run from the plan as the engine would."""
    engine = MemoryProject(64)
    engine.tables[BLOCK_TABLE.path] = planned.block
    engine.tables[GROUND_POINTS.path] = no_points()
    for name in planned.block.names:
        for level in range(LEVELS):
            engine.put(photo_raster(name, level), pyramid(name)[level])
    for thing in volume_plan(planned, ConfidenceLimits(), (), 64, "densification", "EPSG:2100"):
        engine._take(thing)
    return engine


@pytest.fixture(scope="module")
def engine():
    return solved(scene())


def test_every_level_is_written_with_its_own_grid(engine):
    for level in scene().levels:
        height, quality = engine.rasters[volume_height(level.number)], engine.rasters[volume_quality(level.number)]
        assert height.shape == level.grid.shape and quality.shape == (*level.grid.shape, len(Band))
        assert engine.written[volume_height(level.number)].all()


def test_ground_and_roof_are_where_they_are(engine):
    error = abs(engine.rasters[volume_height(0)] - truth(SURFACE.grid))
    judged = np.isfinite(truth(SURFACE.grid))
    assert np.isfinite(error[judged]).mean() > 0.99
    assert np.nanmedian(error[judged]) < 0.3
    roof = truth(SURFACE.grid) > 1
    assert (error[roof] < 1.5).mean() > 0.95 and (error[judged & ~roof] < 1.5).mean() > 0.97


def test_quality_says_where_the_heights_are_good(engine):
    margin, coherence, count, spread, stretch = np.moveaxis(engine.rasters[volume_quality(0)], -1, 0)
    inner = slice(20, 100), slice(20, 100)
    assert np.median(margin[inner]) > 10 and np.median(coherence[inner]) > 90 and count[inner].max() == 4
    assert np.median(spread[inner]) < SPREAD_UNIT
    # The step of the heights follows the widest base of these very photographs.
    assert STRETCH_UNIT <= np.median(stretch[inner]) < 2 * STRETCH_UNIT


def test_a_place_whose_terrain_one_photograph_shows_has_no_height():
    one = solved(scene("ac"))
    height, seen = one.rasters[volume_height(0)], one.rasters[volume_quality(0)][..., Band.SEEN]
    assert np.isfinite(height[seen == 2]).all() and (seen == 2).any()
    x, y = np.meshgrid(*SURFACE.grid.centres(Window(0, 0, *SURFACE.grid.shape)))
    ground = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, one.tables[BLOCK_TABLE.path].ground_mean)])
    within = np.sort([view.within(view.project(ground)) for view in scene("ac").views], axis=0)[0].reshape(height.shape)
    # The frame bends between the places of the terrain, by less than a pixel here.
    assert np.isnan(height[within < -1]).all() and np.isfinite(height[within > 1]).mean() > 0.99


def test_one_photograph_alone_gives_nothing_and_reads_nothing():
    planned = scene("a")
    tile = volume_tiles(planned.levels[-1], planned)[0]
    found = solve_volume(tile, SETTINGS, planned.block)
    assert tile.photos == () and np.isnan(found.height).all() and not found.quality.any()


def test_the_tile_of_the_project_changes_nothing():
    assert SIDE % PLACE == HALO % PLACE == 0
    for thing in volume_plan(scene(), ConfidenceLimits(), (), 64, "densification", "EPSG:2100"):
        if isinstance(thing, Job):
            window = next(iter(thing.writes.values())).window
            assert window.row % SIDE == 0 and window.col % SIDE == 0


def test_pixels_beyond_what_a_tile_reads_do_not_matter():
    planned = scene()
    tile = volume_tiles(planned.levels[0], planned)[0]
    pixels = [pyramid(part.name)[part.level] for part in tile.photos]
    parts = list(zip(tile.photos, pixels, strict=True))
    least = solve_volume(tile, SETTINGS, planned.block, tuple(array[part.window.slices] for part, array in parts), flat(tile))
    whole = tuple(replace(part, window=Window(0, 0, *array.shape[:2])) for part, array in parts)
    most = solve_volume(replace(tile, photos=whole), SETTINGS, planned.block, tuple(pixels), flat(tile))
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
    assert 0 < tile_memory(tile, few).scratch < tile_memory(other, many).scratch
    wide = scene(settings=HeightVolume(widest=32, mean_heights=256))
    assert tile_memory(volume_tiles(wide.levels[-1], wide)[0], wide).scratch > tile_memory(other, many).scratch


def memory_of(tile: VolumeTile, of: VolumeScene) -> int:
    """Working memory and pixels of a tile, bytes."""
    return tile_memory(tile, of).scratch + sum(3 * part.window.cells for part in tile.photos)


def test_photographs_with_few_places_for_their_pixels_stay_out_first(monkeypatch):
    many = scene("abcd")
    tile = volume_tiles(many.levels[-1], many)[0]
    monkeypatch.setattr(volume_tile, "MOST_MEMORY", memory_of(tile, many) - 1)
    needed = dict(zip(tile.photos, (9, 9, 1, 9), strict=True))
    assert tile.photos[2] not in volume_tile._fitting(tile, needed, many)


def test_the_largest_tile_fits_one_worker_of_the_usual_memory():
    """A run with one worker was refused although two lent each other what was missing."""
    assert RunOptions().memory >= PROCESS_BYTES + volume_tile.MOST_MEMORY + 64 * MIB


def test_a_tile_that_would_not_fit_a_worker_leaves_out_the_photographs_it_needs_least(monkeypatch):
    """A deep tile and photographs along the ground asked for more than a worker has, and the run was refused."""
    many = scene("abcd")
    whole = volume_tiles(many.levels[-1], many)[0]
    monkeypatch.setattr(volume_tile, "MOST_MEMORY", memory_of(whole, many) - 1)
    fewer = volume_tiles(many.levels[-1], many)[0]
    assert len(fewer.photos) == len(whole.photos) - 1 and memory_of(fewer, many) < memory_of(whole, many)
    assert [part for part in whole.photos if part in fewer.photos] == list(fewer.photos), "in the order of the block"
    monkeypatch.setattr(volume_tile, "MOST_MEMORY", 0)
    assert len(volume_tiles(many.levels[-1], many)[0].photos) == 2


def test_a_large_tile_reads_more_photographs_than_a_place_compares():
    grid = SURFACE.grid.model_copy(update={"west": -60.0, "north": 180.0, "rows": 240, "cols": 240})
    settings = HeightVolume(photographs=2, widest=64)
    planned = VolumeScene(scene_block(), photos(), SURFACE.model_copy(update={"grid": grid}), settings)
    tile = volume_tiles(planned.levels[0], planned)[0]
    assert len(tile.photos) > 2
    pixels = tuple(pyramid(part.name)[part.level][part.window.slices] for part in tile.photos)
    found = solve_volume(tile, settings, planned.block, pixels, flat(tile))
    level = tile.level.number
    assert (abs(found.height[70 >> level : 100 >> level, 70 >> level : 100 >> level]) < tile.level.step).mean() > 0.9


def test_photographs_that_no_place_compares_are_left_alone():
    planned = scene(settings=HeightVolume(photographs=2, widest=32))
    tile = volume_tiles(planned.levels[0], planned)[0]
    pixels = tuple(pyramid(part.name)[part.level][part.window.slices] for part in tile.photos)
    found = solve_volume(tile, planned.settings, planned.block, pixels, flat(tile))
    # A twin of the first photograph, from the same place: no place prefers it to the others.
    more = replace(tile, photos=(*tile.photos, tile.photos[0]))
    again = solve_volume(more, planned.settings, planned.block, (*pixels, np.full_like(pixels[0], 255)), flat(tile))
    assert np.array_equal(found.height, again.height, equal_nan=True) and np.array_equal(found.quality, again.quality)
    assert np.isfinite(found.height).any()


def test_jobs_read_the_level_below():
    for thing in volume_plan(scene(), ConfidenceLimits(), (), 64, "densification", "EPSG:2100"):
        if isinstance(thing, Job) and thing.function is solve_square:
            level = thing.params["square"].level.number
            coarser = thing.reads.get("coarser")
            assert (coarser is None) == (level == scene().levels[0].number)
            assert coarser is None or (isinstance(coarser, Raster) and coarser.name == volume_height(level + 1))


def test_the_coarser_surface_hides_ground_behind_a_wall_from_some_photographs():
    planned = scene("ac")
    tile = volume_tiles(planned.levels[-1], planned)[0]
    coarser = np.zeros(tile.coarser.shape, np.float32)
    coarser[26:34, 25:35] = 14.0
    pixels = tuple(pyramid(part.name)[part.level][part.window.slices] for part in tile.photos)
    found = solve_volume(tile, SETTINGS, planned.block, pixels, flat(tile), coarser)
    # The box stands at 50 to 70 m east; the photographs look from 20 and 104 m east, so that each misses a strip beside it.
    seen = found.quality[60, :, Band.SEEN]
    assert (seen[30:44] == 2).all() and (seen[46:50] == 1).any() and (seen[70:73] == 1).any() and (seen[80:90] == 2).all()
    assert np.isfinite(found.height[60, 30:90]).all()
