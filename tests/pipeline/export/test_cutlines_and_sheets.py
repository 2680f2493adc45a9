"""Products cut by polygons and divided into sheets: what is inside, what is outside, what the sheets are called."""

import json

import numpy as np
import pytest
import rasterio
from pyproj import Transformer
from rasterio.transform import from_origin

from orthomill.pipeline.cli.export_kinds import Asked, export_as
from orthomill.pipeline.export.conversions.map_sheets import linz_sheets, metric_sheets, quarter_quads, sheets_of
from orthomill.pipeline.export.conversions.wanted import Wanted
from orthomill.pipeline.export.vectors.geopackage import well_known_binary
from orthomill.pipeline.storage.features.outline_files import read_outlines, read_wanted_area
from orthomill.schemas.errors import ResourceError, WorkflowError

WEST, NORTH = 407000.0, 4357600.0


@pytest.fixture
def folder(tmp_path):
    """A run with an orthoimage and codes of 400 x 300 m, all of it grey, and a terrain at 50 m; codes have no value for nothing."""
    (tmp_path / "products").mkdir()
    profile = {"driver": "GTiff", "width": 200, "height": 150, "crs": "EPSG:2100", "transform": from_origin(WEST, NORTH, 2, 2)}
    files = {"ortho": (4, "uint8", 200, None), "terrain": (1, "float32", 50, np.nan), "classes": (1, "uint8", 2, None)}
    for name, (count, dtype, value, nodata) in files.items():
        with rasterio.open(tmp_path / f"products/{name}.tif", "w", count=count, dtype=dtype, nodata=nodata, **profile) as target:
            target.write(np.full((count, 150, 200), value, dtype))
            if count == 4:
                target.colorinterp = [rasterio.enums.ColorInterp[one] for one in ("red", "green", "blue", "alpha")]
    return tmp_path


def square(left: float, top: float, side: float) -> list[list[float]]:
    """A closed ring, m from the upper left corner of the products."""
    x, y = WEST + left, NORTH - top
    return [[x, y], [x + side, y], [x + side, y - side], [x, y - side], [x, y]]


def cutline(path, *polygons, system="EPSG:2100"):
    crs = {"type": "name", "properties": {"name": system}}
    features = [
        {"type": "Feature", "properties": {"name": name}, "geometry": {"type": "Polygon", "coordinates": rings}}
        for name, rings in polygons
    ]
    path.write_text(json.dumps({"type": "FeatureCollection", "crs": crs, "features": features}))
    return path


def made(folder, kind, product=None, sheets=None, **how):
    return export_as(Asked(kind, product, Wanted(**how), None, sheets), folder)


@pytest.mark.parametrize(("product", "outside"), [("ortho", 0), ("terrain", np.nan), ("classes", 0)])
def test_what_lies_outside_a_cutline_or_in_its_hole_is_left_out(folder, product, outside):
    line = cutline(folder / "cut.geojson", ("field", [square(40, 40, 120), square(80, 80, 40)]))
    with rasterio.open(made(folder, "geotiff", product, cutline=line)) as found:
        assert found.bounds == (WEST + 40, NORTH - 160, WEST + 160, NORTH - 40)
        values = found.read(1)
        inside = np.ones((60, 60), bool)
        inside[20:40, 20:40] = False
        assert (values[inside] == {"ortho": 200, "terrain": 50, "classes": 2}[product]).all()
        assert np.array_equal(np.unique(values[~inside]), [outside], equal_nan=True)
        assert (found.dataset_mask() > 0).tolist() == inside.tolist()  # GDAL itself tells one from the other


def test_a_cutline_may_be_in_degrees_while_the_file_is_in_another_system(folder):
    """Compared at places: what is inside in EPSG:2100 is inside in the file of EPSG:32634."""
    to_degrees = Transformer.from_crs("EPSG:2100", "EPSG:4326", always_xy=True)
    ring = [list(to_degrees.transform(*place)) for place in square(100, 100, 100)]
    line = cutline(folder / "cut.geojson", ("field", [ring]), system="urn:ogc:def:crs:OGC:1.3:CRS84")
    with rasterio.open(made(folder, "cog", "terrain", crs="EPSG:32634", cutline=line)) as found:
        change = Transformer.from_crs("EPSG:2100", "EPSG:32634", always_xy=True)
        places = [change.transform(WEST + x, NORTH - y) for x, y in ((104, 104), (196, 196), (150, 150), (96, 150), (204, 150))]
        values = [float(value[0]) for value in found.sample(places)]
    assert values[:3] == pytest.approx([50] * 3) and np.isnan(values[3:]).all()


def test_tiles_and_relief_end_at_the_cutline(folder):
    line = cutline(folder / "cut.geojson", ("field", [square(100, 100, 100)]))
    with rasterio.open(made(folder, "mbtiles", cutline=line)) as found:
        (x,), (y,) = rasterio.warp.transform("EPSG:2100", "EPSG:3857", [WEST + 150], [NORTH - 150])
        assert next(found.sample([(x, y)]))[3] > 0
        (x,), (y,) = rasterio.warp.transform("EPSG:2100", "EPSG:3857", [WEST + 85], [NORTH - 150])
        assert next(found.sample([(x, y)]))[3] == 0
    with rasterio.open(made(folder, "slope", cutline=line)) as found:
        values = found.read(1)
        assert np.isnan(values[[0, -1]]).all() and (values[2:-2, 2:-2] == 0).all()


def test_polygons_of_a_geopackage_written_by_gdal(folder):
    pyogrio = pytest.importorskip("pyogrio")
    rings = [np.column_stack([square(left, left, 50), np.zeros(5)]) for left in (0, 100)]
    shapes = np.array([well_known_binary(ring, 1003) for ring in rings], object)
    names = np.array(["a", "b"], object)
    pyogrio.raw.write(folder / "c.gpkg", shapes, [names], ["name"], geometry_type="Polygon Z", crs="EPSG:2100")
    assert [(one.name, one.bounds[0] - WEST) for one in read_outlines(folder / "c.gpkg", "EPSG:2100")] == [("a", 0), ("b", 100)]
    area = read_wanted_area(folder / "c.gpkg", "EPSG:2100")
    assert len(area.polygons) == 2 and area.bounds[0] == WEST


def test_every_sheet_that_shows_something_is_a_file_and_stands_in_the_index(folder):
    pyogrio = pytest.importorskip("pyogrio")
    path = made(folder, "geotiff", sheets="200m")
    files = sorted(one.name for one in path.glob("*.tif"))
    assert files == sorted(f"{x}_{y}.tif" for x in (407000, 407200) for y in (4357200, 4357400))
    with rasterio.open(path / "407000_4357400.tif") as found:
        assert found.bounds == (407000, 4357400, 407200, 4357600)
    assert sorted(pyogrio.raw.read(path / "sheets.gpkg")[3][1]) == files


def test_sheets_of_the_clients_own_index_have_its_names(folder):
    index = cutline(folder / "index.geojson", ("A/1", [square(0, 0, 100)]), ("away", [square(5000, 0, 100)]))
    path = made(folder, "jpeg", sheets=str(index))
    assert sorted(one.name for one in path.iterdir()) == ["A_1.jgw", "A_1.jpg", "A_1.jpg.aux.xml", "A_1.prj", "sheets.gpkg"]


def test_sheets_have_the_names_of_their_mapping_office():
    """Bounds and names of LINZ's own tests, and Washington West, 38077-H1."""
    assert next(iter(linz_sheets(500, (1236641, 4837201, 1236642, 4837202)))).name == "CG10_500_080037"
    assert [one.name for one in linz_sheets(50_000, (1180001, 4757001, 1180002, 4757002))] == ["CK08"]
    (quad,) = quarter_quads((-77.05, 38.88, -77.01, 38.9))
    assert quad.name == "38077h1_se" and quad.area == (-77.0625, 38.875, -77.0, 38.9375)
    assert [one.name for one in metric_sheets(1000, 1000, (406900, 4357100, 407100, 4357200))] == ["406_4357", "407_4357"]
    assert {one.name[:7] for one in sheets_of("doqq", "EPSG:26918", (323000, 4305000, 326000, 4307000))} == {"38077h1"}


@pytest.mark.parametrize(
    ("how", "words"),
    [
        ({"sheets": "linz:5000"}, "give --crs EPSG:2193"),
        ({"sheets": "doqq"}, "west of Greenwich"),
        ({"sheets": "hexagons"}, "is no grid"),
        ({"sheets": "1m"}, "makes more than 10000 sheets"),
        ({"sheets": "0km"}, "none of its sheets"),
        ({"sheets": "1km", "crs": "EPSG:4326"}, "needs a system in metres"),
        ({"sheets": "nowhere.gpkg"}, "There is no file"),
    ],
)
def test_a_grid_that_cannot_be_is_told_in_a_sentence(folder, how, words):
    with pytest.raises(WorkflowError, match=words):
        made(folder, "geotiff", **how)
    assert list((folder / "products").glob("exported/*")) == []


@pytest.mark.parametrize(
    ("polygons", "words"),
    [
        ([("a", [square(9000, 0, 10)])], "The cutline does not meet ortho.tif"),
        ([], "holds no polygon"),
        ([("a", [square(0, 0, 10)[:2]])], "fewer than three corners"),
    ],
)
def test_a_cutline_that_cuts_nothing_is_told_in_a_sentence(folder, polygons, words):
    line = cutline(folder / "cut.geojson", *polygons)
    with pytest.raises(WorkflowError, match=words):
        made(folder, "geotiff", cutline=line)


def test_a_full_disk_leaves_nothing_and_is_told(folder, monkeypatch):
    def full(*_args, **_more):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("rasterio.open", full)
    with pytest.raises(ResourceError, match=r"No space left on device.*make room"):
        made(folder, "geotiff")
    assert list((folder / "products/exported").iterdir()) == []
