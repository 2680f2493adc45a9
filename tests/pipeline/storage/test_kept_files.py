"""The files of a job: durable when it ends, and every loss and damage found."""

import os

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from orthomill.pipeline.storage.depots.folder import Folder
from orthomill.pipeline.storage.depots.kept_files import defect_of, first_defect, keep

WHOLE = b"0123456789" * 300_000


@pytest.fixture
def kept(tmp_path):
    path = tmp_path / "tables" / "a" / "x.json"
    path.parent.mkdir(parents=True)
    path.write_bytes(WHOLE)
    return tmp_path, keep(Folder(tmp_path), ["tables/a/x.json"])


def changed_without_a_trace(path, content):
    """What a failing disk does: the time of change stays."""
    before = path.stat()
    path.write_bytes(content)
    os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))


def test_an_untouched_file_is_whole(kept):
    folder, files = kept
    assert list(files) == ["tables/a/x.json"] and files["tables/a/x.json"].size == 3_000_000
    assert first_defect(Folder(folder), files) is None and first_defect(Folder(folder), files, thoroughly=True) is None


def test_a_copy_with_other_times_is_whole_by_its_content(kept):
    folder, files = kept
    os.utime(folder / "tables/a/x.json", ns=(1, 1))
    assert first_defect(Folder(folder), files) is None


@settings(max_examples=30, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(at=st.integers(0, 2_999_999), bit=st.integers(0, 7))
def test_every_flipped_bit_is_found_by_content(kept, at, bit):
    folder, files = kept
    path, kept_file = folder / "tables/a/x.json", files["tables/a/x.json"]
    flipped = bytearray(WHOLE)
    flipped[at] ^= 1 << bit
    changed_without_a_trace(path, flipped)
    assert first_defect(Folder(folder), files) is None, "size and time are as recorded"
    assert first_defect(Folder(folder), files, thoroughly=True) == ("tables/a/x.json", "damaged")
    path.write_bytes(flipped)
    os.utime(path, ns=(2, 2))
    assert first_defect(Folder(folder), files) == ("tables/a/x.json", "damaged"), "another time of change makes it suspect"
    path.write_bytes(WHOLE)
    os.utime(path, ns=(kept_file.changed, kept_file.changed))  # for the next example


@pytest.mark.parametrize("size", [0, 1, 2_999_999])
def test_a_shorter_file_is_damaged_at_first_sight(kept, size):
    folder, files = kept
    changed_without_a_trace(folder / "tables/a/x.json", b"0" * size)
    assert first_defect(Folder(folder), files) == ("tables/a/x.json", "damaged")


def test_a_lost_file_and_a_lost_folder_are_missing(kept):
    folder, files = kept
    (folder / "tables/a/x.json").unlink()
    assert first_defect(Folder(folder), files) == ("tables/a/x.json", "missing")
    (folder / "tables/a").rmdir()
    (folder / "tables/a").write_text("a file where a folder was")
    assert defect_of(Folder(folder), "tables/a/x.json", files["tables/a/x.json"], thoroughly=False) == "missing"
