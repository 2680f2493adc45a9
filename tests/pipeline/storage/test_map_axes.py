"""Other programs open the rasters of the store as maps: by dimension names, coordinates and reference system."""

from importlib import import_module

import numpy as np
import pytest
import xarray as xr

from orthomill.pipeline.storage.store import Store
from orthomill.schemas.raster import MapGrid, RasterSpec, map_raster

import_module("rioxarray")  # registers the accessor `rio` of xarray objects

GRID = MapGrid(west=406600.0, north=4358160.0, cell=2.0, rows=5, cols=4)
FINE = MapGrid(west=406600.0, north=4358160.0, cell=1.0, rows=10, cols=8)


def height_of(grid=GRID, name="dsm/height", **more) -> RasterSpec:
    return map_raster(name, grid, "float32", "EPSG:2100", 4, nodata=float("nan"), unit="m", **more)


@pytest.fixture
def store(tmp_path):
    store = Store(tmp_path)
    store.create(height_of())
    store.write("dsm/height", height_of().full, np.arange(20, dtype="float32").reshape(5, 4))
    store.create(map_raster("dsm/ortho", GRID, "uint8", "EPSG:2100", 4, nodata=0, bands=3))
    return store


def opened(store, group="dsm"):
    return xr.open_zarr(store.rasters, group=group, consolidated=False, decode_coords="all")


def test_a_group_opens_as_a_map_with_the_centres_of_its_cells(store):
    data = opened(store)
    assert data["height"].dims == ("y", "x") and data["ortho"].dims == ("y", "x", "band_ortho")
    assert data["x"].values.tolist() == [406601.0, 406603.0, 406605.0, 406607.0]
    assert data["y"].values.tolist() == [4358159.0, 4358157.0, 4358155.0, 4358153.0, 4358151.0]
    assert float(data["height"].sel(x=406605.0, y=4358155.0)) == 10.0


def test_the_reference_system_transform_and_unit_arrive(store):
    height = opened(store)["height"]
    assert height.rio.crs.to_epsg() == 2100
    assert tuple(height.rio.transform())[:6] == GRID.transform
    assert height.attrs["units"] == "m"


def test_a_raster_on_another_grid_has_axes_of_its_own(store):
    store.create(height_of(FINE, "dsm/fine", axes=("fine_y", "fine_x")))
    data = opened(store)
    assert data["fine"].dims == ("fine_y", "fine_x") and data["fine"].shape == (10, 8)
    assert data["fine_x"].values[0] == 406600.5


def test_pixel_rasters_of_different_sizes_open_together(tmp_path):
    store = Store(tmp_path)
    for level, side in (("0", 8), ("1", 4)):
        store.create(RasterSpec(name=f"photos/a/{level}", shape=(side, side, 3), dtype="uint8", chunk=4))
    data = opened(store, "photos/a")
    assert data["0"].dims == ("row_0", "col_0", "band_0") and data["1"].shape == (4, 4, 3)


def test_a_grid_that_has_changed_gets_new_coordinates(store):
    store.create(height_of(FINE))
    store.delete("dsm/ortho")
    assert opened(store)["height"].shape == (10, 8)
    assert opened(store)["x"].values[0] == 406600.5


def test_coordinates_are_no_rasters_of_the_store(store):
    assert store.names() == ("dsm/height", "dsm/ortho")
