"""Draped heights: what is known stays, gaps are closed smoothly, and a window with its halo gives what the whole model gives."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from orthomill.schemas.raster import MapGrid, Window
from orthomill.tasks.texture.ground.draping import (
    BLOCK,
    HALO,
    block_grid,
    block_heights,
    blocks_of,
    drape,
    far_from_heights,
    ground_window,
)
from orthomill.tasks.texture.ground.gentle_ground import calmed, gentle_ground

GRID = MapGrid(west=0.0, north=0.0, cell=0.5, rows=150, cols=171)


def plane(grid: MapGrid = GRID) -> np.ndarray:
    row, col = np.indices(grid.shape)
    return (0.25 * col - 0.125 * row + 40).astype(np.float32)


def draped(heights: np.ndarray, window: Window) -> np.ndarray:
    """The cells `window`, from the whole model's ground and these cells alone."""
    found = block_heights(heights, np.zeros_like(heights), GRID.cell)
    ground, blocks = gentle_ground(*found, BLOCK * GRID.cell), ground_window(GRID, window)
    return drape(heights[window.slices], window, ground[blocks.slices], blocks)


WHOLE = Window(0, 0, *GRID.shape)


def test_known_heights_stay_and_every_hole_is_closed():
    heights = plane()
    heights[10:90, 20:140] = heights[:, 160:] = np.nan
    result = draped(heights, WHOLE)
    known = ~np.isnan(heights)
    assert (result[known] == heights[known]).all() and np.isfinite(result).all()


def test_a_constant_height_is_reproduced_exactly():
    heights = np.full(GRID.shape, 87.3, np.float32)
    heights[5:140, 7:160] = np.nan
    assert (draped(heights, WHOLE) == np.float32(87.3)).all()


def test_a_draped_hole_lies_between_the_heights_around_it():
    heights = plane()
    heights[60:70, 60:90] = np.nan
    hole = draped(heights, WHOLE)[60:70, 60:90]
    assert np.abs(hole - plane()[60:70, 60:90]).max() < 1.5 and plane().min() < hole.min() and hole.max() < plane().max()


def test_an_empty_model_stays_empty():
    assert np.isnan(draped(np.full(GRID.shape, np.nan, np.float32), WHOLE)).all()


def test_a_model_without_holes_is_not_touched():
    assert (draped(plane(), WHOLE) == plane()).all()


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 60), st.integers(0, 60), st.integers(1, 40), st.integers(0, 2**16))
def test_a_window_with_its_halo_gives_what_the_whole_model_gives(row, col, size, seed):
    rng = np.random.default_rng(seed)
    heights = plane() + rng.normal(0, 1, GRID.shape).astype(np.float32)
    heights[rng.random(GRID.shape) < 0.3] = np.nan
    heights[40:100, 30:120] = np.nan
    core = Window(row, col, size, size)
    window = core.grown(HALO).clipped(GRID.shape)
    inner = Window(core.row - window.row, core.col - window.col, size, size).slices
    np.testing.assert_array_equal(draped(heights, window)[inner], draped(heights, WHOLE)[core.slices])


def test_blocks_of_tiles_are_those_of_the_whole_model():
    heights = plane()
    heights[3:40, 50:70] = np.nan
    errors = np.random.default_rng(4).uniform(0, 3, GRID.shape).astype(np.float32)
    whole, tile = block_heights(heights, errors, GRID.cell), Window(64, 128, 64, 43)
    for values, own in zip(whole, block_heights(heights[tile.slices], errors[tile.slices], GRID.cell), strict=True):
        np.testing.assert_array_equal(values[blocks_of(tile).slices], own)
    assert whole.blocks.shape == block_grid(GRID).shape and block_grid(GRID).cell == BLOCK * GRID.cell


def test_a_block_is_as_high_as_what_is_sure_in_it():
    heights = np.full((16, 16), 10.0, np.float32)
    heights[:8] = 14.0
    errors = np.where(heights > 12, np.float32(4.0), np.float32(0.01))
    found = block_heights(heights, errors, 0.05)
    assert found.blocks[0, 0] == pytest.approx(10.0, abs=0.01) and found.weights[0, 0] == pytest.approx(0.5 / 0.05**2, rel=0.01)
    unstated = block_heights(heights, np.full_like(errors, np.nan), 0.05)
    assert unstated.blocks[0, 0] == pytest.approx(12.0) and unstated.weights[0, 0] == pytest.approx(1 / 0.05**2)


def test_guesses_lie_on_gentle_ground_and_what_was_measured_stays():
    """A crown that is a guess of six metres stood on a wall of ten metres, over which photographs were smeared."""
    row, col = np.indices((640, 640))
    away = np.hypot(row - 320, col - 320)
    heights = np.where(away < 120, 10.0, 0.0).astype(np.float32)
    errors = np.where(away < 200, 6.0, 0.02).astype(np.float32)
    errors[312:328, 312:328] = 0.02
    cell, whole = 0.05, Window(0, 0, 640, 640)
    ground = gentle_ground(*block_heights(heights, errors, cell), BLOCK * cell)
    nothing = drape(np.full_like(heights, np.nan), whole, ground, Window(0, 0, 40, 40))
    found = calmed(heights, errors, nothing, cell)
    assert (found[errors < 1] == heights[errors < 1]).all()
    down, right = np.gradient(found, cell)
    ring = (away > 80) & (away < 190)  # farther in it climbs to what was measured
    assert np.hypot(down, right)[ring].max() < 1.3 and found[320, 400] > found[320, 500] + 1.0, "calm, and still a crown"


@pytest.mark.parametrize(("reach", "count"), [(1.0, 9), (2.0, 1), (3.0, 0)])
def test_holes_far_from_any_height(reach, count):
    heights = np.zeros((11, 11), np.float32)
    heights[3:8, 3:8] = np.nan
    assert far_from_heights(heights, reach).sum() == count


def test_without_any_height_everything_is_far():
    assert far_from_heights(np.full((3, 4), np.nan), 1e9).all()
