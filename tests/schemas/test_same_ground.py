"""Windows of two rasters that lie on the same ground."""

import pytest

from orthomill.schemas.raster import MapGrid, Window, map_raster, same_ground


def raster(cell, rows, cols, west=409000.0, north=4357000.0):
    return map_raster(f"a/{cell}", MapGrid(west=west, north=north, cell=cell, rows=rows, cols=cols), "uint8", "EPSG:2100", 64)


HEIGHTS = raster(0.3, 100, 80)


@pytest.mark.parametrize(
    ("other", "expected"),
    [
        (raster(0.1, 300, 240), Window(60, 30, 90, 60)),
        (raster(0.6, 50, 40), Window(10, 5, 15, 10)),
        (raster(0.3, 100, 80, west=409003.0), Window(20, 0, 30, 20)),
        (raster(0.3, 100, 80, west=409100.0), Window(20, 0, 30, 0)),
    ],
)
def test_the_same_ground_of_a_finer_a_coarser_and_a_shifted_grid(other, expected):
    assert same_ground(Window(20, 10, 30, 20), HEIGHTS, other) == expected


def test_a_pixel_that_is_touched_counts_whole():
    assert same_ground(Window(1, 1, 1, 1), HEIGHTS, raster(0.6, 50, 40)) == Window(0, 0, 1, 1)
    assert same_ground(Window(1, 1, 2, 2), HEIGHTS, raster(0.6, 50, 40)) == Window(0, 0, 2, 2)


def test_rasters_without_a_place_have_no_common_ground():
    with pytest.raises(ValueError, match="not both on the map"):
        same_ground(Window(0, 0, 1, 1), HEIGHTS, HEIGHTS.model_copy(update={"transform": None}))
