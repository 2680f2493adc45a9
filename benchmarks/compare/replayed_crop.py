"""Densification of a part of a finished run, in this process: the orientation and images of the run, and a surface of its own.

Every method gets the same photographs, tie points, pairs and range of heights as in the run; only the map and the epipolar images
are cut to what shows the part. Jobs run one after the other, and their CPU time is counted apart from reading and from compiling.
"""

import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from numba.core.event import install_recorder
from scipy.ndimage import map_coordinates

from orthomill.pipeline.engine.execute import read_all
from orthomill.pipeline.storage.store import Store
from orthomill.schemas.epipolar import PAIRS, EpipolarPair, EpipolarPairs, epipolar_raster
from orthomill.schemas.job import Export, Job, MapFile, Raster, Region, Table
from orthomill.schemas.orientation import BLOCK
from orthomill.schemas.project import MapSurface
from orthomill.schemas.raster import MapGrid, RasterSpec, Window
from orthomill.schemas.stage_contract import NotYet
from orthomill.schemas.surface import SURFACE, Surface
from orthomill.tasks.densification.stage import DensificationStage
from orthomill.tasks.geometry.epipolar_window import box_corners, node_window

_BESIDE = 96
"""px of the epipolar images around what shows the part: room for windows and halos"""


@dataclass(frozen=True, eq=False)
class Crop:
    """A part of a finished run: `grid` is that of its surface, `window` lies on it."""

    store: Store
    window: Window

    @classmethod
    def of(cls, run: Path, centre: tuple[float, float], side: float) -> "Crop":
        """The square of `side` m about a place given as shares of the surface's width and height, on whole hundreds of cells."""
        store = Store(run)
        grid = store.table(SURFACE).grid
        cells = round(side / grid.cell)
        col, row = (int(share * size - cells / 2) // 100 * 100 for share, size in zip(centre, (grid.cols, grid.rows), strict=True))
        return cls(store, Window(row, col, cells, cells).clipped(grid.shape))

    @property
    def surface(self) -> Surface:
        whole = self.store.table(SURFACE)
        grid = whole.grid
        west, north = grid.west + self.window.col * grid.cell, grid.north - self.window.row * grid.cell
        cut = MapGrid(west=west, north=north, cell=grid.cell, rows=self.window.height, cols=self.window.width)
        return Surface(grid=cut, height_low=whole.height_low, height_high=whole.height_high)


@dataclass
class Replay:
    """A densification of a crop. After `run`: rasters and tables by name, CPU seconds by what jobs are called."""

    crop: Crop
    files: dict[str, tuple[MapGrid, np.ndarray]] = field(default_factory=dict)
    """height models that settings name, by path: their grid and heights"""
    tables: dict[str, Any] = field(default_factory=dict)
    rasters: dict[str, np.ndarray] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)
    _cuts: dict[str, tuple[Window, Window]] = field(default_factory=dict)
    _done: set[tuple] = field(default_factory=set)

    @property
    def project(self) -> SimpleNamespace:
        return SimpleNamespace(tile=512, crs=self.crop.store.table(BLOCK).crs, grid=MapSurface())

    def table(self, table: Table) -> Any:
        """As a stage asks for it while it plans."""
        if table.path in self.tables:
            return self.tables[table.path]
        if table.path.startswith("densification/"):
            raise NotYet(table.path)
        return self.crop.store.table(table)

    def has_stage(self, kind: str) -> bool:
        return False

    def run(self, stage: DensificationStage) -> "Replay":
        """All jobs of the stage."""
        surface = self.crop.surface
        self.tables[SURFACE.path] = surface
        self.tables[PAIRS.path] = EpipolarPairs(pairs=tuple(self._cut_pairs(surface)))
        self._done.add((stage.kind, "grid", 0, 0))
        complete = False
        while not complete:
            try:
                # A plan that stops for want of a table has been taken as far as it went.
                for thing in stage.plan(self):
                    self._take(thing)
                complete = True
            except NotYet:
                complete = False
        return self

    def _cut_pairs(self, surface: Surface) -> Iterator[EpipolarPair]:
        corners = box_corners(surface.grid, Window(0, 0, *surface.grid.shape), surface.height_low, surface.height_high)
        for pair in self.crop.store.table(PAIRS).pairs:
            left = node_window(pair, 1, corners).grown(_BESIDE).clipped((pair.rows, pair.left_cols))
            offset = pair.column_offset
            first, last = left.col - offset - pair.parallax_high, left.col + left.width - offset - pair.parallax_low
            right = Window(left.row, int(first), left.height, int(last - first)).clipped((pair.rows, pair.right_cols))
            if min(left.height, left.width, right.width) < 2 * _BESIDE:
                continue
            self._cuts[pair.name] = left, right
            yield pair.model_copy(
                update={
                    "row0": pair.row0 - left.row,
                    "left_col0": pair.left_col0 - left.col,
                    "right_col0": pair.right_col0 - right.col,
                    "rows": left.height,
                    "left_cols": left.width,
                    "right_cols": right.width,
                    # These belong to nine places of the whole image; the datum is common to all methods and is not compared.
                    "height_sigmas": (),
                }
            )

    def _take(self, thing: RasterSpec | Job | Export) -> None:
        if isinstance(thing, RasterSpec):
            empty = np.full(thing.shape, thing.nodata if thing.nodata is not None else 0, thing.dtype)
            self.rasters.setdefault(thing.name, empty)
        elif isinstance(thing, Job) and thing.key not in self._done:
            self._done.add(thing.key)
            self._execute(thing)

    def _execute(self, job: Job) -> None:
        with install_recorder("numba:compile") as compiled:
            result, seconds = self._timed(job)
        if compiled.buffer:
            # The compiler's time is none of the method's: now that the kernels are there the job is done once more.
            result, seconds = self._timed(job)
        self.seconds[job.item] = self.seconds.get(job.item, 0.0) + seconds
        values = result._asdict() if hasattr(result, "_fields") else {next(iter(job.writes)): result}
        for name, region in job.writes.items():
            if isinstance(region, Table):
                self.tables[region.path] = values[name]
            else:
                self.rasters[region.name][region.window.slices] = values[name]

    def _timed(self, job: Job) -> tuple[Any, float]:
        reads = {name: read_all(reading, self._read) for name, reading in job.reads.items()}
        began = time.process_time()
        result = job.function(**reads, **job.params)
        return result, time.process_time() - began

    def _read(self, region: Region) -> Any:
        if isinstance(region, Table):
            return self.table(region)
        if isinstance(region, MapFile):
            return self._model(region)
        assert isinstance(region, Raster)
        if region.name in self.rasters:
            return self.rasters[region.name][region.window.slices].copy()
        return self.crop.store.read(region.name, self._in_run(region))

    def _in_run(self, region: Raster) -> Window:
        """The window of the run's raster: epipolar images are cut, photographs are whole."""
        for name, cuts in self._cuts.items():
            for side, cut in zip(("left", "right"), cuts, strict=True):
                if region.name == epipolar_raster(name, side):
                    window = region.window
                    return Window(window.row + cut.row, window.col + cut.col, window.height, window.width)
        return region.window

    def _model(self, region: MapFile) -> np.ndarray:
        """A height model on the grid that is asked for: bilinear between its posts."""
        grid, heights = self.files[region.path]
        x, y = region.grid.centres(region.window)
        col, row = grid.pixel(*np.meshgrid(x, y))
        return map_coordinates(heights, [row, col], order=1, mode="constant", cval=np.nan).astype(np.float32)
