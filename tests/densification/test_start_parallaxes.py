"""Heights of the map in the left epipolar image of a pair, on surfaces whose parallaxes are known in closed form."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from village_pair import LEVEL_GRID, level_pair, parallax_of

from orthomill.schemas.raster import MapGrid, Window
from orthomill.tasks.densification.start_parallaxes import FACTOR, start_parallaxes
from orthomill.tasks.geometry.epipolar_window import map_window

LEFT = Window(40, 60, 32, 48)
FINE = MapGrid(west=0.0, north=0.0, cell=0.5, rows=300, cols=300)
LOW, HIGH = -30.0, 60.0


def started(heights: np.ndarray, grid: MapGrid = FINE, left: Window = LEFT) -> np.ndarray:
    pair = level_pair()
    cells = map_window(pair, left, grid, LOW, HIGH)
    return start_parallaxes(pair, heights[cells.slices].astype(np.float32), grid, cells, left).parallax


@settings(max_examples=20, deadline=None)
@given(z=st.floats(-25.0, 55.0))
def test_a_level_surface_has_one_parallax_everywhere(z):
    found = started(np.full(FINE.shape, z))
    assert found.shape == (LEFT.height // FACTOR, LEFT.width // FACTOR) and found.dtype == np.float32
    assert found == pytest.approx(parallax_of(level_pair(), z), abs=1e-3)


def test_a_slope_has_the_parallax_of_every_pixel_centre():
    pair, slope = level_pair(), 0.2
    x, _ = np.meshgrid(*FINE.centres(Window(0, 0, *FINE.shape)))
    found = started(slope * x)
    # The ray of column u meets z = slope x where H - z = depth and x = xc + u depth / c.
    u = LEFT.col + FACTOR * np.arange(found.shape[1]) + (FACTOR - 1) / 2 - pair.left_col0
    xc, _, flying = pair.left_centre
    depth = (flying - slope * xc) / (1 + slope * u / pair.c)
    assert np.nanmax(np.abs(found - pair.base * pair.c / depth)) < 0.02


def test_a_roof_hides_the_ground_behind_it_and_keeps_its_edge():
    heights = np.zeros(FINE.shape)
    pair = level_pair()
    heights[:, 100:] = 20.0
    found = started(heights)
    levels = [parallax_of(pair, 0.0), parallax_of(pair, 20.0)]
    near = np.min([np.abs(found - level) for level in levels], axis=0)
    assert np.nanmax(near) < 0.01, "a wall makes no ramp"
    high = np.abs(found - levels[1]) < 0.01
    edge = pair.left_col0 + (100 * FINE.cell - pair.left_centre[0]) / (pair.left_centre[2] - 20.0) * pair.c
    first = LEFT.col + FACTOR * high.argmax(axis=1)
    assert (np.abs(first - edge) <= FACTOR).all()


def test_cells_that_the_pixels_cannot_show_change_nothing():
    x, y = np.meshgrid(*FINE.centres(Window(0, 0, *FINE.shape)))
    heights = (6.0 + 4.0 * np.sin(x / 9.0) * np.cos(y / 7.0)).astype(np.float32)
    heights[np.hypot(x - 75.0, y + 75.0) > 100.0] = HIGH
    whole = start_parallaxes(level_pair(), heights, FINE, Window(0, 0, *FINE.shape), LEFT).parallax
    np.testing.assert_array_equal(whole, started(heights))
    assert np.isfinite(whole).all()


@pytest.mark.parametrize("cells", [1, 1000, 7000])
def test_strips_make_no_difference(monkeypatch, cells):
    x, y = np.meshgrid(*FINE.centres(Window(0, 0, *FINE.shape)))
    heights = 6.0 + 4.0 * np.sin(x / 9.0) * np.cos(y / 7.0) + 12.0 * (np.hypot(x - 60, y + 55) < 8)
    whole = started(heights)
    monkeypatch.setattr("orthomill.tasks.densification.start_parallaxes.STRIP", cells)
    np.testing.assert_array_equal(started(heights), whole)


def test_unknown_heights_stay_unknown():
    assert np.isnan(started(np.full(FINE.shape, np.nan))).all()


def test_cells_coarser_than_pixels_leave_no_gaps():
    assert np.isfinite(started(np.full(LEVEL_GRID.shape, 5.0), LEVEL_GRID)).all()


def test_the_map_window_holds_every_cell_that_the_pixels_show():
    pair, grid = level_pair(), LEVEL_GRID
    cells = map_window(pair, LEFT, grid, LOW, HIGH, margin=0)
    for z in (LOW, 10.0, HIGH):
        for u, v in ((60, 40), (107, 40), (60, 71), (107, 71), (80, 55)):
            depth = pair.left_centre[2] - z
            x = pair.left_centre[0] + (u - pair.left_col0) * depth / pair.c
            y = pair.left_centre[1] + (pair.row0 - v) * depth / pair.c
            col, row = grid.pixel(x, y)
            if 0 <= col < grid.cols and 0 <= row < grid.rows:
                assert cells.row <= row <= cells.row + cells.height - 1 and cells.col <= col <= cells.col + cells.width - 1
