"""Pyramids: any tiling gives the whole, and a level shows what the level below shows."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from orthomill.schemas.raster import tiles_of
from orthomill.tasks.imagery.pyramid import (
    full_to_level,
    halved,
    halved_shape,
    halved_window,
    level_count,
    level_shape,
    level_to_full,
    source_window,
)


@settings(max_examples=40, deadline=None)
@given(rows=st.integers(1, 70), cols=st.integers(1, 70), tile=st.integers(3, 40), seed=st.integers(0, 99))
def test_tiles_with_halo_give_the_whole_level(rows, cols, tile, seed):
    image = np.random.default_rng(seed).integers(0, 65536, (rows, cols, 3), dtype=np.uint16)
    whole = halved(image)
    tiled = np.zeros_like(whole)
    for cell in tiles_of(whole.shape, tile):
        tiled[cell.window.slices] = halved_window(image[source_window(cell.window, image.shape).slices], cell.window)
    assert np.array_equal(tiled, whole)


def test_a_ramp_stays_a_ramp_at_the_converted_coordinates():
    image = np.tile(np.arange(0, 200, dtype=np.uint8), (60, 1))
    level = halved(image)
    expected = level_to_full(np.arange(level.shape[1], dtype=float), 1)
    assert np.abs(level[10, 2:-2] - expected[2:-2]).max() <= 0.5
    assert full_to_level(level_to_full(np.array([3.25, 7.0]), 3), 3) == pytest.approx([3.25, 7.0])


def test_a_grid_finer_than_a_level_can_hold_is_smoothed_away():
    stripes = np.tile(np.array([0, 255], dtype=np.uint8), (40, 20))
    assert np.ptp(halved(stripes)[:, 1:-1]) == 0


def test_shapes_and_counts():
    assert halved_shape((5, 8, 3)) == (3, 4, 3)
    assert level_shape((2401, 1000, 3), 3) == (301, 125, 3)
    assert level_count((511, 300)) == 1
    assert level_count((2400, 2400)) == 4
