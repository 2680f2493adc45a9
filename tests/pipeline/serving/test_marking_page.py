"""The marking page: by HTTP, and by keyboard in a real browser where there is one."""

import json
import shutil
import time
import urllib.error
import urllib.request
from contextlib import contextmanager

import cv2
import numpy as np
import pytest

from benchmarks.marking.simulated_marks import CAMERA, simulated_block, simulated_marks
from orthomill.pipeline.report.paper import FLAGS
from orthomill.pipeline.serving.marking.mark_ledger import MarkLedger
from orthomill.pipeline.serving.marking.mark_routes import mark_routes
from orthomill.pipeline.serving.marking.marking_session import MarkingSession
from orthomill.pipeline.serving.marking.mask_images import MASKS, MaskImages
from orthomill.pipeline.watching.map_server import served
from orthomill.schemas.photo import Photo
from orthomill.tasks.marking.hidden_areas import hidden_mask
from orthomill.tasks.marking.judging import judged, sights
from orthomill.tasks.marking.next_points import next_points

BLOCK = simulated_block(2, 5, seed=3)
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
SIZES = dict.fromkeys(BLOCK.belief.names, (CAMERA.width, CAMERA.height))


class KnownBlock:
    oriented = True

    def judged(self, marks):
        return judged(BLOCK.belief, marks)

    def sights(self, marks, point):
        return sights(BLOCK.belief, marks, point)

    def proposals(self, marks, name, read):
        return ()

    def next_points(self, marks):
        return next_points(BLOCK.belief, marks, 1)


class GreyCrops:
    def __init__(self):
        self.photos = {
            name: Photo(name=name, path=name, width=4000, height=3000, bands=1, dtype="uint8", camera="c") for name in SIZES
        }

    def jpeg(self, name, col, row, scale, size):
        return cv2.imencode(".jpg", np.full((size[1], size[0]), 120, np.uint8))[1].tobytes() if name in self.photos else None

    def grey(self, name, window):
        return np.full(window.shape, np.nan, np.float32)


@contextmanager
def page_of(folder, points=1):
    """The address of a page whose points have coordinates and no marks, and its session."""
    ledger = MarkLedger(folder, "EPSG:32632", SIZES)
    if ledger.is_new:
        given = simulated_marks(BLOCK, 4, points=points)
        bare = tuple(point.model_copy(update={"marks": {}, "role": "control"}) for point in given.points)
        ledger.replace(given.model_copy(update={"points": bare}))
    crops = GreyCrops()
    session = MarkingSession(
        "site", ledger, crops, KnownBlock(), MaskImages(folder, folder / MASKS, crops.photos.values(), hidden_mask)
    )
    with served(mark_routes(session), "marks") as address:
        yield address, session


def asked(address, path, body=None, kind="application/json"):
    """Status and value of an answer."""
    request = urllib.request.Request(address.removesuffix("marks") + path, None if body is None else json.dumps(body).encode())
    request.add_header("Content-Type", kind)
    try:
        with urllib.request.urlopen(request, timeout=30) as answer:
            return answer.status, json.loads(answer.read())
    except urllib.error.HTTPError as error:
        text = error.read()
        return error.code, json.loads(text) if text.startswith(b"{") else {}


def test_changes_need_the_secret_json_and_sense(tmp_path):
    with page_of(tmp_path) as (address, session):
        change = {"kind": "mark", "point": "P1", "photo": "photo_0001", "before": None, "after": {"col": 5.0, "row": 6.0}}
        secret = address.split("/")[3]
        with pytest.raises(urllib.error.HTTPError, match="404"):
            urllib.request.urlopen(address.replace(secret, "x" * len(secret)), timeout=10)
        assert asked(address, "change", change, "text/plain")[0] == 400
        status, told = asked(address, "change", change | {"after": {"col": "left", "row": 6.0}})
        assert status == 400 and "after.col" in told["error"]
        status, told = asked(address, "change", change | {"after": {"col": 9e9, "row": 6.0}})
        assert status == 400 and "outside of photo_0001" in told["error"]
        assert asked(address, "change", change)[0] == 200
        status, told = asked(address, "change", change | {"after": {"col": 7.0, "row": 6.0}})
        assert status == 409 and "another page" in told["error"] and told["points"][0]["marks"]["photo_0001"]["col"] == 5.0
        assert session.ledger.marks.points[0].marks["photo_0001"].col == 5.0
        assert asked(address, "crop.jpg?photo=photo_0001&col=nan&row=1&scale=1&w=10&h=10")[0] == 400
        assert asked(address, "crop.jpg?photo=none&col=1&row=1&scale=1&w=10&h=10")[0] == 404
        assert asked(address, "sights.json?point=nobody") == (200, [])


def test_where_next_is_told_and_written(tmp_path):
    with page_of(tmp_path) as (address, _):
        status, told = asked(address, "next", {})
        assert status == 200 and told[0].startswith("A control point at") and (tmp_path / "next_points.gpx").exists()


def test_a_hidden_area_becomes_a_mask_and_is_shown_again(tmp_path):
    with page_of(tmp_path) as (address, session):
        area = {"photo": "photo_0001", "corners": [[10, 20], [100, 20], [100, 60], [10, 60]]}
        status, told = asked(address, "change", {"kind": "area", "before": None, "after": area})
        assert status == 200 and told["areas"] == [area]
        mask = cv2.imread(str(tmp_path / MASKS / "photo_0001.png"), cv2.IMREAD_UNCHANGED)
        assert mask.shape == (3000, 4000) and (mask == 0).sum() == 91 * 41 and (mask[20:61, 10:101] == 0).all()
        assert len(session.ledger.marks.areas) == 1
        assert asked(address, "change", {"kind": "area", "before": area, "after": None})[0] == 200
        assert not (tmp_path / MASKS / "photo_0001.png").exists()
        status, told = asked(address, "change", {"kind": "area", "before": None, "after": area | {"corners": [[1, 1], [2, 2]]}})
        assert status == 400 and "corners" in told["error"]


@pytest.fixture(scope="module")
def browser():
    playwright = pytest.importorskip("playwright.sync_api", reason="Playwright is not installed: pip install playwright")
    if CHROMIUM is None:
        pytest.skip("There is no Chromium on this machine to look at the page with.")
    with playwright.sync_playwright() as driver:
        found = driver.chromium.launch(executable_path=CHROMIUM, args=list(FLAGS))
        yield found
        found.close()


def opened(browser, address):
    page, errors = browser.new_page(bypass_csp=True), []
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.goto(address)
    page.wait_for_function("document.body.dataset.ready === 'yes'", timeout=60_000)
    return page, errors


def settled(page):
    page.wait_for_function("!sending && !unsent.length", timeout=60_000)


def marked(session):
    return session.ledger.marks.points[0].marks


def test_a_point_by_keyboard_undone_and_moved(tmp_path, browser):
    with page_of(tmp_path) as (address, session):
        page, errors = opened(browser, address)
        expected = page.evaluate("sights.length")
        begun = time.monotonic()
        for count in range(1, expected + 1):
            page.keyboard.press("Enter")
            settled(page)
            page.wait_for_function(f"Object.keys(named(point).marks).length === {count}", timeout=60_000)
            page.wait_for_function(f"sights.length === {expected - count}", timeout=60_000)
        assert time.monotonic() - begun < 60, "ten photographs a minute"
        assert len(marked(session)) == expected
        page.keyboard.press("u")
        settled(page)
        assert len(marked(session)) == expected - 1
        page.keyboard.press("r")
        settled(page)
        photo = page.evaluate("photo")
        before = marked(session)[photo]
        for _ in range(3):
            page.keyboard.press("Shift+ArrowRight")
        page.evaluate("mark(cursor)")
        settled(page)
        assert marked(session)[photo].col == pytest.approx(before.col + 0.3, abs=2e-3)
        page.keyboard.press("Delete")
        settled(page)
        assert photo not in marked(session)
        page.set_viewport_size({"width": 390, "height": 800})
        assert page.evaluate("document.documentElement.scrollWidth <= innerWidth"), "a telephone needs no sideways scrolling"
        names = page.evaluate("[...document.querySelectorAll('#sights b')].map(one => [one.scrollWidth, one.clientWidth])")
        assert names and all(needed <= there for needed, there in names), "names of photographs are readable there"
        assert not errors


def test_a_mark_that_is_confirmed_stays_as_it_is(tmp_path, browser):
    with page_of(tmp_path) as (address, session):
        page, errors = opened(browser, address)
        page.evaluate("mark(cursor)")
        settled(page)
        revision = session.ledger.revision
        page.evaluate("mark(cursor)")
        settled(page)
        assert session.ledger.revision == revision and len(marked(session)) == 1 and not errors


def test_what_is_refused_is_shown_no_longer(tmp_path, browser):
    with page_of(tmp_path) as (address, _):
        page, _ = opened(browser, address)
        page.evaluate("make({kind: 'point', before: fields(named('P1')), after: {...fields(named('P1')), sigma: [-1, -1, -1]}})")
        page.wait_for_function("!sending && named('P1').sigma[0] > 0", timeout=30_000)
        assert page.evaluate("done.length") == 0, "there is nothing to undo"


def test_a_wrong_mark_is_named_on_the_page(tmp_path, browser):
    with page_of(tmp_path) as (address, _):
        page, errors = opened(browser, address)
        for shift in (0, 0, 0, 0, 25):
            page.evaluate(f"mark({{col: cursor.col + {shift}, row: cursor.row}})")
            settled(page)
            photo = page.evaluate("photo")
            page.evaluate("step(1)")
        page.wait_for_function("document.querySelectorAll('#wrong div').length === 1", timeout=30_000)
        assert f"P1 in {photo} is off by" in page.inner_text("#wrong")
        assert not errors


def test_what_could_not_be_sent_is_sent_when_the_page_opens_again(tmp_path, browser):
    with page_of(tmp_path) as (address, session):
        page, _ = opened(browser, address)
        page.route("**/change", lambda route: route.abort())
        page.keyboard.press("Enter")
        page.wait_for_function("document.getElementById('said').textContent.includes('does not answer')", timeout=30_000)
        assert not marked(session)
        page.unroute("**/change")
        # As after a crash: nothing of the page is left but what the browser keeps.
        page.goto("about:blank")
        page.goto(address)
        page.wait_for_function("document.body.dataset.ready === 'yes' && !unsent.length", timeout=60_000)
        settled(page)
        assert len(marked(session)) == 1


def test_two_browsers_see_each_other(tmp_path, browser):
    with page_of(tmp_path) as (address, session):
        one, _ = opened(browser, address)
        other, _ = opened(browser, address)
        one.keyboard.press("Enter")
        settled(one)
        other.wait_for_function("Object.keys(state.points[0].marks).length === 1", timeout=30_000)
        photo = next(iter(marked(session)))
        stale = {"kind": "mark", "point": "P1", "photo": photo, "before": None, "after": {"col": 3.0, "row": 3.0}}
        assert asked(address, "change", stale)[0] == 409


def test_an_area_is_hidden_by_clicks_and_shown_again(tmp_path, browser):
    with page_of(tmp_path) as (address, session):
        page, errors = opened(browser, address)
        page.keyboard.press("m")
        box = page.locator("#canvas").bounding_box()
        for x, y in ((0.3, 0.3), (0.6, 0.3), (0.6, 0.7), (0.3, 0.7)):
            page.mouse.click(box["x"] + x * box["width"], box["y"] + y * box["height"])
        page.keyboard.press("Enter")
        settled(page)
        (area,) = session.ledger.marks.areas
        assert len(area.corners) == 4 and "masks: " in page.inner_text("#dialog")
        page.keyboard.press("Escape")
        page.mouse.click(box["x"] + 0.45 * box["width"], box["y"] + 0.5 * box["height"])
        page.keyboard.press("Delete")  # the corner of the click
        page.keyboard.press("Delete")
        settled(page)
        assert not session.ledger.marks.areas and not marked(session) and not errors
