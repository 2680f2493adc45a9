"""The rasters and jobs of the height volume: level by level, then which of the finest heights count as measured."""

from collections.abc import Callable, Iterator
from typing import Any

from orthomill.schemas.epipolar import EpipolarPair
from orthomill.schemas.job import Job, MapFile, Raster, Reading, Region, Stream, Table
from orthomill.schemas.memory import array_bytes
from orthomill.schemas.observations import GROUND_POINTS
from orthomill.schemas.orientation import BLOCK as BLOCK_TABLE
from orthomill.schemas.photo import photo_raster
from orthomill.schemas.raster import MapGrid, RasterSpec, Window, map_raster, tiles_of
from orthomill.tasks.densification.canopy.canopy_heights import CanopyTile
from orthomill.tasks.densification.plan.canopy_jobs import depth_maps, depth_plan, narrow
from orthomill.tasks.densification.settings.guide_settings import ConfidenceLimits, Guide, GuideFile
from orthomill.tasks.densification.volume.confidence import JudgedSquare, judged_square
from orthomill.tasks.densification.volume.guide_heights import guided_terrain
from orthomill.tasks.densification.volume.levels import SIDE, VolumeLevel, VolumeScene
from orthomill.tasks.densification.volume.quality import Band, Judgement
from orthomill.tasks.densification.volume.terrain import terrain, terrain_grid
from orthomill.tasks.densification.volume.volume_square import (
    VolumeSquare,
    solve_square,
    square_scratch,
    square_side,
    volume_squares,
)


def volume_height(level: int) -> str:
    """float32 m, NaN where fewer than two photographs show the cell."""
    return f"densification/volume/{level}/height"


def volume_quality(level: int) -> str:
    """uint8 (rows, cols, 5), see `Band`."""
    return f"densification/volume/{level}/quality"


TERRAIN = "densification/terrain"
"""float32 m, heights of a lattice of places from the tie points, or from an existing model"""
GUIDE_REACH = "densification/guide_reach"
"""(rows, cols, 2) float32 m at the same places: how far below and above an existing model heights are looked for"""
JUDGED_HEIGHT = "densification/volume/height"
"""float32 m, NaN where fewer than two photographs show the cell"""
JUDGEMENT = "densification/volume/judgement"
"""uint8 (rows, cols, 5), see `Judgement`"""
CONFIDENCE = "densification/volume/confidence"
"""uint8 codes of Confidence"""


def volume_plan(
    scene: VolumeScene, limits: ConfidenceLimits, pairs: tuple[EpipolarPair, ...], side: int, stage: str, crs: str
) -> Iterator[RasterSpec | Job]:
    """The rasters and jobs of all levels, the coarsest first; level 0 and what is judged have the cells of the surface.

    pairs: of the block, of which narrow ones have depth maps. side: cells; as many whole tiles as there are in it are solved, and
    judged, by a job.
    """
    yield from guided_terrain_plan(scene.guide, scene.surface.grid, stage, crs, scene.reach)
    for level in scene.levels:
        yield from volume_specs(level, square_side(level, side), crs)
        for square in volume_squares(level, scene, side):
            yield _job(square, scene, stage)
    seen_alike = narrow(pairs)
    yield from depth_plan(seen_alike, stage)
    yield from _judged(scene, limits, seen_alike, SIDE * max(side // SIDE, 1), stage, crs)


def guided_terrain_plan(
    guide: Guide, surface: MapGrid, stage: str, crs: str, reach: float | None = None
) -> Iterator[RasterSpec | Job]:
    """The terrain of the whole block in one piece, for gaps between tie points may be large: from these, or from an existing
    model with them, which then says how far from it heights are looked for (`reach`, m, to both sides, where it is given)."""
    grid = terrain_grid(surface)
    # Axes of its own: rasters of one folder that share names of axes must have the same size.
    axes = "terrain_y", "terrain_x"
    yield map_raster(TERRAIN, grid, "float32", crs, SIDE, nodata=float("nan"), unit="m", axes=axes)
    whole = Window(0, 0, *grid.shape)
    reads: dict[str, Region] = {"points": GROUND_POINTS, "block": BLOCK_TABLE}
    writes: dict[str, Raster | Table] = {"heights": Raster(TERRAIN, whole)}
    params: dict[str, Any] = {"grid": grid}
    function: Callable[..., Any] = terrain
    if isinstance(guide, GuideFile):
        yield map_raster(GUIDE_REACH, grid, "float32", crs, SIDE, nodata=float("nan"), unit="m", bands=2, axes=axes)
        function, reads["guide"], writes["reach"] = (
            guided_terrain,
            MapFile(guide.path, crs, grid, whole),
            Raster(GUIDE_REACH, whole),
        )
        params.update(path=guide.path, reach=reach)
    # Tie points are predicted from one another on every size of squares, one after the other.
    scratch = array_bytes(120, grid)
    yield Job(stage=stage, item="terrain", function=function, reads=reads, writes=writes, params=params, scratch=scratch)


def volume_specs(level: VolumeLevel, side: int, crs: str) -> tuple[RasterSpec, RasterSpec]:
    """The rasters of a level. One chunk is one square of `side` cells."""
    return (
        map_raster(volume_height(level.number), level.grid, "float32", crs, side, nodata=float("nan"), unit="m"),
        map_raster(volume_quality(level.number), level.grid, "uint8", crs, side, bands=len(Band), colours=False),
    )


def _job(square: VolumeSquare, scene: VolumeScene, stage: str) -> Job:
    level, reads = square.level.number, dict[str, Reading](block=BLOCK_TABLE)
    if square.tiles:
        reads["photos"] = Stream(
            tuple(tuple(Raster(photo_raster(part.name, part.level), part.window) for part in tile.photos) for tile in square.tiles)
        )
        reads["terrain"] = Raster(TERRAIN, square.places)
        if scene.guided:
            reads["reach"] = Raster(GUIDE_REACH, square.places)
    if square.coarser:
        reads["coarser"] = Raster(volume_height(level + 1), square.coarser)
    return Job(
        stage=stage,
        item=f"volume {level}",
        function=solve_square,
        reads=reads,
        writes={"height": Raster(volume_height(level), square.window), "quality": Raster(volume_quality(level), square.window)},
        params={"square": square, "settings": scene.settings},
        row=square.row,
        col=square.col,
        scratch=square_scratch(square, scene),
    )


def _judged(
    scene: VolumeScene, limits: ConfidenceLimits, pairs: tuple[EpipolarPair, ...], side: int, stage: str, crs: str
) -> Iterator[RasterSpec | Job]:
    """Which heights of the finest level count as measured, and those of coarser levels where they stand alone."""
    grid = scene.surface.grid
    yield map_raster(JUDGED_HEIGHT, grid, "float32", crs, side, nodata=float("nan"), unit="m")
    yield map_raster(JUDGEMENT, grid, "uint8", crs, side, bands=len(Judgement), colours=False)
    yield map_raster(CONFIDENCE, grid, "uint8", crs, side)
    names = {"height": JUDGED_HEIGHT, "judgement": JUDGEMENT, "confidence": CONFIDENCE}
    shapes = [level.grid.shape for level in reversed(scene.levels)]
    for tile in tiles_of(grid.shape, side):
        judging = JudgedSquare.of(tile.window, SIDE, shapes, terrain_grid(grid).shape)
        coarser = list(enumerate(judging.levels))[1:]
        reads: dict[str, Reading] = {
            "height": Raster(volume_height(0), judging.around),
            "quality": Raster(volume_quality(0), judging.around),
            "terrain": Raster(TERRAIN, judging.places),
        }
        if coarser:
            reads["coarser_heights"] = tuple(Raster(volume_height(level), window) for level, window in coarser)
            reads["coarser_qualities"] = tuple(Raster(volume_quality(level), window) for level, window in coarser)
        canopy = CanopyTile.of(scene.surface, tile.window, pairs) if pairs else None
        if canopy and canopy.pieces:
            reads["maps"] = depth_maps(canopy)
        yield Job(
            stage=stage,
            item="volume",
            function=judged_square,
            reads=reads,
            writes={key: Raster(name, tile.window) for key, name in names.items()},
            params={"square": judging, "settings": limits, "step": scene.levels[-1].step, "canopy": canopy},
            row=tile.row,
            col=tile.col,
            # Running sums in int64 of two quantities and their slices; of the levels, five float64 bands and their copies.
            scratch=max(array_bytes(280, one.around) for one in judging.tiles) + (canopy.scratch if canopy else 0),
        )
