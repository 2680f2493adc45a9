import pytest

from orthomill.schemas.memory import MIB, array_bytes
from orthomill.schemas.raster import MapGrid, Window


@pytest.mark.parametrize("extent", [Window(5, 7, 3, 4), MapGrid(west=0.0, north=0.0, cell=1.0, rows=3, cols=4), (3, 4), 12])
def test_windows_grids_shapes_and_counts_are_counted_alike(extent):
    assert array_bytes(8, extent) == 96
    assert array_bytes(8, extent, 2, (5,)) == 960


def test_a_mebibyte_is_an_array_of_so_many_bytes():
    assert array_bytes(1, 1024, 1024) == MIB
