"""Products in other systems, areas, cells and formats: read back by other programs."""

import json
import sqlite3
from types import SimpleNamespace
from xml.etree import ElementTree

import numpy as np
import pytest
import rasterio
from box_scene import block
from PIL import Image
from pyproj import CRS
from rasterio.transform import from_origin

from orthomill.pipeline.cli.export_kinds import Asked, export_as
from orthomill.pipeline.export.conversions.camera_files import MappedBlock, write_camera_geopackage
from orthomill.pipeline.export.conversions.kml_file import write_kml
from orthomill.pipeline.export.conversions.relief_files import gradient, hillshade, slope
from orthomill.pipeline.export.conversions.wanted import Wanted
from orthomill.schemas.errors import StoreError, WorkflowError
from orthomill.schemas.maps.map_page import MapCamera
from orthomill.schemas.observations import ControlPoint
from orthomill.schemas.orientation import GroundResidual

WEST, NORTH, ROWS, COLS = 407000.0, 4357600.0, 600, 700


@pytest.fixture
def folder(tmp_path):
    """A run with an orthoimage of 1 m, red in the west and blue in the east, and a terrain of 1 m rising to the east by a tenth."""
    (tmp_path / "products").mkdir()
    profile = {"driver": "GTiff", "width": COLS, "height": ROWS, "crs": "EPSG:2100", "transform": from_origin(WEST, NORTH, 1, 1)}
    rgba = np.zeros((4, ROWS, COLS), np.uint8)
    rgba[0, :, :350], rgba[2, :, 350:], rgba[3] = 200, 200, 255
    with rasterio.open(tmp_path / "products/ortho.tif", "w", count=4, dtype="uint8", **profile) as target:
        target.write(rgba)
        target.colorinterp = [rasterio.enums.ColorInterp[name] for name in ("red", "green", "blue", "alpha")]
    z = np.tile(50 + 0.1 * np.arange(COLS, dtype=np.float32), (ROWS, 1))
    z[:20] = np.nan
    with rasterio.open(tmp_path / "products/terrain.tif", "w", count=1, dtype="float32", nodata=np.nan, **profile) as target:
        target.write(z, 1)
    return tmp_path


def made(folder, kind, **how):
    path, product, sheets = how.pop("path", None), how.pop("product", None), how.pop("sheets", None)
    return export_as(Asked(kind, product, Wanted(**how), path, sheets), folder)


def test_a_geotiff_in_another_system_shows_the_same_at_the_same_place(folder):
    path = made(folder, "cog", crs="EPSG:32634", cell=2.0)
    with rasterio.open(path) as found, rasterio.open(folder / "products/ortho.tif") as given:
        assert found.crs == "EPSG:32634" and found.res == (2.0, 2.0)
        assert found.tags(ns="IMAGE_STRUCTURE")["LAYOUT"] == "COG"
        assert found.transform.c % 2 == 0 and found.transform.f % 2 == 0
        for x in (WEST + 100.5, WEST + 600.5):
            (east,), (north,) = rasterio.warp.transform("EPSG:2100", "EPSG:32634", [x], [NORTH - 300.5])
            assert np.abs(next(found.sample([(east, north)])).astype(int) - next(given.sample([(x, NORTH - 300.5)]))).max() < 12


def test_an_area_is_cut_on_whole_cells(folder):
    with rasterio.open(
        made(folder, "geotiff", area=(WEST + 10.2, NORTH - 200, WEST + 110, NORTH - 100.7), product="terrain")
    ) as found:
        assert found.bounds == (WEST + 10, NORTH - 200, WEST + 110, NORTH - 100) and found.dtypes == ("float32",)
        assert found.read(1)[50, 0] == pytest.approx(51.0, abs=1e-3)


@pytest.mark.parametrize(("kind", "suffix"), [("png", ".pgw"), ("jpeg", ".jgw")])
def test_a_picture_has_its_place_beside_it(folder, kind, suffix):
    path = made(folder, kind, cell=2.0)
    with Image.open(path) as picture:
        assert picture.size == (350, 300) and picture.convert("RGB").getpixel((40, 100))[0] > 180
    lines = [float(line) for line in path.with_suffix(suffix).read_text().split()]
    assert lines == [2.0, 0.0, 0.0, -2.0, WEST + 1.0, NORTH - 1.0]
    assert "PROJCS" in path.with_suffix(".prj").read_text()
    with rasterio.open(path) as found:
        assert found.crs.to_epsg() == 2100 and found.transform[2] == WEST
    assert sorted(p.suffix for p in path.parent.iterdir()) == sorted([path.suffix, suffix, ".prj", ".xml"])


def test_slope_and_hillshade_of_a_plane_are_those_of_the_plane(folder):
    with rasterio.open(made(folder, "slope")) as found:
        values = found.read(1)
        assert values[100:500, 5:-5] == pytest.approx(np.degrees(np.arctan(0.1)), abs=1e-3) and np.isnan(values[:20]).all()
    with rasterio.open(made(folder, "hillshade")) as found:
        shade = found.read(1)
        light = (np.sin(np.pi / 4) - np.cos(np.pi / 4) * 0.1 * np.sin(np.radians(315))) / np.hypot(1, 0.1)
        assert set(np.unique(shade[100:500, 5:-5])) == {round(1 + 254 * light)} and not shade[:20].any() and found.nodata == 0


def test_slopes_face_the_way_they_rise():
    row, col = np.mgrid[:5, :5].astype(float)
    east, north = gradient(2.0 * col - 3.0 * row, 2.0)
    assert east[2, 2] == pytest.approx(1.0) and north[2, 2] == pytest.approx(1.5)
    assert slope(0 * col, 1.0)[2, 2] == 0 and hillshade(0 * col, 1.0)[2, 2] == round(1 + 254 * np.sin(np.pi / 4))


def test_tiles_of_the_web_show_the_place_on_the_globe(folder):
    path = made(folder, "mbtiles")
    base = sqlite3.connect(path)
    about = dict(base.execute("SELECT name, value FROM metadata"))
    west, south, east, north = (float(value) for value in about["bounds"].split(","))
    (lon,), (lat,) = rasterio.warp.transform("EPSG:2100", "EPSG:4326", [WEST + 350], [NORTH - 300])
    assert west < lon < east and south < lat < north and about["format"] == "webp"
    with rasterio.open(path) as found:
        assert found.crs == "EPSG:3857" and found.count >= 3
        (x,), (y,) = rasterio.warp.transform("EPSG:2100", "EPSG:3857", [WEST + 100], [NORTH - 300])
        assert next(found.sample([(x, y)]))[0] > 150
    pyramid = made(folder, "xyz")
    tiles = {tuple(p.relative_to(pyramid).with_suffix("").parts) for p in pyramid.rglob("*.webp")}
    rows = base.execute("SELECT zoom_level, tile_column, tile_row FROM tiles").fetchall()
    assert tiles == {(str(z), str(x), str(2**z - 1 - y)) for z, x, y in rows}
    assert json.loads((pyramid / "tiles.json").read_text())["maxzoom"] == max(z for z, _, _ in rows)


def test_pmtiles_are_read_by_their_own_reader(folder):
    reader = pytest.importorskip("pmtiles.reader")
    path = made(folder, "pmtiles")
    assert list(path.parent.iterdir()) == [path]
    with path.open("rb") as source:
        found = reader.Reader(reader.MmapSource(source))
        header = found.header()
        assert header["addressed_tiles_count"] > 1 and header["min_lon_e7"] < header["max_lon_e7"]
        zoom, x, y = header["min_zoom"], *_tile(header)
        data = found.get(zoom, x, y)
        assert data[:4] == b"RIFF"


def _tile(header) -> tuple[int, int]:
    n = 2 ** header["min_zoom"]
    lon, lat = header["center_lon_e7"] / 1e7, np.radians(header["center_lat_e7"] / 1e7)
    return int((lon + 180) / 360 * n), int((1 - np.arcsinh(np.tan(lat)) / np.pi) / 2 * n)


def test_photographs_are_points_and_areas(tmp_path):
    pyogrio = pytest.importorskip("pyogrio")
    name = block().names[0]
    outline = ((407000.0, 4357000.0), (407100.0, 4357000.0), (407100.0, 4357100.0))
    cameras = (MapCamera(name=name, centre=(407050.0, 4357050.0, 500.0), outline=outline, taken="2026-05-01T10:00:00"),)
    write_camera_geopackage(tmp_path / "c.gpkg", MappedBlock(block(), cameras))
    assert pyogrio.list_layers(tmp_path / "c.gpkg").tolist() == [["cameras", "Point Z"], ["footprints", "Polygon Z"]]
    write_kml(tmp_path / "c.kml", MappedBlock(SimpleNamespace(crs="EPSG:2100"), cameras))
    root = ElementTree.parse(tmp_path / "c.kml").getroot()
    places = [e.text for e in root.iter("{http://www.opengis.net/kml/2.2}coordinates")]
    assert [float(v) for v in places[0].split(",")] == pytest.approx([22.92, 39.35, 500.0], abs=0.02)
    assert len(places[1].split()) == 4 and pyogrio.read_info(tmp_path / "c.kml")["features"] == 1


def test_surveyed_points_show_what_the_block_differs_from_them(tmp_path):
    pyogrio = pytest.importorskip("pyogrio")
    point = ControlPoint(name="7", role="check", xyz=(407010.0, 4357020.0, 60.0), sigma=(0.01, 0.01, 0.02), measurements={})
    tie = point.model_copy(update={"name": "9", "role": "tie"})
    unseen = point.model_copy(update={"name": "8", "role": "control"})
    residual = GroundResidual(name="7", role="check", difference=(0.02, -0.01, 0.05), predicted=(0.02, 0.02, 0.03), photos=3)
    write_camera_geopackage(tmp_path / "c.gpkg", MappedBlock(block(), (), (point, unseen, tie), (residual,)))
    assert dict(pyogrio.list_layers(tmp_path / "c.gpkg")) == {
        "cameras": "Point Z",
        "footprints": "Polygon Z",
        "surveyed_points": "Point Z",
        "residuals": "LineString Z",
    }
    facts, _, _, columns = pyogrio.raw.read(tmp_path / "c.gpkg", layer="surveyed_points")
    rows = dict(zip(facts["fields"], columns, strict=True))
    assert rows["point"].tolist() == ["7", "8"] and rows["dz"][0] == 0.05 and np.isnan(rows["dz"][1])
    _, _, shapes, _ = pyogrio.raw.read(tmp_path / "c.gpkg", layer="residuals")
    assert np.frombuffer(shapes[0][9:], "<f8").reshape(2, 3)[1] == pytest.approx([407030.0, 4357010.0, 60.0])
    write_kml(tmp_path / "c.kml", MappedBlock(SimpleNamespace(crs="EPSG:2100"), (), (point, unseen, tie), (residual,)))
    text = (tmp_path / "c.kml").read_text()
    assert text.count("<Placemark>") == 2 and "X +0.020 m, Y -0.010 m, Z +0.050 m" in text
    assert pyogrio.read_info(tmp_path / "c.kml", layer="surveyed points")["features"] == 2


def test_a_globe_shows_no_block_that_lies_nowhere(tmp_path):
    nowhere = 'ENGCRS["site",EDATUM["site"],CS[Cartesian,2],AXIS["x",east],AXIS["y",north],LENGTHUNIT["metre",1]]'
    with pytest.raises(WorkflowError, match="this block has none"):
        write_kml(tmp_path / "c.kml", MappedBlock(SimpleNamespace(crs=nowhere), ()))


def test_a_facade_leaves_as_picture_and_as_tiff_without_a_place_on_earth(folder):
    """The orthoimage of a wall names no reference system: its own metres remain."""
    with rasterio.open(folder / "products/ortho.tif") as source:
        profile, pixels = {**source.profile, "crs": None, "photometric": "rgb", "alpha": "yes"}, source.read()
    with rasterio.open(folder / "products/ortho.tif", "w", **profile) as target:
        target.write(pixels)
    path = made(folder, "jpeg", cell=2.0)
    assert path.with_suffix(".jgw").exists() and not path.with_suffix(".prj").exists()
    with rasterio.open(made(folder, "cog", area=(WEST, NORTH - 100, WEST + 50, NORTH))) as found:
        assert found.crs is None and found.shape == (100, 50) and found.read(1)[50, 20] == 200
    assert sorted(one.name for one in made(folder, "png", sheets="300m").glob("*.png"))[0] == "406800_4356900.png"
    with pytest.raises(WorkflowError, match="has no place on a map"):
        made(folder, "cog", crs="EPSG:2100")
    with pytest.raises(WorkflowError, match="has no place on a map"):
        made(folder, "mbtiles")


def test_heights_keep_what_they_count_from_in_another_system(folder):
    with rasterio.open(folder / "products/terrain.tif", "r+") as target:
        target.crs = "EPSG:2100+5773"
    with rasterio.open(made(folder, "geotiff", product="terrain", crs="EPSG:32634+3855")) as found:
        system = CRS.from_wkt(found.crs.to_wkt())
        assert [one.to_epsg() for one in system.sub_crs_list] == [32634, 5773]
        (x,), (y,) = rasterio.warp.transform("EPSG:2100", "EPSG:32634", [WEST + 300.5], [NORTH - 300.5])
        assert next(found.sample([(x, y)]))[0] == pytest.approx(80.0, abs=0.06)


@pytest.mark.parametrize(
    ("kind", "how", "words"),
    [
        ("shapefile", {}, "is not known"),
        ("geotiff", {"crs": "EPSG:1"}, "no reference system that PROJ knows"),
        ("geotiff", {"area": (0, 0, 1, 1)}, "does not meet ortho.tif"),
        ("geotiff", {"area": (5, 0, 1, 1)}, "west and south come first"),
        ("geotiff", {"cell": 1e-4}, "pixels is asked for"),
        ("slope", {"crs": "EPSG:4326"}, "needs a system in metres"),
        ("png", {"product": "terrain"}, "is no picture"),
        ("mbtiles", {"crs": "EPSG:3857"}, "takes --of, --cutline; leave out --crs"),
        ("geotiff", {"path": "../away.tif"}, "outside the run's folder"),
    ],
)
def test_what_cannot_be_is_said_in_a_sentence(folder, kind, how, words):
    with pytest.raises(WorkflowError, match=words):
        made(folder, kind, **how)


def test_a_product_that_is_not_there_is_named_with_those_that_are(folder):
    with pytest.raises(StoreError, match=r"no product dsm; --of is one of ortho, terrain"):
        made(folder, "cog", product="dsm")
