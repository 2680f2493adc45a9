"""GeoTIFFs that are made in parts: the same pixels, levels and figures as those written in one piece."""

import numpy as np
import pytest
import rasterio
from memory_store import TRANSFORM, MemoryStore

from orthomill.pipeline.export.exports import export
from orthomill.pipeline.export.file_parts import in_parts
from orthomill.pipeline.export.geotiff import cloud_layout
from orthomill.pipeline.export.geotiff.band_statistics import of_tags, of_tile
from orthomill.pipeline.export.geotiff.tiff_directory import BIG, TILE_OFFSETS, TILE_SIZES, directories
from orthomill.schemas.job import Export
from orthomill.schemas.raster import RasterSpec

SHAPE = (4300, 5000)
NAN = float("nan")
HEIGHTS = Export("d", "dsm", "products/dsm.tif", "cog", {"z": "d/z"})
PICTURE = Export("t", "ortho", "products/ortho.tif", "cog", {"rgba": "t/ortho"})


@pytest.fixture(scope="module")
def store():
    heights = np.add.outer(np.arange(SHAPE[0]), np.arange(SHAPE[1])).astype(np.float32) * np.float32(0.01)
    heights[4000:4200, 3900:4400] = NAN  # over the border of all four parts
    picture = np.zeros((*SHAPE, 4), np.uint8)
    picture[..., 0], picture[..., 1], picture[..., 3] = np.arange(SHAPE[1]) // 20, 77, np.where(np.isnan(heights), 0, 255)
    return MemoryStore().put("d/z", heights, 512, nodata=NAN, unit="m").put("t/ortho", picture, 512)


def joined(store, wanted, folder):
    """The file made of its parts, and how many there were."""
    store.files = folder
    exports = list(in_parts(wanted, store.specs, 1e12))
    for one in exports:
        export(one, store, folder)
    return folder / wanted.path, len(exports) - 1


def whole(store, wanted, folder):
    export(wanted, store, folder)
    return folder / wanted.path


@pytest.fixture(scope="module")
def both(store, tmp_path_factory):
    """The heights in parts and in one piece."""
    made, parts = joined(store, HEIGHTS, tmp_path_factory.mktemp("parts"))
    assert parts == 4
    return made, whole(store, HEIGHTS, tmp_path_factory.mktemp("whole"))


def test_small_files_and_other_formats_stay_one_job(store):
    small = {"d/z": RasterSpec(name="d/z", shape=(4096, 4096), dtype="float32", chunk=512)}
    assert list(in_parts(HEIGHTS, small, 1e12)) == list(in_parts(HEIGHTS, {}, 1e12)) == [HEIGHTS]
    listed = Export("d", "cells", "products/dsm.xyz", "xyz", {"z": "d/z"})
    assert list(in_parts(listed, store.specs, 1e12)) == [listed]


def test_every_level_is_that_of_the_file_in_one_piece(both, store):
    for level in (None, 0, 1, 2, 3):
        options = {} if level is None else {"overview_level": level}
        with rasterio.open(both[0], **options) as one, rasterio.open(both[1], **options) as other:
            np.testing.assert_array_equal(one.read(), other.read())
            assert one.transform == other.transform and one.shape == other.shape
    with rasterio.open(both[0]) as one:
        np.testing.assert_array_equal(one.read(1), store.arrays["d/z"])
        assert one.overviews(1) == [2, 4, 8, 16] and tuple(one.transform)[:6] == TRANSFORM and one.crs.to_epsg() == 2100


def test_statistics_are_those_of_all_parts(both):
    with rasterio.open(both[0]) as one, rasterio.open(both[1]) as other:
        values = one.read(1)
        tags, expected = one.tags(1), other.tags(1)
    assert {name: float(tags[name]) for name in expected} == pytest.approx({name: float(text) for name, text in expected.items()})
    assert float(tags["STATISTICS_STDDEV"]) == pytest.approx(np.nanstd(values.astype(float)))
    assert float(tags["STATISTICS_VALID_PERCENT"]) == pytest.approx(100 * np.isfinite(values).mean())


def test_the_layout_is_that_of_a_cog_and_every_tile_has_its_frame(both):
    content = both[0].read_bytes()
    levels = directories(both[0])
    offsets = [level[TILE_OFFSETS].numbers.astype(int) for level in levels]
    sizes = [level[TILE_SIZES].numbers.astype(int) for level in levels]
    for at, size in zip(np.concatenate(offsets), np.concatenate(sizes), strict=True):
        assert int.from_bytes(content[at - 4 : at], "little") == size
        assert content[at + size : at + size + 4] == content[at + size - 4 : at + size]
    assert all((np.diff(level) > 0).all() for level in offsets), "row by row"
    for smaller, larger in zip(offsets[1:], offsets, strict=False):
        assert smaller.max() < larger.min()
    assert sum(size.sum() + 8 * len(size) for size in sizes) == len(content) - offsets[-1].min() + 4, "nothing between"
    with rasterio.open(both[0]) as image:
        assert image.tags(ns="IMAGE_STRUCTURE")["LAYOUT"] == "COG"


def test_parts_beside_each_other_make_the_file_in_one_piece(both):
    pixels = [path.read_bytes()[directories(path)[-1][TILE_OFFSETS].numbers[0] :] for path in both]
    assert pixels[0] == pixels[1], "byte for byte, but for the last digits of statistics"


def test_a_picture_in_parts_has_its_colours_and_no_dark_rim(store, tmp_path):
    path, _ = joined(store, PICTURE, tmp_path)
    with rasterio.open(path) as image, rasterio.open(path, overview_level=0) as half:
        assert [c.name for c in image.colorinterp] == [c.name for c in half.colorinterp] == ["red", "green", "blue", "alpha"]
        np.testing.assert_array_equal(np.moveaxis(image.read(), 0, 2), store.arrays["t/ortho"])
        seen = half.read(4)
    assert set(np.unique(seen)) == {0, 255}


def test_the_bytes_do_not_depend_on_the_order_of_the_parts(both, store, tmp_path):
    store.files = tmp_path
    *parts, last = in_parts(HEIGHTS, store.specs, 1e12)
    for one in (*reversed(parts), last):
        export(one, store, tmp_path)
    assert (tmp_path / HEIGHTS.path).read_bytes() == both[0].read_bytes()


def test_files_too_large_for_32_bits_have_64(store, tmp_path, monkeypatch):
    monkeypatch.setattr(cloud_layout, "MOST", 10_000)
    path, _ = joined(store, HEIGHTS, tmp_path)
    assert path.read_bytes()[2] == BIG.version
    with rasterio.open(path) as image, rasterio.open(path, overview_level=3) as smallest:
        np.testing.assert_array_equal(image.read(1), store.arrays["d/z"])
        assert smallest.shape == (269, 313) and image.tags(ns="IMAGE_STRUCTURE")["LAYOUT"] == "COG"


def test_statistics_of_nothing_add_nothing():
    values = np.arange(12, dtype=np.float32).reshape(1, 3, 4)
    some, none = of_tile(values, np.ones(values.shape, bool)), of_tile(values, np.zeros(values.shape, bool))
    assert none.tags(12) == [{"STATISTICS_VALID_PERCENT": "0"}]
    for both_ways in (some.joined(none), none.joined(some), of_tags(some.tags(24), 24), of_tags(none.tags(12), 12).joined(some)):
        assert np.concatenate([*vars(both_ways).values()]) == pytest.approx(np.concatenate([*vars(some).values()]))
