"""The map of a run by HTTP: its files in ranges, the photographs of a place, and nothing beside them."""

import json
import urllib.error
import urllib.request
from contextlib import contextmanager
from types import SimpleNamespace

import numpy as np
import pytest
from box_scene import CAMERA, DSM, block, heights

from orthomill.pipeline.serving.viewer.viewer_routes import PlaceAnswers, map_of, viewer_routes
from orthomill.pipeline.watching.map_server import served
from orthomill.schemas.errors import StoreError
from orthomill.schemas.orientation import BLOCK
from orthomill.schemas.photo import PHOTOS, Photo, Photos
from orthomill.schemas.surface import HEIGHT, SURFACE, Surface
from orthomill.tasks.inspections.photographs_of_place import photographs_of_place


def store() -> SimpleNamespace:
    size = {"width": CAMERA.width, "height": CAMERA.height, "bands": 3, "dtype": "uint8", "camera": "test"}
    photos = Photos(photos=tuple(Photo(name=name, path=name, **size) for name in "abcd"))
    tables = {BLOCK.path: block(), SURFACE.path: Surface(grid=DSM, height_low=0, height_high=20), PHOTOS.path: photos}
    z = heights()
    z[5, 5] = np.nan
    return SimpleNamespace(
        names=lambda: (HEIGHT,), table=lambda table: tables[table.path], read=lambda name, window: z[window.slices]
    )


@contextmanager
def page(folder):
    (folder / "index.html").write_text("<title>volos</title>")
    (folder / "large.pmtiles").write_bytes(bytes(range(100)))
    with served(viewer_routes(folder, PlaceAnswers(store(), photographs_of_place)), "index.html") as address:
        yield address.removesuffix("index.html")


def answer(address, headers=None):
    try:
        with urllib.request.urlopen(urllib.request.Request(address, headers=headers or {}), timeout=20) as found:
            return found.status, found.read()
    except urllib.error.HTTPError as error:
        return error.code, b""


def test_files_come_whole_or_in_ranges_and_nothing_lies_outside_or_without_the_secret(tmp_path):
    products = tmp_path / "products"
    products.mkdir()
    (tmp_path / "secret.txt").write_text("no")
    with page(products) as start:
        assert answer(start + "index.html") == (200, b"<title>volos</title>")
        assert answer(start + "large.pmtiles", {"Range": "bytes=10-13"}) == (206, bytes([10, 11, 12, 13]))
        assert answer(start + "large.pmtiles", {"Range": "bytes=-2"}) == (206, bytes([98, 99]))
        for wrong in ("..%2fsecret.txt", "../secret.txt", "none.html"):
            assert answer(start + wrong)[0] in (403, 404)
        assert answer(start.rsplit("/", 2)[0] + "/guess/index.html")[0] == 404


def test_a_place_behind_a_wall_is_shown_by_the_photographs_that_see_it(tmp_path):
    with page(tmp_path) as start:
        status, text = answer(start + "place.json?x=72.5&y=60.5")
        found = {one["photo"]: one for one in json.loads(text)}
        assert status == 200 and found["c"]["free"] and not found["a"]["free"], "the box stands between a and the place"
        assert list(found)[-1] == "a" and found["c"]["pixel"] == pytest.approx(0.5, abs=0.03)
        assert json.loads(answer(start + "place.json?x=5.5&y=114.5")[1]) == [], "no height there"
        assert json.loads(answer(start + "place.json?x=-900&y=0")[1]) == []
        assert answer(start + "place.json?x=nan&y=0")[0] == 400 and answer(start + "place.json?x=1")[0] == 400
        assert answer(start + "crop.jpg?photo=none&col=1&row=1&scale=2&size=50")[0] == 404


def test_a_run_without_a_map_says_what_to_do(tmp_path):
    with pytest.raises(StoreError, match="has no map yet: add '- kind: viewer'"):
        map_of(tmp_path)
