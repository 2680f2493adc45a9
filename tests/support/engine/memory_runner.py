"""Runs the jobs of one stage in memory and holds them to their contract: the engine without store, records and workers."""

from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import numpy as np
from scipy.ndimage import map_coordinates

from orthomill.pipeline.engine.execute import read_all
from orthomill.pipeline.engine.job_signature import misfit
from orthomill.schemas.job import Export, HeightFile, HeightHeader, Job, MapFile, MapHeader, MeshFile, PhotoPixels, Raster, Table
from orthomill.schemas.project import MapSurface
from orthomill.schemas.raster import RasterSpec
from orthomill.schemas.stage_contract import NotYet, Stage


@dataclass
class MemoryProject:
    """Rasters and tables by name; also the view that a stage plans with."""

    tile: int
    rasters: dict[str, np.ndarray] = field(default_factory=dict)
    specs: dict[str, RasterSpec] = field(default_factory=dict)
    tables: dict[str, Any] = field(default_factory=dict)
    written: dict[str, np.ndarray] = field(default_factory=dict)
    keys: set = field(default_factory=set)
    files: dict[str, Any] = field(default_factory=dict)
    """what files hold: of maps their grid and values, of meshes the mesh, of images their pixels"""
    exports: dict[tuple, Export] = field(default_factory=dict)

    @property
    def project(self):
        return SimpleNamespace(tile=self.tile, crs="EPSG:2100", project="memory", grid=MapSurface())

    def table(self, table):
        if table.path not in self.tables:
            raise NotYet(table.path)
        return self.tables[table.path]

    def raster(self, name):
        return self.specs[name]

    def image_files(self, source):
        return tuple(path for path in sorted(self.files) if path.startswith(f"{source.path}/"))

    def has_stage(self, kind):
        return False

    def put(self, name: str, array: np.ndarray) -> None:
        self.rasters[name], self.written[name] = array, np.ones(array.shape[:2], bool)

    def run(self, stage: Stage) -> None:
        """Plan and execute until planning needs nothing more."""
        complete = False
        while not complete:
            planned, complete = [], True
            try:
                planned.extend(iter_until(stage.plan(self), planned))
            except NotYet:
                complete = False
            for thing in planned:
                self._take(thing)

    def _take(self, thing) -> None:
        if isinstance(thing, RasterSpec) and thing.name not in self.specs:
            self.specs[thing.name] = thing
            self.put(thing.name, np.full(thing.shape, thing.nodata or 0, thing.dtype))
            self.written[thing.name][:] = False
        elif isinstance(thing, Job) and thing.key not in self.keys:
            self.keys.add(thing.key)
            self._execute(thing)

        elif isinstance(thing, Export):
            self.exports[thing.key] = thing

    def _execute(self, job: Job) -> None:
        assert misfit(job) is None, misfit(job)
        result = job.function(**{name: read_all(reading, self._read) for name, reading in job.reads.items()}, **job.params)
        if hasattr(result, "_fields"):
            result = result._asdict()
        elif not (isinstance(result, dict) and result.keys() == job.writes.keys()):
            result = {next(iter(job.writes)): result}
        assert all(value is None for name, value in result.items() if name not in job.writes)
        for name, region in job.writes.items():
            self._write(region, result[name])

    def _read(self, region: Raster | Table):
        if isinstance(region, Table):
            return self.tables[region.path]
        if isinstance(region, MapHeader | HeightHeader):
            return self.files[region.path][0]
        if isinstance(region, HeightFile):
            return self._heights(region)
        if isinstance(region, MapFile):
            return self.files[region.path][1][region.window.slices]
        if isinstance(region, MeshFile):
            return self.files[region.path]
        if isinstance(region, PhotoPixels):
            return self.files[region.path][region.window.slices]
        array = self.rasters[region.name]
        assert region.window == region.window.clipped(array.shape) and not region.window.empty, region
        assert self.written[region.name][region.window.slices].all(), f"read before it was written: {region}"
        return array[region.window.slices].copy()

    def _heights(self, region: HeightFile) -> np.ndarray:
        """Bilinear heights of a file at the centres of the region's cells; NaN outside."""
        grid, values = self.files[region.path]
        x, y = np.meshgrid(*region.grid.centres(region.window))
        col, row = grid.pixel(x, y)
        # Rounded, so that cells that coincide are taken as they are.
        return map_coordinates(values, [row.round(9), col.round(9)], order=1, cval=np.nan).astype(np.float32)

    def _write(self, region: Raster | Table, value) -> None:
        if isinstance(region, Table):
            assert isinstance(value, region.type), region
            self.tables[region.path] = value
            return
        spec, window = self.specs[region.name], region.window
        assert value.shape[:2] == window.shape and value.dtype == spec.dtype, (region, value.shape, value.dtype)
        assert window.row % spec.chunk == 0 and window.col % spec.chunk == 0
        assert not self.written[region.name][window.slices].any(), f"written twice: {region}"
        self.rasters[region.name][window.slices] = value
        self.written[region.name][window.slices] = True


def iter_until(plan, planned):
    """Hand over what a plan yields even when it stops with NotYet."""
    for thing in plan:
        planned.append(thing)
    return ()
