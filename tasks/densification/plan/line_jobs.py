"""The rasters and jobs of vertical line locus: blocks of nodes, tiles of the surface, and the files of nodes."""

from collections.abc import Iterator

from orthomill.schemas.job import Export, Job, Raster, Reading, Table
from orthomill.schemas.observations import GROUND_POINTS
from orthomill.schemas.orientation import BLOCK as BLOCK_TABLE
from orthomill.schemas.outcome import Outcome
from orthomill.schemas.photo import photo_raster
from orthomill.schemas.raster import MapGrid, RasterSpec, map_raster, tiles_of
from orthomill.tasks.densification.line_locus.locus_block import (
    LineStatistics,
    LocusBlock,
    LocusScene,
    check_search,
    lines_scratch,
    locus_block,
    solve_lines,
    sum_lines,
    terrain_window,
)
from orthomill.tasks.densification.line_locus.node_markers import MARKERS, marker_factor
from orthomill.tasks.densification.plan.volume_jobs import GUIDE_REACH, TERRAIN, guided_terrain_plan
from orthomill.tasks.densification.settings.guide_settings import GuideFile

LINE_NODES = "densification/lines/nodes"
"""(rows, cols, 4) float32: height m and its standard error m, NaN unless accepted; correlation, and its limit"""
LINE_PHOTOGRAPHS = "densification/lines/photographs"
"""uint8, photographs that were compared"""
LINE_OUTCOME = "densification/lines/outcome"
"""uint8 `orthomill.schemas.outcome.Outcome`"""
LINES = Table("densification/lines.json", LineStatistics)


def locus_plan(scene: LocusScene, stage: str, crs: str) -> Iterator[RasterSpec | Job | Export]:
    """The blocks of nodes and their products. Raises GeometryError for a search that cannot find anything."""
    check_search(scene)
    grid, side = scene.surface.grid, scene.settings.block
    factor = marker_factor(grid.cell, scene.pixel)
    yield from _specs(grid, side, factor, crs)
    if scene.settings.start == "terrain":
        yield from guided_terrain_plan(scene.settings.guide, grid, stage, crs)
    tables = []
    for tile in tiles_of(grid.shape, side):
        tables.append(Table(f"densification/lines/{tile.row}-{tile.col}.json", LineStatistics))
        yield _block_job(locus_block(scene, tile.row, tile.col, tile.window), scene, factor, tables[-1], stage)
    yield Job(stage=stage, item="line-counts", function=sum_lines, reads={"parts": tuple(tables)}, writes={"sum": LINES})
    yield Export(stage, "nodes", "products/line_locus.xyz", "xyz", rasters={"nodes": LINE_NODES})
    yield Export(stage, "markers", "products/line_locus_nodes.tif", "cog", rasters={"nodes": MARKERS})


def _specs(grid: MapGrid, side: int, factor: int, crs: str) -> Iterator[RasterSpec]:
    # One chunk is one block, whatever the tile of the project.
    yield map_raster(LINE_NODES, grid, "float32", crs, side, nodata=float("nan"), bands=4)
    yield map_raster(LINE_PHOTOGRAPHS, grid, "uint8", crs, side)
    yield map_raster(LINE_OUTCOME, grid, "uint8", crs, side, nodata=Outcome.NOT_TRIED)
    finer = MapGrid(west=grid.west, north=grid.north, cell=grid.cell / factor, rows=grid.rows * factor, cols=grid.cols * factor)
    yield map_raster(MARKERS, finer, "uint8", crs, side * factor, nodata=0)


def _block_job(block: LocusBlock, scene: LocusScene, factor: int, table: Table[LineStatistics], stage: str) -> Job:
    reads: dict[str, Reading] = {"orientation": BLOCK_TABLE}
    if block.photos:
        reads["photos"] = tuple(Raster(photo_raster(part.name, part.level), part.window) for part in block.photos)
    if scene.settings.start == "terrain":
        reads["terrain"] = Raster(TERRAIN, terrain_window(block))
        if isinstance(scene.settings.guide, GuideFile):
            reads["reach"] = Raster(GUIDE_REACH, terrain_window(block))
    else:
        reads["points"] = GROUND_POINTS
    writes: dict[str, Raster | Table] = {
        "nodes": Raster(LINE_NODES, block.window),
        "photographs": Raster(LINE_PHOTOGRAPHS, block.window),
        "outcome": Raster(LINE_OUTCOME, block.window),
        "markers": Raster(MARKERS, block.window.scaled(factor)),
        "statistics": table,
    }
    return Job(
        stage=stage,
        item="lines",
        function=solve_lines,
        reads=reads,
        writes=writes,
        params={"block": block, "settings": scene.settings, "factor": factor},
        row=block.row,
        col=block.col,
        scratch=lines_scratch(block, scene.settings, factor),
    )
