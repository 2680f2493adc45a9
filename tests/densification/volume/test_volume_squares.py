"""Tiles of the height volume solved by one job: as each alone, whatever the square, with the photographs of one at a time."""

import weakref

import numpy as np
import pytest
from textured_box import SURFACE, photos, pyramid, scene_block

from orthomill.schemas.job import Job, regions_of
from orthomill.schemas.raster import RasterSpec
from orthomill.tasks.densification.plan.volume_jobs import volume_height, volume_plan
from orthomill.tasks.densification.settings.guide_settings import ConfidenceLimits
from orthomill.tasks.densification.volume import volume_square, volume_tile
from orthomill.tasks.densification.volume.levels import SIDE, VolumeScene
from orthomill.tasks.densification.volume.volume_square import solve_square, square_scratch, square_side, volume_squares
from orthomill.tasks.densification.volume.volume_tile import solve_volume, tile_memory, volume_tiles
from orthomill.tasks.matching.volume.volume_settings import HeightVolume

SETTINGS = HeightVolume(widest=32)
SMALL = 48
"""cells along a tile here, so that the box has several"""


def scene() -> VolumeScene:
    return VolumeScene(scene_block("abcd"), photos("abcd"), SURFACE, SETTINGS)


def flat(square):
    return np.zeros(square.places.shape, np.float32)


@pytest.fixture
def small(monkeypatch):
    for module in (volume_tile, volume_square):
        monkeypatch.setattr(module, "SIDE", SMALL)
    planned = scene()
    assert len(volume_tiles(planned.levels[-1], planned)) > 4
    return planned


def pixels_of(tile):
    return tuple(pyramid(part.name)[part.level][part.window.slices].copy() for part in tile.photos)


def coarse(level):
    """Heights of a level, of which no two places have the same ones."""
    rows, cols = np.indices(level.grid.shape)
    return (2 * np.sin(rows / 7) + np.cos(cols / 5)).astype(np.float32)


@pytest.mark.parametrize("side", [SMALL, 2 * SMALL, 5 * SMALL])
def test_a_square_is_its_tiles_one_by_one(small, side):
    level, above = small.levels[-1], coarse(small.levels[-2])
    made = np.full(level.grid.shape, np.nan, np.float32), np.zeros((*level.grid.shape, 5), np.uint8)
    alone = made[0].copy(), made[1].copy()
    for tile in volume_tiles(level, small):
        found = solve_volume(tile, SETTINGS, small.block, pixels_of(tile), flat(tile), above[tile.coarser.slices])
        for values, part in zip(alone, found, strict=True):
            values[tile.window.slices] = part
    for square in volume_squares(level, small, side):
        read = flat(square), above[square.coarser.slices]
        found = solve_square(square, SETTINGS, small.block, map(pixels_of, square.tiles), *read)
        for values, part in zip(made, found, strict=True):
            values[square.window.slices] = part
    assert np.isfinite(made[0]).mean() > 0.9
    assert all(np.array_equal(one, other, equal_nan=True) for one, other in zip(made, alone, strict=True))


def test_photographs_of_a_tile_go_before_those_of_the_next_are_read(small):
    square = next(iter(volume_squares(small.levels[0], small, 16 * SMALL)))
    held = []

    def read():
        for tile in square.tiles:
            assert not any(reference() is not None for reference in held)
            pixels = pixels_of(tile)
            held[:] = [weakref.ref(one) for one in pixels]
            yield pixels
            del pixels

    solve_square(square, SETTINGS, small.block, read(), flat(square))
    assert len(held) == len(square.tiles[-1].photos)


def test_tiles_that_no_two_photographs_show_are_left_out():
    planned = VolumeScene(scene_block("a"), photos("a"), SURFACE, SETTINGS)
    (square,) = volume_squares(planned.levels[-1], planned, SIDE)
    assert square.tiles == () and square.coarser is None and square_scratch(square, planned) == 0
    found = solve_square(square, SETTINGS, planned.block)
    assert found.height.shape == square.window.shape and np.isnan(found.height).all() and not found.quality.any()


def test_squares_show_the_ground_of_a_tile_of_the_project_on_every_level():
    levels = scene().levels
    sides = [square_side(level, 4 * SIDE) // SIDE for level in reversed(levels)]
    assert sides == [4, 2, 1, 1][: len(levels)] and len(levels) > 1
    assert [square_side(level, SIDE // 2) for level in levels] == [SIDE] * len(levels)


def test_memory_is_that_of_the_most_demanding_tile_and_there_are_fewer_jobs():
    grid = SURFACE.grid.model_copy(update={"rows": 4 * SIDE, "cols": 3 * SIDE})
    planned = VolumeScene(scene_block(), photos(), SURFACE.model_copy(update={"grid": grid}), SETTINGS)
    level = planned.levels[-1]
    jobs = {side: solving(planned, level, side) for side in (SIDE, 2 * SIDE)}
    assert [len(of) for of in jobs.values()] == [12, 4]
    regions = [
        {region for job in of if "photos" in job.reads for region in regions_of(job.reads["photos"])} for of in jobs.values()
    ]
    assert regions[0] == regions[1] and regions[0]
    for square, job in zip(volume_squares(level, planned, 2 * SIDE), jobs[2 * SIDE], strict=True):
        groups = job.reads["photos"].regions if square.tiles else ()
        pixels = max((sum(3 * region.window.cells for region in group) for group in groups), default=0)
        assert job.scratch + pixels == max((sum(tile_memory(tile, planned)) for tile in square.tiles), default=0)


def solving(planned, level, side):
    """The jobs of a level."""
    found = list(volume_plan(planned, ConfidenceLimits(), (), side, "densification", "EPSG:2100"))
    chunks = {thing.name: thing.chunk for thing in found if isinstance(thing, RasterSpec)}
    assert chunks[volume_height(level.number)] == side
    return [thing for thing in found if isinstance(thing, Job) and thing.item == f"volume {level.number}"]
