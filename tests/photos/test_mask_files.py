"""Masks in files of their own: whose they are by their names, in which orientation, and what becomes of the pixels."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from orthomill.pipeline.storage.image_files import read_pixels
from orthomill.pipeline.storage.photographs.folder_listing import image_files, left_out_lines, list_folder
from orthomill.pipeline.workflow.photograph_survey import survey_folder
from orthomill.schemas.errors import PhotoError
from orthomill.schemas.photo import Header, Photo, PhotoRemarkCode
from orthomill.schemas.project import MaskFiles, PhotoFolder
from orthomill.schemas.raster import Window
from orthomill.schemas.survey_files.photograph_masks import masked_photograph
from orthomill.tasks.imagery.masked_pixels import picture_of, with_mask
from orthomill.tasks.photos.mask_files import with_masks
from orthomill.tasks.photos.pixels import upright_strip


def photo(path: str = "p/IMG_1.JPG", width: int = 60, height: int = 40, orientation: int = 1) -> Photo:
    name = Path(path).stem
    return Photo(name=name, path=path, width=width, height=height, bands=3, dtype="uint8", camera="c", exif_orientation=orientation)


def mask(path: str, width: int = 60, height: int = 40) -> Header:
    return Header(path=path, width=width, height=height, bands=1, dtype="uint8")


def image(path: Path, value: int = 200) -> None:
    path.parent.mkdir(exist_ok=True)
    Image.fromarray(np.full((40, 60), value, np.uint8)).save(path)


@pytest.mark.parametrize("name", ["IMG_1.png", "img_1_mask.PNG", "IMG_1.JPG.png", "IMG_1.jpg_mask.tif", "IMG_1-mask.jpg"])
def test_a_mask_is_found_under_each_programs_name(name):
    (found,), (remark,) = with_masks([photo()], (mask(f"masks/{name}"),))
    assert found.mask == f"masks/{name}" and found.masked and found.stored_bands == 4
    assert remark.code is PhotoRemarkCode.MASK_FILES and remark.photos == ("IMG_1",)
    assert masked_photograph("DJI_0001.JPG") == "dji_0001"


def test_masks_of_nobody_are_told_and_photographs_without_are_whole():
    (found,), (remark,) = with_masks([photo()], (mask("masks/IMG_10.png"),))
    assert found.mask is None and not found.masked
    assert remark.code is PhotoRemarkCode.IDLE_MASK and remark.photos == ("masks/IMG_10.png",)


def test_masks_of_another_size_and_two_of_one_photograph_are_refused():
    with pytest.raises(PhotoError, match=r"30 x 20 px, and its photograph p/IMG_1.JPG 60 x 40"):
        with_masks([photo()], (mask("m/IMG_1.png", 30, 20),))
    with pytest.raises(PhotoError, match="several masks"):
        with_masks([photo()], (mask("m/IMG_1.png"), mask("m/IMG_1_mask.png")))


@pytest.mark.parametrize("upright", [False, True])
def test_a_turned_photograph_has_its_mask_in_either_orientation(upright):
    turned, hidden = photo(width=40, height=60, orientation=6), np.s_[5:15, 30:50]
    (found,), _ = with_masks([turned], (mask("m/IMG_1.png", *((40, 60) if upright else (60, 40))),))
    assert found.mask_upright == upright
    in_file = np.full((40, 60, 1), 255, np.uint8)
    in_file[hidden] = 0
    shown = np.rot90(in_file, -1)
    pixels = np.full((40, 60, 3), 90, np.uint8)
    strip = upright_strip(pixels, 6, shown if upright else in_file, 1 if upright else 6)
    assert strip.shape == (60, 40, 4) and np.array_equal(picture_of(strip), shown[..., 0] == 255)


@pytest.mark.parametrize("dtype", ["uint8", "uint16"])
def test_ripples_of_jpeg_beside_black_are_black_and_the_files_own_mask_counts_too(dtype):
    pixels = np.full((1, 4, 4), np.iinfo(dtype).max, dtype)
    pixels[0, 3, 3] = 0  # transparent in the file
    found = with_mask(pixels, np.array([[0, 12, 230, 255]], np.uint8)[..., None])
    assert picture_of(found).tolist() == [[False, False, True, False]] and found.dtype == dtype


def test_masks_beside_the_photographs_are_no_photographs(tmp_path):
    for name in ("a.jpg", "b.jpg", "a_mask.png", "c_mask.jpg"):
        image(tmp_path / "photos" / name)
    folder = PhotoFolder(kind="folder", path="photos")
    assert image_files(tmp_path, folder) == ("photos/a.jpg", "photos/b.jpg", "photos/c_mask.jpg")
    assert "1 mask (a_mask.png)" in " ".join(left_out_lines(list_folder(tmp_path, folder)))
    assert image_files(tmp_path, MaskFiles(path="photos")) == ("photos/a_mask.png",)
    survey = survey_folder("photos", tmp_path)
    assert survey.source.masks == "photos" and not survey.left_out


def test_a_folder_of_masks_is_found_if_one_of_them_is_named_like_a_photograph(tmp_path):
    for name in ("photos/a.jpg", "photos/b.jpg", "masks/other.png"):
        image(tmp_path / name)
    assert survey_folder("photos", tmp_path).source.masks is None
    image(tmp_path / "masks" / "b.png")
    assert survey_folder("photos", tmp_path).source.masks == "masks"


def test_white_of_a_mask_with_one_bit_is_white(tmp_path):
    Image.fromarray(np.kron([[0, 255]], np.ones((8, 8))).astype(np.uint8)).convert("1").save(tmp_path / "m.png")
    assert np.unique(read_pixels(tmp_path / "m.png", Window(0, 0, 8, 16))).tolist() == [0, 255]
