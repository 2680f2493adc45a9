"""The folder of another program: what is handed in is written, photographs as pictures, masks beside them."""

from types import SimpleNamespace

import numpy as np
import pytest
from box_scene import block
from PIL import Image

from orthomill.pipeline.cli.export_kinds import Asked, export_as
from orthomill.pipeline.export.block_folder import BlockMethods
from orthomill.pipeline.export.conversions.wanted import Wanted
from orthomill.pipeline.storage.store import Store
from orthomill.schemas.errors import StoreError
from orthomill.schemas.job import Table
from orthomill.schemas.observations import GROUND_POINTS, IMAGE_RESIDUALS, GroundPoints, ImageResiduals
from orthomill.schemas.orientation import BLOCK, Block
from orthomill.schemas.photo import PHOTOS, Photo, Photos, photo_raster
from orthomill.schemas.raster import RasterSpec

SURVEY = Table("orientation/survey_block.json", Block), Table("orientation/survey_points.parquet", GroundPoints)
NONE = np.zeros(0, np.float32)


def run_of(folder, dtype, bands):
    """A run with one photograph of 40 x 30 px: red, and hidden in its right half where it has a mask."""
    store = Store(folder)
    photo = Photo(name="a", path="a.jpg", width=40, height=30, bands=3, dtype=dtype, camera="c")
    store.write_table(PHOTOS, Photos(photos=(photo,)))
    store.write_table(BLOCK, block())
    store.write_table(GROUND_POINTS, GroundPoints(*[NONE] * 9))
    store.write_table(IMAGE_RESIDUALS, ImageResiduals(*[NONE] * 8))
    spec = RasterSpec(name=photo_raster("a"), shape=(30, 40, bands), dtype=dtype, chunk=64)
    store.create(spec)
    pixels = np.zeros(spec.shape, dtype)
    pixels[..., 0] = np.iinfo(dtype).max
    if bands == 4:
        pixels[:, :20, 3] = np.iinfo(dtype).max
    store.write(spec.name, spec.full, pixels)
    return folder


def files(project, program, suffix, read):
    assert program == "colmap" and project[2].names == block().names
    yield "sparse/cameras.bin", b"cameras"
    yield f"images/a{suffix}", read("a")


methods = SimpleNamespace(block=lambda: BlockMethods(lambda *tables: tables, files, SURVEY))


@pytest.mark.parametrize(("dtype", "bands", "name"), [("uint8", 3, "a.jpg"), ("uint8", 4, "a.jpg"), ("uint16", 3, "a.png")])
def test_photographs_become_pictures_and_masks(tmp_path, dtype, bands, name):
    path = export_as(Asked("colmap", None, Wanted(), None), run_of(tmp_path, dtype, bands), methods)
    assert path == tmp_path / "products/exported/colmap" and (path / "sparse/cameras.bin").read_bytes() == b"cameras"
    with Image.open(path / "images" / name) as picture:
        assert (
            picture.size == (40, 30)
            and picture.convert("RGB").getpixel((5, 5))[0] > 240 > 20 > picture.convert("RGB").getpixel((5, 5))[2]
        )
    assert (path / "masks").is_dir() == (bands == 4)
    if bands == 4:
        with Image.open(path / "masks/a.jpg.png") as mask:
            assert mask.getpixel((5, 5)) == 255 and mask.getpixel((30, 5)) == 0


def test_a_second_export_replaces_the_first_one(tmp_path):
    run_of(tmp_path, "uint8", 3)
    path = export_as(Asked("colmap", None, Wanted(), None), tmp_path, methods)
    (path / "old").write_text("")
    assert not (export_as(Asked("colmap", None, Wanted(), None), tmp_path, methods) / "old").exists()


def test_before_the_orientation_there_is_nothing_to_hand_over(tmp_path):
    with pytest.raises(StoreError, match="has no oriented photographs yet"):
        export_as(Asked("colmap", None, Wanted(), None), tmp_path, methods)
    assert list((tmp_path / "products").glob("exported/*")) == []
