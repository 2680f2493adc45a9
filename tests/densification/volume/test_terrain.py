"""The terrain from tie points: medians around places, gaps closed, interpolated at the cells of any level."""

import numpy as np
from textured_box import scene_block

from orthomill.schemas.observations import GroundPoints
from orthomill.schemas.raster import MapGrid, Window
from orthomill.tasks.densification.volume.terrain import SPACING, at_cells, places_around, terrain, terrain_grid

GRID = terrain_grid(MapGrid(west=0.0, north=320.0, cell=1.0, rows=310, cols=200))


def tie_points(x, y, z) -> GroundPoints:
    n = len(x)
    errors = np.zeros(n, np.float32)
    place = (np.asarray(values, float) for values in (x, y, z))
    return GroundPoints(np.arange(n), *place, errors, errors, errors, np.full(n, 2, np.int16), errors)


def test_places_lie_on_the_corners_all_around():
    assert (GRID.rows, GRID.cols, GRID.cell) == (11, 8, SPACING)
    x, y = GRID.centres(Window(0, 0, *GRID.shape))
    assert x[0] == 0 and y[0] == 320 and x[-1] >= 200 and y[-1] <= 10


def test_a_place_has_the_median_height_of_its_points():
    block = scene_block()
    heights = terrain(tie_points([5, 6, 7, 100], [310, 311, 312, 100], [3, 900, 4, 20]), block, GRID)
    assert heights[0, 0] == 4 and heights[7, 3] == 20
    assert heights.min() >= 4 and heights.max() <= 20


def test_points_elsewhere_and_points_without_a_height_do_not_count():
    points = tie_points([-500, 10, 40], [100, 10, 200], [1e6, np.nan, 7])
    assert (terrain(points, scene_block(), GRID) == 7).all()


def test_without_tie_points_the_terrain_is_the_mean_of_the_block():
    block = scene_block()
    assert (terrain(tie_points([], [], []), block, GRID) == np.float32(block.ground_mean)).all()


def test_a_plane_is_a_plane_at_the_cells_of_every_level():
    rows, cols = np.indices(GRID.shape)
    plane = (2.0 * rows * SPACING - cols * SPACING).astype(np.float32)
    for factor in (1, 4, 64):
        window = Window(0, 64 // factor, 128 // factor, 64 // factor)
        places = places_around(window, factor, GRID.shape)
        found = at_cells(plane[places.slices], places, window, factor)
        row, col = ((first + np.arange(n) + 0.5) * factor for first, n in ((window.row, window.height), (window.col, window.width)))
        np.testing.assert_allclose(found, 2.0 * row[:, None] - col[None, :], rtol=1e-5)
