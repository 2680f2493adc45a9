"""Draped heights: what is known stays, gaps are closed smoothly, and a window with its halo gives what the whole model gives."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from orthomill.schemas.raster import MapGrid, Window
from orthomill.tasks.imagery.pull_push import filled
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

GRID = MapGrid(west=0.0, north=0.0, cell=0.5, rows=150, cols=171)


def plane(grid: MapGrid = GRID) -> np.ndarray:
    row, col = np.indices(grid.shape)
    return (0.25 * col - 0.125 * row + 40).astype(np.float32)


def draped(heights: np.ndarray, window: Window) -> np.ndarray:
    """The cells `window`, from the whole model's ground and these cells alone."""
    ground, blocks = filled(block_heights(heights)), ground_window(GRID, window)
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
    whole, tile = block_heights(heights), Window(64, 128, 64, 43)
    np.testing.assert_array_equal(whole[blocks_of(tile).slices], block_heights(heights[tile.slices]))
    assert whole.shape == block_grid(GRID).shape and block_grid(GRID).cell == BLOCK * GRID.cell


@pytest.mark.parametrize(("reach", "count"), [(1.0, 9), (2.0, 1), (3.0, 0)])
def test_holes_far_from_any_height(reach, count):
    heights = np.zeros((11, 11), np.float32)
    heights[3:8, 3:8] = np.nan
    assert far_from_heights(heights, reach).sum() == count


def test_without_any_height_everything_is_far():
    assert far_from_heights(np.full((3, 4), np.nan), 1e9).all()
