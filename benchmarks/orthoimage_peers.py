"""The true orthoimage beside orthority, and where its shift comes from: `python -m benchmarks orthoimage RUN [PYTHON]`.

RUN is the folder of a finished project, PYTHON the interpreter of an environment that has orthority (`pip install orthority` in an
environment of its own). Both programs get the same photographs, block, surface and cells. orthority puts one photograph after the
other on the ground, without a test of visibility and without blending; orthomill does all of it. CPU-seconds of one thread,
writing an uncompressed GeoTIFF included.
"""

import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import rasterio

from benchmarks.instrument.result_page import write_page
from benchmarks.measured_run import run_folders
from orthomill.pipeline.storage.store import Store
from orthomill.schemas.job import Job, Raster, Table
from orthomill.schemas.orientation import BLOCK, Block
from orthomill.schemas.photo import photo_raster
from orthomill.schemas.raster import MapGrid, RasterSpec, Window
from orthomill.schemas.surface import CORRECTED, HEIGHT, ORTHO, PROVENANCE, RELATIVE_PRECISION, SURFACE, Provenance, Surface
from orthomill.schemas.truth import TRUTH_BLOCK, TRUTH_GRID, TRUTH_MATERIAL, TRUTH_ORTHO, TRUTH_SURFACE, TRUTH_VISIBILITY
from orthomill.tasks.colouring.colour_settings import Balance, BlockBalance, NoBalance
from orthomill.tasks.evaluation.classes import place_classes
from orthomill.tasks.evaluation.orthoimage_accuracy import OrthoScene, fit_grey, fitted, grey_sums, shifts
from orthomill.tasks.imagery.pull_push import filled
from orthomill.tasks.texture.ground.draping import block_heights, drape
from orthomill.tasks.texture.report.texture_report import COVERAGE
from orthomill.tasks.texture.stage import TextureStage

TILE = 512
WORKER = Path(__file__).with_name("orthority_worker.py")
SURFACE_RASTERS = HEIGHT, CORRECTED, RELATIVE_PRECISION, PROVENANCE
"""what the stage reads of the surface"""
CROP = 0.4
"""share of the side of the surface whose shift is measured, around its middle"""


@dataclass
class TextureRun:
    """The stage `texture` on a finished project, in memory; `over` replaces rasters and tables by name."""

    store: Store
    over: dict[str, Any]
    project: Any
    made: dict[str, Any] = field(default_factory=dict)
    seconds: float = 0.0

    def table(self, table: Table) -> Any:
        return self._read(table)

    def raster(self, name: str) -> RasterSpec:
        return self.store.spec(name)

    def has_stage(self, kind: str) -> bool:
        return kind == "dsm_check" and CORRECTED in self.store.names()

    def run(self, stage: TextureStage, crop: Window | None = None) -> None:
        """All jobs; of the tiles of the orthoimage only those that touch `crop`, cells of the surface model."""
        for one in stage.plan(self):
            if isinstance(one, RasterSpec):
                self.made[one.name] = np.full(one.shape, one.nodata or 0, one.dtype)
            elif isinstance(one, Job) and one.item != "report" and (one.item != "ortho" or _touch(one.params["extent"].core, crop)):
                self._execute(one)

    def _execute(self, job: Job) -> None:
        started = time.process_time()
        reads = {name: tuple(map(self._read, r)) if isinstance(r, tuple) else self._read(r) for name, r in job.reads.items()}
        result = job.function(**reads, **job.params)
        self.seconds += time.process_time() - started
        values = result._asdict() if hasattr(result, "_asdict") else {next(iter(job.writes)): result}
        for name, region in job.writes.items():
            if isinstance(region, Raster):
                self.made[region.name][region.window.slices] = values[name]
            else:
                self.made[region.path] = values[name]

    def _read(self, region: Any) -> Any:
        name = region.name if isinstance(region, Raster) else region.path
        for known in (self.made, self.over):
            if name in known:
                return known[name][region.window.slices] if isinstance(region, Raster) else known[name]
        return self.store.read(name, region.window) if isinstance(region, Raster) else self.store.table(region)


def _touch(one: Window, other: Window | None) -> bool:
    return other is None or not one.overlap(other).empty


def texture_run(store: Store, **over: Any) -> TextureRun:
    """A run of the stage with replaced rasters and tables, by name."""
    return TextureRun(store, over, SimpleNamespace(tile=TILE))


@dataclass(frozen=True)
class Speed:
    """What a program did: pixels of photographs that it put on the ground, pixels of the orthoimage, CPU-seconds."""

    name: str
    photo_pixels: int
    ortho_pixels: int
    seconds: float

    def row(self) -> str:
        photo, ortho = self.photo_pixels / 1e6, self.ortho_pixels / 1e6
        whole = f"{ortho:.1f} | {ortho / self.seconds:.2f}" if ortho else "- | -"
        return f"| {self.name} | {photo:.1f} | {self.seconds:.1f} | {photo / self.seconds:.1f} | {whole} |"


def _write(path: Path, values: np.ndarray, crs: str | None = None, grid: MapGrid | None = None) -> None:
    """An uncompressed tiled GeoTIFF of (rows, cols) or (rows, cols, bands)."""
    bands = values[..., None] if values.ndim == 2 else values
    height, width, count = bands.shape
    place = {"crs": crs, "transform": rasterio.Affine(*grid.transform)} if grid else {}
    with rasterio.open(path, "w", "GTiff", width, height, count, dtype=bands.dtype, tiled=True, **place) as target:
        target.write(np.moveaxis(bands, 2, 0))


def own_speed(name: str, store: Store, folder: Path, balance: Balance) -> tuple[Speed, float]:
    """orthomill's speed, and the cell of its orthoimage (m); `folder` holds the photographs as GeoTIFFs."""
    # Both read plain files: decoding the chunks of the store is no part of making an orthoimage.
    names = [name for name in store.names() if name.startswith("photos/") or name in SURFACE_RASTERS]
    rasters = {name: store.read(name, store.spec(name).full) for name in names}
    texture_run(store, **rasters).run(TextureStage(balance=balance), crop=Window(0, 0, 1, 1))  # compiles
    run = texture_run(store, **rasters)
    run.run(TextureStage(balance=balance))
    started = time.process_time()
    for photo in store.table(BLOCK).names:
        with rasterio.open(folder / f"{photo}.tif") as source:
            source.read()
    surface = store.table(SURFACE)
    divisor = run.made[ORTHO].shape[0] // surface.grid.rows
    grid = surface.grid.model_copy(update={"cell": surface.grid.cell / divisor})
    _write(folder / "ortho.tif", run.made[ORTHO], store.table(BLOCK).crs, grid)
    coverage = run.made[COVERAGE]
    seconds = run.seconds + time.process_time() - started
    return Speed(name, int(coverage.sum(dtype=np.int64)), int((coverage > 0).sum()), seconds), grid.cell


def write_photographs(store: Store, folder: Path) -> None:
    """The photographs as both programs read them."""
    for name in store.table(BLOCK).names:
        spec = store.spec(photo_raster(name))
        _write(folder / f"{name}.tif", store.read(spec.name, spec.full))


def peer_task(store: Store, folder: Path, cell: float) -> Path:
    """The same block, surface and cells as orthority takes them."""
    block, surface = store.table(BLOCK), store.table(SURFACE)
    name = CORRECTED if CORRECTED in store.names() else HEIGHT
    whole = Window(0, 0, *surface.grid.shape)
    heights = store.read(name, whole)
    blocks = filled(block_heights(heights, np.zeros_like(heights), surface.grid.cell).blocks)
    _write(folder / "surface.tif", drape(heights, whole, blocks, Window(0, 0, *blocks.shape)), block.crs, surface.grid)
    task = {"crs": block.crs, "cell": cell, "folder": str(folder), "dem": str(folder / "surface.tif")}
    path = folder / "task.json"
    path.write_text(json.dumps(task | {"photos": [_peer_photo(store, block, name, folder) for name in block.names]}))
    return path


def _peer_photo(store: Store, block: Block, name: str, folder: Path) -> dict[str, Any]:
    camera, orientation = block.camera_of(name), block.of(name)
    lens = {key: camera.value(key) for key in ("c", "x0", "y0", "k1", "k2", "k3", "p1", "p2")}
    place = {"centre": orientation.centre, "omega_phi_kappa": orientation.omega_phi_kappa}
    return {"name": name, "file": str(folder / f"{name}.tif"), "size": (camera.width, camera.height), **lens, **place}


def peer_speed(python: str, task: Path) -> Speed:
    """orthority's speed. Raises CalledProcessError when it is not installed there."""
    done = subprocess.run([python, str(WORKER), str(task)], capture_output=True, text=True, check=True)
    found = json.loads(done.stdout.splitlines()[-1])
    return Speed("orthority", found["pixels"], 0, found["seconds"])


# --- where the shift comes from -----------------------------------------------------------------------------------------------


def shift_rows(store: Store) -> Iterator[str]:
    """The mean shift of a crop with the true and the adjusted orientation, on true and on measured heights."""
    truth, surface = store.table(TRUTH_GRID), store.table(SURFACE)
    fine = round(surface.grid.cell / truth.cell)
    grid = surface.grid.model_copy(update={"cell": truth.cell, "rows": surface.grid.rows * fine, "cols": surface.grid.cols * fine})
    corner = round((truth.north - grid.north) / truth.cell), round((grid.west - truth.west) / truth.cell)
    rows, cols = (int(CROP * side) // 2 * 2 for side in surface.grid.shape)
    crop = Window((surface.grid.rows - rows) // 2, (surface.grid.cols - cols) // 2, rows, cols)
    own = Window(0, 0, *grid.shape)
    true_heights = store.read(TRUTH_SURFACE, Window(*corner, *grid.shape)).astype(np.float32)
    codes = np.full(grid.shape, Provenance.AGREED, np.uint8)
    measured = {"heights": "measured", "surface": surface, "crop": crop, "over": {}}
    given = {HEIGHT: true_heights, CORRECTED: true_heights, PROVENANCE: codes, RELATIVE_PRECISION: np.zeros_like(true_heights)}
    fine_surface = Surface(grid=grid, height_low=surface.height_low, height_high=surface.height_high)
    true = {"heights": "true", "surface": fine_surface, "crop": crop.scaled(fine), "over": given}
    place = crop.scaled(fine).clipped(own.shape)
    for name, block in (("true", store.table(TRUTH_BLOCK)), ("adjusted", store.table(BLOCK))):
        for case in (true, measured):
            run = texture_run(store, **{BLOCK.path: block, SURFACE.path: case["surface"], **case["over"]})
            run.run(TextureStage(cell=truth.cell), case["crop"])
            ortho = run.made[ORTHO][place.slices]
            yield f"| {name} | {case['heights']} | {_mean_shift(store, ortho, place, corner)} |"


def _mean_shift(store: Store, ortho: np.ndarray, place: Window, corner: tuple[int, int]) -> str:
    source = Window(place.row + corner[0], place.col + corner[1], *place.shape)
    colours = store.read(TRUTH_ORTHO, source).astype(np.float32)
    material, seen = store.read(TRUTH_MATERIAL, source), np.bitwise_count(store.read(TRUTH_VISIBILITY, source)).astype(np.uint8)
    painted = fitted(ortho, fit_grey((grey_sums(ortho, colours),)))
    scene = OrthoScene(Window(0, 0, *place.shape), painted, colours, ortho[..., 3] > 0, material, seen, np.ones(seen.shape, bool))
    found = shifts(scene, Window(0, 0, *place.shape), place_classes(material))
    known = np.isfinite(found.dx) & (found.seen > 0)
    return f"{found.dx[known].mean():+.3f} | {found.dy[known].mean():+.3f} | {int(known.sum())}"


def main(words: list[str]) -> None:
    """Measure both programs on a run, and the shift where the truth is known; write benchmarks/results/orthoimage.md."""
    (folder,), python = run_folders(words[:1], "volos"), words[1] if len(words) > 1 else sys.executable
    store = Store(folder)
    with tempfile.TemporaryDirectory() as scratch:
        write_photographs(store, Path(scratch))
        whole, cell = own_speed("orthomill", store, Path(scratch), BlockBalance())
        plain, _ = own_speed("orthomill, brightness not balanced", store, Path(scratch), NoBalance(kind="none"))
        peer = peer_speed(python, peer_task(store, Path(scratch), cell))
    lines = [
        "# The true orthoimage beside orthority, and its shift",
        "",
        f"One thread; the same photographs, block, surface and cells of {cell:g} m. orthority puts single photographs on the",
        "ground; orthomill also tests what each of them sees, balances their brightness, rejects outlying colours and blends.",
        "Photo pixels: values of photographs put on the ground.",
        "",
        "| program | photo Mpx | CPU-s | photo Mpx per CPU-s | orthoimage Mpx | orthoimage Mpx per CPU-s |",
        "| --- | --- | --- | --- | --- | --- |",
        whole.row(),
        plain.row(),
        peer.row(),
        "",
    ]
    if TRUTH_ORTHO in store.names():
        lines += [
            "Mean shift against the true orthoimage (px, right and down; least-squares matching at nodes around the middle):",
            "",
            "| orientation | heights | right | down | nodes |",
            "| --- | --- | --- | --- | --- |",
            *shift_rows(store),
            "",
            "What is left with true orientations and heights is the texture's own. The rest is the datum of the block: errors of",
            "the measurements of its control points, which no orthoimage can remove.",
            "",
        ]
    write_page("orthoimage", words, "\n".join(lines))
