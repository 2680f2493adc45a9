"""Compiled kernels are found again while the sources are the same, and never after they changed."""

import os
import time

import pytest

from orthomill.kernels import kernel_cache
from orthomill.kernels.kernel_cache import folder_of, kernel_folder, kernels_are_kept, sources_digest, tidy


@pytest.fixture
def sources(tmp_path, monkeypatch):
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    folder = tmp_path / "sources"
    (folder / "tasks" / "room").mkdir(parents=True)
    (folder / "schemas").mkdir()
    (folder / "pyproject.toml").write_text("")
    (folder / "tasks" / "room" / "kernels.py").write_text("from orthomill.tasks.callee import f\n")
    (folder / "tasks" / "callee.py").write_text("from orthomill.schemas import (\n    codes,\n)\nf = 1\n")
    (folder / "schemas" / "codes.py").write_text("DONE = 0\n")
    (folder / "tasks" / "other.py").write_text("from orthomill.schemas.codes import DONE\n")
    return folder


def digest(sources, module="tasks/room/kernels.py"):
    kernel_cache._read.cache_clear()  # a process reads its sources once
    return sources_digest(sources / module, sources)


@pytest.mark.parametrize("module", ["tasks/room/kernels.py", "tasks/callee.py", "schemas/codes.py"])
def test_a_change_in_what_kernels_are_made_of_gives_another_folder(sources, module):
    before = digest(sources)
    assert digest(sources) == before
    with (sources / module).open("a") as text:
        text.write("more = 2\n")
    assert digest(sources) != before


def test_a_change_in_a_file_that_a_kernel_does_not_import_compiles_nothing_again(sources):
    before, other = digest(sources), digest(sources, "tasks/other.py")
    (sources / "tasks" / "other.py").write_text("g = 2\n")
    assert digest(sources) == before
    assert digest(sources, "tasks/other.py") != other


def test_the_users_choice_is_used(sources, tmp_path, monkeypatch):
    assert kernel_folder(sources) == sources / ".cache" / "kernels"
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "elsewhere"))
    assert kernel_folder(sources) == tmp_path / "elsewhere"


def test_an_installed_package_keeps_its_kernels_in_the_users_cache(sources, tmp_path, monkeypatch):
    (sources / "pyproject.toml").unlink()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "mine"))
    assert kernel_folder(sources) == tmp_path / "mine" / "orthomill" / "kernels"


def test_kernels_that_nobody_used_for_a_week_are_removed(sources):
    old = kernel_folder(sources) / "tasks.room.kernels-0123456789abcdef"
    recent = kernel_folder(sources) / "tasks.room.kernels-fedcba9876543210"
    for folder in (old, recent):
        folder.mkdir(parents=True)
    long_ago = time.time() - 30 * 86400
    os.utime(old, (long_ago, long_ago))
    tidy(sources)
    assert not old.exists() and recent.exists()


def test_only_kernels_of_the_present_sources_count_as_kept(sources):
    kernel_cache._read.cache_clear()
    stale = kernel_folder(sources) / "tasks.room.kernels-0123456789abcdef"
    stale.mkdir(parents=True)
    (stale / "f.1.nbc").write_bytes(b"")
    assert not kernels_are_kept(sources)
    present = folder_of(sources / "tasks" / "room" / "kernels.py", sources)
    present.mkdir()
    (present / "f.1.nbc").write_bytes(b"")
    assert kernels_are_kept(sources)
