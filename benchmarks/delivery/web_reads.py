"""What programs of the web say of the models of a run: `python -m benchmarks web_reads RUN MODULES`.

MODULES is the `node_modules` of a folder in which `npm install cesium gltf-validator` was typed. Khronos' validator judges every
GLB, and CesiumJS opens the 3D Tiles in a Chromium without a window and is asked for heights.
"""

import json
import subprocess
import threading
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2
import numpy as np
import rasterio
from pyproj import CRS, Transformer

from benchmarks.delivery.browser_page import page_says
from benchmarks.instrument.result_page import ROOT, write_page
from benchmarks.measured_run import orthomill, run_folders

HERE = Path(__file__).parent
PICTURE = ROOT / "docs" / "pictures" / "cesium.jpg"
PLACES, FLAT, SEED = 300, 0.3, 40
"""heights that are asked for, and m that the four cells around such a place differ by at most"""


def main(words: list[str]) -> None:
    """Exports both models, has them judged and opened, and writes the page and the picture of the documentation."""
    run, modules = run_folders(words[:1], "volos_small")[0].absolute(), Path(words[1]).resolve()
    for form in ("glb", "3dtiles"):
        ended = orthomill(run.parents[1], "export", run.name, "--as", form)
        if ended.code:
            raise SystemExit(ended.output)
    exported = run / "products" / "exported"
    model, tiles = exported / "dsm.glb", exported / "dsm_3dtiles"
    judged = _judged(modules, [model, *sorted(tiles.rglob("*.glb"))])
    places, heights = _flat_places(run / "products" / "dsm.tif")
    opened = _opened(modules, tiles, places)
    if not opened["heights"]:
        raise SystemExit(f"CesiumJS cannot open the tiles: {opened['failed']}")
    answers = np.array([np.nan if z is None else z for z in opened["heights"]], dtype=np.float64)  # type: ignore[attr-defined]
    off = answers - heights
    rows = [
        f"| Khronos glTF validator {judged[0]['version']} | {len(judged)} GLB | {sum(one['errors'] for one in judged)} errors, "
        f"{sum(one['warnings'] for one in judged)} warnings |",
        f"| CesiumJS {opened['version']} | 3D Tiles, all levels | {len(opened['failed'])} tiles failed |",  # type: ignore[arg-type]
        f"| the same, asked for heights | {np.isfinite(off).sum()} of {len(off)} places answered | "
        f"median {np.nanmedian(off):+.3f} m, root mean square {np.sqrt(np.nanmean(off**2)):.3f} m, "
        f"largest {np.nanmax(np.abs(off)):.3f} m from dsm.tif |",
    ]
    lines = [
        "# Models in programs of the web",
        "",
        f"Places: of `dsm.tif`, where the four cells around differ by {FLAT:g} m at most; heights are transformed by PROJ",
        "to those above WGS 84's ellipsoid, as the tiles have them. The picture is docs/pictures/cesium.jpg.",
        "",
        "| program | of what | found |",
        "| --- | --- | --- |",
        *rows,
    ]
    write_page("web_reads", words, "\n".join(lines) + "\n")


def _judged(modules: Path, files: list[Path]) -> list[dict[str, int]]:
    ended = subprocess.run(["node", HERE / "glb_verdicts.cjs", modules, *files], capture_output=True, text=True)
    if ended.returncode:
        raise SystemExit(f"The validator does not run: {ended.stderr.strip().splitlines()[-1:]}; was it installed there?")
    found: list[dict[str, int]] = json.loads(ended.stdout)
    return found


def _flat_places(file: Path) -> tuple[np.ndarray, np.ndarray]:
    """(n, 2) longitude and latitude of places between four cells of nearly one height, and (n,) heights above the ellipsoid, m."""
    with rasterio.open(file) as dsm:
        cells, transform, crs = dsm.read(1, masked=True).filled(np.nan), dsm.transform, CRS(dsm.crs.to_wkt())
    four = np.stack([cells[:-1, :-1], cells[1:, :-1], cells[:-1, 1:], cells[1:, 1:]])
    rows, cols = np.nonzero(np.ptp(four, axis=0) <= FLAT)
    some = np.random.default_rng(SEED).choice(len(rows), PLACES, replace=False)
    rows, cols = rows[some], cols[some]
    x, y = transform * (cols + 1.0, rows + 1.0)
    upright = crs if len(crs.axis_info) == 3 else crs.to_3d()
    to_globe = Transformer.from_crs(upright, "EPSG:4979", always_xy=True)
    lon, lat, z = to_globe.transform(x, y, four.mean(axis=0)[rows, cols].astype(np.float64))
    return np.column_stack([lon, lat]), np.asarray(z)


def _opened(modules: Path, tiles: Path, places: np.ndarray) -> dict[str, object]:
    """What the page of CesiumJS found; a picture of it is kept."""
    with TemporaryDirectory() as folder:
        root = Path(folder)
        (root / "cesium").symlink_to(modules / "cesium")
        (root / "tiles").symlink_to(tiles)
        page = (HERE / "cesium_page.html").read_text().replace("PLACES", json.dumps(places.tolist()))
        (root / "index.html").write_text(page)
        server = ThreadingHTTPServer(("127.0.0.1", 0), partial(_Quiet, directory=folder))
        threading.Thread(target=server.serve_forever, daemon=True).start()
        try:
            found = page_says(f"http://127.0.0.1:{server.server_port}/index.html", root / "shot.png")
        finally:
            server.shutdown()
        cv2.imwrite(str(PICTURE), cv2.imread(str(root / "shot.png")), [cv2.IMWRITE_JPEG_QUALITY, 85])
    return found


class _Quiet(SimpleHTTPRequestHandler):
    def log_message(self, format: str, *args: object) -> None:
        """Nothing: the study prints its page only."""
