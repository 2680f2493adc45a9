"""The map of tiles in a real browser: a failing, a retried and a resumed tile while the run goes on, and the page that is kept."""

import shutil
from contextlib import contextmanager
from threading import Thread

import pytest
from toy_stages import MEMORY, SmoothStage, SourceStage, SumStage, run_in, session_in

from orthomill.pipeline.engine.dask_cluster import local_client
from orthomill.pipeline.engine.dask_runner import DaskRunner
from orthomill.pipeline.forecast.known_costs import Expectations
from orthomill.pipeline.report.paper import FLAGS
from orthomill.pipeline.watching.cost_model import CostModel
from orthomill.pipeline.watching.live_map import MAP, live_map
from orthomill.pipeline.watching.run_watch import Watchers

NOTHING = Expectations({}, here=False)
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
COUNTS = "() => Array.from(document.querySelectorAll('#key span')).map(span => span.textContent).join(', ')"


@pytest.fixture(scope="module")
def browser():
    playwright = pytest.importorskip("playwright.sync_api", reason="Playwright is not installed: pip install playwright")
    if CHROMIUM is None:
        pytest.skip("There is no Chromium on this machine to look at the map with.")
    with playwright.sync_playwright() as driver:
        found = driver.chromium.launch(executable_path=CHROMIUM, args=list(FLAGS))
        yield found
        found.close()


@contextmanager
def watched_run(root, *stages):
    """The address of the map of a run that goes on beside; its scheduler lives until the end of the context."""
    session, told = session_in(root, *stages, tile=16), []
    with local_client(2, MEMORY, 8900) as client:
        runner, model = DaskRunner(client, MEMORY, "here"), CostModel(("source", "smooth", "sum"), 2, NOTHING)
        with live_map(session, runner, model, told.append) as tiles:
            run = Thread(target=session.run, args=(runner, Watchers((model, tiles))), daemon=True)
            run.start()
            yield told[0].removeprefix("map of tiles: ")
            run.join(30)


def looked_at(browser, address):
    page, errors = browser.new_page(bypass_csp=True), []
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.goto(address)
    return page, errors


def test_failed_retried_and_unchanged_tiles_are_seen(tmp_path, browser):
    lure = tmp_path / "lure"
    lure.touch()
    source = SourceStage(rows=64, cols=64, pause=0.15, poison=(32, 32), lure=str(lure))
    with watched_run(tmp_path, source, SmoothStage(), SumStage()) as address:
        page, errors = looked_at(browser, address)
        page.wait_for_function(f"({COUNTS})().includes('1 failed')", timeout=60_000)
        page.wait_for_function(f"({COUNTS})().includes('0 waiting, 0 running')", timeout=60_000)
        assert "11 blocked" in page.evaluate(COUNTS), "nine neighbours, the product and the sum"
        assert page.evaluate("Math.max(...attempt.slice(0, tiles))") >= 2, "the failing tile was tried again"
        page.evaluate("open(state.indexOf(5))")
        page.wait_for_selector("#panel .error")
        assert "poisoned" in page.inner_text("#panel") and not errors


def test_what_an_earlier_run_did_is_on_the_map_and_the_map_is_kept(tmp_path, browser):
    run_in(tmp_path, SourceStage(rows=64, cols=64), tile=16)
    with watched_run(tmp_path, SourceStage(rows=64, cols=64), SmoothStage(), SumStage()) as address:
        page, errors = looked_at(browser, address)
        page.wait_for_function(f"({COUNTS})().includes('0 waiting, 0 running')", timeout=60_000)
        assert "17 unchanged" in page.evaluate(COUNTS)
        page.set_viewport_size({"width": 390, "height": 800})
        assert page.evaluate("document.documentElement.scrollWidth <= innerWidth"), "a telephone needs no sideways scrolling"
        assert not errors
    page, errors = looked_at(browser, (tmp_path / "runs" / "toy" / MAP).as_uri())
    page.wait_for_function(f"({COUNTS})().includes('17 unchanged')", timeout=20_000)
    assert "all tiles done" in page.inner_text("#left") and not errors
    page.wait_for_function("document.body.dataset.pictures === '2'", timeout=20_000)
    page.evaluate("open(keys.indexOf('smooth/tile/1/2'))")
    said = page.inner_text("#panel")
    assert "Raster(" in said and "source/numbers" in said and "fingerprint" in said and "why it ran" in said
    assert page.evaluate("document.querySelector('#panel canvas').getContext('2d').getImageData(96, 96, 1, 1).data[3]") == 255
    assert not errors
