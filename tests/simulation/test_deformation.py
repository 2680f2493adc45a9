"""Known errors of a surface: right sizes, right signs, apart from each other, the same for every window."""

import numpy as np
import pytest

from benchmarks.deformation import Bump, Deformation, planted, shape_of
from orthomill.schemas.raster import MapGrid, Window

GRID = MapGrid(west=500.0, north=900.0, cell=2.0, rows=300, cols=400)


def places():
    random = np.random.default_rng(0)
    return np.column_stack([random.uniform(600, 1200, 4000), random.uniform(400, 800, 4000)])


def test_twenty_bumps_of_alternating_sign():
    made = planted(GRID, places(), 20.0)
    assert [b.height for b in made.bumps] == [3.0, -3.0] * 10
    xy = np.array([(b.x, b.y) for b in made.bumps])
    apart = np.hypot(*(xy[:, None] - xy[None]).transpose(2, 0, 1)) + 1e9 * np.eye(20)
    assert apart.min() > 2.5 * made.bumps[0].radius
    assert made == planted(GRID, places(), 20.0)


def test_tilt_and_bumps_add():
    made = Deformation(GRID, 5.0, (Bump(900.0, 600.0, 20.0, 3.0),))
    assert made.at(np.array(500.0), np.array(900.0)) == pytest.approx(5.0)
    assert made.at(np.array(1300.0), np.array(300.0)) == pytest.approx(-5.0)
    assert made.at(np.array(900.0), np.array(600.0)) == pytest.approx(3.0)
    assert shape_of(made.bumps[0], np.array([900.0, 910.0, 921.0]), np.full(3, 600.0)) == pytest.approx([1.0, 0.5, 0.0])


def test_a_window_sees_what_the_whole_sees():
    made = planted(GRID, places(), 20.0)
    whole = made.at(*np.meshgrid(*GRID.centres(Window(0, 0, *GRID.shape))))
    window = Window(100, 37, 50, 60)
    np.testing.assert_array_equal(made.at(*np.meshgrid(*GRID.centres(window))), whole[window.slices])
