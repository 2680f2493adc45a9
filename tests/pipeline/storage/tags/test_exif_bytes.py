"""EXIF from bytes: made blocks of both byte orders, damaged ones, and pictures of three kinds."""

import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
import rasterio
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from orthomill.pipeline.storage.image_files import read_header
from orthomill.pipeline.storage.tags.exif_bytes import exif_tags, jpeg_exif, png_exif

DATA = Path(__file__).parents[5] / "shared" / "data"
FORMATS = {2: "s", 3: "H", 4: "I", 5: "II", 7: "s", 11: "f"}


def directory(order: str, entries: list[tuple[int, int, tuple | bytes]], at: int) -> bytes:
    """A directory of (tag, type, values) that begins at offset `at`, with its values behind it."""
    head, tail = struct.pack(f"{order}H", len(entries)), b""
    behind = at + 2 + 12 * len(entries) + 4
    for tag, kind, values in entries:
        raw = values if isinstance(values, bytes) else struct.pack(f"{order}{FORMATS[kind][0] * len(values)}", *values)
        count = len(raw) // struct.calcsize(f"<{FORMATS[kind]}")
        place = raw.ljust(4, b"\0") if len(raw) <= 4 else struct.pack(f"{order}I", behind + len(tail))
        tail += raw if len(raw) > 4 else b""
        head += struct.pack(f"{order}HHI", tag, kind, count) + place
    return head + b"\0" * 4 + tail


def block(order: str) -> bytes:
    """Make, model and orientation; a directory of EXIF with DJI's note, and one of GPS."""
    note_at, exif_at, gps_at = 400, 200, 700
    note = directory(order, [(1, 2, b"DJI\0"), (9, 11, (-89.9,)), (10, 11, (44.25,)), (11, 11, (0.5,))], note_at)
    main = [(0x010F, 2, b"DJI\0"), (0x0110, 2, b"FC300S\0"), (0x0112, 3, (6,)), (0x8769, 4, (exif_at,)), (0x8825, 4, (gps_at,))]
    gps = [(1, 2, b"S\0"), (2, 5, (46, 1, 50, 1, 33999, 1000)), (5, 7, b"\1"), (0x1F, 5, (5, 0))]
    content = (b"II*\0" if order == "<" else b"MM\0*") + struct.pack(f"{order}I", 8) + directory(order, main, 8)
    exif = directory(order, [(0x920A, 5, (361, 100)), (0x927C, 7, note)], exif_at)
    # The note lies where its entry says: behind the two entries of its directory and the focal length.
    at = exif_at + 2 + 24 + 4 + 8
    moved = directory(order, [(1, 2, b"DJI\0"), (9, 11, (-89.9,)), (10, 11, (44.25,)), (11, 11, (0.5,))], at)
    exif = exif.replace(note, moved)
    return content.ljust(exif_at, b"\0") + exif.ljust(gps_at - exif_at, b"\0") + directory(order, gps, gps_at)


@pytest.mark.parametrize("order", ["<", ">"])
def test_a_block_of_either_byte_order(order):
    tags = exif_tags(block(order))
    assert (tags["Make"], tags["Model"], tags["Orientation"], tags["FocalLength"]) == ("DJI", "FC300S", "6", "(3.61)")
    assert tags["GPSLatitude"] == "(46) (50) (33.999)" and tags["GPSLatitudeRef"] == "S"
    assert tags["GPSHPositioningError"] == "(0)", "a quotient of nothing"
    assert float(tags["MakerNote:CameraYaw"]) == 44.25 and float(tags["MakerNote:CameraPitch"]) == pytest.approx(-89.9)


def test_the_note_of_another_maker_is_not_read():
    tags = exif_tags(block("<").replace(b"DJI\0", b"XYZ\0"))
    assert tags["Make"] == "XYZ" and not [name for name in tags if name.startswith("MakerNote")]


@settings(max_examples=300, deadline=None)
@given(
    changes=st.lists(st.tuples(st.integers(0, 799), st.integers(0, 255)), max_size=12),
    cut=st.integers(0, 800),
    order=st.sampled_from("<>"),
)
def test_damaged_blocks_give_fewer_tags_and_no_error(changes, cut, order):
    damaged = bytearray(block(order))
    for at, value in changes:
        damaged[min(at, len(damaged) - 1)] = value
    tags = exif_tags(bytes(damaged[:cut]))
    assert all(isinstance(text, str) and len(text) < 3000 for text in tags.values())


def test_no_block_at_all():
    assert exif_tags(b"") == exif_tags(b"II") == exif_tags(b"JPEG" * 10) == {}


def picture(path: Path, exif: Image.Exif) -> Path:
    Image.fromarray(np.zeros((90, 120, 3), np.uint8)).save(path, exif=exif)
    return path


@pytest.mark.parametrize("suffix", ["jpg", "png"])
def test_jpeg_and_png_give_the_same_tags(tmp_path, suffix):
    exif = Image.Exif()
    exif[0x010F], exif[0x0110], exif[0x0112] = "DJI", "FC300S", 6
    exif.get_ifd(0x8769)[0x920A] = 3.61
    exif.get_ifd(0x8769)[0xA431] = "A111"
    exif.get_ifd(0x8825).update({1: "N", 2: (46.0, 50.0, 33.999), 3: "W", 4: (91.0, 59.0, 39.5), 6: 198.6})
    tags = read_header(picture(tmp_path / f"a.{suffix}", exif)).tags
    assert (tags["Make"], tags["Model"], tags["Orientation"], tags["BodySerialNumber"]) == ("DJI", "FC300S", "6", "A111")
    assert "3.61" in tags["FocalLength"] and "46" in tags["GPSLatitude"] and tags["GPSLongitudeRef"] == "W"
    assert "198.6" in tags["GPSAltitude"]


def test_make_model_and_orientation_of_a_tiff(tmp_path):
    exif = Image.Exif()
    exif[0x010F], exif[0x0110], exif[0x0112] = "DJI", "FC300S", 6
    tags = read_header(picture(tmp_path / "a.tif", exif)).tags
    assert (tags["Make"], tags["Model"], tags["Orientation"]) == ("DJI", "FC300S", "6")


def test_chunks_of_a_png_are_skipped_and_a_false_length_ends_the_search(tmp_path):
    def chunk(name: bytes, content: bytes) -> bytes:
        return struct.pack(">I", len(content)) + name + content + struct.pack(">I", zlib.crc32(name + content))

    path = tmp_path / "a.png"
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", b"\0" * 13) + chunk(b"eXIf", b"II*\0") + chunk(b"IEND", b""))
    assert png_exif(path) == b"II*\0"
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + struct.pack(">I", 2**31) + b"eXIf" + b"\0" * 10)
    assert png_exif(path) == b""


def test_a_jpeg_without_exif_has_none(tmp_path):
    Image.fromarray(np.zeros((80, 80), np.uint8)).save(tmp_path / "a.jpg")
    assert jpeg_exif(tmp_path / "a.jpg") == b""
    (tmp_path / "b.jpg").write_bytes(b"\xff\xd8\xff\xe1\0\0")
    assert jpeg_exif(tmp_path / "b.jpg") == b""


def test_big_tiffs_are_read(tmp_path):
    with rasterio.open(tmp_path / "a.tif", "w", driver="GTiff", width=80, height=80, count=1, dtype="uint8", BIGTIFF="YES") as file:
        file.write(np.zeros((1, 80, 80), np.uint8))
    assert "Make" not in read_header(tmp_path / "a.tif").tags


@pytest.mark.skipif(not (DATA / "brighton").exists(), reason="the photographs of brighton lie beside the repository")
def test_the_note_of_a_real_phantom_agrees_with_its_xmp():
    tags = read_header(DATA / "brighton" / "DJI_0020.JPG").tags
    for note, xmp in (("CameraYaw", "GimbalYawDegree"), ("CameraPitch", "GimbalPitchDegree"), ("Yaw", "FlightYawDegree")):
        assert float(tags[f"MakerNote:{note}"]) == pytest.approx(float(tags[f"drone-dji:{xmp}"]), abs=1e-4)
