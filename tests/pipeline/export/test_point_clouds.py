"""Clouds in other systems and areas and as octrees, read back by laspy."""

import json
from itertools import chain

import laspy
import numpy as np
import pytest
from laspy.vlrs.known import WktCoordinateSystemVlr
from pyproj import CRS, Transformer

from orthomill.pipeline.cli.export_kinds import Asked, export_as
from orthomill.pipeline.export.clouds.point_octree import PointOctree
from orthomill.pipeline.export.conversions.wanted import Wanted
from orthomill.schemas.errors import StoreError, WorkflowError

WEST, SOUTH, SIDE, COUNT = 407000.0, 4357000.0, 200.0, 20_000


def cloud(path, seed=0, west=WEST, crs="EPSG:2100", extra=True):
    """Points of a hill with classes, colours, and standard errors as an attribute of their own."""
    random = np.random.default_rng(seed)
    x, y = west + SIDE * random.random(COUNT), SOUTH + SIDE * random.random(COUNT)
    header = laspy.LasHeader(version="1.4", point_format=7)
    header.scales, header.offsets = np.full(3, 0.001), np.array([WEST, SOUTH, 0.0])
    if extra:
        header.add_extra_dim(laspy.ExtraBytesParams("sigma", "float32"))
    header.vlrs.append(WktCoordinateSystemVlr(CRS.from_user_input(crs).to_wkt("WKT1_GDAL")))
    header.global_encoding.wkt = True
    points = laspy.LasData(header)
    points.x, points.y, points.z = x, y, 50 + 10 * np.sin((x - WEST) / 30)
    points.classification, points.red = random.integers(2, 7, COUNT), random.integers(0, 65535, COUNT)
    points.return_number, points.number_of_returns = np.ones(COUNT, np.uint8), np.ones(COUNT, np.uint8)
    if extra:
        points.sigma = random.random(COUNT)
    path.parent.mkdir(parents=True, exist_ok=True)
    points.write(path)
    return laspy.read(path)


@pytest.fixture
def folder(tmp_path):
    cloud(tmp_path / "products/points.laz")
    return tmp_path


def made(folder, kind, product=None, **how):
    return export_as(Asked(kind, product, Wanted(**how), None), folder)


def rows(points) -> np.ndarray:
    """All of what points are, in an order of their own."""
    columns = (points.x, points.y, points.z, points.classification, points.red, points.sigma)
    table = np.column_stack([np.asarray(column, np.float64) for column in columns])
    return table[np.lexsort(table.T)]


@pytest.mark.parametrize("kind", ["laz", "copc"])
def test_all_points_are_there_with_all_that_they_are(folder, kind):
    path = made(folder, kind)
    assert path.name == f"points{'.copc' if kind == 'copc' else ''}.laz"
    given, found = laspy.read(folder / "products/points.laz"), laspy.read(path)
    assert np.array_equal(rows(found), rows(given))
    assert (found.header.mins == given.header.mins).all() and (found.header.maxs == given.header.maxs).all()
    assert found.header.number_of_points_by_return[0] == COUNT and found.header.parse_crs() == CRS("EPSG:2100")
    assert list(path.parent.iterdir()) == [path]


def test_a_reader_of_copc_finds_the_points_of_a_level_and_of_a_place(folder):
    with laspy.CopcReader.open(made(folder, "copc")) as reader:
        info = reader.copc_info
        assert np.log2(info.halfsize / 0.001) % 1 == 0 and info.spacing == info.halfsize / 64
        levels = [len(reader.query(level=level)) for level in range(8)]
        assert sum(levels) == COUNT and levels[0] > 1000 and levels[1] > 1000
        coarse = reader.query(level=0)
        cell = np.floor((np.column_stack([coarse.x, coarse.y, coarse.z]) - (info.center - info.halfsize)) / info.spacing + 1e-9)
        assert len(np.unique(cell, axis=0)) == len(coarse)  # no two points of the root in one cell
        low, high = np.array([WEST + 20, SOUTH + 30]), np.array([WEST + 60, SOUTH + 50])
        found = reader.query(bounds=laspy.copc.Bounds(low, high))
    given = laspy.read(folder / "products/points.laz")
    places = np.column_stack([given.x, given.y])
    assert np.array_equal(rows(found), rows(given[((places >= low) & (places <= high)).all(axis=1)]))


def test_copc_begins_as_the_specification_says(folder):
    data = made(folder, "copc").read_bytes()
    assert data[:4] == b"LASF" and data[375 : 375 + 60][2:6] == b"copc" and data[393:395] == (1).to_bytes(2, "little")
    assert data[104] == 7 | 0x80 and int.from_bytes(data[395:397], "little") == 160
    page_at, page_size = (int.from_bytes(data[at : at + 8], "little") for at in (429 + 40, 429 + 48))
    assert page_at + page_size == len(data) and page_size % 32 == 0
    assert int.from_bytes(data[235:243], "little") == page_at - 60 and data[page_at - 58 : page_at - 54] == b"copc"


def test_entwine_tiles_hold_the_points_that_their_hierarchy_counts(folder):
    path = made(folder, "ept")
    about = json.loads((path / "ept.json").read_text())
    hierarchy = json.loads((path / "ept-hierarchy/0-0-0-0.json").read_text())
    assert about["points"] == sum(hierarchy.values()) == COUNT and about["srs"]["horizontal"] == "2100"
    side = about["bounds"][3] - about["bounds"][0]
    found = []
    for key, count in hierarchy.items():
        level, *place = map(int, key.split("-"))
        points = laspy.read(path / "ept-data" / f"{key}.laz")
        low = np.array(about["bounds"][:3]) + np.array(place) * side / 2**level
        xyz = np.column_stack([points.x, points.y, points.z])
        assert len(points) == count and (xyz >= low - 1e-6).all() and (xyz < low + side / 2**level + 1e-6).all()
        assert level == 0 or "-".join(map(str, (level - 1, *(p // 2 for p in place)))) in hierarchy
        found.append(rows(points))
    together = np.concatenate(found)
    assert np.array_equal(together[np.lexsort(together.T)], rows(laspy.read(folder / "products/points.laz")))
    names = [one["name"] for one in about["schema"]]
    assert {"X", "Classification", "ReturnNumber", "PointSourceId", "GpsTime", "Red", "sigma"} <= set(names)


def test_a_tree_that_does_not_fit_into_memory_is_the_same_above_its_cut(folder, tmp_path):
    """Divided at once, and through many files of few points: the points of the upper levels are the same."""
    given = laspy.read(folder / "products/points.laz").points.array
    trees = []
    for bucket in (10**6, 3000):
        (scratch := tmp_path / str(bucket)).mkdir()
        tree = PointOctree(iter(np.array_split(given, 7)), scratch, bucket)
        trees.append((tree.cut, {key: np.sort(records["X"]).tolist() for key, records in tree.nodes()}))
        assert list(scratch.iterdir()) == []
    (whole_cut, whole), (cut, parts) = trees
    assert whole_cut == 0 and cut >= 2 and sum(map(len, parts.values())) == COUNT
    assert sorted(chain(*parts.values())) == sorted(chain(*whole.values()))
    assert set(parts[0, 0, 0, 0]) == set(whole[0, 0, 0, 0])


def test_points_at_one_place_end_somewhere(tmp_path):
    given = np.zeros(9000, laspy.PointFormat(6).dtype())
    given["X"][:4500] = 1
    tree = PointOctree([given], tmp_path)
    nodes = dict(tree.nodes())
    assert sum(map(len, nodes.values())) == 9000 and max(key.level for key in nodes) <= tree.cube.levels


def test_points_move_to_another_system_and_keep_their_heights(folder):
    given, found = laspy.read(folder / "products/points.laz"), laspy.read(made(folder, "laz", crs="EPSG:32634"))
    x, y = Transformer.from_crs("EPSG:2100", "EPSG:32634", always_xy=True).transform(given.x, given.y)
    assert np.abs(np.asarray(found.x) - x).max() < 6e-4 and np.abs(np.asarray(found.y) - y).max() < 6e-4
    assert (np.asarray(found.Z) == np.asarray(given.Z)).all() and found.header.parse_crs() == CRS("EPSG:32634")


def test_a_cutline_with_a_hole_and_an_area_leave_what_lies_in_them(folder):
    def square(low, high):
        return [[WEST + a, SOUTH + b] for a, b in ((low, low), (high, low), (high, high), (low, high), (low, low))]

    (folder / "cut.geojson").write_text(
        json.dumps(
            {
                "type": "Feature",
                "crs": {"type": "name", "properties": {"name": "EPSG:2100"}},
                "geometry": {"type": "Polygon", "coordinates": [square(20, 120), square(50, 80)]},
            }
        )
    )
    area = (WEST + 100, SOUTH, WEST + 200, SOUTH + 200)
    given = laspy.read(folder / "products/points.laz")
    x, y = np.asarray(given.x) - WEST, np.asarray(given.y) - SOUTH
    inside = (x > 20) & (x < 120) & (y > 20) & (y < 120) & ~((x > 50) & (x < 80) & (y > 50) & (y < 80))
    assert np.array_equal(rows(laspy.read(made(folder, "laz", cutline=folder / "cut.geojson"))), rows(given[inside]))
    both = laspy.read(made(folder, "laz", cutline=folder / "cut.geojson", area=area))
    assert np.array_equal(rows(both), rows(given[inside & (x >= 100)]))


def test_the_files_of_a_large_surface_become_one(tmp_path):
    for k in (0, 1):
        cloud(tmp_path / f"products/points/0-{k}.laz", seed=k, west=WEST + k * SIDE)
    with laspy.CopcReader.open(made(tmp_path, "copc")) as reader:
        assert len(reader.query()) == 2 * COUNT


def test_every_point_is_in_one_sheet(folder):
    pyogrio = pytest.importorskip("pyogrio")
    path = export_as(Asked("laz", None, Wanted(), None, "100m"), folder)
    names = sorted(one.name for one in path.glob("*.laz"))
    assert names == sorted(f"{x}_{y}.laz" for x in (407000, 407100) for y in (4357000, 4357100))
    for name in names:
        found, (west, south) = laspy.read(path / name), map(float, name[:-4].split("_"))
        assert (np.floor((np.asarray(found.x) - west) / 100) == 0).all() and (
            np.floor((np.asarray(found.y) - south) / 100) == 0
        ).all()
    together = np.concatenate([rows(laspy.read(path / name)) for name in names])
    assert np.array_equal(together[np.lexsort(together.T)], rows(laspy.read(folder / "products/points.laz")))
    assert sorted(pyogrio.raw.read(path / "sheets.gpkg")[3][1]) == names
    with pytest.raises(WorkflowError, match="is the most; give a coarser grid"):
        export_as(Asked("laz", None, Wanted(), None, "5m"), folder)


@pytest.mark.parametrize(
    ("kind", "how", "words"),
    [
        ("laz", {"crs": "EPSG:1"}, "no reference system that PROJ knows"),
        ("laz", {"crs": "EPSG:9518"}, "points keep theirs"),
        ("copc", {"crs": "EPSG:4326"}, "needs a system in metres"),
        ("ept", {"crs": "EPSG:4326"}, "needs a system in metres"),
        ("laz", {"area": (0, 0, 1, 1)}, "No point lies"),
        ("copc", {"area": (0, 0, 1, 1)}, "No point lies"),
        ("laz", {"cell": 2.0}, "takes --of, --crs, --area, --cutline, --sheets; leave out --cell"),
    ],
)
def test_a_cloud_that_cannot_be_is_told_in_a_sentence(folder, kind, how, words):
    with pytest.raises(WorkflowError, match=words):
        made(folder, kind, **how)
    assert list((folder / "products").glob("exported/*")) == []


def test_files_of_different_kinds_are_not_mixed(tmp_path):
    for k in (0, 1):
        cloud(tmp_path / f"products/points/0-{k}.laz", extra=bool(k))
    with pytest.raises(StoreError, match="different kinds"):
        made(tmp_path, "laz")
    with pytest.raises(StoreError, match="has no product cells; --of is one of points"):
        made(tmp_path, "copc", "cells")
