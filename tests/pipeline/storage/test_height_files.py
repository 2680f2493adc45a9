"""Surfaces of users: GeoTIFF and LAZ in any system, their heights in metres, and those that cannot be read."""

from pathlib import Path

import laspy
import numpy as np
import pytest
import rasterio
from laspy.vlrs.known import WktCoordinateSystemVlr
from pyproj import CRS
from rasterio.transform import from_origin

from orthomill.pipeline.storage.height_files import check_height_file, plan_crs_of, read_height_grid, read_heights
from orthomill.pipeline.storage.height_systems import height_system, vertical_shift
from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.job import HeightFile, HeightHeader
from orthomill.schemas.raster import MapGrid, Window

GRID = MapGrid(west=500_000.0, north=4_000_100.0, cell=1.0, rows=100, cols=120)
CRS_HERE = "EPSG:32634"
PART = Window(10, 20, 40, 30)


def plane(x, y):
    return 50 + 0.02 * (x - GRID.west) - 0.03 * (y - GRID.north)


def wanted(window: Window):
    x, y = np.meshgrid(*GRID.centres(window))
    return plane(x, y)


def tiff(path: Path, crs: str | None = CRS_HERE, unit: str = "", factor: float = 1.0) -> Path:
    values = (wanted(Window(0, 0, *GRID.shape)) * factor).astype(np.float32)
    values[:5] = -9999.0 * factor * 2
    with rasterio.open(
        path, "w", "GTiff", 120, 100, 1, crs, from_origin(GRID.west, GRID.north, 1, 1), "float32", nodata=None
    ) as target:
        target.write(values, 1)
        if unit:
            target.set_band_unit(1, unit)
    return path


def laz(path: Path, crs: str | None = CRS_HERE, noise: bool = True) -> Path:
    random = np.random.default_rng(2)
    x, y = random.uniform(0, 120, 60_000) + GRID.west, GRID.north - random.uniform(0, 100, 60_000)
    header = laspy.LasHeader(version="1.4", point_format=6)
    header.scales, header.offsets = [0.001] * 3, [GRID.west, GRID.north, 0]
    if crs:
        header.vlrs.append(WktCoordinateSystemVlr(CRS.from_user_input(crs).to_wkt()))
        header.global_encoding.wkt = True
    points = laspy.ScaleAwarePointRecord.zeros(len(x), header=header)
    points.x, points.y, points.z = x, y, plane(x, y)
    if noise:
        points.z[:300] += 400.0
        points.classification[:300] = 18
    with laspy.open(path, "w", header=header, laz_backend=laspy.LazBackend.Lazrs) as target:
        target.write_points(points)
    return path


def read(path: Path, window: Window = PART, crs: str = CRS_HERE, system: str | None = None):
    return read_heights(path, HeightFile(str(path), crs, GRID, window, system))


@pytest.mark.parametrize("make", [tiff, laz])
def test_a_surface_keeps_its_place_and_its_heights(tmp_path, make):
    path = make(tmp_path / ("a.laz" if make is laz else "a.tif"))
    window = Window(10, 20, 40, 30)
    values = read(path)
    assert np.isfinite(values).all() and np.abs(values - wanted(window)).max() < 0.06
    grid = read_height_grid(path, HeightHeader(str(path), CRS_HERE))
    assert (grid.west, grid.north) == pytest.approx((GRID.west, GRID.north), abs=0.1) and plan_crs_of(path) == CRS_HERE
    check_height_file(path)


def test_values_that_are_no_heights_are_holes(tmp_path):
    assert np.isnan(read(tiff(tmp_path / "a.tif"), Window(0, 0, 4, 20))).all()


def test_pieces_of_a_point_cloud_agree(tmp_path):
    path = laz(tmp_path / "a.laz")
    whole = read(path, Window(0, 0, 60, 60))
    parts = [read(path, Window(row, 0, 30, 60)) for row in (0, 30)]
    np.testing.assert_array_equal(np.concatenate(parts), whole)


@pytest.mark.parametrize("unit", ["ft", "US survey foot"])
def test_a_band_in_feet_is_converted(tmp_path, unit):
    path = tiff(tmp_path / "a.tif", unit=unit, factor=1 / 0.3048)
    assert np.abs(read(path) - wanted(Window(10, 20, 40, 30))).max() < 0.01


def test_another_plan_system_is_transformed(tmp_path):
    path = laz(tmp_path / "a.laz")
    x, y = 24.0, 38.0  # far from the block: nothing lies there, and nothing is invented
    grid = GRID.model_copy(update={"west": 700_000.0 + x, "north": 4_200_000.0 + y})
    assert np.isnan(read_heights(path, HeightFile(str(path), CRS_HERE, grid, Window(0, 0, 20, 20)))).all()
    greek = read_height_grid(path, HeightHeader(str(path), "EPSG:2100"))
    assert greek.cols * greek.cell == pytest.approx(120, rel=0.05) and abs(greek.west - GRID.west) > 1000


def test_files_without_a_system_need_a_word(tmp_path):
    for path in (tiff(tmp_path / "a.tif", None), laz(tmp_path / "a.laz", None)):
        with pytest.raises(WorkflowError, match="no coordinate reference system"):
            read(path)
        assert np.isfinite(read(path, system=CRS_HERE)).any()


def test_what_is_no_surface_is_told(tmp_path):
    for name in ("a.laz", "a.tif"):
        path = tmp_path / name
        path.write_text("no surface")
        with pytest.raises(WorkflowError, match="can be read"):
            check_height_file(path)


def test_a_missing_geoid_grid_is_named_with_the_way_to_get_it():
    system = height_system(CRS.from_user_input("EPSG:32634+3855"))
    try:
        shift = vertical_shift(
            np.array([500_000.0]), np.array([4_000_000.0]), system, CRS.from_user_input("EPSG:32634+5773"), "a.tif"
        )
    except WorkflowError as error:
        assert "needs" in str(error) and "leave the height part out" in str(error)
    else:
        assert abs(shift[0]) < 5
