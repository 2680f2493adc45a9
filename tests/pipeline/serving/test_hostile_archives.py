"""Archives of strangers: what is honest comes out, what is not is a sentence, and nothing is ever written elsewhere."""

import random
import stat
import struct
import zipfile
from pathlib import Path

import pytest

from orthomill.pipeline.serving.queue.safe_archives import ArchiveLimits, unpacked
from orthomill.pipeline.serving.queue.upload_names import checked_name, is_image
from orthomill.schemas.errors import OrthomillError, WorkflowError

LIMITS = ArchiveLimits(files=50, file_bytes=4 * 2**20, bytes=8 * 2**20, reserve=0)


def packed(path: Path, entries: dict[str, bytes], method: int = zipfile.ZIP_DEFLATED, mode: int = 0) -> Path:
    with zipfile.ZipFile(path, "w", method) as archive:
        for name, content in entries.items():
            entry = zipfile.ZipInfo(name)
            entry.compress_type = method
            entry.external_attr = mode << 16
            archive.writestr(entry, content)
    return path


def test_photographs_and_lists_come_out_with_names_of_their_own(tmp_path):
    entries = {
        "100MEDIA/DJI_1.JPG": b"a",
        "101MEDIA/DJI_1.JPG": b"b",
        "gcp_list.txt": b"EPSG:32634",
        "__MACOSX/._DJI_1.JPG": b"x",
        "101MEDIA/DJI_1_mask.png": b"m",
    }
    archive = packed(tmp_path / "block.zip", {**entries, "notes.docx": b"?", "inner.zip": b"PK"})
    count, told = unpacked(archive, tmp_path / "images", LIMITS)
    assert count == 2 and told == ["block.zip: 2 files are neither photographs nor lists, and were left out."]
    found = {path.name: path.read_bytes() for path in (tmp_path / "images").iterdir()}
    assert found == {"DJI_1.JPG": b"a", "101MEDIA_DJI_1.JPG": b"b", "gcp_list.txt": b"EPSG:32634", "DJI_1_mask.png": b"m"}


@pytest.mark.parametrize("name", ["../a.jpg", "a/../../b.jpg", "/etc/a.jpg", "C:\\a.jpg", "..\\a.jpg", "a/\\b.jpg/../c.jpg"])
def test_paths_that_lead_out_are_refused(tmp_path, name):
    with pytest.raises(WorkflowError, match="leads out of it"):
        unpacked(packed(tmp_path / "x.zip", {"fine.jpg": b"1", name: b"2"}), tmp_path / "images", LIMITS)
    assert not (tmp_path / "images").exists()


@pytest.mark.parametrize("mode", [stat.S_IFLNK | 0o777, stat.S_IFCHR | 0o600, stat.S_IFIFO | 0o600])
def test_links_and_devices_are_refused(tmp_path, mode):
    with pytest.raises(WorkflowError, match="a link or a device"):
        unpacked(packed(tmp_path / "x.zip", {"a.jpg": b"/etc/passwd"}, mode=mode), tmp_path / "images", LIMITS)


def test_bombs_end_at_the_bounds(tmp_path):
    zeros = packed(tmp_path / "zeros.zip", {f"{i}.tif": bytes(3 * 2**20) for i in range(12)})
    assert zeros.stat().st_size < 2**16
    with pytest.raises(WorkflowError, match="far more than photographs are compressed to"):
        unpacked(zeros, tmp_path / "images", LIMITS)
    assert sum(path.stat().st_size for path in (tmp_path / "images").iterdir()) <= LIMITS.bytes
    with pytest.raises(WorkflowError, match=r"big\.tif"):
        unpacked(packed(tmp_path / "big.zip", {"big.tif": bytes(5 * 2**20)}), tmp_path / "more", LIMITS)
    with pytest.raises(WorkflowError, match="says that it holds 51 files"):
        unpacked(packed(tmp_path / "many.zip", {f"{i}.jpg": b"" for i in range(51)}), tmp_path / "many", LIMITS)


def test_a_directory_that_lies_about_its_size_is_not_read(tmp_path):
    archive = packed(tmp_path / "x.zip", {"a.jpg": b"1"})
    content = bytearray(archive.read_bytes())
    struct.pack_into("<I", content, content.rfind(b"PK\x05\x06") + 12, 2**31)
    archive.write_bytes(content)
    with pytest.raises(WorkflowError):
        unpacked(archive, tmp_path / "images", LIMITS)


def test_packings_that_take_any_memory_and_passwords_are_refused(tmp_path):
    with pytest.raises(WorkflowError, match="unusual packing"):
        unpacked(packed(tmp_path / "x.zip", {"a.jpg": b"1"}, zipfile.ZIP_LZMA), tmp_path / "images", LIMITS)
    locked = bytearray(packed(tmp_path / "y.zip", {"a.jpg": b"1"}).read_bytes())
    locked[6] |= 1
    locked[locked.rfind(b"PK\x01\x02") + 8] |= 1
    (tmp_path / "y.zip").write_bytes(locked)
    with pytest.raises(WorkflowError, match="password"):
        unpacked(tmp_path / "y.zip", tmp_path / "images", LIMITS)


def test_the_same_name_twice_is_refused(tmp_path):
    with pytest.raises(WorkflowError, match="twice"):
        unpacked(packed(tmp_path / "x.zip", {"a.jpg": b"1", "A.JPG": b"2"}), tmp_path / "images", LIMITS)


def test_two_hundred_damaged_archives_write_nothing_outside(tmp_path):
    chance = random.Random(43)
    honest = packed(tmp_path / "honest.zip", {f"10{i}MEDIA/{i}.jpg": bytes([i]) * 400 for i in range(5)}).read_bytes()
    place = tmp_path / "deep" / "task"
    place.mkdir(parents=True)
    refused = 0
    for number in range(200):
        content = bytearray(honest)
        for _ in range(chance.randrange(1, 12)):
            content[chance.randrange(len(content))] = chance.randrange(256)
        del content[chance.choice((len(content), chance.randrange(len(content)))) :]
        archive = tmp_path / "x.zip"
        archive.write_bytes(content)
        try:
            unpacked(archive, place / f"images{number}", LIMITS)
        except OrthomillError as error:
            refused += 1
            assert "\n" not in str(error)
    assert refused > 100
    written = {path for path in tmp_path.rglob("*") if path.is_file()} - {tmp_path / "honest.zip", tmp_path / "x.zip"}
    assert all(path.parent.parent == place and path.parent.name.startswith("images") for path in written)
    assert not list(tmp_path.rglob("*.part"))


@pytest.mark.parametrize("name", ["", ".", "..", ".hidden.jpg", "a\x00.jpg", "a\n.jpg", "con.jpg", "x" * 201 + ".jpg"])
def test_names_that_are_none(name):
    with pytest.raises(WorkflowError):
        checked_name(name)


def test_names_lose_their_paths_and_keep_their_letters():
    assert checked_name("C:\\photos\\DJI 1.JPG") == "DJI 1.JPG" and checked_name("../../é ü.jpg") == "é ü.jpg"
    assert is_image("a.DNG") and is_image("a.heic") and not is_image("a_mask.jpg") and not is_image("align.tif")
