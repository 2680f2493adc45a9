"""A run whose results are in doubt ends well, says so last, and fails with --strict."""

import shutil

import pytest
from PIL import Image
from small_site import command, make_site, photographs, write_workflow

from orthomill.pipeline.storage.store import Store
from orthomill.schemas.stage_report import report_table


@pytest.fixture
def site(tmp_path, monkeypatch):
    monkeypatch.chdir(make_site(tmp_path))
    write_workflow(tmp_path, stages=["photos"])
    return tmp_path


def displace(photo, latitude):
    with Image.open(photo) as image:
        image.load()
        exif = image.getexif()
    exif.get_ifd(0x8825)[2] = latitude
    image.save(photo, quality=90, exif=exif)


def test_a_position_that_was_set_aside_is_told_last_and_strict_fails(site):
    displace(photographs(site)[1], (46.0, 56.0, 30.0))
    said = command("run", "site", "--sequential")
    assert said.endswith("km from the other photographs and is not used; the photograph itself is. (report: Photographs)")
    assert "doubtful The GPS tag of" in command("run", "site", "--sequential", "--strict", code=3), "also when nothing was to do"
    report = Store(site / "runs" / "site").table(report_table("photos"))
    assert set(report.doubts) <= set(report.warnings), "what is told stands in the report"


def test_without_doubt_strict_changes_nothing(site):
    said = command("run", "site", "--sequential", "--strict")
    assert "doubtful" not in said
    shutil.rmtree(site / "runs")
    assert "doubtful" not in command("run", "site", "--sequential")
