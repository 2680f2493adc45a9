"""Point clouds that are made in parts: the same points as those written in one piece."""

import laspy
import lazrs
import numpy as np
import pytest
from memory_store import TRANSFORM, MemoryStore

from orthomill.pipeline.export import file_parts
from orthomill.pipeline.export.exports import export
from orthomill.pipeline.export.file_parts import in_parts
from orthomill.schemas.job import Export

CELLS = Export("d", "cells", "products/cells.laz", "laz", {"z": "d/z", "rgb": "t/ortho", "sigma": "d/sigma"})
SHAPE = (600, 700)
FINE = (0.25, 0.0, TRANSFORM[2], 0.0, -0.25, TRANSFORM[5])


def store_of(heights):
    colours = np.zeros((2 * SHAPE[0], 2 * SHAPE[1], 4), np.uint8)
    colours[..., 0], colours[..., 1], colours[..., 3] = np.arange(2 * SHAPE[1]) // 8, 50, 255
    made = MemoryStore().put("d/z", heights, 64, nodata=np.nan).put("d/sigma", heights * np.float32(0.01), 64, nodata=np.nan)
    return made.put("t/ortho", colours, 128, transform=FINE)


@pytest.fixture
def heights(monkeypatch):
    monkeypatch.setattr(file_parts, "PART", 256)
    found = np.add.outer(np.arange(SHAPE[0]), np.arange(SHAPE[1])).astype(np.float32) * np.float32(0.05)
    found[:256, 256:512] = np.nan  # a part without a point
    return found


def joined(heights, folder):
    store = store_of(heights)
    store.files = folder
    exports = list(in_parts(CELLS, store.specs, 1e12))
    for one in exports:
        export(one, store, folder)
    assert len(exports) == 10
    return laspy.read(folder / CELLS.path)


def sorted_points(cloud):
    names = ("X", "Y", "Z", "red", "green", "blue", "sigma", "classification", "return_number", "number_of_returns")
    order = np.lexsort((cloud.X, cloud.Y))
    return np.column_stack([np.asarray(cloud[name])[order].astype(float) for name in names])


def test_the_points_are_those_of_the_file_in_one_piece(heights, tmp_path):
    found = joined(heights, tmp_path)
    export(CELLS, store_of(heights), tmp_path / "whole")
    whole = laspy.read(tmp_path / "whole" / CELLS.path)
    np.testing.assert_array_equal(sorted_points(found), sorted_points(whole))
    assert len(found) == np.isfinite(heights).sum() > 2 * 50_000, "more than a chunk in a part or none"
    for name in ("mins", "maxs", "offsets", "scales", "number_of_points_by_return"):
        np.testing.assert_array_equal(getattr(found.header, name), getattr(whole.header, name), name)
    assert found.header.parse_crs() == whole.header.parse_crs()
    assert [one.user_id for one in found.header.vlrs].count("laszip encoded") == 0, "laspy takes it out of the list"


def test_all_chunks_but_the_last_have_the_same_number_of_points(heights, tmp_path):
    joined(heights, tmp_path)
    with laspy.open(tmp_path / CELLS.path) as reader:
        packing = next(one for one in reader.header.vlrs if one.user_id == "laszip encoded").record_data_bytes()
        count, at = reader.header.point_count, reader.header.offset_to_point_data
    packer = lazrs.LazVlr(packing)
    with (tmp_path / CELLS.path).open("rb") as source:
        source.seek(at)
        chunks = lazrs.read_chunk_table(source, packer)
    assert packer.chunk_size() == 50_000 and not packer.uses_variable_size_chunks() and len(chunks) == -(-count // 50_000)


def test_points_are_found_in_the_middle(heights, tmp_path):
    """By their number, as readers do that show a part of a file; and in pieces from the beginning."""
    whole = joined(heights, tmp_path)
    with laspy.open(tmp_path / CELLS.path) as reader:
        pieces = np.concatenate([piece.array for piece in reader.chunk_iterator(9_973)])
        np.testing.assert_array_equal(pieces, whole.points.array)
        for first in (0, 49_999, 50_000, 131_072, len(whole) - 1):
            reader.seek(first)
            np.testing.assert_array_equal(reader.read_points(1).array, whole.points.array[first : first + 1])


def test_parts_of_full_chunks_alone_and_smaller_than_one(heights, tmp_path, monkeypatch):
    monkeypatch.setattr(file_parts, "PART", 250)
    heights = np.pad(np.ones((200, 250), np.float32), ((0, SHAPE[0] - 200), (0, SHAPE[1] - 250)), constant_values=np.nan)
    assert len(joined(heights, tmp_path / "full")) == 50_000
    heights[300, 300] = 2.0
    with_one = joined(heights, tmp_path / "one")
    assert len(with_one) == 50_001 and with_one.z[-1] == 2.0


def test_a_cloud_without_a_point_is_a_file(heights, tmp_path):
    assert len(joined(np.full(SHAPE, np.nan, np.float32), tmp_path)) == 0
