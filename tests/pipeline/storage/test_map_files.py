"""Georeferenced files of the user arrive on the project's grid."""

import numpy as np
import pytest
import rasterio
from rasterio.transform import from_origin

from orthomill.pipeline.storage.map_files import read_map, read_map_grid
from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.job import MapFile
from orthomill.schemas.raster import MapGrid, Window


def write_ramp(path, crs="EPSG:2100"):
    cols = np.arange(60)[None, :] + np.zeros((50, 1))
    with rasterio.open(
        path,
        "w",
        driver="GTiff",
        width=60,
        height=50,
        count=1,
        dtype="float32",
        crs=crs,
        transform=from_origin(1000.0, 2000.0, 1.0, 1.0),
        nodata=-9999,
    ) as target:
        target.write(cols.astype("float32"), 1)
    return path


def test_a_ramp_keeps_its_place_on_a_finer_grid(tmp_path):
    path = write_ramp(tmp_path / "ramp.tif")
    grid = MapGrid(west=1010.0, north=1990.0, cell=0.5, rows=40, cols=40)
    values = read_map(path, MapFile("ramp.tif", "EPSG:2100", grid, Window(4, 6, 10, 12)))
    x, _ = grid.centres(Window(4, 6, 10, 12))
    assert values.shape == (10, 12) and np.allclose(values, x - 1000.5, atol=1e-4)


def test_outside_the_file_is_nan(tmp_path):
    path = write_ramp(tmp_path / "ramp.tif")
    grid = MapGrid(west=900.0, north=2100.0, cell=1.0, rows=400, cols=400)
    values = read_map(path, MapFile("ramp.tif", "EPSG:2100", grid, Window(0, 0, 50, 50)))
    assert np.isnan(values).all()


def test_the_bounds_become_a_grid(tmp_path):
    grid = read_map_grid(write_ramp(tmp_path / "ramp.tif"), "EPSG:2100")
    assert grid == MapGrid(west=1000.0, north=2000.0, cell=1.0, rows=50, cols=60)


def test_a_file_without_crs_and_no_geotiff_are_refused(tmp_path):
    with pytest.raises(WorkflowError, match="coordinate reference system"):
        read_map_grid(write_ramp(tmp_path / "bare.tif", crs=None), "EPSG:2100")
    (tmp_path / "text.tif").write_text("hello")
    with pytest.raises(WorkflowError, match="not a GeoTIFF"):
        read_map_grid(tmp_path / "text.tif", "EPSG:2100")
