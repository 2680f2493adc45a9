"""Products in sheets: joined they are pixel for pixel the single file, and whoever asks for a product gets what joins them."""

from xml.etree import ElementTree

import numpy as np
import pytest
import rasterio
from memory_store import GREEK, TRANSFORM, MemoryStore
from rasterio.windows import Window as Part

from orthomill.pipeline.cli.export_kinds import Asked, export_as
from orthomill.pipeline.export import file_parts
from orthomill.pipeline.export.conversions.wanted import Wanted
from orthomill.pipeline.export.exports import export
from orthomill.pipeline.export.file_parts import in_parts
from orthomill.pipeline.export.geotiff import overviews
from orthomill.pipeline.storage.depots.folder import Folder
from orthomill.pipeline.storage.depots.product_files import (
    as_they_lie,
    in_sheets,
    joins_own_sheets,
    product_file,
    product_size,
    raster_products,
    sheet_folder,
)
from orthomill.pipeline.storage.features.outline_files import read_outlines
from orthomill.pipeline.storage.map_files import opened_map
from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.job import Export
from orthomill.schemas.stage_report import Evidence, Product, StageReport

SHAPE = (1200, 1700)
NAN = float("nan")
WHOLE = 1e12
HEIGHTS = Export("d", "dsm", "products/dsm.tif", "cog", {"z": "d/z", "sigma": "d/sigma"})
PICTURE = Export("t", "ortho", "products/ortho.tif", "cog", {"rgba": "t/ortho"})
CODES = Export("d", "codes", "products/codes.tif", "cog", {"code": "d/code"})
ALL = (HEIGHTS, PICTURE, CODES)


def store_with(chunk):
    """Nothing in the lower left, where whole sheets of 512 px are empty."""
    heights = np.add.outer(np.arange(SHAPE[0]), np.arange(SHAPE[1])).astype(np.float32) * np.float32(0.01)
    heights[400:, :1100] = NAN
    seen = np.isfinite(heights)
    picture = np.zeros((*SHAPE, 4), np.uint8)
    picture[..., 0], picture[..., 1], picture[..., 3] = np.arange(SHAPE[1]) // 20, 77, 255
    picture[~seen] = 0
    codes = np.where(seen, 3, 0).astype(np.uint8)
    sigma = np.where(seen, heights * np.float32(0.1), NAN).astype(np.float32)
    return (
        MemoryStore()
        .put("d/z", heights, chunk, nodata=NAN, unit="m", tags={"plane": "level"})
        .put("d/sigma", sigma, chunk, nodata=NAN, unit="m")
        .put("t/ortho", picture, chunk)
        .put("d/code", codes, chunk)
    )


@pytest.fixture(autouse=True)
def small_sheets(monkeypatch):
    monkeypatch.setattr(file_parts, "SHEET", 512)


def written(store, wanted, folder, above=1.0):
    """The exports that were made in a folder."""
    store.files = folder
    made = list(in_parts(wanted, store.specs, above))
    for one in made:
        export(one, store, folder)
    return made


@pytest.fixture(scope="module")
def single(tmp_path_factory):
    folder, store = tmp_path_factory.mktemp("single"), store_with(256)
    for wanted in ALL:
        export(wanted, store, folder)
    return folder


def told(path):
    """What a file says of itself, but for its layout and figures."""
    with rasterio.open(path) as file:
        tags = {name: text for name, text in file.tags().items() if not name.startswith("OVR")}
        bands = (file.descriptions, file.units, file.dtypes, [str(value) for value in file.nodatavals], file.colorinterp)
        return file.crs, file.transform, file.shape, bands, tags, file.mask_flag_enums


@pytest.mark.parametrize("chunk", [256, 512, 320])
@pytest.mark.parametrize("wanted", ALL, ids=lambda one: one.item)
def test_joined_they_are_byte_for_byte_the_pixels_of_the_single_file(wanted, chunk, single, tmp_path):
    made = written(store_with(chunk), wanted, tmp_path)
    assert len(made) == 3 * 4 + 1 and made[-1].path == wanted.path.replace(".tif", ".vrt")
    joined = tmp_path / made[-1].path
    assert not (tmp_path / wanted.path).exists()
    with rasterio.open(joined) as sheets, rasterio.open(single / wanted.path) as whole:
        assert sheets.read().tobytes() == whole.read().tobytes()
        assert sheets.dataset_mask().tobytes() == whole.dataset_mask().tobytes()
    assert told(joined) == told(single / wanted.path)


def test_a_sheet_without_content_is_no_file_and_one_of_an_earlier_run_goes(tmp_path):
    folder, store = tmp_path / "products/dsm_sheets", store_with(256)
    folder.mkdir(parents=True)
    (folder / "1-0.tif").write_bytes(b"earlier")
    made = written(store, HEIGHTS, tmp_path)
    there = {f"{row}-{col}.tif" for row in range(3) for col in range(4)} - {"1-0.tif", "1-1.tif", "2-0.tif", "2-1.tif"}
    assert {path.name for path in folder.iterdir()} == there | {"sheets.gpkg"}
    assert [bool(export(one, store, tmp_path)) for one in made[:-1]] == [one.path.rpartition("/")[2] in there for one in made[:-1]]
    outlines = {outline.name: outline.bounds for outline in read_outlines(folder / "sheets.gpkg", GREEK)}
    assert {f"{name}.tif" for name in outlines} == there
    assert outlines["0-1"] == pytest.approx((TRANSFORM[2] + 256, TRANSFORM[5] - 256, TRANSFORM[2] + 512, TRANSFORM[5]))


def test_no_pixel_is_in_two_sheets_and_none_is_missing():
    counted = np.zeros(SHAPE, int)
    for one in list(in_parts(PICTURE, store_with(256).specs, 1.0))[:-1]:
        counted[one.window.slices] += 1
        assert (one.window.row, one.window.col) == (512 * one.row, 512 * one.col)
    assert (counted == 1).all()


@pytest.mark.parametrize("wanted", ALL, ids=lambda one: one.item)
def test_a_sheet_is_a_cog_with_the_overviews_of_the_whole(wanted, single, tmp_path, monkeypatch):
    monkeypatch.setattr(file_parts, "SHEET", 1024)
    written(store_with(256), wanted, tmp_path)
    sheet = tmp_path / sheet_folder(wanted.path) / "0-1.tif"
    with rasterio.open(sheet, overview_level=0) as half, rasterio.open(single / wanted.path, overview_level=0) as whole:
        np.testing.assert_array_equal(half.read(), whole.read(window=Part(512, 0, 338, 512)))
    with rasterio.open(sheet) as file:
        assert file.tags(ns="IMAGE_STRUCTURE")["LAYOUT"] == "COG" and file.overviews(1) == [2]


def test_small_scales_are_read_from_the_overviews_of_the_sheets(tmp_path, monkeypatch):
    monkeypatch.setattr(file_parts, "SHEET", 1024)
    monkeypatch.setattr(overviews, "halved", lambda stack, values: np.full_like(values[:, ::2, ::2], 42))
    written(store_with(256), CODES, tmp_path)
    with rasterio.open(tmp_path / "products/codes.vrt") as file:
        assert set(np.unique(file.read(1, window=Part(0, 0, 1700, 1024), out_shape=(512, 850)))) == {42}
        assert 42 not in file.read(1)


def test_below_the_bound_nothing_changes(tmp_path, single):
    store = store_with(256)
    size = SHAPE[0] * SHAPE[1] * 4
    assert list(in_parts(PICTURE, store.specs, size)) == [PICTURE] and len(list(in_parts(PICTURE, store.specs, size - 1))) == 13
    assert list(in_parts(HEIGHTS, store.specs, 2 * size)) == [HEIGHTS], "both bands count"
    written(store, PICTURE, tmp_path, WHOLE)
    assert (tmp_path / PICTURE.path).read_bytes() == (single / PICTURE.path).read_bytes()
    assert [path.name for path in (tmp_path / "products").iterdir()] == ["ortho.tif"]


def test_all_that_they_name_lies_beside_them_wherever_they_are_moved(tmp_path, single):
    written(store_with(256), PICTURE, tmp_path / "a")
    (tmp_path / "a/products").rename(tmp_path / "moved")
    named = [one.text for one in ElementTree.parse(tmp_path / "moved/ortho.vrt").iter("SourceFilename")]
    assert len(named) == 4 * 8 and all(name.startswith("ortho_sheets/") for name in named)
    with rasterio.open(tmp_path / "moved/ortho.vrt") as file, rasterio.open(single / PICTURE.path) as whole:
        assert file.read().tobytes() == whole.read().tobytes()


def test_the_bytes_do_not_depend_on_the_order_of_the_sheets(tmp_path):
    store = store_with(256)
    written(store, PICTURE, tmp_path / "a")
    store.files = tmp_path / "b"
    *sheets, last = in_parts(PICTURE, store.specs, 1.0)
    for one in (*reversed(sheets), last):
        export(one, store, tmp_path / "b")
    files = [path.relative_to(tmp_path / "a") for path in (tmp_path / "a").rglob("*") if path.is_file()]
    assert len(files) == 8 + 2
    for path in files:
        assert (tmp_path / "a" / path).read_bytes() == (tmp_path / "b" / path).read_bytes(), path


def test_a_raster_of_no_system_is_joined_in_its_own_plane(tmp_path):
    store = MemoryStore().put("d/code", np.full((600, 600), 5, np.uint8), 64, crs=None)
    made = written(store, CODES, tmp_path)
    with rasterio.open(tmp_path / made[-1].path) as file:
        assert file.crs is None and tuple(file.transform)[:6] == TRANSFORM and (file.read(1) == 5).all()


def test_one_function_tells_which_file_a_product_is(tmp_path):
    written(store_with(256), PICTURE, tmp_path)
    written(store_with(256), HEIGHTS, tmp_path, WHOLE)
    assert product_file(tmp_path, "ortho") == tmp_path / "products/ortho.vrt"
    assert product_file(tmp_path, "dsm") == tmp_path / "products/dsm.tif"
    assert product_file(tmp_path, "terrain") is None and product_file(tmp_path / "none", "ortho") is None
    assert raster_products(["a.tif", "a.vrt", "b.vrt", "c.laz"]) == {"a": "a.tif", "b": "b.vrt"}, "the finished one"
    assert in_sheets(["a.tif", "b.vrt"]) == {"products/b.tif": "products/b.vrt"}
    sizes = sum(path.stat().st_size for path in (tmp_path / "products/ortho_sheets").iterdir())
    assert product_size(Folder(tmp_path), "products/ortho.vrt") == sizes + (tmp_path / "products/ortho.vrt").stat().st_size
    assert product_size(Folder(tmp_path), "products/none.vrt") is None


def test_a_report_names_products_as_they_lie():
    report = StageReport(
        products=(Product(path="products/ortho.tif", purpose="for a GIS"), Product(path="products/ortho_source.tif", purpose="")),
        warnings=("see products/ortho.tif, and products/ortho_source.tif.",),
        evidence=(Evidence(of="plan", rmse=0.1, source="", products=("products/ortho.tif",)),),
    )
    found = as_they_lie(report, ["ortho.vrt", "ortho_source.tif"])
    assert [product.path for product in found.products] == ["products/ortho.vrt", "products/ortho_source.tif"]
    assert found.warnings == ("see products/ortho.vrt, and products/ortho_source.tif.",)
    assert found.evidence[0].products == ("products/ortho.vrt",)
    assert as_they_lie(report, ["ortho.tif"]) is report


@pytest.mark.parametrize("kind", ["geotiff", "cog", "png"])
def test_an_export_of_sheets_is_that_of_the_single_file(kind, tmp_path, single):
    written(store_with(256), PICTURE, tmp_path)
    wanted = Wanted(area=(409100.0, 4356800.0, 409500.0, 4356900.0))
    one, other = (export_as(Asked(kind, "ortho", wanted, None), folder) for folder in (tmp_path, single))
    assert one.read_bytes() == other.read_bytes()
    one, other = (export_as(Asked("cog", None, Wanted(), None, "100m"), folder) for folder in (tmp_path, single))
    assert [path.name for path in sorted(one.iterdir())] == [path.name for path in sorted(other.iterdir())]


def test_sheets_are_opened_as_a_map_and_another_virtual_raster_is_not(tmp_path):
    written(store_with(256), HEIGHTS, tmp_path)
    path = tmp_path / "products/dsm.vrt"
    with opened_map(path) as file:
        assert file.count == 2
    sheet = "dsm_sheets/0-0.tif"
    for named in ("../secret.tif", "/etc/passwd", "dsm_sheets/../../a-0.tif"):
        other = tmp_path / "products/other.vrt"
        other.write_text(path.read_text().replace(sheet, named))
        assert not joins_own_sheets(other)
        path_changed = path.read_text().replace(sheet, named)
        (tmp_path / "x").mkdir(exist_ok=True)
        (tmp_path / "x/dsm.vrt").write_text(path_changed)
        assert not joins_own_sheets(tmp_path / "x/dsm.vrt")
    with pytest.raises(WorkflowError, match="not a GeoTIFF"):
        opened_map(tmp_path / "x/dsm.vrt")


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ('relativeToVRT="1"', 'relativeToVRT="0"'),
        ("SimpleSource>", "ComplexSource>"),
        ("<VRTRasterBand ", '<VRTRasterBand subClass="VRTDerivedRasterBand" '),
        ("<VRTDataset", "<!DOCTYPE x><VRTDataset"),
    ],
)
def test_a_virtual_raster_of_anything_else_is_none_of_ours(before, after, tmp_path):
    written(store_with(256), HEIGHTS, tmp_path)
    path = tmp_path / "products/dsm.vrt"
    assert joins_own_sheets(path)
    path.write_text(path.read_text().replace(before, after))
    assert not joins_own_sheets(path)


def test_a_sheet_that_is_no_geotiff_is_not_opened(tmp_path):
    written(store_with(256), HEIGHTS, tmp_path)
    (tmp_path / "products/dsm_sheets/0-0.tif").write_text("<VRTDataset/>")
    assert not joins_own_sheets(tmp_path / "products/dsm.vrt")
