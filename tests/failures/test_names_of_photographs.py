"""Photographs with names that nobody expects: each has its own pixels, tables and records, or is refused in one sentence."""

import os

import numpy as np
import pytest
from small_site import command, counts, make_site, photographs, start_command

from orthomill.pipeline.storage.image_files import read_pixels
from orthomill.pipeline.storage.store import Store
from orthomill.schemas.orientation import Block


@pytest.fixture
def site(tmp_path, monkeypatch):
    monkeypatch.chdir(make_site(tmp_path))
    return tmp_path


def renamed(site, names):
    for photo, name in zip(photographs(site), names, strict=True):
        photo.rename(photo.with_name(f"{name}.JPG"))


@pytest.mark.parametrize(
    "names",
    [
        ("α", "β", "γ"),
        ("照片" * 40, "照片" * 39 + "二", "三"),
        ("p(1)", "p[1]", "p 1 "),
        ("a" * 249 + "1", "a" * 249 + "2", "zarr.json"),
        ("two\nlines", "a 'quote\"", "[red]100%\\"),
    ],
    ids=["greek", "chinese", "brackets", "long", "hostile"],
)
def test_every_photograph_has_its_own_raster_and_pairs(site, names):
    renamed(site, names)
    ran, unchanged, failed = counts(command("run", "site", "--sequential"))
    assert (unchanged, failed) == (0, 0)
    store = Store(site / "runs" / "site")
    for photo in photographs(site):
        raster = f"photos/{photo.stem}/0"
        assert raster in store.names()
        whole = store.spec(raster).full
        assert np.array_equal(store.read(raster, whole), read_pixels(photo, whole))
    block = Block.model_validate_json((site / "runs/site/tables/orientation/block.json").read_bytes())
    assert set(block.names) == {photo.stem for photo in photographs(site)}
    assert counts(command("run", "site", "--sequential"))[:2] == (0, ran)


def test_a_name_that_is_no_text_is_refused_in_one_sentence(site):
    photo = photographs(site)[0]
    os.rename(photo, os.fsencode(photo.parent) + b"/p\xff\n.JPG")
    said = command("run", "site", "--sequential", code=2)
    assert said.startswith(
        "error: workflows/site.yaml:5: photographs > path: The photograph photos/p\\udcff\\n.JPG has a name that"
    )
    assert said.endswith("is not UTF-8 text; rename it with letters that this system can show.")


def test_a_damaged_photograph_with_line_ends_in_its_name_is_one_line(site):
    renamed(site, ("two\nlines", "b", "c"))
    (site / "photos" / "two\nlines.JPG").write_bytes(b"")
    said = command("run", "site", "--sequential", "--until", "photos")
    assert "photos/two\\nlines.JPG is empty (0 bytes)." in said


@pytest.mark.slow
def test_a_terminal_that_cannot_show_a_name_shows_its_codes(site, monkeypatch):
    renamed(site, ("α", "b", "c"))
    (site / "photos" / "α.JPG").write_bytes(b"")
    monkeypatch.setenv("PYTHONIOENCODING", "ascii")
    out, errors = (process := start_command(site, "run", "site", "--sequential", "--until", "photos")).communicate(timeout=120)
    assert process.returncode == 0 and "Traceback" not in out + errors
    assert "photos/\\u03b1.JPG is empty (0 bytes)" in out + errors
