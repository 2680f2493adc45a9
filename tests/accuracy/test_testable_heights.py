"""What a surface promises wherever a check point could test it."""

import numpy as np
import pytest

from orthomill.schemas.raster import MapGrid, Window, tiles_of
from orthomill.schemas.surface import Provenance
from orthomill.tasks.accuracy.points.testable_heights import LATTICE, TestablePart, promised_heights

GRID = MapGrid(west=100.0, north=220.0, cell=0.5, rows=300, cols=420)
STEP = 200
"""column at which a wall of 5 m stands, and from which the surface promises less"""


@pytest.fixture(scope="module")
def surface():
    """Heights, standard errors, codes and the datum's part; estimated below row 200."""
    col = np.broadcast_to(np.arange(GRID.cols), GRID.shape)
    code = np.full(GRID.shape, Provenance.AGREED, np.uint8)
    code[200:] = Provenance.INTERPOLATED
    sigma = np.where(col < STEP, 0.03, 0.12).astype(np.float32)
    return np.where(col < STEP, 20.0, 25.0).astype(np.float32), sigma, code, np.full(GRID.shape, 0.02, np.float32)


def found_by(surface, tile):
    parts = [TestablePart(GRID, one.window, 0.1) for one in tiles_of(GRID.shape, tile)]
    return [promised_heights(tuple(raster[part.read.slices] for raster in surface), part).sigma for part in parts]


def test_places_are_those_where_a_point_is_tested(surface):
    (sigma,) = found_by(surface, 512)
    # None below row 200, and none at the wall.
    rows, columns = np.arange(0, 196, LATTICE), np.arange(0, GRID.cols, LATTICE)
    west, east = columns[columns < STEP - 3], columns[columns > STEP + 3]
    assert np.isclose(sigma, 0.03).sum() == len(rows) * len(west)
    assert np.isclose(sigma, 0.12).sum() == len(rows) * len(east)


@pytest.mark.parametrize("tile", [64, 100, 256])
def test_they_do_not_depend_on_the_tiles(surface, tile):
    np.testing.assert_array_equal(np.sort(np.concatenate(found_by(surface, tile))), np.sort(found_by(surface, 512)[0]))


def test_a_part_without_ground_promises_nothing(surface):
    part = TestablePart(GRID, Window(220, 0, 80, 100), 0.1)
    assert not len(promised_heights(tuple(raster[part.read.slices] for raster in surface), part))
