"""Compiled kernels are found again while the sources are the same, and never after they changed."""

import os
import time

import numba
import pytest

from orthomill.tasks.kernel_cache import sources_digest, use_kernel_cache


@pytest.fixture
def sources(tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", "")
    monkeypatch.setattr(numba.config, "CACHE_DIR", "")
    folder = tmp_path / "sources"
    (folder / "tasks" / "room").mkdir(parents=True)
    (folder / "schemas").mkdir()
    (folder / "tasks" / "room" / "kernels.py").write_text("from numba import njit\nfrom orthomill.tasks.callee import f\n")
    (folder / "tasks" / "callee.py").write_text("from orthomill.schemas import (\n    codes,\n)\nf = 1\n")
    (folder / "schemas" / "codes.py").write_text("DONE = 0\n")
    (folder / "tasks" / "other.py").write_text("g = 1\n")
    return folder


@pytest.mark.parametrize("module", ["tasks/room/kernels.py", "tasks/callee.py", "schemas/codes.py"])
def test_a_change_in_what_kernels_are_made_of_gives_another_folder(sources, tmp_path, monkeypatch, module):
    use_kernel_cache(sources, tmp_path / "kept")
    before = os.environ["NUMBA_CACHE_DIR"]
    monkeypatch.setenv("NUMBA_CACHE_DIR", "")
    use_kernel_cache(sources, tmp_path / "kept")
    assert os.environ["NUMBA_CACHE_DIR"] == before
    with (sources / module).open("a") as text:
        text.write("more = 2\n")
    monkeypatch.setenv("NUMBA_CACHE_DIR", "")
    use_kernel_cache(sources, tmp_path / "kept")
    assert os.environ["NUMBA_CACHE_DIR"] != before


def test_numba_that_was_imported_before_uses_the_folder_too(sources, tmp_path):
    use_kernel_cache(sources, tmp_path / "kept")
    assert numba.config.CACHE_DIR == os.environ["NUMBA_CACHE_DIR"] != ""


def test_a_module_that_no_kernel_uses_does_not_count(sources):
    before = sources_digest(sources)
    (sources / "tasks" / "other.py").write_text("g = 2\n")
    assert sources_digest(sources) == before


def test_a_renamed_module_is_a_change(sources):
    before = sources_digest(sources)
    (sources / "tasks" / "room" / "kernels.py").rename(sources / "tasks" / "room" / "renamed.py")
    assert sources_digest(sources) != before


def test_the_users_choice_stays(sources, tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", "elsewhere")
    use_kernel_cache(sources, tmp_path / "kept")
    assert os.environ["NUMBA_CACHE_DIR"] == "elsewhere"
    assert not (tmp_path / "kept").exists()


def test_kernels_of_old_sources_are_removed(sources, tmp_path):
    old, recent = tmp_path / "kept" / "old", tmp_path / "kept" / "recent"
    old.mkdir(parents=True)
    recent.mkdir()
    long_ago = time.time() - 30 * 86400
    os.utime(old, (long_ago, long_ago))
    use_kernel_cache(sources, tmp_path / "kept")
    assert not old.exists() and recent.exists()


def test_a_place_that_cannot_be_written_changes_nothing(sources, tmp_path):
    (tmp_path / "kept").write_text("a file, not a folder")
    use_kernel_cache(sources, tmp_path / "kept")
    assert os.environ["NUMBA_CACHE_DIR"] == ""
