"""The rasters and jobs of the height volume: level by level, then one height per cell from all levels."""

from collections.abc import Iterator

from orthomill.schemas.job import Job, Raster, Region
from orthomill.schemas.orientation import BLOCK as BLOCK_TABLE
from orthomill.schemas.photo import photo_raster
from orthomill.schemas.raster import RasterSpec, Tile, map_raster, tiles_of
from orthomill.tasks.densification.volume.levels import SIDE, VolumeLevel, VolumeScene
from orthomill.tasks.densification.volume.merged_levels import LevelsUnderTile, Sureness, merge_levels
from orthomill.tasks.densification.volume.volume_tile import VolumeTile, solve_volume, tile_scratch, volume_tiles


def volume_height(level: int) -> str:
    """float32 m, NaN where fewer than two photographs show the cell."""
    return f"densification/volume/{level}/height"


def volume_quality(level: int) -> str:
    """uint8 (rows, cols, 4), see `SolvedVolume.quality`."""
    return f"densification/volume/{level}/quality"


MERGED_HEIGHT = "densification/volume/height"
"""float32 m, NaN where fewer than two photographs show the cell"""
MERGED_QUALITY = "densification/volume/quality"
"""uint8 (rows, cols, 4), see `SolvedVolume.quality`, of the level that the height comes from"""
MERGED_LEVEL = "densification/volume/level"
"""uint8, see `MergedVolume.level`"""


def volume_plan(scene: VolumeScene, sure: Sureness, stage: str, crs: str) -> Iterator[RasterSpec | Job]:
    """The rasters and jobs of all levels, the coarsest first; level 0 and what is merged have the cells of the surface."""
    for level in scene.levels:
        yield from volume_specs(level, crs)
        for tile in volume_tiles(level, scene):
            yield _job(tile, scene, stage)
    yield from _merged(scene.levels[::-1], sure, stage, crs)


def volume_specs(level: VolumeLevel, crs: str) -> tuple[RasterSpec, RasterSpec]:
    """The rasters of a level. One chunk is one tile."""
    return (
        map_raster(volume_height(level.number), level.grid, "float32", crs, SIDE, nodata=float("nan"), unit="m"),
        map_raster(volume_quality(level.number), level.grid, "uint8", crs, SIDE, bands=4),
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


def _merged(levels: tuple[VolumeLevel, ...], sure: Sureness, stage: str, crs: str) -> Iterator[RasterSpec | Job]:
    """One height per cell; levels: the finest first."""
    finest = levels[0]
    yield map_raster(MERGED_HEIGHT, finest.grid, "float32", crs, SIDE, nodata=float("nan"), unit="m")
    yield map_raster(MERGED_QUALITY, finest.grid, "uint8", crs, SIDE, bands=4)
    yield map_raster(MERGED_LEVEL, finest.grid, "uint8", crs, SIDE)
    for tile in tiles_of(finest.grid.shape, SIDE):
        yield _merging(tile, levels, sure, stage)


def _merging(tile: Tile, levels: tuple[VolumeLevel, ...], sure: Sureness, stage: str) -> Job:
    under = LevelsUnderTile.of(tile.window, [level.grid.shape for level in levels])
    windows = list(zip(levels, under.levels, strict=True))
    names = {"height": MERGED_HEIGHT, "quality": MERGED_QUALITY, "level": MERGED_LEVEL}
    return Job(
        stage,
        "volume",
        merge_levels,
        {
            "heights": tuple(Raster(volume_height(level.number), window) for level, window in windows),
            "qualities": tuple(Raster(volume_quality(level.number), window) for level, window in windows),
        },
        {key: Raster(name, tile.window) for key, name in names.items()},
        {"tile": under, "settings": sure},
        row=tile.row,
        col=tile.col,
        scratch=60 * tile.window.height * tile.window.width,
    )
