"""The map that is kept when a run has ended: everything that the page shows must be in it."""

import base64
import gzip
import json
import re

import cv2
import numpy as np
import pytest
from toy_stages import MEMORY, SmoothStage, SourceStage, session_in

from orthomill.pipeline.engine.runner import SequentialRunner
from orthomill.pipeline.forecast.known_costs import Expectations
from orthomill.pipeline.watching import live_map as module
from orthomill.pipeline.watching.cost_model import CostModel
from orthomill.pipeline.watching.live_map import MAP, live_map
from orthomill.pipeline.watching.run_watch import Watchers
from orthomill.pipeline.watching.tile_picture import _coloured
from orthomill.schemas.raster import RasterSpec

NOTHING = Expectations({}, here=False)


def kept_after_a_run(root, **settings) -> dict:
    """What the page of a small run holds: 4 x 5 tiles of 16 px in two stages, 64 x 72 px."""
    session = session_in(root, SourceStage(rows=64, cols=72, **settings), SmoothStage(), tile=16)
    runner, model = SequentialRunner(MEMORY), CostModel(("source", "smooth"), 1, NOTHING)
    with live_map(session, runner, model, lambda line: None) as tiles:
        session.run(runner, Watchers((model, tiles)))
    data = re.search(r'const KEPT = "([^"]+)"', (session.folder / MAP).read_text())[1]
    return json.loads(gzip.decompress(base64.b64decode(data)))


def test_every_tile_keeps_its_record_and_its_inputs(tmp_path):
    kept = kept_after_a_run(tmp_path)
    keys = [key for part in kept["parts"] for key in part["keys"]]
    tile = kept["details"][keys.index("smooth/tile/1/2")]
    assert [found["key"] for found in kept["details"]] == keys
    assert tile["record"]["status"] == "done" and tile["reason"] == "not done yet" and len(tile["inputs"]) == 1
    assert "source/numbers" in tile["inputs"][0]


def test_attempts_are_known_without_a_scheduler_that_tells(tmp_path):
    kept = kept_after_a_run(tmp_path, poison=(32, 32))
    keys = [key for part in kept["parts"] for key in part["keys"]]
    changed = [number for part in kept["parts"] for number in part["changed"]]
    attempts = {keys[tile]: attempt for tile, attempt in zip(changed[::6], changed[5::6], strict=True)}
    assert attempts["source/tile/2/2"] == 2 and attempts["source/tile/0/0"] == 1


def test_the_picture_of_a_raster_shows_all_its_tiles(tmp_path):
    kept = kept_after_a_run(tmp_path)
    panels = [name for _, name, *_ in kept["parts"][-1]["panels"]]
    content = np.frombuffer(base64.b64decode(kept["pictures"][str(panels.index("numbers"))]), np.uint8)
    picture = cv2.imdecode(content, cv2.IMREAD_UNCHANGED)
    assert picture.shape == (64, 72, 3), "nothing of it is transparent"
    # The numbers grow from row to row.
    assert (np.diff(picture[8::16, :, 0].mean(axis=1)) > 0).all()


@pytest.mark.parametrize(("limit", "part", "left"), [("KEPT_RECORDS", "details", 5), ("KEPT_PICTURES", "pictures", 0)])
def test_a_page_of_very_many_tiles_stays_small(tmp_path, monkeypatch, limit, part, left):
    monkeypatch.setattr(module, limit, 5)
    assert len(kept_after_a_run(tmp_path)[part]) == left


def test_bands_that_are_no_colours_show_the_first(recwarn):
    spec = RasterSpec(name="a/nodes", shape=(4, 4, 3), dtype="float32", chunk=64)
    bands = np.full((4, 4, 3), np.nan, np.float32)
    bands[1:, :, 0] = np.arange(3)[:, None]
    shown = _coloured(bands, spec)
    assert (shown[0, :, 3] == 0).all() and (shown[1:, :, 3] == 255).all() and (np.diff(shown[1:, 0, 0].astype(int)) > 0).all()
    assert not recwarn


@pytest.mark.parametrize("colours", [True, False])
def test_bands_of_eight_bits_are_colours_unless_they_measure_something(colours):
    spec = RasterSpec(name="a/judgement", shape=(2, 3, 4), dtype="uint8", chunk=64, colours=colours)
    bands = np.zeros((2, 3, 4), np.uint8)
    bands[..., 0], bands[..., 2] = np.arange(3), 7
    shown = _coloured(bands, spec)
    # As colours: blue first, and transparent where the fourth band is 0.
    assert (shown[..., 0] == 7).all() == colours and (shown[..., 3] == 0).all() == colours
    assert (np.diff(shown[0, :, 1].astype(int)) > 0).all() != colours


def test_how_a_raster_is_drawn_is_not_in_the_text_that_fingerprints_are_made_of():
    spec = RasterSpec(name="a/judgement", shape=(2, 3, 4), dtype="uint8", chunk=64)
    assert repr(spec) == repr(spec.model_copy(update={"colours": False})) and "colours" not in repr(spec)


@pytest.mark.parametrize("transform", [None, (1.0, 0.0, 0.0, 0.0, -1.0, 0.0)])
def test_heights_without_end_are_transparent_and_do_not_disturb_the_others(recwarn, transform):
    spec = RasterSpec(name="a/height", shape=(5, 5), dtype="float32", chunk=64, transform=transform)
    heights = np.arange(25, dtype=np.float32).reshape(5, 5)
    heights[0, 0], heights[4, 4] = np.inf, np.nan
    shown = _coloured(heights, spec)
    assert shown[0, 0, 3] == shown[4, 4, 3] == 0 and (shown[1:4] > 0).all()
    assert not recwarn
