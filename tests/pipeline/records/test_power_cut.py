"""The power goes while a project runs: what was not forced to the disk is lost or empty, and the next run finds all of it."""

import os
import random
import shutil
import time
from types import SimpleNamespace

import pytest
from toy_stages import MEMORY, SmoothStage, SourceStage, SumStage, pixels, run_in, session_in

from orthomill.pipeline.engine.runner import SequentialRunner
from orthomill.pipeline.records import power_cut
from orthomill.pipeline.records.power_cut import NOTE, examine_after_power_cut, flushing

STAGES = (SourceStage(rows=700, cols=700), SmoothStage(), SumStage())


class PowerCut(BaseException):
    """The machine is off."""


class Disk:
    """Remembers what was there when everything was forced to the disk."""

    def __init__(self, folder, monkeypatch):
        self._folder, self._forced = folder, {}
        monkeypatch.setattr(os, "sync", self._sync)

    def _sync(self):
        self._forced = {path: path.stat() for path in self._folder.rglob("*") if path.is_file()}

    def cut(self, chance):
        """Of what was not forced to the disk, some is gone, some has its length but zeros, some is shorter, some is there."""
        for path in [path for path in self._folder.rglob("*") if path.is_file()]:
            status, forced = path.stat(), self._forced.get(path)
            if forced and forced.st_mtime_ns == status.st_mtime_ns:
                continue
            # To what was forced something may have been appended since; a file that was replaced is another one.
            kept = forced.st_size if forced and forced.st_ino == status.st_ino else 0
            how = chance.choice(("gone", "zeros", "short", "whole"))
            if how == "gone" and not kept:
                path.unlink()
            elif how != "whole":
                old, new = path.read_bytes()[:kept], path.read_bytes()[kept:]
                left = {"zeros": bytes(len(new)), "short": new[: len(new) // 2], "gone": b""}
                path.write_bytes(old + left[how])
                os.utime(path, ns=(status.st_atime_ns, status.st_mtime_ns))


class CutAfter:
    """A watcher that ends the run after so many jobs, and forces all to the disk in between."""

    def __init__(self, jobs, flush):
        self._left, self._flush_at, self._flush = jobs, jobs // 2, flush

    def planned(self, key): ...
    def skipped(self, key): ...

    def finished(self, finished, seconds):
        self._left -= 1
        if self._left == self._flush_at:
            self._flush()
        if self._left == 0:
            raise PowerCut


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    root = tmp_path_factory.mktemp("whole")
    run_in(root, *STAGES)
    return root


@pytest.mark.parametrize("jobs", [1, 9, 30, 47, 60, 74])
def test_a_run_after_a_power_cut_ends_the_same_bit_for_bit(whole, tmp_path, monkeypatch, jobs):
    folder = tmp_path / "runs" / "toy"
    monkeypatch.setattr(power_cut, "boot", lambda: "before")
    disk = Disk(folder, monkeypatch)
    with pytest.raises(PowerCut):
        session_in(tmp_path, *STAGES).run(SequentialRunner(MEMORY), CutAfter(jobs, lambda: power_cut._flush(folder)))
    disk.cut(random.Random(jobs))
    monkeypatch.setattr(power_cut, "boot", lambda: "after")
    found = examine_after_power_cut(folder)
    assert found is not None
    resumed = run_in(tmp_path, *STAGES)
    assert not resumed.failures and len(resumed.skipped) >= jobs // 2 - 1, "what was forced to the disk is kept"
    for name in ("source/numbers", "smooth/numbers"):
        assert pixels(tmp_path, name).tobytes() == pixels(whole, name).tobytes()
    for path in ("tables/sum/total.json", "products/smooth.tif"):
        assert (folder / path).read_bytes() == (whole / "runs/toy" / path).read_bytes()


def test_nothing_is_examined_while_the_machine_stays_up(tmp_path):
    with flushing(tmp_path):
        pass
    assert (tmp_path / NOTE).exists() and examine_after_power_cut(tmp_path) is None


def test_only_what_is_younger_than_the_note_is_examined(whole, tmp_path, monkeypatch):
    folder = shutil.copytree(whole / "runs" / "toy", tmp_path / "toy")
    # Jobs that ended in the second before the note are examined too; the toy project may have ended just now.
    a_minute_later = time.time() + 60.0
    monkeypatch.setattr(power_cut, "time", SimpleNamespace(time=lambda: a_minute_later))
    with flushing(folder):
        pass
    chunk = folder / "rasters.zarr/source/numbers/c/1/1"
    status = chunk.stat()
    chunk.write_bytes(bytes(status.st_size))
    os.utime(chunk, ns=(status.st_atime_ns, status.st_mtime_ns))
    monkeypatch.setattr(power_cut, "boot", lambda: "another start")
    assert examine_after_power_cut(folder).damaged == {}
    (folder / NOTE).unlink()
    assert set(examine_after_power_cut(folder).damaged) == {"rasters.zarr/source/numbers/c/1/1"}


def test_everything_is_forced_to_the_disk_again_and_again_and_at_the_end(tmp_path, monkeypatch):
    synced = []
    monkeypatch.setattr(os, "sync", lambda: synced.append(len(synced)))
    monkeypatch.setattr(power_cut, "EVERY", 0.01)
    with flushing(tmp_path):
        while len(synced) < 3:
            pass
    assert len(synced) >= 4
