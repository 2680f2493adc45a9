"""Compiled kernels are found again while the sources are the same, and never after they changed."""

import os
import time

import pytest

from tasks.kernel_cache import sources_digest, use_kernel_cache


@pytest.fixture
def sources(tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", "")
    folder = tmp_path / "sources"
    (folder / "room").mkdir(parents=True)
    (folder / "room" / "caller.py").write_text("from callee import f\n")
    (folder / "callee.py").write_text("f = 1\n")
    return folder


def test_a_change_in_any_module_gives_another_folder(sources, tmp_path, monkeypatch):
    use_kernel_cache(sources, tmp_path / "kept")
    before = os.environ["NUMBA_CACHE_DIR"]
    monkeypatch.setenv("NUMBA_CACHE_DIR", "")
    use_kernel_cache(sources, tmp_path / "kept")
    assert os.environ["NUMBA_CACHE_DIR"] == before
    (sources / "callee.py").write_text("f = 2\n")
    monkeypatch.setenv("NUMBA_CACHE_DIR", "")
    use_kernel_cache(sources, tmp_path / "kept")
    assert os.environ["NUMBA_CACHE_DIR"] != before


def test_a_renamed_module_is_a_change(sources):
    before = sources_digest(sources)
    (sources / "callee.py").rename(sources / "other.py")
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
