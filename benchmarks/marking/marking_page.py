"""The marking page in a scripted browser: how long a point in ten photographs takes, and what is lost when its parts are killed.

python -m benchmarks marking_page [KILLS]

The page of a simulated block runs in a process of its own. One that is killed with -9 is started again, as its user would; a mark
counts as lost where the page had an answer to it and the files do not have it. Needs Playwright and a Chromium on this machine.
"""

import json
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from benchmarks.instrument.result_page import write_page
from benchmarks.marking.simulated_marks import CAMERA, SimulatedBlock, simulated_block, simulated_marks
from orthomill.pipeline.report.paper import BROWSERS, FLAGS
from orthomill.pipeline.serving.marking.mark_ledger import MarkLedger
from orthomill.pipeline.serving.marking.mark_routes import mark_routes
from orthomill.pipeline.serving.marking.marking_session import MarkingSession
from orthomill.pipeline.serving.marking.mask_images import MASKS, MaskImages
from orthomill.pipeline.watching.map_server import served
from orthomill.schemas.marks import Marks
from orthomill.schemas.photo import Photo
from orthomill.schemas.raster import Window
from orthomill.tasks.marking.hidden_areas import hidden_mask
from orthomill.tasks.marking.judging import judged, sights
from orthomill.tasks.marking.next_points import next_points

ASKED = 10
"""photographs in a minute"""
LONGEST = 1.5
"""seconds after which a part is killed"""
PATIENCE = 60_000
"""ms"""


class Knows:
    """What the page asks of a simulated block."""

    oriented = True

    def __init__(self, block: SimulatedBlock) -> None:
        self.belief = block.belief

    def judged(self, marks: Marks) -> Any:
        return judged(self.belief, marks)

    def sights(self, marks: Marks, point: str) -> Any:
        return sights(self.belief, marks, point)

    def proposals(self, marks: Marks, name: str, read: Any) -> tuple[()]:
        return ()

    def next_points(self, marks: Marks) -> Any:
        return next_points(self.belief, marks, 1)


class Pictures:
    """Photographs of noise: what they show is no matter here."""

    def __init__(self, names: tuple[str, ...]) -> None:
        size = {"width": CAMERA.width, "height": CAMERA.height, "bands": 1, "dtype": "uint8", "camera": "c"}
        self.photos = {name: Photo(name=name, path=name, **size) for name in names}

    def jpeg(self, name: str, col: float, row: float, scale: float, size: tuple[int, int]) -> bytes:
        noise = np.random.default_rng(1).integers(80, 160, (size[1], size[0]), dtype=np.uint8)
        return bytes(cv2.imencode(".jpg", noise)[1])

    def grey(self, name: str, window: Window) -> np.ndarray:
        return np.full(window.shape, np.nan, np.float32)


def serve(folder: Path) -> None:
    """Serve the page until the process is killed; its address is the first line told."""
    block = simulated_block(4, 10, seed=3)
    ledger = MarkLedger(folder, "EPSG:32632", dict.fromkeys(block.belief.names, (CAMERA.width, CAMERA.height)))
    if ledger.is_new:
        given = simulated_marks(block, 4, points=6, most=20)
        bare = [point.model_copy(update={"marks": {}, "role": "control"}) for point in given.points]
        seen = {point.name: len(sights(block.belief, Marks(points=(point,)), point.name)) for point in bare}
        # The page opens with the first: one that enough photographs show.
        ledger.replace(Marks(points=tuple(sorted(bare, key=lambda point: -seen[point.name]))))
    crops: Any = Pictures(block.belief.names)
    masks = MaskImages(folder, folder / MASKS, crops.photos.values(), hidden_mask)
    with served(mark_routes(MarkingSession("site", ledger, crops, Knows(block), masks)), "marks") as address:
        print(address, flush=True)
        while True:
            time.sleep(3600)


@contextmanager
def served_apart(folder: Path) -> Iterator[str]:
    """The address of the page, in a process that is killed with -9 at the end."""
    command = [sys.executable, "-m", "benchmarks.marking.marking_page", "serve", str(folder)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            yield process.stdout.readline().strip()
        finally:
            process.send_signal(signal.SIGKILL)


def kept(folder: Path) -> dict[str, set[str]]:
    """Photographs with a mark, by point, as the files have them."""
    ledger = json.loads((folder / "marks.json").read_text())
    return {point["name"]: set(point["marks"]) for point in ledger["points"]}


def opened(browser: Any, address: str) -> Any:
    page = browser.new_page()
    page.goto(address)
    page.wait_for_function("document.body.dataset.ready === 'yes' && !sending && !unsent.length", timeout=PATIENCE)
    return page


def by_keyboard(browser: Any, folder: Path) -> tuple[float, list[float]]:
    """Seconds of a point in ten photographs by Enter, and ms from each key until all residuals are shown."""
    with served_apart(folder) as address:
        page = opened(browser, address)
        begun, each, expected = time.monotonic(), [], page.evaluate("sights.length")
        for count in range(1, ASKED + 1):
            pressed = time.monotonic()
            page.keyboard.press("Enter")
            page.wait_for_function(f"Object.keys(named(point).marks).length === {count} && !sending", timeout=PATIENCE)
            each.append(1000 * (time.monotonic() - pressed))
            # Only then the page shows the next photograph, at which whoever marks looks.
            page.wait_for_function(f"sights.length === {expected} - {count}", timeout=PATIENCE)
        whole = time.monotonic() - begun
        page.close()
    return whole, each


def killed_pages(start: Any, folder: Path, kills: int, chance: random.Random) -> tuple[int, int]:
    """Kill browser or server, in turn, while Enter is pressed: how many marks were acknowledged, and how many of them are lost."""
    acknowledged: set[tuple[str, str]] = set()
    for number in range(kills):
        browser = start()
        with served_apart(folder) as address:
            page = opened(browser, address)
            if not page.evaluate("sights.length"):
                page.keyboard.press("n")
            until = time.monotonic() + chance.uniform(0.05, LONGEST)
            with suppress(Exception):
                while time.monotonic() < until:
                    page.keyboard.press("Enter")
                    acknowledged |= {(one[0], one[1]) for one in page.evaluate(_ACKNOWLEDGED)}
                    if not page.evaluate("sights.length"):
                        page.keyboard.press("n")
            if number % 2:
                _kill_browser(browser)
        with suppress(Exception):
            browser.close()
    there = kept(folder)
    return len(acknowledged), sum(photo not in there.get(point, set()) for point, photo in acknowledged)


_ACKNOWLEDGED = "unsent.length || sending ? [] : state.points.flatMap(p => Object.keys(p.marks).map(photo => [p.name, photo]))"


def _kill_browser(browser: Any) -> None:
    """End all processes of a browser of ours with -9."""
    owner = browser.orthomill_profile
    for process in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            if owner in (process / "cmdline").read_bytes().decode(errors="replace"):
                os.kill(int(process.name), signal.SIGKILL)


def main(words: list[str]) -> None:
    """Keeps the page."""
    from playwright.sync_api import sync_playwright

    kills = int(words[0]) if words else 20
    chromium = next(found for name in BROWSERS if (found := shutil.which(name)))
    with tempfile.TemporaryDirectory(prefix="marks-") as folder, sync_playwright() as driver:

        def start() -> Any:
            profile = tempfile.mkdtemp(dir=folder, prefix="profile-")
            context = driver.chromium.launch_persistent_context(
                profile, executable_path=chromium, args=list(FLAGS), bypass_csp=True
            )
            return _Pages(context, profile)

        browser = start()
        seconds, each = by_keyboard(browser, Path(folder) / "timed")
        browser.close()
        count, lost = killed_pages(start, Path(folder) / "killed", kills, random.Random(41))
    text = "\n".join(
        [
            "# The marking page in a browser",
            "",
            "A simulated block of 40 photographs, points with coordinates; Enter marks the predicted place and goes on.",
            "",
            "| what | figure |",
            "| --- | --- |",
            f"| a point in {ASKED} photographs by keyboard | {seconds:.1f} s |",
            f"| from a key until all residuals are shown | median {np.median(each):.0f} ms, longest {max(each):.0f} ms |",
            f"| page's process and browser killed with -9 in turn, {kills} times | {count} marks acknowledged, {lost} lost |",
        ]
    )
    write_page("marking_page", words, text)


class _Pages:
    """A browser with a profile of its own, which knows whose processes are its own."""

    def __init__(self, context: Any, profile: str) -> None:
        self._context, self.orthomill_profile = context, profile

    def new_page(self) -> Any:
        return self._context.new_page()

    def close(self) -> None:
        self._context.close()


if __name__ == "__main__":
    if sys.argv[1:2] == ["serve"]:
        serve(Path(sys.argv[2]))
    main(sys.argv[1:])
