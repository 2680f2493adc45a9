"""Lines as GeoPackage, DXF and GeoJSON: read back by other programs."""

import json
import sqlite3
import tracemalloc
from dataclasses import fields, replace
from types import SimpleNamespace

import numpy as np
import pytest

from orthomill.pipeline.export.exports import export
from orthomill.pipeline.export.vectors.geojson import write_geojson
from orthomill.pipeline.export.vectors.geopackage import write_geopackage
from orthomill.pipeline.export.vectors.map_drawing import write_drawing
from orthomill.pipeline.export.vectors.map_features import Feature, Layer, line_features
from orthomill.pipeline.storage.store import Store
from orthomill.schemas.bare_ground import ContourLines
from orthomill.schemas.job import Export, Table
from orthomill.schemas.maps.coded_areas import CodedAreas
from orthomill.schemas.raster import MapGrid, map_raster


def contours() -> ContourLines:
    """A ring at 10 m and a dashed line at 12.5 m."""
    x = np.array([0.0, 4.0, 4.0, 0.0, 10.0, 11.0, 12.0]) + 407000
    y = np.array([0.0, 0.0, 4.0, 0.0, 0.0, 5.0, 1.0]) + 4357000
    line, flat = np.array([0, 0, 0, 0, 1, 1, 1]), np.array([0, 0, 0, 0, 1, 1, 1], bool)
    height = np.where(flat, 12.5, 10.0)
    return ContourLines(
        line=line,
        x=x,
        y=y,
        z=height,
        layer=np.where(flat, "CONTOUR_DASHED", "CONTOUR_INDEX"),
        dashed=flat,
        text=np.where(flat, "", "10"),
        height=height,
        index=~flat,
        measured=~flat,
        sigma=np.where(flat, 0.5, 0.05),
    )


def layer() -> Layer:
    return Layer("contours", "line", tuple(line_features(contours())))


def test_a_geopackage_is_read_by_gdal(tmp_path):
    pyogrio = pytest.importorskip("pyogrio")
    path = tmp_path / "c.gpkg"
    write_geopackage(path, (layer(),), "EPSG:2100")
    info = pyogrio.read_info(path)
    assert info["crs"] == "EPSG:2100" and info["geometry_type"] == "LineString Z" and info["features"] == 2
    meta, _, geometry, columns = pyogrio.raw.read(path)
    values = dict(zip(meta["fields"], columns, strict=True))
    assert values["height"].tolist() == [10.0, 12.5] and values["measured"].tolist() == [True, False]
    coordinates = np.frombuffer(geometry[1][9:], "<f8").reshape(-1, 3)
    assert coordinates[:, 2].tolist() == [12.5] * 3 and coordinates[0, 0] == 407010.0


def test_a_geopackage_is_the_same_file_when_it_is_written_again_and_keeps_the_rules_of_sqlite(tmp_path):
    for name in ("a.gpkg", "b.gpkg"):
        write_geopackage(tmp_path / name, (layer(),), "EPSG:2100")
    assert (tmp_path / "a.gpkg").read_bytes() == (tmp_path / "b.gpkg").read_bytes()
    base = sqlite3.connect(tmp_path / "a.gpkg")
    assert base.execute("PRAGMA integrity_check").fetchone() == ("ok",)
    assert base.execute("PRAGMA foreign_key_check").fetchall() == []
    assert base.execute("PRAGMA application_id").fetchone() == (0x47504B47,)
    assert base.execute("SELECT min_x, max_y FROM gpkg_contents").fetchone() == (407000.0, 4357005.0)


def test_points_and_areas_without_a_system_are_read_as_well(tmp_path):
    pyogrio = pytest.importorskip("pyogrio")
    ring = np.array([[0, 0, 1], [2, 0, 1], [2, 2, 1], [0, 0, 1]], float)
    layers = (
        Layer("cameras", "point", (Feature(np.array([[1.0, 2.0, 3.0]]), {"name": "a", "sigma": None}),)),
        Layer("footprints", "area", (Feature(ring, {"name": "a"}),)),
    )
    write_geopackage(tmp_path / "b.gpkg", layers, None)
    assert pyogrio.list_layers(tmp_path / "b.gpkg").tolist() == [["cameras", "Point Z"], ["footprints", "Polygon Z"]]
    assert pyogrio.read_info(tmp_path / "b.gpkg", layer="footprints")["features"] == 1


def test_a_line_of_a_drawing_has_the_codes_and_values_of_each_vertex_whatever_its_layer_is_called(tmp_path):
    places = np.array([[407000.12345, -0.00001, 12.5], [407001.0, 4357000.5, 13.0]])
    write_drawing(tmp_path / "c.dxf", (Layer("lines", "line", (Feature(places, {}, layer="5 %.4f {0}"),)),))
    found = (tmp_path / "c.dxf").read_bytes().decode().split("ENTITIES\r\n")[1]
    head = [(0, "POLYLINE"), (8, "5 %.4f {0}"), (66, "1"), (70, "8"), (10, "0.0000"), (20, "0.0000"), (30, "0.0000")]
    vertices = []
    for x, y, z in places:
        vertices += [(0, "VERTEX"), (8, "5 %.4f {0}"), (70, "32"), (10, f"{x:.4f}"), (20, f"{y:.4f}"), (30, f"{z:.4f}")]
    expected = [*head, *vertices, (0, "SEQEND"), (0, "ENDSEC"), (0, "EOF")]
    assert found == "".join(f"{code:>3}\r\n{value}\r\n" for code, value in expected)


def test_a_drawing_is_read_by_another_program_with_layers_line_types_and_heights(tmp_path):
    ezdxf = pytest.importorskip("ezdxf")
    path = tmp_path / "c.dxf"
    write_drawing(path, (layer(),))
    drawing = ezdxf.readfile(path)
    ring, line = drawing.modelspace().query("POLYLINE")
    assert ring.is_closed and len(ring.vertices) == 3 and not line.is_closed and ring.is_3d_polyline
    assert line.vertices[1].dxf.location.isclose((407011, 4357005, 12.5))
    assert {one.dxf.layer for one in drawing.modelspace()} <= {one.dxf.name for one in drawing.layers}
    assert drawing.layers.get("CONTOUR_DASHED").dxf.linetype == "DASHED"
    assert drawing.layers.get("CONTOUR_INDEX").dxf.linetype.upper() == "CONTINUOUS"
    (text,) = drawing.modelspace().query("TEXT")
    assert text.dxf.text == "10" and -90 <= text.dxf.rotation <= 90
    assert not drawing.audit().errors


def test_geojson_is_in_degrees_and_on_a_plane_of_its_own_in_metres(tmp_path):
    for crs, first in (("EPSG:2100", (22.93, 39.35)), (None, (407000.0, 4357000.0))):
        with (tmp_path / "c.geojson").open("w") as target:
            write_geojson(target, (layer(),), crs)
        found = json.loads((tmp_path / "c.geojson").read_text())
        place = found["features"][0]["geometry"]["coordinates"][0]
        assert place[:2] == pytest.approx(first, abs=0.02) and place[2] == 10.0
        assert found["features"][1]["properties"] == {"height": 12.5, "index": False, "measured": False, "sigma": 0.5}


def test_areas_of_codes_are_polygons_with_holes_and_names(tmp_path):
    pyogrio = pytest.importorskip("pyogrio")
    codes = np.zeros((60, 80), np.uint16)
    codes[10:50, 10:60], codes[20:40, 20:40], codes[0, 0] = 1, 2, 2
    grid = MapGrid(west=407000.0, north=4357000.0, cell=0.5, rows=60, cols=80)
    spec = map_raster("texture/source", grid, "uint16", "EPSG:2100", 64)
    areas = CodedAreas(attributes={1: {"photograph": "a.jpg", "taken": "2026-05-01"}, 2: {"photograph": "b.jpg", "taken": ""}})
    store = SimpleNamespace(spec=lambda _: spec, read=lambda _, window: codes[window.slices], table=lambda _: areas)
    seams = Export("texture", "seams", "seams.gpkg", "areas", {"codes": "texture/source"}, (Table("a.json", CodedAreas),))
    export(seams, store, tmp_path)
    meta, _, geometry, columns = pyogrio.raw.read(tmp_path / "seams.gpkg")
    found = dict(zip(meta["fields"], columns, strict=True))
    assert found["photograph"].tolist() == ["a.jpg", "b.jpg"] and found["area_m2"].tolist() == [400.0, 100.0]
    assert meta["crs"] == "EPSG:2100" and int.from_bytes(geometry[0][5:9], "little") == 2, "an outline and a hole"


def many_lines(lines: int, vertices: int) -> ContourLines:
    count = lines * vertices
    line = np.repeat(np.arange(lines), vertices)
    x, y, flat = np.arange(count) * 0.5, np.sin(np.arange(count)) * 9.0, np.zeros(count, bool)
    drawing = {"layer": np.full(count, "CONTOUR"), "dashed": flat, "text": np.full(count, "")}
    return ContourLines(
        line=line, x=x, y=y, z=x, **drawing, height=np.full(count, 1.0), index=flat, measured=~flat, sigma=np.full(count, 0.1)
    )


def written_from(folder, kind: str, tables: dict[str, ContourLines]) -> tuple[bytes, int]:
    """A file of lines, and the most memory that it took, of tables that are made when they are read."""
    spec = map_raster("terrain/height", MapGrid(west=0.0, north=9.0, cell=1.0, rows=9, cols=9), "float32", "EPSG:2100", 9)
    made = {name: Table(name, ContourLines) for name in tables}
    store = SimpleNamespace(spec=lambda _: spec, table=lambda table: replace(tables[table.path]))
    job = Export("terrain", "lines", f"lines.{kind}", kind, {"place": spec.name}, tuple(made.values()))
    folder.mkdir()
    tracemalloc.start()
    export(job, store, folder)
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    return (folder / f"lines.{kind}").read_bytes(), most


@pytest.mark.parametrize("kind", ["gpkg", "dxf", "geojson"])
def test_lines_of_many_sheets_take_the_memory_of_one_and_are_those_of_a_single_table(tmp_path, kind):
    sheet, empty = many_lines(30, 400), many_lines(0, 1)
    # While a sheet is read the last line of the one before is still there, with all that its places lie in.
    of_two, of_many = (written_from(tmp_path / f"{n}", kind, {str(i): sheet for i in range(n)})[1] for n in (2, 12))
    assert of_many < 1.1 * of_two
    few, _ = written_from(tmp_path / "few", kind, {"0": sheet, "1": empty})
    alone, _ = written_from(tmp_path / "alone", kind, {"0": sheet})
    twice = {"0": contours(), "1": contours()}
    both = {f.name: np.concatenate([getattr(contours(), f.name)] * 2) for f in fields(ContourLines)}
    both["line"] = np.array([0, 0, 0, 0, 1, 1, 1, 2, 2, 2, 2, 3, 3, 3])
    assert few == alone
    assert written_from(tmp_path / "a", kind, twice)[0] == written_from(tmp_path / "b", kind, {"0": ContourLines(**both)})[0]


def test_lines_that_were_stored_are_written_like_new_ones(tmp_path):
    pyogrio = pytest.importorskip("pyogrio")
    store, table = Store(tmp_path), Table("terrain/contours.parquet", ContourLines)
    store.write_table(table, contours())
    stored = Layer("contours", "line", tuple(line_features(store.table(table))))
    write_geopackage(tmp_path / "a.gpkg", (stored,), "EPSG:2100")
    assert pyogrio.read_info(tmp_path / "a.gpkg")["features"] == 2
    assert [feature.text for feature in stored.features] == ["10", ""] and stored.features[1].dashed is True
