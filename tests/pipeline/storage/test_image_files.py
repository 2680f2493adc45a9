"""Image files as users have them: read as stored, or refused by name in one sentence."""

import os
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
import rasterio
from front_door import photograph
from PIL import Image

import orthomill.pipeline.storage.image_files
from orthomill.pipeline.storage.file_names import shown
from orthomill.pipeline.storage.image_files import read_header, read_pixels
from orthomill.pipeline.storage.photographs.folder_listing import image_files
from orthomill.schemas.errors import PhotoError, WorkflowError
from orthomill.schemas.project import PhotoFolder, PhotoList
from orthomill.schemas.raster import Window

WHOLE = Window(0, 0, 48, 64)


def refusal(path: Path, window: Window | None = None) -> str:
    with pytest.raises(PhotoError) as caught:
        read_pixels(path, window) if window else read_header(path)
    sentence = str(caught.value)
    assert path.name in sentence and "\n" not in sentence and sentence.endswith(".")
    return sentence


def saved(path: Path, pixels: np.ndarray, **options) -> Path:
    Image.fromarray(pixels).save(path, **options)
    return path


def noise(*shape: int, dtype=np.uint8) -> np.ndarray:
    return np.random.default_rng(1).integers(0, 255, shape, dtype=dtype)


def test_a_header_has_size_and_tags_by_their_plain_names(tmp_path):
    path = photograph(tmp_path / "a.JPG", make="DJI FC300S", gps=(-91.9946, 46.8426), focal=3.61)
    header = read_header(path)
    assert (header.path, header.width, header.height, header.bands, header.dtype) == (str(path), 64, 48, 3, "uint8")
    assert header.tags["Make"] == "DJI" and "3.61" in header.tags["FocalLength"] and header.tags["GPSLongitudeRef"] == "W"
    assert not any(name.startswith("EXIF_") for name in header.tags)


def test_an_ordinary_photograph_causes_no_output_and_no_warning(tmp_path, capfd, recwarn):
    read_header(photograph(tmp_path / "a.jpg"))
    read_pixels(tmp_path / "a.jpg", WHOLE)
    assert capfd.readouterr() == ("", "") and not recwarn.list


@pytest.mark.parametrize("suffix", ["png", "tif"])
@pytest.mark.parametrize(("shape", "dtype", "bands"), [((48, 64), "uint8", 1), ((48, 64, 3), "uint8", 3), ((48, 64), "uint16", 1)])
def test_pixels_come_as_stored(tmp_path, suffix, shape, dtype, bands):
    pixels = noise(*shape, dtype=dtype)
    path = saved(tmp_path / f"a.{suffix}", pixels)
    assert read_header(path).bands == bands
    part = read_pixels(path, Window(5, 7, 11, 13))
    assert part.dtype == dtype
    assert np.array_equal(part, pixels.reshape(48, 64, bands)[5:16, 7:20])


@pytest.mark.parametrize("suffix", ["png", "tif"])
@pytest.mark.parametrize("bands", [2, 4])
def test_an_alpha_band_is_a_mask_behind_the_colours(tmp_path, suffix, bands):
    pixels = noise(48, 64, bands)
    pixels[..., -1] = 255
    # Transparent, nearly so, and the soft rim of a mask.
    pixels[:12, :16, -1], pixels[12, :16, -1], pixels[13, :16, -1] = 0, 1, 200
    path = saved(tmp_path / f"a.{suffix}", pixels)
    header, found = read_header(path), read_pixels(path, WHOLE)
    assert (header.bands, header.masked) == (bands - 1, True)
    assert np.array_equal(found[..., :-1], pixels[..., :-1])
    assert np.array_equal(found[..., -1], np.where(pixels[..., -1] == 255, 255, 0))
    assert np.array_equal(read_pixels(path, Window(10, 5, 7, 30)), found[10:17, 5:35])


def test_a_mask_of_sixteen_bits_is_full_at_their_greatest_value(tmp_path):
    pixels = noise(48, 64, 4, dtype="uint16")
    pixels[..., 3] = 65535
    pixels[:12, :16, 3] = 0
    path = tmp_path / "a.tif"
    profile = {"driver": "GTiff", "width": 64, "height": 48, "count": 4, "dtype": "uint16", "photometric": "rgb", "alpha": "yes"}
    with rasterio.open(path, "w", **profile) as file:
        file.write(np.moveaxis(pixels, 2, 0))
    assert np.array_equal(read_pixels(path, WHOLE), pixels)


def test_an_inner_mask_and_a_value_for_no_data_are_masks_too(tmp_path):
    pixels = np.maximum(noise(48, 64, 3), 1)
    pixels[:12, :16] = 0
    profile = {"driver": "GTiff", "width": 64, "height": 48, "count": 3, "dtype": "uint8", "photometric": "rgb"}
    with rasterio.open(tmp_path / "nodata.tif", "w", **profile, nodata=0) as file:
        file.write(np.moveaxis(pixels, 2, 0))
    with rasterio.Env(GDAL_TIFF_INTERNAL_MASK=True), rasterio.open(tmp_path / "inner.tif", "w", **profile) as file:
        file.write(np.moveaxis(pixels, 2, 0))
        file.write_mask(pixels.any(axis=2))
    for name in ("nodata.tif", "inner.tif"):
        found = read_pixels(tmp_path / name, WHOLE)
        assert np.array_equal(found[..., 3], np.where(pixels.any(axis=2), 255, 0)), name


def test_colours_for_printing_are_converted_and_masked_by_nothing(tmp_path):
    colours = Image.fromarray(noise(48, 64, 3)).convert("CMYK")
    colours.save(tmp_path / "a.tif")
    colours.save(tmp_path / "b.jpg", quality=100)
    for name in ("a.tif", "b.jpg"):
        header, found = read_header(tmp_path / name), read_pixels(tmp_path / name, WHOLE)
        assert (header.bands, header.masked, found.shape) == (3, False, (48, 64, 3))
        assert np.abs(found.astype(int) - noise(48, 64, 3)).mean() < 12, name


def test_a_photograph_without_alpha_has_no_mask(tmp_path):
    path = saved(tmp_path / "a.jpg", noise(48, 64, 3))
    assert not read_header(path).masked
    assert read_pixels(path, WHOLE).shape == (48, 64, 3)


def test_the_largest_page_of_a_tiff_is_the_photograph(tmp_path):
    pixels, path = noise(48, 64, 3), tmp_path / "a.tif"
    Image.fromarray(pixels[::4, ::4]).save(path, save_all=True, append_images=[Image.fromarray(pixels)])
    assert (read_header(path).width, read_header(path).height) == (64, 48)
    assert np.array_equal(read_pixels(path, WHOLE), pixels) and read_header(path).pictures == 1
    Image.fromarray(pixels).save(path, save_all=True, append_images=[Image.fromarray(pixels)])
    assert read_header(path).pictures == 2


def test_the_orientation_flag_is_not_applied_here(tmp_path):
    exif = Image.Exif()
    exif[0x0112] = 6
    path = saved(tmp_path / "a.jpg", noise(48, 64, 3), exif=exif)
    header = read_header(path)
    assert (header.width, header.height, header.tags["Orientation"]) == (64, 48, "6")


def test_a_truncated_jpeg_is_found_without_decoding(tmp_path):
    path = photograph(tmp_path / "a.jpg")
    path.write_bytes(path.read_bytes()[:-300])
    assert "is truncated" in refusal(path) and "copy it again" in refusal(path)
    assert "it holds too few data for its size" in refusal(path, WHOLE)


def test_the_end_marker_of_a_thumbnail_does_not_count(tmp_path):
    small = photograph(tmp_path / "small.jpg").read_bytes()
    whole = photograph(tmp_path / "a.jpg", width=1024).read_bytes()
    segment = b"\xff\xe9" + struct.pack(">H", len(small) + 2) + small
    path = tmp_path / "b.jpg"
    path.write_bytes(whole[:2] + segment + whole[2:])
    assert read_header(path).width == 1024
    path.write_bytes(path.read_bytes()[:-1000])
    assert "is truncated" in refusal(path)


def test_data_after_the_end_marker_do_no_harm(tmp_path):
    path = photograph(tmp_path / "a.jpg")
    path.write_bytes(path.read_bytes() + bytes(10_000))
    assert read_header(path).width == 64
    assert read_pixels(path, WHOLE).shape == (48, 64, 3)


def test_a_jpeg_with_a_hole_is_refused_when_it_is_read(tmp_path):
    path = photograph(tmp_path / "a.jpg", width=512)
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2] + b"\xff\xd9")
    assert read_header(path).width == 512
    assert "is damaged at 48 % of its height or before" in refusal(path, Window(0, 0, 48, 512))


@pytest.mark.parametrize("suffix", ["png", "tif"])
def test_other_truncated_images_are_refused(tmp_path, suffix):
    path = saved(tmp_path / f"a.{suffix}", noise(480, 640, 3))
    path.write_bytes(path.read_bytes()[:200_000])
    with pytest.raises(PhotoError, match=f"a\\.{suffix}"):
        read_header(path)
        read_pixels(path, Window(0, 0, 480, 640))


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"these are field notes\n" * 100, "is not a JPEG, TIFF or PNG image but plain text, whatever its name says"),
        (b"", "is empty (0 bytes)"),
        (bytes(range(256)), "but another kind of file"),
        (b"GIF89a" + bytes(100), "but another kind of file"),
        (b"\xff\xd8\xff\xe0" + bytes(50), "begins like an image, but cannot be opened"),
        (b"<VRTDataset rasterXSize='9' rasterYSize='9'></VRTDataset>", "but plain text"),
    ],
)
def test_what_is_only_named_like_a_photograph(tmp_path, content, words):
    path = tmp_path / "notes.jpg"
    path.write_bytes(content)
    assert words in refusal(path)
    assert words in refusal(path, WHOLE)


def test_a_missing_photograph_and_a_folder(tmp_path):
    assert "does not exist" in refusal(tmp_path / "a.jpg")
    (tmp_path / "b.jpg").mkdir()
    assert "cannot be read" in refusal(tmp_path / "b.jpg")


def png_that_claims(path: Path, side: int) -> Path:
    """A PNG of a few bytes whose header promises side x side pixels."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", side, side, 8, 0, 0, 0, 0)
    chunks = chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(bytes(100))) + chunk(b"IEND", b"")
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + chunks)
    return path


def test_a_decompression_bomb_is_refused_unread(tmp_path):
    path = png_that_claims(tmp_path / "bomb.png", 60_000)
    assert "claims 60000 x 60000 px, which is 3.6 gigapixels" in refusal(path)
    assert "more than 2 gigapixels are refused" in refusal(path, Window(0, 0, 10, 10))


def test_the_limit_in_pixels(tmp_path, monkeypatch):
    path = photograph(tmp_path / "a.jpg")
    monkeypatch.setattr(orthomill.pipeline.storage.image_files, "PIXEL_LIMIT", 64 * 48)
    assert read_header(path).width == 64
    monkeypatch.setattr(orthomill.pipeline.storage.image_files, "PIXEL_LIMIT", 64 * 48 - 1)
    assert "gigapixels" in refusal(path)


def test_images_of_another_kind_say_how_to_save_them(tmp_path):
    Image.fromarray(noise(48, 64)).convert("P").save(tmp_path / "palette.png")
    assert "has a colour palette; save it as grey or RGB" in refusal(tmp_path / "palette.png")
    with rasterio.open(tmp_path / "five.tif", "w", driver="GTiff", width=8, height=8, count=5, dtype="uint8") as file:
        file.write(noise(5, 8, 8))
    assert "has 5 bands" in refusal(tmp_path / "five.tif")
    with rasterio.open(tmp_path / "float.tif", "w", driver="GTiff", width=8, height=8, count=1, dtype="float32") as file:
        file.write(np.zeros((1, 8, 8), np.float32))
    assert "holds float32 values; save it with 8 or 16 bits" in refusal(tmp_path / "float.tif")


def test_a_window_outside_the_photograph_is_refused(tmp_path):
    path = photograph(tmp_path / "a.jpg")
    assert "has 64 x 48 px" in refusal(path, Window(0, 0, 49, 64))


def test_the_image_files_of_a_folder(tmp_path):
    for name in ("b.JPG", "a.jpeg", "c.Tif", "d.tiff", "e.PNG"):
        photograph(tmp_path / "photos" / "x.jpg").rename(tmp_path / "photos" / name)
    (tmp_path / "photos" / "notes.txt").write_text("x")
    (tmp_path / "photos" / "._b.JPG").write_bytes(b"x")
    (tmp_path / "photos" / "folder.jpg").mkdir()
    folder = PhotoFolder(kind="folder", path="photos")
    assert image_files(tmp_path, folder) == ("photos/a.jpeg", "photos/b.JPG", "photos/c.Tif", "photos/d.tiff", "photos/e.PNG")
    assert image_files(tmp_path, PhotoFolder(kind="folder", path="photos/", pattern="[ab]*")) == ("photos/a.jpeg", "photos/b.JPG")
    assert image_files(tmp_path, PhotoList(kind="list", paths=("z.jpg", "a.jpg"))) == ("a.jpg", "z.jpg")
    with pytest.raises(WorkflowError, match="None of the 5 images"):
        image_files(tmp_path, PhotoFolder(kind="folder", path="photos", pattern="DSC*"))
    with pytest.raises(WorkflowError, match="cannot be read"):
        image_files(tmp_path, PhotoFolder(kind="folder", path="nowhere"))


def test_paths_are_shown_relative_to_the_current_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert shown(tmp_path / "photos" / "a.jpg") == "photos/a.jpg"
    assert shown(Path("photos/a.jpg")) == "photos/a.jpg"
    assert shown(Path(os.sep) / "etc" / "a.jpg") == "/etc/a.jpg"


def decoding(path):
    return read_header(path).decoding


def test_the_header_tells_how_the_rows_of_a_file_can_be_had(tmp_path):
    image = Image.fromarray(np.arange(64 * 48 * 3, dtype=np.uint8).reshape(64, 48, 3))
    for name, how in {"b.jpg": {}, "p.jpg": {"progressive": True}, "n.png": {}, "t.tif": {}}.items():
        image.save(tmp_path / name, **how)
    found = {name: decoding(tmp_path / name) for name in ("b.jpg", "p.jpg", "n.png", "t.tif")}
    assert found == {"b.jpg": "in_order", "p.jpg": "at_once", "n.png": "in_order", "t.tif": "anywhere"}


def test_an_interlaced_png_is_decoded_at_once(tmp_path):
    path = tmp_path / "i.png"
    Image.new("L", (64, 64)).save(path)
    data = bytearray(path.read_bytes())
    data[28] = 1  # the interlace method, followed by the checksum of the chunk
    data[29:33] = zlib.crc32(data[12:29]).to_bytes(4, "big")
    path.write_bytes(data)
    assert decoding(path) == "at_once"


def test_a_tiff_of_a_single_high_strip_is_decoded_in_order(tmp_path):
    path = tmp_path / "s.tif"
    with rasterio.open(
        path, "w", driver="GTiff", width=8, height=2000, count=1, dtype="uint8", blockysize=2000, compress="lzw"
    ) as file:
        file.write(np.zeros((1, 2000, 8), np.uint8))
    assert decoding(path) == "in_order"


@pytest.mark.parametrize("name", ["a.png", "a.jpg", "a.tif"])
def test_windows_in_any_order_are_those_of_the_whole(tmp_path, name):
    path = tmp_path / name
    Image.fromarray(np.random.default_rng(1).integers(0, 255, (700, 300, 3), dtype=np.uint8)).save(path)
    whole = read_pixels(path, Window(0, 0, 700, 300))
    for row, col in ((0, 0), (256, 0), (512, 100), (128, 17), (0, 3)):
        assert np.array_equal(read_pixels(path, Window(row, col, 100, 100)), whole[row : row + 100, col : col + 100])


def test_a_file_that_is_decoded_in_order_is_opened_once(tmp_path, monkeypatch):
    path, opened = tmp_path / "a.png", []
    Image.fromarray(np.random.default_rng(1).integers(0, 255, (700, 300, 3), dtype=np.uint8)).save(path)
    real = rasterio.open
    monkeypatch.setattr(rasterio, "open", lambda *words, **more: opened.append(words) or real(*words, **more))
    for row in range(0, 700, 100):
        read_pixels(path, Window(row, 0, 100, 300))
    assert len(opened) == 1
    Image.new("RGB", (300, 700), (1, 2, 3)).save(path)
    assert (read_pixels(path, Window(600, 0, 100, 300)) == (1, 2, 3)).all(), "a file that has changed is opened anew"
    assert len(opened) == 2
