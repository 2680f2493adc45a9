"""The rasters and jobs of the height volume, level by level."""

from collections.abc import Iterator

from orthomill.schemas.job import Job, Raster, Region
from orthomill.schemas.orientation import BLOCK as BLOCK_TABLE
from orthomill.schemas.photo import photo_raster
from orthomill.schemas.raster import RasterSpec, map_raster
from orthomill.tasks.densification.volume.levels import BLOCK, VolumeLevel, VolumeScene
from orthomill.tasks.densification.volume.volume_tile import VolumeTile, solve_volume, tile_scratch, volume_tiles


def volume_height(level: int) -> str:
    """float32 m, NaN where fewer than two photographs show the cell."""
    return f"densification/volume/{level}/height"


def volume_quality(level: int) -> str:
    """uint8 (rows, cols, 4), see `SolvedVolume.quality`."""
    return f"densification/volume/{level}/quality"


def volume_plan(scene: VolumeScene, stage: str, crs: str) -> Iterator[RasterSpec | Job]:
    """The rasters and jobs of all levels, the coarsest first; level 0 has the cells of the surface."""
    for level in scene.levels:
        yield from volume_specs(level, crs)
        for tile in volume_tiles(level, scene):
            yield _job(tile, scene, stage)


def volume_specs(level: VolumeLevel, crs: str) -> tuple[RasterSpec, RasterSpec]:
    """The rasters of a level. One chunk is one tile."""
    return (
        map_raster(volume_height(level.number), level.grid, "float32", crs, BLOCK, nodata=float("nan"), unit="m"),
        map_raster(volume_quality(level.number), level.grid, "uint8", crs, BLOCK, bands=4),
    )


def _job(tile: VolumeTile, scene: VolumeScene, stage: str) -> Job:
    reads: dict[str, Region | tuple[Region, ...]] = {"block": BLOCK_TABLE}
    if tile.photos:
        reads["photos"] = tuple(Raster(photo_raster(part.name, part.level), part.window) for part in tile.photos)
    if tile.photos and tile.coarser:
        reads["coarser"] = Raster(volume_height(tile.level.number + 1), tile.coarser)
    level = tile.level.number
    return Job(
        stage,
        f"volume {level}",
        solve_volume,
        reads,
        {"height": Raster(volume_height(level), tile.window), "quality": Raster(volume_quality(level), tile.window)},
        {"tile": tile, "settings": scene.settings},
        row=tile.row,
        col=tile.col,
        scratch=tile_scratch(tile, scene),
    )
