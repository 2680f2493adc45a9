"""The viewer of an orthoimage of a gigapixel in a browser, from the disk: how soon it shows a picture, and every zoom after that.

python -m benchmarks large_map [SIDE]

The pyramid has the tiles that a run would write, a few pictures under all their names. Needs Playwright and a Chromium.
"""

import os
import random
import shutil
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from benchmarks.instrument.result_page import write_page
from orthomill.pipeline.export.viewer.tile_pyramid import QUALITY, Run, runs_of
from orthomill.pipeline.export.viewer.viewer_page import page_text
from orthomill.pipeline.report.paper import BROWSERS, FLAGS
from orthomill.schemas.maps.map_parts import TILE

FOLDER = "viewer"
CELL = 0.05
"""m"""
DIFFERENT = 16
PLACES = 12
"""at each zoom"""
DEVICES = {"laptop": (1440, 900), "telephone": (390, 844)}
LOADED = (
    "() => { const tiles = [...document.querySelectorAll('img.tile')]; "
    "return tiles.length > 0 && tiles.every(one => one.complete && one.naturalWidth); }"
)
MOVED = (
    "([x, y, zoom]) => { const l = OM.layers[0]; "
    "om.map.setView([l.north - y * l.rows * l.cell, l.west + x * l.cols * l.cell], zoom, {animate: false}); }"
)


def write_map(folder: Path, side: int) -> int:
    """A page over a pyramid of side x side px; returns the bytes of the page."""
    samples = _samples(folder)
    levels: dict[int, list[Run]] = {}
    while not levels or TILE << (len(levels) - 1) < side:
        level = len(levels)
        along = -(-side // (TILE << level))
        names = [f"{row}-{col}.jpg" for row in range(along) for col in range(along)]
        place = folder / FOLDER / "0" / str(level)
        place.mkdir(parents=True)
        for number, name in enumerate(names):
            os.link(samples[number % DIFFERENT], place / name)
        levels[level] = list(runs_of(tuple(names)))
    layer = {"title": "Orthoimage", "caption": "", "style": "rgb", "folder": f"{FOLDER}/0", "size": TILE, "levels": levels}
    layer |= {"legend": {"classes": [], "colours": [], "low": None, "high": None, "unit": ""}}
    layer |= {"west": 500000.0, "north": 5000000.0, "cell": CELL, "rows": side, "cols": side}
    data: dict[str, Any] = {"project": "large", "system": "", "layers": [layer], "cameras": [], "lines": None, "cloud": None}
    text = page_text(data).encode()
    (folder / "index.html").write_bytes(text)
    return len(text)


def _samples(folder: Path) -> list[Path]:
    """Pictures as full of detail as a town from the air: 1.5 bits a pixel and more."""
    rng, out = np.random.default_rng(40), []
    for number in range(DIFFERENT):
        noise = cv2.GaussianBlur(rng.normal(0, 1, (TILE, TILE, 3)).astype(np.float32), (0, 0), 1.5)
        path = folder / f"sample{number}.jpg"
        cv2.imwrite(str(path), np.clip(120 + 160 * noise, 0, 255), [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
        out.append(path)
    return out


def timed(browser: Any, address: str, size: tuple[int, int]) -> tuple[float, list[float]]:
    """ms until the first picture is there, and of every change of zoom and place after it."""
    context = browser.new_context(viewport={"width": size[0], "height": size[1]})
    page = context.new_page()
    begun = time.monotonic()
    page.goto(address)
    page.wait_for_function(LOADED)
    first, each, chance = 1000 * (time.monotonic() - begun), [], random.Random(1)
    low, high = page.evaluate("[om.map.getMinZoom(), om.map.getMaxZoom()]")
    for zoom in np.arange(np.ceil(low), high - 2):
        for _ in range(PLACES):
            begun = time.monotonic()
            page.evaluate(MOVED, [chance.random(), chance.random(), float(zoom)])
            page.wait_for_function(LOADED)
            each.append(1000 * (time.monotonic() - begun))
    context.close()
    return first, each


def main(words: list[str]) -> None:
    """Keeps the page."""
    from playwright.sync_api import sync_playwright

    side = int(words[0]) if words else 32768
    chromium = next(found for name in BROWSERS if (found := shutil.which(name)))
    lines = ["| screen | first picture, ms | a zoom, median ms | 95 % | longest |", "| --- | --- | --- | --- | --- |"]
    with tempfile.TemporaryDirectory(prefix="map-") as folder, sync_playwright() as driver:
        size = write_map(Path(folder), side)
        browser = driver.chromium.launch(executable_path=chromium, args=list(FLAGS))
        for device, shape in DEVICES.items():
            first, each = timed(browser, (Path(folder) / "index.html").as_uri(), shape)
            lines.append(f"| {device} | {first:.0f} | {np.median(each):.0f} | {np.quantile(each, 0.95):.0f} | {max(each):.0f} |")
        browser.close()
    preface = f"{side} x {side} px ({side * side / 1e9:.2f} Gpx) from the disk; the page without its tiles has {size / 1e6:.2f} MB."
    write_page("large_map", words, "\n".join(["# A large map in a browser", "", preface, "", *lines]))


if __name__ == "__main__":
    main(sys.argv[1:])
