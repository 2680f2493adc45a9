"""Polygons that a client has drawn: which cells lie inside, whatever the tile."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from orthomill.schemas.maps.wanted_area import WantedArea
from orthomill.schemas.project import MapSurface, PlaneSurface
from orthomill.schemas.raster import MapGrid, Window, tiles_of

GRID = MapGrid(west=0.0, north=30.0, cell=1.0, rows=30, cols=40)
ALL = Window(0, 0, *GRID.shape)
ELL = ((2.0, 2.0), (20.0, 2.0), (20.0, 10.0), (8.0, 10.0), (8.0, 25.0), (2.0, 25.0))
FAR = ((30.0, 20.0), (38.0, 20.0), (38.0, 28.0))


def test_cells_of_a_bent_area_and_of_two_areas():
    inside = WantedArea(polygons=((ELL,),)).cells(GRID, ALL)
    expected = np.zeros(GRID.shape, bool)
    expected[20:28, 2:20] = expected[5:28, 2:8] = True
    assert np.array_equal(inside, expected)
    both = WantedArea(polygons=((ELL,), (FAR,)))
    assert both.bounds == (2.0, 2.0, 38.0, 28.0)
    # A triangle of 32 m2 has the centres of 32 cells within those of its diagonal.
    assert abs((both.cells(GRID, ALL) & ~expected).sum() - 32) <= 4
    assert WantedArea().cells(GRID, ALL).all(), "nothing was drawn: everywhere"
    hole = ((3.0, 3.0), (7.0, 3.0), (7.0, 9.0), (3.0, 9.0), (3.0, 3.0))
    assert expected.sum() - WantedArea(polygons=((ELL, hole),)).cells(GRID, ALL).sum() == 24


@given(
    corners=st.lists(st.tuples(st.integers(-5, 45), st.integers(-5, 35)), min_size=3, max_size=7, unique=True),
    tile=st.integers(3, 17),
)
def test_tiles_say_what_the_whole_says_and_a_turned_ring_the_same(corners, tile):
    ring = tuple((float(x), float(y)) for x, y in corners)
    whole, out = WantedArea(polygons=((ring,),)).cells(GRID, ALL), np.zeros(GRID.shape, bool)
    for one in tiles_of(GRID.shape, tile):
        out[one.window.slices] = WantedArea(polygons=((ring,),)).cells(GRID, one.window)
    assert np.array_equal(out, whole)
    assert np.array_equal(WantedArea(polygons=((ring[::-1],),)).cells(GRID, ALL), whole)
    assert np.array_equal(WantedArea(polygons=((ring[1:] + ring[:1],),)).cells(GRID, ALL), whole)


def test_an_area_is_two_corners_a_file_or_all():
    assert MapSurface(area=(0, 0, 5, 5)).area_file is None and MapSurface().area_file is None
    assert MapSurface(area="maps/sheet.gpkg").area_file == "maps/sheet.gpkg" and PlaneSurface(kind="plane").area_file is None
    for wrong, says in (((5, 0, 0, 5), "no inside"), ("sheet.tif", "no file of polygons")):
        with pytest.raises(ValidationError, match=says):
            MapSurface(area=wrong)
