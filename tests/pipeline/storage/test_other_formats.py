"""HEIC and raw photographs: read where their libraries are installed, otherwise refused with the name of the extra."""

import base64
import io
import struct

import numpy as np
import pytest
from PIL import Image

from orthomill.pipeline.storage.image_files import read_header, read_pixels
from orthomill.pipeline.storage.photographs import file_kinds, other_formats
from orthomill.pipeline.storage.photographs.file_kinds import Kind, kind_of_file, readable_suffixes
from orthomill.schemas.errors import PhotoError
from orthomill.schemas.raster import Window


@pytest.fixture
def without_libraries(monkeypatch):
    for module in (file_kinds, other_formats):
        monkeypatch.setattr(module, "find_spec", lambda name: None)
    readable_suffixes.cache_clear()
    yield
    readable_suffixes.cache_clear()


HEIC = base64.b64decode(
    "AAAAHGZ0eXBoZWljAAAAAG1pZjFoZWljbWlhZgAAAZdtZXRhAAAAAAAAACFoZGxyAAAAAAAAAABwaWN0AAAAAAAAAAAAAAAAAAAAADRpbG9jAAAAAERA"
    "AAIAAQAAAAABuwABAAAAAAAAAJQAAgAAAAACTwABAAAAAAAAAGYAAAA4aWluZgAAAAAAAgAAABVpbmZlAgAAAAABAABodmMxAAAAABVpbmZlAgAAAQAC"
    "AABFeGlmAAAAAA5waXRtAAAAAAABAAAA1mlwcnAAAAC3aXBjbwAAAHhodmNDAQNwAAAAkAAAAAAAHvAA/P34+AAADwNgAAEAGEABDAH//wNwAAADAJAA"
    "AAMAAAMAHroCQGEAAQArQgEBA3AAAAMAkAAAAwAAAwAeoDCBBZbqSSmubgIaDAgAAAMAyAAAAwAIQGIAAQAHRAHBcrAiQAAAABNjb2xybmNseAABAA0A"
    "BoAAAAAUaXNwZQAAAAAAAABgAAAAQAAAABBwaXhpAAAAAAMICAgAAAAXaXBtYQAAAAAAAAABAAEEgQIDBAAAABppcmVmAAAAAAAAAA5jZHNjAAIAAQAB"
    "AAABAm1kYXQAAACQKAGvBPhBr7wH4jRrK4O1IgZ1L3F9se5SiFfcD+TA/fWvNy3DWXHAu9gDVADWcteF37I+Uf6kf8xZGfxrX1cgR9DBXnqTHgvP9ZP4"
    "GT1dab0jzuqvNBAzROAmC1XoiuV16o15hnkYXsjQPEf8x4KoaModsE+NL6VS8nhDEbRgwOAqd2kdFN4LKznw3/QN/GE+AAAABkV4aWYAAE1NACoAAAAI"
    "AAMBDwACAAAABgAAADIBEAACAAAACQAAADiHaQAEAAAAAQAAAEIAAAAAQXBwbGUAaVBob25lIDcAAAABkgoADAAAAAEAAABUAAAAAEAP64UeuFHs"
)
"""96 x 64 px, a ramp of grey from left to right, with the tags of an iPhone 7"""


def dng(path, pixels: np.ndarray):
    """The smallest DNG: one page of sensor values (rows, cols) uint16 under a filter of red, green, green, blue."""
    rows, cols = pixels.shape
    matrix = np.array([3.24, -1.54, -0.5, -0.97, 1.88, 0.04, 0.06, -0.2, 1.06])
    rationals = b"".join(struct.pack("<ii", round(value * 10000), 10000) for value in matrix)
    entries = {
        254: (4, 1, 0), 256: (4, 1, cols), 257: (4, 1, rows), 258: (3, 1, 16), 259: (3, 1, 1), 262: (3, 1, 32803),
        271: (2, b"DJI\0"), 272: (2, b"FC6310\0"), 273: (4, 1, None), 274: (3, 1, 6), 277: (3, 1, 1), 278: (4, 1, rows),
        279: (4, 1, pixels.nbytes), 33421: (3, 2, 2 | 2 << 16), 33422: (1, 4, 0 | 1 << 8 | 1 << 16 | 2 << 24),
        50706: (1, 4, 1 | 4 << 8), 50708: (2, b"DJI FC6310\0"), 50717: (4, 1, 65535), 50721: (10, rationals),
    }  # fmt: skip
    at = 8 + 2 + 12 * len(entries) + 4
    words, behind = b"", b""
    for tag, (kind, *rest) in sorted(entries.items()):
        data = rest[0] if isinstance(rest[0], bytes) else b""
        count = (len(data) // 8 if kind == 10 else len(data)) if data else rest[0]
        value = struct.pack("<I", rest[1] or 0) if not data else data.ljust(4, b"\0")
        if len(value) > 4:
            value, behind = struct.pack("<I", at + len(behind)), behind + data + b"\0" * (len(data) % 2)
        words += struct.pack("<HHI", tag, kind, count) + (b"STRP" if tag == 273 else value)
    words = words.replace(b"STRP", struct.pack("<I", at + len(behind)))
    path.write_bytes(b"II*\0" + struct.pack("<IH", 8, len(entries)) + words + bytes(4) + behind + pixels.tobytes())
    return path


def test_heic_is_read_whole_with_its_tags(tmp_path):
    pytest.importorskip("pi_heif", reason="the extra 'formats' is not installed")
    ramp = np.broadcast_to(np.linspace(0, 255, 96).astype(np.uint8)[None, :, None], (64, 96, 3))
    path = tmp_path / "a.HEIC"
    path.write_bytes(HEIC)
    header = read_header(path)
    assert (header.width, header.height, header.bands, header.dtype, header.decoding) == (96, 64, 3, "uint8", "at_once")
    assert header.tags["Model"] == "iPhone 7" and "3.99" in header.tags["FocalLength"]
    part = read_pixels(path, Window(8, 16, 20, 30))
    assert part.shape == (20, 30, 3) and np.abs(part.astype(int) - ramp[8:28, 16:46]).max() < 12
    path.write_bytes(path.read_bytes()[:300])
    with pytest.raises(PhotoError, match=r"a\.HEIC cannot be read as a HEIC photograph"):
        read_pixels(path, Window(0, 0, 64, 96))


def test_dng_is_developed_to_sixteen_bits(tmp_path):
    pytest.importorskip("rawpy", reason="the extra 'formats' is not installed")
    values = np.tile(np.linspace(1000, 40000, 96).astype(np.uint16), (64, 1))
    path = dng(tmp_path / "a.dng", values)
    header = read_header(path)
    assert (header.width, header.height, header.bands, header.dtype, header.decoding) == (96, 64, 3, "uint16", "at_once")
    pixels = read_pixels(path, Window(0, 0, 64, 96))
    grey = pixels[8:-8, 8:-8].mean(axis=(0, 2))
    assert pixels.dtype == np.uint16 and (np.diff(grey[::8]) > 0).all(), "the ramp of the sensor is that of the photograph"
    path.write_bytes(path.read_bytes()[:200])
    with pytest.raises(PhotoError, match="as a raw photograph"):
        read_header(path)


def test_without_the_libraries_the_extra_is_named(tmp_path, without_libraries):
    assert kind_of_file("a.HEIC") is Kind.HEIF and kind_of_file("a.DNG") is Kind.RAW
    path = tmp_path / "a.HEIC"
    path.write_bytes(struct.pack(">I", 24) + b"ftypheic" + bytes(100))
    with pytest.raises(PhotoError, match=r"a\.HEIC is a HEIC photograph; install the extra .*orthomill\[formats\]"):
        read_header(path)


def test_a_jpeg_under_another_name_is_a_jpeg(tmp_path):
    out = io.BytesIO()
    Image.new("RGB", (64, 48)).save(out, "JPEG")
    for name in ("a.HEIC", "a.DNG"):
        (tmp_path / name).write_bytes(out.getvalue())
        assert read_header(tmp_path / name).width == 64
