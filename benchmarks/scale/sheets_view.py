"""How long it takes to look at an orthoimage in sheets: all of it, a part, and its pixels, from a disk and from an object store.

python -m benchmarks sheets_view [SHEETS]

SHEETS (19, as in a county) sheets along a side, all of them the same picture, joined by a virtual raster. Each view is read by a
process of its own, as 1000 x 1000 px. The object store is SeaweedFS on this machine, whose requests take a millisecond; to it every
sheet is sent.
"""

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from unittest.mock import patch

import numpy as np

from benchmarks.instrument.result_page import write_page
from orthomill.pipeline.export.file_parts import SHEET
from orthomill.pipeline.export.geotiff.band_stack import Stack
from orthomill.pipeline.export.geotiff.cloud_geotiff import write_image
from orthomill.pipeline.export.geotiff.virtual_raster import write_virtual
from orthomill.pipeline.storage.depots.bucket import bucket_of
from orthomill.schemas.raster import RasterSpec, Window
from tests.support.stores.seaweed import WEED, seaweed

NAME, ADDRESS = "products/ortho", "s3://trial/view"
VIEW = """
import sys, time, rasterio
from rasterio.windows import Window
path, off, side = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
begun = time.monotonic()
with rasterio.open(path) as file:
    opened = time.monotonic()
    shown = file.read(window=Window(off, off, side or file.width, side or file.height), out_shape=(file.count, 1000, 1000))
print(opened - begun, time.monotonic() - opened, (shown > 0).mean())
"""


@dataclass(frozen=True)
class Picture:
    """A raster that is made when it is read: stripes, opaque."""

    def read(self, name: str, window: Window) -> np.ndarray:
        """(height, width, 4) of a window."""
        values = np.full((*window.shape, 4), 255, np.uint8)
        values[..., :3] = (np.add.outer(np.arange(window.height), np.arange(window.width)) // 256 % 200 + 1)[..., None]
        return values


def main(words: list[str]) -> None:
    """Makes the sheets, looks at them, and writes the page."""
    side = int(words[0]) if words else 19
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        seconds = _make(folder, side)
        sheet, joined = folder / f"{NAME}_sheets/0-0.tif", folder / f"{NAME}.vrt"
        lines = [
            "# An orthoimage in sheets, looked at",
            "",
            f"{side} x {side} sheets of {SHEET} x {SHEET} px, {side**2 * SHEET**2 * 4 / 1e9:.0f} GB not compressed; a sheet took "
            f"{seconds:.0f} CPU-s, what joins them has {joined.stat().st_size / 1e3:.0f} kB. Every sheet is the same picture of "
            f"{sheet.stat().st_size / 1e6:.1f} MB. Views of 1000 x 1000 px; s until the file is open, and until the view is read.",
            "",
            "| from | view | open | read |",
            "| --- | --- | --- | --- |",
            *_views("a folder", str(joined), side, {}),
        ]
        if WEED:
            lines += _in_store(folder, side)
    write_page("sheets_view", words, "\n".join(lines))


def _make(folder: Path, side: int) -> float:
    """The sheets, one of them by many names, and what joins them; CPU-s of one."""
    place = {"crs": "EPSG:2100", "transform": (0.05, 0.0, 4e5, 0.0, -0.05, 4.4e6)}
    spec = RasterSpec(name="ortho", shape=(side * SHEET, side * SHEET, 4), dtype="uint8", chunk=4096, **place)
    stack, sheets = Stack({"rgba": spec}, np.dtype(np.uint8), None), folder / f"{NAME}_sheets"
    sheets.mkdir(parents=True)
    begun = time.process_time()
    write_image(stack, Picture(), Window(0, 0, SHEET, SHEET), sheets / "0-0.tif", folder)
    seconds = time.process_time() - begun
    windows = {f"{row}-{col}.tif": Window(row * SHEET, col * SHEET, SHEET, SHEET) for row in range(side) for col in range(side)}
    for name in windows:
        if name != "0-0.tif":
            os.link(sheets / "0-0.tif", sheets / name)
    write_virtual(stack, {f"{sheets.name}/{name}": window for name, window in windows.items()}, folder / f"{NAME}.vrt")
    return seconds


def _views(place: str, path: str, side: int, environment: dict[str, str]) -> Iterator[str]:
    for view, off, wide in (("all of it", 0, 0), ("four sheets", SHEET, 2 * SHEET), ("pixels", SHEET * side // 2, 1000)):
        words = [sys.executable, "-c", VIEW, path, str(off), str(wide)]
        said = subprocess.run(words, env={**os.environ, **environment}, capture_output=True, text=True, check=True).stdout.split()
        assert said[2] == "1.0", "a sheet was not found"
        yield f"| {place} | {view} | {float(said[0]):.2f} | {float(said[1]):.2f} |"


def _in_store(folder: Path, side: int) -> list[str]:
    with tempfile.TemporaryDirectory() as data, seaweed(Path(data)) as server, patch.dict(os.environ, server.environment):
        bucket = bucket_of(ADDRESS)
        for path in sorted(path for path in (folder / "products").rglob("*") if path.is_file()):
            bucket.send(path, path.relative_to(folder).as_posix())
        reached = {"AWS_S3_ENDPOINT": f"127.0.0.1:{server.s3}", "AWS_HTTPS": "NO", "AWS_VIRTUAL_HOSTING": "FALSE"}
        return list(_views("SeaweedFS", f"/vsis3/{ADDRESS.removeprefix('s3://')}/{NAME}.vrt", side, reached))
