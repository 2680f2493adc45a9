"""The smallest engine: runs the jobs of one stage on arrays in memory, and holds them to their contract."""

from dataclasses import dataclass, field
from types import SimpleNamespace

import numpy as np

from orthomill.pipeline.engine.job_signature import misfit
from orthomill.schemas.job import Job, Raster, Table
from orthomill.schemas.raster import RasterSpec
from orthomill.schemas.stage_contract import NotYet


@dataclass
class MemoryEngine:
    """Rasters and tables by name."""

    tile: int = 256
    rasters: dict[str, np.ndarray] = field(default_factory=dict)
    tables: dict[str, object] = field(default_factory=dict)
    specs: dict[str, RasterSpec] = field(default_factory=dict)
    exports: list = field(default_factory=list)
    done: set = field(default_factory=set)

    @property
    def project(self):
        return SimpleNamespace(tile=self.tile, crs="EPSG:2100")

    def table(self, table):
        if table.path not in self.tables:
            raise NotYet(table.path)
        return self.tables[table.path]

    def run(self, stage):
        """Plan and run until nothing new comes."""
        while True:
            before, pending = len(self.done), []
            try:
                for item in stage.plan(self):
                    if isinstance(item, RasterSpec):
                        self._create(item)
                    elif isinstance(item, Job):
                        pending.append(item)
                    else:
                        self.exports.append(item)
            except NotYet:
                pass
            for job in pending:
                if job.key not in self.done:
                    self._execute(job)
            if len(self.done) == before:
                return self

    def _create(self, spec):
        if spec.name not in self.specs:
            self.specs[spec.name] = spec
            self.rasters[spec.name] = np.full(spec.shape, 0 if spec.nodata is None else spec.nodata, spec.dtype)

    def _read(self, region):
        if isinstance(region, tuple):
            return tuple(map(self._read, region))
        if isinstance(region, Table):
            return self.tables[region.path]
        array = self.rasters[region.name]
        assert region.window == region.window.clipped(array.shape) and not region.window.empty
        return array[region.window.slices].copy()

    def _execute(self, job):
        assert misfit(job) is None, misfit(job)
        result = job.function(**{name: self._read(region) for name, region in job.reads.items()}, **job.params)
        result = result._asdict() if hasattr(result, "_fields") else {next(iter(job.writes)): result}
        assert all(value is None for name, value in result.items() if name not in job.writes)
        for name, region in job.writes.items():
            if isinstance(region, Raster):
                spec, value = self.specs[region.name], result[name]
                assert value.dtype == spec.dtype and value.shape[:2] == region.window.shape
                assert region.window.row % spec.chunk == 0 and region.window.col % spec.chunk == 0
                self.rasters[region.name][region.window.slices] = value
            else:
                assert isinstance(result[name], region.type)
                self.tables[region.path] = result[name]
        self.done.add(job.key)
