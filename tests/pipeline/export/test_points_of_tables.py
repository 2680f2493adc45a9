"""Point clouds made from the rows of tables, and the classes and sources of points."""

from dataclasses import dataclass, replace

import laspy
import numpy as np
import pytest
from memory_store import TRANSFORM, MemoryStore

from orthomill.pipeline.export.exports import export
from orthomill.schemas.errors import StoreError
from orthomill.schemas.job import Columns, Export, Table

NAN = float("nan")
CELL, WEST, NORTH = TRANSFORM[0], TRANSFORM[2], TRANSFORM[5]


@dataclass(frozen=True)
class Marks(Columns):
    x: np.ndarray
    y: np.ndarray
    z: np.ndarray
    sigma: np.ndarray
    rays: np.ndarray
    code: np.ndarray
    source: np.ndarray


def marks(row: float, count: int = 40) -> Marks:
    """Points along a row of pixels, at hundredths of a metre."""
    col = np.round(np.linspace(1.0, 98.0, count), 2)
    x, y = WEST + CELL * col, np.full(count, NORTH - CELL * row)
    z = np.round(50 + np.sin(col), 2)
    codes = (np.arange(count) % 3 + 1).astype(np.uint8)
    return Marks(x, y, z, (0.01 * codes).astype(np.float32), codes + np.uint8(1), codes, np.uint16(1000) * codes)


ROW, COL = np.indices((90, 100))
COLOURS = np.stack([COL, ROW, 0 * ROW + 7, np.where(ROW < 80, 255, 0)], axis=-1).astype(np.uint8)
"""Red is the column and green the row of a pixel; the last rows are transparent."""
TABLES = (Table("p/0.parquet", Marks), Table("p/1.parquet", Marks), Table("p/2.parquet", Marks))
PARTS = (marks(3.5), marks(0, 0), marks(70.25, 11))


def written(tmp_path, parts=PARTS, colours=COLOURS, **rasters):
    store = MemoryStore().put("t/ortho", colours, 64)
    tables = TABLES[: len(parts)]
    for table, part in zip(tables, parts, strict=True):
        store.put_table(table, part)
    export(Export("t", "points", "points.laz", "laz", {"rgb": "t/ortho", **rasters}, tables), store, tmp_path)
    return tmp_path / "points.laz"


def test_colours_of_sixteen_bits_are_those_of_the_points(tmp_path):
    coarse, fine = laspy.read(written(tmp_path)), laspy.read(written(tmp_path, colours=COLOURS.astype(np.uint16) * 257))
    assert (fine.red == coarse.red).all() and (fine.green == coarse.green).all() and fine.red.max() > 255


def test_every_row_of_every_table_is_a_point_at_its_own_place(tmp_path):
    cloud = laspy.read(written(tmp_path))
    for label in ("x", "y", "z"):
        expected = np.concatenate([getattr(part, label) for part in PARTS])
        np.testing.assert_allclose(np.array(cloud[label]), expected, atol=0.00051)
    assert len(cloud) == 51 and cloud.header.parse_crs().to_epsg() == 2100


def test_attributes_class_and_source_of_points(tmp_path):
    cloud = laspy.read(written(tmp_path))
    codes = np.concatenate([part.code for part in PARTS])
    np.testing.assert_array_equal(cloud.classification, 64 + codes)
    np.testing.assert_array_equal(cloud.point_source_id, 1000 * codes.astype(int))
    np.testing.assert_array_equal(cloud["rays"], codes + 1)
    np.testing.assert_allclose(cloud["sigma"], 0.01 * codes, rtol=1e-6)
    assert list(cloud.point_format.extra_dimension_names) == ["sigma", "rays"]


def test_a_point_has_the_colour_of_the_pixel_that_contains_it(tmp_path):
    cloud = laspy.read(written(tmp_path))
    np.testing.assert_array_equal(np.array(cloud.red) // 257, np.floor((np.array(cloud.x) - WEST) / CELL))
    np.testing.assert_array_equal(np.array(cloud.green) // 257, np.floor((NORTH - np.array(cloud.y)) / CELL))


def test_a_point_without_colour_is_black(tmp_path):
    outside = marks(5.0, 3)
    outside = replace(outside, x=outside.x + np.array([0.0, 1e3, 0.0]), y=outside.y - np.array([0.0, 0.0, CELL * 80]))
    cloud = laspy.read(written(tmp_path, (outside,)))
    assert cloud.blue.tolist() == [7 * 257, 0, 0]


def test_the_same_tables_make_the_same_bytes(tmp_path):
    assert written(tmp_path / "a").read_bytes() == written(tmp_path / "b").read_bytes()


def test_cells_have_classes_as_well(tmp_path):
    heights = np.ones((70, 80), np.float32)
    codes = (np.arange(80)[None] % 7).astype(np.uint8).repeat(70, axis=0)
    store = MemoryStore().put("z", heights, 64, nodata=NAN).put("code", codes, 64)
    export(Export("d", "cells", "cells.laz", "laz", {"z": "z", "code": "code"}), store, tmp_path)
    cloud = laspy.read(tmp_path / "cells.laz")
    cols = np.floor((np.array(cloud.x) - WEST) / CELL).astype(int)
    np.testing.assert_array_equal(cloud.classification, 64 + codes[0, cols])


def test_a_code_that_has_no_class_is_refused(tmp_path):
    with pytest.raises(StoreError, match="must be between 0 and 191"):
        written(tmp_path, (replace(marks(1.0), code=np.full(40, 192, np.uint8)),))
    assert not (tmp_path / "points.laz").exists()


def test_rows_without_a_reference_system_are_refused(tmp_path):
    store = MemoryStore().put_table(TABLES[0], PARTS[0])
    with pytest.raises(StoreError, match='needs a raster called "rgb"'):
        export(Export("t", "points", "points.laz", "laz", tables=TABLES[:1]), store, tmp_path)


@dataclass(frozen=True)
class Flat(Columns):
    x: np.ndarray
    y: np.ndarray


def test_rows_without_a_height_are_refused(tmp_path):
    table = Table("p/flat.parquet", Flat)
    store = MemoryStore().put("t/ortho", COLOURS, 64).put_table(table, Flat(np.zeros(2), np.zeros(2)))
    with pytest.raises(StoreError, match="it has no column z"):
        export(Export("t", "points", "points.laz", "laz", {"rgb": "t/ortho"}, (table,)), store, tmp_path)
