"""Photographs with several kinds of defects: each is named with advice, and the rest of the block is oriented."""

import json
import shutil

import numpy as np
import pytest
from PIL import Image, ImageFilter
from small_site import SHIPPED, command_in, write_workflow

from orthomill.schemas.orientation import Block
from orthomill.schemas.photo import Photos

pytestmark = pytest.mark.slow

STRIP = ("DJI_0030", "DJI_0031", "DJI_0032", "DJI_0033")
TURNED, TAGLESS = "DJI_0033", "DJI_0032"
SIZE = (1000, 562)


def write(name, target, turned=False, tags=True):
    """A reduced photograph; turned: its pixels lie on the side, and EXIF says so; without tags EXIF says nothing."""
    with Image.open(SHIPPED / f"{name}.JPG") as image:
        small, exif = image.resize(SIZE, Image.Resampling.LANCZOS), image.getexif()
    if turned:
        small = small.transpose(Image.Transpose.ROTATE_90)
        exif[0x0112] = 6
    small.save(target, quality=92, **({"exif": exif} if tags else {}))


@pytest.fixture(scope="module")
def tables(tmp_path_factory):
    """The tables of a run over four photographs of a strip and three that are wrong; one of the strip lost its tags."""
    root = tmp_path_factory.mktemp("bad")
    photos = root / "photos"
    photos.mkdir()
    (root / "workflows").mkdir()
    for name in STRIP:
        write(name, photos / f"{name}.JPG", turned=name == TURNED, tags=name != TAGLESS)
    shutil.copy(photos / "DJI_0030.JPG", photos / "DJI_0030_copy.JPG")
    Image.open(photos / "DJI_0031.JPG").save(photos / "DJI_0031.png")
    noise = np.random.default_rng(5).integers(0, 255, (*SIZE[::-1], 3), dtype=np.uint8)
    with Image.open(SHIPPED / "DJI_0030.JPG") as image:
        Image.fromarray(noise).filter(ImageFilter.GaussianBlur(2)).save(photos / "stranger.JPG", quality=92, exif=image.getexif())
    write_workflow(root)
    command_in(root, "run", "site", "--sequential")
    return root / "runs" / "site" / "tables"


def warnings(tables, stage):
    return json.loads((tables / stage / "report.json").read_text())["warnings"]


def test_all_photographs_of_the_strip_are_oriented(tables):
    block = Block.model_validate_json((tables / "orientation" / "block.json").read_bytes())
    assert set(block.names) == set(STRIP)
    assert block.sigma0_px < 0.6


def test_a_photograph_turned_by_exif_is_upright_and_lies_in_the_strip(tables):
    photos = Photos.model_validate_json((tables / "photos" / "photos.json").read_bytes())
    assert (photos[TURNED].width, photos[TURNED].height, photos[TURNED].exif_orientation) == (*SIZE, 6)
    block = Block.model_validate_json((tables / "orientation" / "block.json").read_bytes())
    assert block.of_photo[TURNED] == block.of_photo["DJI_0030"], "upright it lies as the sensor saw it, like the others"
    height = [block.of(name).centre[2] for name in STRIP]
    assert np.ptp(height) < 6.0


def test_the_same_picture_twice_is_named(tables):
    said = [text for text in warnings(tables, "tie_points") if "are the same picture" in text]
    assert len(said) == 1 and said[0].startswith("DJI_0030 and DJI_0030_copy") and "DJI_0030_copy is left out" in said[0]
    assert not any("No other photograph" in text and "copy" in text for text in warnings(tables, "tie_points"))


def test_a_photograph_without_tags_takes_the_camera_of_the_others(tables):
    (said,) = [text for text in warnings(tables, "calibration") if "gives no focal length" in text]
    assert TAGLESS in said and "which has their size" in said
    block = Block.model_validate_json((tables / "orientation" / "block.json").read_bytes())
    assert block.of_photo[TAGLESS] == block.of_photo["DJI_0030"]


def test_a_second_file_of_one_name_is_set_aside_and_named(tables):
    (said,) = [text for text in warnings(tables, "photos") if "have the same name DJI_0031" in text]
    assert "rename it" in said


def test_a_photograph_without_overlap_is_named(tables):
    block = Block.model_validate_json((tables / "orientation" / "block.json").read_bytes())
    assert "stranger" not in block.names and any(one.photo == "stranger" for one in block.unoriented)
    assert any("stranger" in text for text in warnings(tables, "tie_points"))
