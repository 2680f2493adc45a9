"""The jobs that give outlined water its levels, and those that name what looks like water elsewhere."""

from collections.abc import Iterator
from math import nan

from orthomill.schemas.job import AreaFile, Export, Job, Raster, Reading, Stream, Table
from orthomill.schemas.maps.coded_areas import CodedAreas
from orthomill.schemas.maps.wanted_area import WantedArea
from orthomill.schemas.memory import array_bytes
from orthomill.schemas.raster import MapGrid, RasterSpec, Tile, Window, map_raster, tiles_of
from orthomill.schemas.surface import Surface
from orthomill.tasks.densification.plan.volume_jobs import CONFIDENCE, JUDGED_HEIGHT, volume_height
from orthomill.tasks.densification.speckle_blocks import BlockBand, block_grid, speckle_blocks
from orthomill.tasks.densification.volume.levels import SIDE
from orthomill.tasks.densification.water.water_levels import WaterLevels, shore_windows, taken_outlines, water_levels
from orthomill.tasks.densification.water.water_places import CANDIDATES, WaterPlaces, water_places

WATER_OUTLINES = Table("densification/water_outlines.json", WantedArea)
WATER = Table("densification/water.json", WaterLevels)
WATER_BLOCKS = "densification/water_blocks"
"""float32 (rows, cols, 3), see `BlockBand`"""
WATER_NUMBER = "densification/water_number"
"""uint16: number of the place that looks like water, from 1"""
WATER_PLACES = Table("densification/water_places.json", WaterPlaces)
WATER_AREAS = Table("densification/water_areas.json", CodedAreas)
_AXES = ("water_y", "water_x")
_TILE = 4 * SIDE
"""cells along a tile that is made to blocks: little is done with each"""


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


def place_plan(surface: Surface, outlined: bool, stage: str, crs: str) -> Iterator[RasterSpec | Job | Export]:
    """What looks like water and is not `outlined`: blocks tile by tile, then all of them at once."""
    coarse = block_grid(surface.grid)
    factor = round(coarse.cell / surface.grid.cell)
    yield map_raster(WATER_BLOCKS, coarse, "float32", crs, _TILE // factor, nan, bands=len(BlockBand), axes=_AXES, colours=False)
    yield map_raster(WATER_NUMBER, coarse, "uint16", crs, _TILE // factor, nodata=0, axes=_AXES)
    yield from (_blocks(tile, factor, stage) for tile in tiles_of(surface.grid.shape, _TILE))
    whole = Window(0, 0, *coarse.shape)
    reads: dict[str, Reading] = {"blocks": Raster(WATER_BLOCKS, whole)}
    if outlined:
        reads["outlined"] = WATER_OUTLINES
    yield Job(
        stage=stage,
        item="water places",
        function=water_places,
        reads=reads,
        writes={"places": WATER_PLACES, "areas": WATER_AREAS, "numbers": Raster(WATER_NUMBER, whole)},
        params={"grid": coarse, "wanted": surface.wanted, "looked_for": surface.height_high - surface.height_low},
        scratch=array_bytes(40, coarse),
    )
    yield Export(stage, "water_places", CANDIDATES, "areas", {"codes": WATER_NUMBER}, (WATER_AREAS,))


def _blocks(tile: Tile, factor: int, stage: str) -> Job:
    names = {"raw": volume_height(0), "judged": JUDGED_HEIGHT, "confidence": CONFIDENCE}
    return Job(
        stage=stage,
        item="water blocks",
        function=speckle_blocks,
        reads={key: Raster(name, tile.window) for key, name in names.items()},
        writes={"blocks": Raster(WATER_BLOCKS, tile.window.reduced(factor))},
        params={"factor": factor},
        row=tile.row,
        col=tile.col,
        scratch=array_bytes(40, tile.window),
    )
