"""Where a job stands on the map of tiles: in the frame of the photograph or pair that it works on, or on the ground."""

from collections.abc import Mapping

from orthomill.pipeline.engine.planned.planned_jobs import PlannedJob
from orthomill.pipeline.watching.tile_board import Panel
from orthomill.schemas.job import Export, Raster
from orthomill.schemas.raster import RasterSpec

SINGLE = "single jobs"
PER_ROW = 40
"""single jobs beside each other"""


class TilePlaces:
    """Gives every job its panel, column and row."""

    def __init__(self, specs: Mapping[str, RasterSpec]) -> None:
        self._specs = specs
        self._singles: dict[str, int] = {}

    def place(self, planned: PlannedJob) -> tuple[Panel, int, int]:
        """(panel, column, row): by the written window, in units of the raster's chunks, so that neighbours are neighbours."""
        job = planned.job
        region = None if isinstance(job, Export) else next((r for r in job.writes.values() if isinstance(r, Raster)), None)
        if region is None and (job.key[2] or job.key[3]):
            return Panel(job.stage, job.item), job.key[3], job.key[2]
        if region is None or (spec := self._specs[region.name]).full == region.window:
            number = self._singles[job.stage] = self._singles.get(job.stage, -1) + 1
            return Panel(job.stage, SINGLE), number % PER_ROW, number // PER_ROW
        ground = _ground(spec)
        across = spec.shape[1] / spec.chunk, spec.shape[0] / spec.chunk
        panel = Panel(job.stage, region.name.removeprefix(f"{job.stage}/"), ground, across, region.name)
        return panel, region.window.col // spec.chunk, region.window.row // spec.chunk


def _ground(spec: RasterSpec) -> tuple[float, float, float, float] | None:
    if spec.transform is None:
        return None
    a, _, west, _, e, north = spec.transform
    return west, north, west + a * spec.shape[1], north + e * spec.shape[0]
