"""Photographs of an object store, brought into the project before its workflow is written."""

import io
import os
import shutil
from collections import namedtuple

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

pytest.importorskip("obstore")

from orthomill.pipeline.cli.commands.application import app
from orthomill.pipeline.storage.depots import fetched_photographs as fetching
from orthomill.pipeline.storage.depots.bucket import bucket_of, is_address
from orthomill.pipeline.storage.depots.fetched_photographs import Fetched, fetched_photographs
from orthomill.pipeline.storage.photographs.file_kinds import FOREIGN_SUFFIXES, LIST_SUFFIXES
from orthomill.schemas.errors import ResourceError, WorkflowError

FILES = {"a.JPG": b"one", "card/DJI_0002.jpg": b"two", "gcp_list.txt": b"EPSG:32615\n", "film.mp4": b"long", ".hidden.jpg": b"x"}
WANTED = ("a.JPG", "card/DJI_0002.jpg", "gcp_list.txt")


@pytest.fixture
def flight(request):
    bucket = bucket_of(f"memory://{request.node.name}")
    for name, content in FILES.items():
        bucket.put(name, content)
    return bucket


def test_photographs_and_lists_come_in_their_folders_and_only_what_changed_comes_again(flight, tmp_path):
    assert fetched_photographs(flight.address, tmp_path / "site") == Fetched(tuple(sorted(WANTED)), new=3, left=2)
    found = {path.relative_to(tmp_path / "site").as_posix(): path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    assert found == {name: FILES[name] for name in WANTED}
    assert fetched_photographs(flight.address + "/", tmp_path / "site").new == 0
    # Of the same length, but later.
    os.utime(tmp_path / "site" / "a.JPG", (0, 0))
    flight.put("a.JPG", b"new")
    assert fetched_photographs(flight.address, tmp_path / "site").new == 1
    assert (tmp_path / "site" / "a.JPG").read_bytes() == b"new"


def test_names_that_lead_out_of_the_folder_are_left(tmp_path, monkeypatch):
    bucket = bucket_of("memory://leads-out")
    listed = [("../a.jpg", 1, 0.0), ("b\\..\\c.jpg", 1, 0.0), ("/d.jpg", 1, 0.0)]
    monkeypatch.setattr(type(bucket), "objects", lambda self: iter(listed))
    with pytest.raises(WorkflowError, match="holds no photographs, among 3 objects"):
        fetched_photographs("memory://leads-out", tmp_path / "site")
    assert not list(tmp_path.iterdir())


def test_photographs_for_which_there_is_no_room_are_not_begun(flight, tmp_path, monkeypatch):
    monkeypatch.setattr(fetching.shutil, "disk_usage", lambda place: namedtuple("Usage", "total used free")(9, 9, 0))
    with pytest.raises(ResourceError, match=r"The photographs have 0\.0 GB and the disk of .* make room"):
        fetched_photographs(flight.address, tmp_path / "site")
    assert not (tmp_path / "site").exists()


def test_init_fetches_photographs_and_names_what_is_wrong_before(flight, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    bucket = bucket_of("memory://flown")
    for number in range(2):
        picture = io.BytesIO()
        Image.fromarray(np.random.default_rng(number).integers(0, 255, (96, 128, 3), dtype=np.uint8)).save(picture, "JPEG")
        bucket.put(f"DJI_{number}.JPG", picture.getvalue())
    run = CliRunner().invoke(app, ["init", "site", "--photos", "memory://flown"])
    assert run.exit_code == 0, run.output
    assert "2 files of memory://flown lie in photographs/site now, 2 of them new" in run.output
    assert "path: photographs/site\n" in (tmp_path / "workflows" / "site.yaml").read_text()
    shutil.rmtree(tmp_path / "photographs")
    again = CliRunner().invoke(app, ["init", "site", "--photos", "memory://flown"])
    assert again.exit_code != 0 and "exists already" in again.output and not (tmp_path / "photographs").exists()


def test_what_is_an_address():
    assert is_address("s3://bucket/flight") and is_address("gs://b") and is_address("az://c/d")
    assert not is_address("flight") and not is_address("/mnt/s3:/flight") and not is_address("http://there/flight")


def test_whatever_is_looked_for_beside_photographs_is_fetched(tmp_path):
    bucket, wanted = bucket_of("memory://beside"), sorted(LIST_SUFFIXES | FOREIGN_SUFFIXES)
    for suffix in wanted:
        bucket.put(f"points{suffix}", b"1")
    files = tuple(f"points{suffix}" for suffix in wanted)
    assert fetched_photographs(bucket.address, tmp_path / "site") == Fetched(files, new=len(wanted), left=0)
