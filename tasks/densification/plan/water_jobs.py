"""The jobs that give outlined water its levels."""

from collections.abc import Iterator

from orthomill.schemas.job import AreaFile, Job, Raster, Stream, Table
from orthomill.schemas.maps.wanted_area import WantedArea
from orthomill.schemas.memory import array_bytes
from orthomill.schemas.raster import MapGrid, tiles_of
from orthomill.tasks.densification.plan.volume_jobs import CONFIDENCE, JUDGED_HEIGHT
from orthomill.tasks.densification.volume.levels import SIDE
from orthomill.tasks.densification.water import WaterLevels, shore_windows, taken_outlines, water_levels

WATER_OUTLINES = Table("densification/water_outlines.json", WantedArea)
WATER = Table("densification/water.json", WaterLevels)


def outlines_job(file: str, stage: str, crs: str) -> Job:
    """What the file says is water."""
    reads = {"outlines": AreaFile(file, crs)}
    return Job(stage=stage, item="water outlines", function=taken_outlines, reads=reads, writes={"outlines": WATER_OUTLINES})


def water_plan(outlines: WantedArea, grid: MapGrid, stage: str) -> Iterator[Job]:
    """The levels of the outlines, from the volume along their shores."""
    windows = shore_windows(outlines, grid, (tile.window for tile in tiles_of(grid.shape, SIDE)))
    yield Job(
        stage=stage,
        item="water",
        function=water_levels,
        reads={
            "outlines": WATER_OUTLINES,
            "height": Stream(tuple(Raster(JUDGED_HEIGHT, window) for window in windows)),
            "confidence": Stream(tuple(Raster(CONFIDENCE, window) for window in windows)),
        },
        writes={"levels": WATER},
        params={"grid": grid, "windows": windows},
        scratch=array_bytes(40, SIDE, SIDE),
    )
