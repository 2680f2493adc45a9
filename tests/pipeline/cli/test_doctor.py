import socket
from collections import namedtuple

import pytest

from orthomill.pipeline.cli import doctor as examination
from orthomill.pipeline.cli.doctor import doctor
from orthomill.schemas.memory import GIB


def finding(name, folder):
    return next(row for row in doctor(folder) if row.name == name)


def test_every_row_says_what_was_found_and_a_failing_one_what_to_do(tmp_path):
    rows = doctor(tmp_path)
    assert {
        "Python",
        "numba",
        "GDAL driver COG",
        "PROJ database",
        "memory",
        "free disk",
        "file locks",
        "atomic renaming",
        "kernel cache",
        "dashboard port 8787",
    } <= {row.name for row in rows}
    assert all(row.value for row in rows) and all(row.ok or row.advice for row in rows)
    assert len({row.name for row in rows}) == len(rows)


def test_the_examination_leaves_nothing_behind(tmp_path):
    doctor(tmp_path)
    assert not list(tmp_path.iterdir())


def test_a_missing_library_is_named(tmp_path, monkeypatch):
    monkeypatch.setattr(examination, "LIBRARIES", (("no-such-library", 1), ("numpy", 99)))
    assert finding("no-such-library", tmp_path).value == "missing"
    assert "version 99" in finding("numpy", tmp_path).advice and not finding("numpy", tmp_path).ok


def test_a_taken_port_is_said_and_does_no_harm(tmp_path, monkeypatch):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        monkeypatch.setattr(examination, "DASHBOARD_PORT", port)
        row = finding(f"dashboard port {port}", tmp_path)
        assert row.value == "taken" and row.ok and "next free port" in row.advice
    assert finding(f"dashboard port {port}", tmp_path).value == "free"


def test_a_full_disk_and_little_memory_are_reported(tmp_path, monkeypatch):
    monkeypatch.setattr(examination.shutil, "disk_usage", lambda place: namedtuple("U", "free")(GIB))
    monkeypatch.setattr(examination.psutil, "virtual_memory", lambda: namedtuple("M", "available total")(GIB, 8 * GIB))
    assert not finding("free disk", tmp_path).ok and "make room" in finding("free disk", tmp_path).advice
    assert not finding("memory", tmp_path).ok and finding("memory", tmp_path).value == "1.0 GiB free of 8.0"


def test_a_folder_that_cannot_be_written_is_reported(tmp_path):
    row = finding("run folder", tmp_path / "is" / "not" / "there")
    assert not row.ok and "make it writable" in row.advice


def test_locks_that_do_not_hold_are_found(tmp_path, monkeypatch):
    monkeypatch.setattr(examination.fcntl, "flock", lambda stream, how: None)
    assert not finding("file locks", tmp_path).ok


@pytest.mark.parametrize("driver", ["COG", "JPEG"])
def test_a_missing_driver_is_found(tmp_path, monkeypatch, driver):
    class Few:
        def __enter__(self):
            return self

        def __exit__(self, *error):
            return None

        def drivers(self):
            return {"GTiff": "", "PNG": ""}

    monkeypatch.setattr(examination.rasterio, "Env", Few)
    assert not finding(f"GDAL driver {driver}", tmp_path).ok and finding("GDAL driver PNG", tmp_path).ok
