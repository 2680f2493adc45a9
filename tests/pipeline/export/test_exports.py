import json
import os
import resource
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import laspy
import numpy as np
import pytest
import rasterio
from memory_store import TRANSFORM, MemoryStore
from pydantic import BaseModel
from pyproj import CRS

from orthomill.pipeline.export.exports import csv_text, export
from orthomill.schemas.errors import ResourceError, StoreError
from orthomill.schemas.job import Columns, Export, Table
from orthomill.schemas.raster import RasterSpec

NAN = float("nan")


def ramp(rows, cols):
    """A smooth plane with a hole."""
    heights = (100 + 0.01 * np.arange(cols)[None] + 0.02 * np.arange(rows)[:, None]).astype(np.float32)
    heights[10:30, 20:50] = np.nan
    return heights


@pytest.fixture
def store():
    rows, cols = 700, 1100
    heights = ramp(rows, cols)
    ortho = np.zeros((rows, cols, 4), np.uint8)
    ortho[..., 0], ortho[..., 1], ortho[..., 2], ortho[..., 3] = 200, 100, 50, np.where(np.isnan(heights), 0, 255)
    counts = np.where(np.isnan(heights), 0, 1 + np.arange(cols)[None] % 3).astype(np.uint8)
    made = MemoryStore().put("d/height", heights, 256, nodata=NAN, unit="m").put("d/count", counts, 256, nodata=0)
    return made.put("d/precision", heights * np.float32(0.001), 256, nodata=NAN, unit="m").put("t/ortho", ortho, 256)


def opened(store, tmp_path, fmt, rasters, name="out.tif"):
    export(Export("d", "x", f"products/{name}", fmt, rasters), store, tmp_path)
    return tmp_path / "products" / name


def assert_is_cog(path):
    """The layout the format asks for: main image first, its overviews after it, all tiled, and pixels after all directories."""
    with rasterio.open(path) as image:
        assert image.tags(ns="IMAGE_STRUCTURE")["LAYOUT"] == "COG"
        assert image.block_shapes[0] == (512, 512)
        assert image.overviews(1) == [2, 4]
        main = int(image.get_tag_item("IFD_OFFSET", "TIFF", bidx=1))
        first_block = int(image.get_tag_item("BLOCK_OFFSET_0_0", "TIFF", bidx=1))
        smaller = [int(image.get_tag_item("IFD_OFFSET", "TIFF", bidx=1, ovr=level)) for level in range(2)]
        assert main < smaller[0] < smaller[1] < first_block


def test_a_cog_of_heights_has_its_place_nodata_names_and_statistics(store, tmp_path):
    path = opened(store, tmp_path, "cog", {"height": "d/height", "precision": "d/precision"})
    assert_is_cog(path)
    with rasterio.open(path) as image:
        assert image.crs.to_epsg() == 2100
        assert tuple(image.transform)[:6] == TRANSFORM
        assert image.tags()["AREA_OR_POINT"] == "Area"
        assert np.isnan(image.nodata) and image.dtypes == ("float32", "float32")
        assert image.descriptions == ("height (m)", "precision (m)") and image.units == ("m", "m")
        np.testing.assert_array_equal(image.read(1), store.arrays["d/height"])
        np.testing.assert_array_equal(image.read(2), store.arrays["d/precision"])
        assert float(image.tags(1)["STATISTICS_MAXIMUM"]) == pytest.approx(float(np.nanmax(store.arrays["d/height"])))


def test_overviews_of_heights_are_means_that_leave_the_holes_out(store, tmp_path):
    with rasterio.open(opened(store, tmp_path, "cog", {"height": "d/height"}), overview_level=0) as image:
        smaller = image.read(1)
    blocks = store.arrays["d/height"].reshape(350, 2, 550, 2)
    full = ~np.isnan(blocks).any(axis=(1, 3))
    np.testing.assert_allclose(smaller[full], blocks.mean(axis=(1, 3))[full], atol=1e-4)


def test_an_orthoimage_has_colours_and_alpha(store, tmp_path):
    path = opened(store, tmp_path, "cog", {"ortho": "t/ortho"})
    assert_is_cog(path)
    with rasterio.open(path) as image:
        assert [c.name for c in image.colorinterp] == ["red", "green", "blue", "alpha"]
        assert image.dtypes == ("uint8",) * 4
        np.testing.assert_array_equal(np.moveaxis(image.read(), 0, 2), store.arrays["t/ortho"])


def test_bands_of_different_kind_become_float_with_nan(store, tmp_path):
    with rasterio.open(opened(store, tmp_path, "cog", {"height": "d/height", "count": "d/count"})) as image:
        assert image.dtypes == ("float32", "float32")
        count = store.arrays["d/count"].astype(float)
        np.testing.assert_array_equal(image.read(2), np.where(count == 0, np.nan, count))


def test_codes_are_never_averaged_in_overviews(store, tmp_path):
    with rasterio.open(opened(store, tmp_path, "cog", {"count": "d/count"}), overview_level=1) as image:
        assert image.dtypes == ("uint8",) and image.nodata == 0
        assert set(np.unique(image.read(1))) <= {0, 1, 2, 3}


def test_a_vertical_system_travels_with_the_file(tmp_path):
    store = MemoryStore().put("d/z", ramp(80, 90), crs="EPSG:2100+5773", nodata=NAN)
    with rasterio.open(opened(store, tmp_path, "cog", {"z": "d/z"})) as image:
        assert "EGM96 height" in image.crs.to_wkt()


@pytest.mark.parametrize(("crs", "heights"), [("EPSG:32634+4979", 3), ("EPSG:32634+5773", 3), ("EPSG:32634", 2)])
def test_heights_and_points_have_the_system_of_the_project(tmp_path, crs, heights):
    store = MemoryStore().put("d/z", ramp(80, 90), crs=crs, nodata=NAN)
    path = opened(store, tmp_path, "cog", {"z": "d/z"})
    # A file beside it, where GDAL puts what the format does not hold, is lost with the first copy.
    with rasterio.Env(GDAL_PAM_ENABLED="NO"), rasterio.open(path) as image:
        written = CRS.from_wkt(image.crs.to_wkt())
        assert image.descriptions == ("z",) and np.array_equal(image.read(1), ramp(80, 90), equal_nan=True)
    cloud = laspy.read(opened(store, tmp_path, "laz", {"z": "d/z"}, "points.laz"))
    for found in (written, cloud.header.parse_crs()):
        assert len(found.axis_info) == heights and found.equals(CRS.from_user_input(crs)), found.name
    (record,) = cloud.header.vlrs
    assert record.string.startswith("PROJCS[" if heights == 2 else "COMPD_CS["), "LAS has WKT 1"


def test_heights_above_another_ellipsoid_are_named(tmp_path):
    store = MemoryStore().put("d/z", ramp(80, 90), crs="EPSG:25832+4937", nodata=NAN)
    path = opened(store, tmp_path, "cog", {"z": "d/z"})
    with rasterio.Env(GDAL_PAM_ENABLED="NO"), rasterio.open(path) as image:
        plane, heights = CRS.from_wkt(image.crs.to_wkt()).sub_crs_list
    assert plane.to_epsg() == 25832 and heights.name == "ETRS89 ellipsoidal height"
    cloud = laspy.read(opened(store, tmp_path, "laz", {"z": "d/z"}, "points.laz"))
    assert cloud.header.parse_crs().equals(CRS.from_user_input("EPSG:25832+4937"))


@pytest.mark.parametrize("dtype", ["uint8", "uint16"])
@pytest.mark.parametrize("bands", [1, 3])
def test_a_photograph_reads_back_as_it_was(tmp_path, dtype, bands):
    pixels = np.random.default_rng(0).integers(0, np.iinfo(dtype).max, (300, 417, bands), dtype)
    store = MemoryStore().put("p/a", pixels, 128, crs=None, transform=None)
    path = opened(store, tmp_path, "tiff", {"image": "p/a"})
    with pytest.warns(rasterio.errors.NotGeoreferencedWarning), rasterio.open(path) as image:
        assert image.crs is None and image.profile["tiled"] and image.count == bands
        np.testing.assert_array_equal(np.moveaxis(image.read(), 0, 2), pixels)


def test_places_are_listed_cell_by_cell_where_there_is_a_height(store, tmp_path):
    path = opened(store, tmp_path, "xyz", {"height": "d/height"}, "heights.xyz")
    x, y, z = np.loadtxt(path).T
    heights = ramp(700, 1100)
    col, row = (x - TRANSFORM[2]) / TRANSFORM[0] - 0.5, (y - TRANSFORM[5]) / TRANSFORM[4] - 0.5
    assert len(x) == np.isfinite(heights).sum()
    assert np.allclose(z, heights[np.rint(row).astype(int), np.rint(col).astype(int)], atol=6e-4)


def test_places_need_one_raster_on_the_map(store, tmp_path):
    with pytest.raises(StoreError, match="exactly one raster on the map"):
        opened(store, tmp_path, "xyz", {"height": "d/height", "precision": "d/precision"}, "heights.xyz")


class Endless(MemoryStore):
    """A raster far larger than may be read at once; its values are made when they are asked for."""

    def __init__(self, rows, cols, chunk):
        super().__init__()
        place = {"crs": "EPSG:2100", "transform": TRANSFORM}
        self.specs = {"d/z": RasterSpec(name="d/z", shape=(rows, cols), dtype="float32", chunk=chunk, nodata=NAN, **place)}

    def read(self, name, window):
        self.largest = max(self.largest, window.height * window.width)
        return np.full(window.shape, window.row, np.float32)


@pytest.mark.parametrize(("fmt", "name"), [("cog", "z.tif"), ("tiff", "z.tif"), ("laz", "z.laz")])
def test_no_more_than_a_chunk_is_read_at_once(tmp_path, fmt, name):
    store = Endless(1500, 2100, 256)
    opened(store, tmp_path, fmt, {"z": "d/z"}, name)
    assert store.largest == (512 if fmt == "cog" else 256) ** 2, "a tile of a COG is 512 px"


def test_a_point_cloud_holds_every_finite_cell_with_colour_and_precision(store, tmp_path):
    rasters = {"z": "d/height", "rgb": "t/ortho", "sigma": "d/precision", "count": "d/count"}
    path = opened(store, tmp_path, "laz", rasters, "points.laz")
    heights = store.arrays["d/height"]
    cloud = laspy.read(path)
    assert str(cloud.header.version) == "1.4" and cloud.header.point_format.id == 7 and cloud.header.are_points_compressed
    assert cloud.header.parse_crs().to_epsg() == 2100
    assert len(cloud) == np.isfinite(heights).sum()
    cols, rows = (np.array(cloud.x) - TRANSFORM[2]) / 0.5 - 0.5, (TRANSFORM[5] - np.array(cloud.y)) / 0.5 - 0.5
    rows, cols = np.rint(rows).astype(int), np.rint(cols).astype(int)
    np.testing.assert_allclose(cloud.z, heights[rows, cols], atol=0.00051)
    np.testing.assert_array_equal(cloud["sigma"], store.arrays["d/precision"][rows, cols])
    np.testing.assert_array_equal(cloud["count"], store.arrays["d/count"][rows, cols])
    assert (cloud.red[0], cloud.green[0], cloud.blue[0]) == (200 * 257, 100 * 257, 50 * 257)


def cells(rows, cols, cell, west, north):
    return np.zeros((rows, cols), np.float32), (cell, 0.0, west, 0.0, -cell, north)


@pytest.mark.parametrize(("z_cell", "rgb_cell", "apart"), [(4.0, 1.0, 0.0), (2.0, 1.0, 0.0), (1.0, 2.0, 0.5), (1.0, 1.0, 0.0)])
def test_colours_may_lie_on_a_nested_grid(tmp_path, z_cell, rgb_cell, apart):
    """Colours that code the ground position in half metres come back at that position, whatever the two cell sizes."""
    heights, place = cells(int(96 / z_cell), int(120 / z_cell), z_cell, 1000.0, 5000.0)
    rgb = np.full((int(96 / rgb_cell), int(120 / rgb_cell), 4), 255, np.uint8)
    rgb[..., 0] = 2 * (np.arange(rgb.shape[1]) + 0.5) * rgb_cell
    rgb[..., 1] = (2 * (np.arange(rgb.shape[0]) + 0.5) * rgb_cell)[:, None]
    store = MemoryStore().put("z", heights, 64, transform=place, nodata=NAN)
    store.put("rgb", rgb, 64, transform=(rgb_cell, 0.0, 1000.0, 0.0, -rgb_cell, 5000.0))
    cloud = laspy.read(opened(store, tmp_path, "laz", {"z": "z", "rgb": "rgb"}, "p.laz"))
    np.testing.assert_allclose(np.array(cloud.red) / 257 / 2, np.array(cloud.x) - 1000, atol=apart + 1e-6)
    np.testing.assert_allclose(np.array(cloud.green) / 257 / 2, 5000 - np.array(cloud.y), atol=apart + 1e-6)


def test_transparent_pixels_do_not_darken_a_point(tmp_path):
    heights, place = cells(64, 64, 1.0, 0.0, 0.0)
    rgb = np.zeros((128, 128, 4), np.uint8)
    rgb[::2, ::2] = (240, 120, 60, 255)
    store = MemoryStore().put("z", heights, 64, transform=place, nodata=NAN)
    store.put("rgb", rgb, 64, transform=(0.5, 0.0, 0.0, 0.0, -0.5, 0.0))
    cloud = laspy.read(opened(store, tmp_path, "laz", {"z": "z", "rgb": "rgb"}, "p.laz"))
    assert set(cloud.red) == {240 * 257}


def test_colours_that_do_not_nest_are_refused(tmp_path):
    heights, place = cells(64, 64, 1.0, 0.0, 0.0)
    rgb = np.zeros((64, 64, 4), np.uint8)
    store = MemoryStore().put("z", heights, 64, transform=place)
    store.put("rgb", rgb, 64, transform=(1.0, 0.0, 0.3, 0.0, -1.0, 0.0))
    with pytest.raises(StoreError, match="shares its cell borders"):
        opened(store, tmp_path, "laz", {"z": "z", "rgb": "rgb"}, "p.laz")


def test_the_same_points_make_the_same_bytes(store, tmp_path):
    first = opened(store, tmp_path / "a", "laz", {"z": "d/height"}, "p.laz").read_bytes()
    assert first == opened(store, tmp_path / "b", "laz", {"z": "d/height"}, "p.laz").read_bytes()


class Speech(BaseModel):
    word: str
    value: float | None


@dataclass(frozen=True)
class Rows(Columns):
    name: np.ndarray
    number: np.ndarray
    x: np.ndarray
    sigma: np.ndarray


ROWS = Rows(np.array(['a, "b"', "Λάρισα"]), np.array([1, -2]), np.array([1 / 3, NAN]), np.array([0.1, 2.5e-7], np.float32))


def test_json_is_the_table_in_readable_form(tmp_path):
    table = Table("a/b.json", Speech)
    store = MemoryStore().put_table(table, Speech(word="ß", value=None))
    export(Export("a", "x", "b.json", "json", tables=(table,)), store, tmp_path)
    assert json.loads((tmp_path / "b.json").read_text()) == {"word": "ß", "value": None}
    assert (tmp_path / "b.json").read_text().startswith('{\n  "word"')


def test_csv_reads_back_to_the_same_numbers(tmp_path):
    table = Table("a/rows.parquet", Rows)
    export(Export("a", "x", "rows.csv", "csv", tables=(table,)), MemoryStore().put_table(table, ROWS), tmp_path)
    expected = 'name,number,x,sigma\n"a, ""b""",1,0.3333333333333333,0.1\nΛάρισα,-2,nan,2.5e-07\n'
    assert (tmp_path / "rows.csv").read_text() == expected
    lines = csv_text(ROWS).splitlines()
    assert float(lines[1].split(",")[-2]) == 1 / 3 and np.float32(lines[2].split(",")[-1]) == np.float32(2.5e-7)


@pytest.mark.parametrize(
    ("wanted", "says"),
    [
        (Export("d", "x", "../out.tif", "cog", {"z": "d/height"}), "is outside the run's folder"),
        (Export("d", "x", "o.dwg", "dwg", {"z": "d/height"}), "known formats are areas, bytes, cog, cog of parts, cog of sheets"),
        (Export("d", "x", "o.tif", "cog", {}), "needs at least one"),
        (Export("d", "x", "o.tif", "cog", {"z": "d/none"}), "no raster d/none"),
        (Export("d", "x", "o.tif", "cog", {"z": "d/height", "o": "d/small"}), "different grids"),
        (Export("d", "x", "o.tif", "tiff", {"z": "d/height", "o": "d/count"}), "exactly one"),
        (Export("d", "x", "o.laz", "laz", {"height": "d/height"}), 'a raster called "z"'),
        (Export("d", "x", "o.json", "json"), "exactly one table"),
    ],
)
def test_exports_that_make_no_sense_are_refused_and_leave_nothing(store, tmp_path, wanted, says):
    store.put("d/small", ramp(60, 70))
    with pytest.raises(StoreError, match=says):
        export(wanted, store, tmp_path / "run")
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]


class Broken(MemoryStore):
    def read(self, name, window):
        if window.row > 0:
            raise StoreError("a chunk is damaged")
        return super().read(name, window)


@pytest.mark.parametrize(("fmt", "name"), [("cog", "z.tif"), ("laz", "z.laz")])
def test_a_failure_half_way_keeps_the_old_file_and_no_scraps(tmp_path, fmt, name):
    store = Broken().put("z", ramp(700, 200), nodata=NAN)
    (tmp_path / name).write_text("old")
    with pytest.raises(StoreError, match="damaged"):
        export(Export("d", "x", name, fmt, {"z": "z"}), store, tmp_path)
    assert (tmp_path / name).read_text() == "old"
    assert [path.name for path in tmp_path.iterdir()] == [name]


FULL_DISK = """
import resource, sys
import numpy as np
from pathlib import Path
from memory_store import MemoryStore
from orthomill.pipeline.export.exports import export
from orthomill.schemas.errors import ResourceError
from orthomill.schemas.job import Export
noise = np.random.default_rng(0).random((900, 900), dtype=np.float32)
store = MemoryStore().put("z", noise, 256)
resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, 200_000))
try:
    export(Export("d", "x", sys.argv[2], sys.argv[3], {"z": "z"}), store, Path(sys.argv[1]))
except ResourceError as error:
    print(error)
"""


@pytest.mark.parametrize(("fmt", "name"), [("cog", "z.tif"), ("tiff", "z.tif"), ("laz", "z.laz")])
def test_a_full_disk_is_reported_and_leaves_nothing(tmp_path, fmt, name):
    """A limit on the size of files simulates a full disk: writing beyond it fails in the same place."""
    environment = os.environ | {"PYTHONPATH": f"{Path(__file__).parent}:{os.environ['PYTHONPATH']}"}
    command = [sys.executable, "-c", FULL_DISK, str(tmp_path), name, fmt]
    done = subprocess.run(command, capture_output=True, text=True, env=environment)
    assert "cannot be written" in done.stdout and "make room" in done.stdout, done.stdout + done.stderr
    assert not list(tmp_path.iterdir())


@pytest.mark.skipif(os.geteuid() == 0, reason="the superuser may write anywhere")
def test_a_read_only_folder_is_reported(store, tmp_path):
    (tmp_path / "products").mkdir(mode=0o500)
    with pytest.raises(ResourceError, match="make the folder writable"):
        opened(store, tmp_path, "cog", {"z": "d/height"})


def test_memory_stays_flat_when_the_raster_grows(tmp_path):
    opened(Endless(1024, 1024, 512), tmp_path, "cog", {"z": "d/z"}, "a.tif")
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    opened(Endless(6144, 4096, 512), tmp_path, "cog", {"z": "d/z"}, "b.tif")
    grown = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024
    assert grown < 96, f"{grown:.0f} MiB more for a raster of 96 MiB"
