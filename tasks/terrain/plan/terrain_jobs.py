"""The jobs of the terrain: blocks of the surface, their ground, what hiding it tells, bridges, cells, points, and what is taken
away."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from math import nan

from orthomill.schemas.bare_ground import (
    ABOVE_GROUND,
    CELL_CLASS,
    TERRAIN,
    TERRAIN_CODE,
    TERRAIN_PRECISION,
    TERRAIN_RELATIVE,
    point_classes_table,
)
from orthomill.schemas.job import Export, Job, Raster, Reading, Table
from orthomill.schemas.memory import array_bytes
from orthomill.schemas.orientation import BLOCK
from orthomill.schemas.raster import MapGrid, RasterSpec, Tile, Window, map_raster, tiles_of
from orthomill.schemas.stage_contract import ProjectView
from orthomill.schemas.stage_report import report_table
from orthomill.schemas.surface import CORRECTED, DATUM_PRECISION, HEIGHT, PROVENANCE, RELATIVE_PRECISION, SURFACE, points_table
from orthomill.tasks.terrain.ground import block_heights, bridges, evened_ground, hidden_ground
from orthomill.tasks.terrain.ground.learned_errors import FillErrors, GroundSamples, learned_errors
from orthomill.tasks.terrain.ground.terrain_cells import blocks_around
from orthomill.tasks.terrain.plan.contour_jobs import INTERVAL, contour_jobs
from orthomill.tasks.terrain.report.terrain_report import TerrainFacts, terrain_report
from orthomill.tasks.terrain.stage import DrawContours, TerrainStage
from orthomill.tasks.terrain.terrain_sums import TerrainSums, sums_of_tile
from orthomill.tasks.terrain.terrain_tile import (
    TerrainRules,
    blocks_of_tile,
    bridge_tile,
    classify_points,
    filter_tile,
    ground_of_tile,
    tell_of_tile,
    terrain_tile,
)

BLOCKS = "terrain/blocks"
"""float32 m (rows, cols, 3): height of blocks of cells, its standard error among neighbours, that of the datum; NaN where too
little was measured"""
KEPT = "terrain/kept"
"""uint8 (rows, cols): 1 for blocks that the filter keeps"""
GROUND = "terrain/ground"
"""uint8 (rows, cols): 0 for blocks that are no ground; blocks to the nearest such one for ground, up to the margin and one more"""
EXPECTED = "terrain/expected"
"""float32 (rows, cols, 4): of ground beside objects, what `told_by_ground` expects there"""
BARE = "terrain/bare"
"""float32 m (rows, cols, 4): the bare ground of blocks, its standard error, that of the datum, and what was added beside objects"""
OPEN_SIDE = "terrain/open_side"
"""uint8 (rows, cols): the widest angle without ground around a block"""
ERRORS = Table("terrain/fill_errors.json", FillErrors)
BLOCKS_OF_WIDEST = 60
"""blocks along the widest object: enough to see its shape"""
MOST_CELLS = 64
"""cells along a block: tiles are a multiple of it"""
_SAMPLE = 200
"""bytes of a sample of hidden ground and its copies"""
BLOCK_AXES = ("block_y", "block_x")
_CELL_RASTERS = {
    "height": TERRAIN,
    "precision": TERRAIN_PRECISION,
    "relative": TERRAIN_RELATIVE,
    "code": TERRAIN_CODE,
    "above": ABOVE_GROUND,
    "cell_class": CELL_CLASS,
}


@dataclass(frozen=True, eq=False)
class TerrainJobs:
    """The jobs of a project."""

    view: ProjectView
    settings: TerrainStage

    @cached_property
    def grid(self) -> MapGrid:
        """Of the surface model."""
        return self.view.table(SURFACE).grid

    @cached_property
    def rules(self) -> TerrainRules:
        """How ground is found."""
        asked, cell, factor = self.settings, self.grid.cell, 1
        while factor < MOST_CELLS and 2 * factor * cell <= asked.widest_object / BLOCKS_OF_WIDEST:
            factor *= 2
        return TerrainRules(
            cell=cell,
            factor=factor,
            widest=asked.widest_object,
            slope=asked.slope,
            steepest=asked.steepest,
            roughness=asked.roughness,
            reach=asked.max_gap,
            extent=self.grid.cell * min(self.grid.shape),
        )

    @cached_property
    def coarse(self) -> MapGrid:
        """The grid of the blocks."""
        grid, factor = self.grid, self.rules.factor
        shape = {"rows": -(-grid.rows // factor), "cols": -(-grid.cols // factor)}
        return MapGrid(west=grid.west, north=grid.north, cell=grid.cell * factor, **shape)

    @cached_property
    def tiles(self) -> list[Tile]:
        """Of the surface model."""
        return list(tiles_of(self.grid.shape, self.view.project.tile))

    @cached_property
    def heights(self) -> str:
        """The raster of heights."""
        return CORRECTED if self.view.has_stage("dsm_check") else HEIGHT

    def all(self) -> Iterator[RasterSpec | Job | Export]:
        """All jobs."""
        yield from self._rasters()
        for of_tile in (self._blocks, self._kept, self._ground, self._told):
            yield from map(of_tile, self.tiles)
        parts = {"parts": tuple(_samples_table(tile) for tile in self.tiles)}
        yield Job(
            stage="terrain",
            item="learned",
            function=learned_errors,
            reads=parts,
            writes={"errors": ERRORS},
            params={"cell": self.rules.block, "rings": self.rules.margin},
            scratch=array_bytes(_SAMPLE, self.coarse) // hidden_ground.STRIDE**2,
        )
        for of_tile in (self._bridge, self._cells, self._points, self._sums):
            yield from map(of_tile, self.tiles)
        if isinstance(self.settings.contours, DrawContours):
            yield from contour_jobs(self.settings.contours, self.grid, self.view.project.tile, self._sums_tables)
        yield self._report()
        bands = {"height": TERRAIN, "precision": TERRAIN_PRECISION, "code": TERRAIN_CODE, "relative": TERRAIN_RELATIVE}
        yield Export("terrain", "terrain", "products/terrain.tif", "cog", bands)
        yield Export("terrain", "above", "products/height_above_ground.tif", "cog", {"above": ABOVE_GROUND})
        yield Export("terrain", "classes", "products/classes.tif", "cog", {"class": CELL_CLASS})

    def _rasters(self) -> Iterator[RasterSpec]:
        grid, crs, size = self.grid, self.view.table(BLOCK).crs, self.view.project.tile
        for name in (TERRAIN, TERRAIN_PRECISION, TERRAIN_RELATIVE, ABOVE_GROUND):
            yield map_raster(name, grid, "float32", crs, size, nodata=nan, unit="m")
        for name in (TERRAIN_CODE, CELL_CLASS):
            yield map_raster(name, grid, "uint8", crs, size, nodata=0)
        coarse, chunk = self.coarse, size // self.rules.factor
        for name, bands in ((BLOCKS, block_heights.BANDS), (EXPECTED, hidden_ground.BANDS), (BARE, bridges.BANDS)):
            yield map_raster(name, coarse, "float32", crs, chunk, nodata=nan, unit="m", bands=bands, axes=BLOCK_AXES, colours=False)
        for name in (KEPT, GROUND, OPEN_SIDE):
            yield map_raster(name, coarse, "uint8", crs, chunk, axes=BLOCK_AXES)

    def _core(self, tile: Tile) -> Window:
        """The blocks of a tile."""
        return tile.window.reduced(self.rules.factor)

    def _job(self, tile: Tile, item: str, function: Callable, reads: dict, writes: dict, params: dict, scratch: int) -> Job:
        return Job(
            stage="terrain",
            item=item,
            function=function,
            reads=reads,
            writes=writes,
            params=params,
            row=tile.row,
            col=tile.col,
            scratch=scratch,
        )

    def _blocks(self, tile: Tile) -> Job:
        names = {"heights": self.heights, "sigma": RELATIVE_PRECISION, "datum": DATUM_PRECISION, "provenance": PROVENANCE}
        reads = {key: Raster(name, tile.window) for key, name in names.items()}
        writes = {"blocks": Raster(BLOCKS, self._core(tile))}
        # Three float64 copies in blocks, and their masks.
        scratch = array_bytes(64, tile.window)
        return self._job(tile, "blocks", blocks_of_tile, reads, writes, {"rules": self.rules}, scratch)

    def _kept(self, tile: Tile) -> Job:
        core = self._core(tile)
        window = core.grown(self.rules.filter_halo).clipped(self.coarse.shape)
        reads = {"blocks": Raster(BLOCKS, window)}
        params = {"window": window, "core": core, "rules": self.rules}
        return self._job(tile, "kept", filter_tile, reads, {"kept": Raster(KEPT, core)}, params, 48 * window.cells)

    def _ground(self, tile: Tile) -> Job:
        core = self._core(tile)
        window = core.grown(self.rules.ground_halo).clipped(self.coarse.shape)
        reads = {"blocks": Raster(BLOCKS, window), "kept": Raster(KEPT, window)}
        params = {"window": window, "core": core, "rules": self.rules}
        # Numbers and extents of patches, and what waits to be numbered.
        return self._job(tile, "ground", ground_of_tile, reads, {"ground": Raster(GROUND, core)}, params, 136 * window.cells)

    def _told(self, tile: Tile) -> Job:
        core, shift = self._core(tile), self.rules.shift
        window = core.grown(self.rules.fill_halo).clipped(self.coarse.shape)
        moved = Window(window.row + shift, window.col + shift, window.height, window.width).clipped(self.coarse.shape)
        reads: dict[str, Reading] = {"blocks": Raster(BLOCKS, window), "ground": Raster(GROUND, window)}
        if not moved.empty:
            reads["moved"] = Raster(GROUND, moved)
        writes = {"samples": _samples_table(tile), "expected": Raster(EXPECTED, core)}
        params = {"window": window, "core": core, "rules": self.rules}
        return self._job(tile, "told", tell_of_tile, reads, writes, params, 192 * window.cells)

    def _bridge(self, tile: Tile) -> Job:
        core = self._core(tile)
        window = core.grown(self.rules.fill_halo).clipped(self.coarse.shape)
        reads: dict[str, Reading] = {
            "blocks": Raster(BLOCKS, window),
            "ground": Raster(GROUND, window),
            "expected": Raster(EXPECTED, window),
            "errors": ERRORS,
        }
        writes = {"bare": Raster(BARE, core), "open_side": Raster(OPEN_SIDE, core)}
        params = {"window": window, "core": core, "rules": self.rules}
        return self._job(tile, "bridge", bridge_tile, reads, writes, params, 240 * window.cells)

    def _cells(self, tile: Tile) -> Job:
        window = tile.window.grown(self.rules.roofs.halo).clipped(self.grid.shape)
        blocks = blocks_around(window, self.rules.factor, self.coarse.shape).grown(evened_ground.REACH).clipped(self.coarse.shape)
        names = {"heights": self.heights, "sigma": RELATIVE_PRECISION, "provenance": PROVENANCE}
        reads: dict[str, Reading] = {"surface": SURFACE, **{key: Raster(name, window) for key, name in names.items()}}
        reads |= {key: Raster(name, blocks) for key, name in (("bare", BARE), ("open_side", OPEN_SIDE), ("ground", GROUND))}
        writes = {key: Raster(name, tile.window) for key, name in _CELL_RASTERS.items()}
        params = {"windows": (window, blocks), "core": tile.window, "rules": self.rules}
        # Of the blocks, four float64 arrays and the bands.
        scratch = 160 * window.cells + 64 * blocks.cells
        return self._job(tile, "cells", terrain_tile, reads, writes, params, scratch)

    def _points(self, tile: Tile) -> Job:
        reads: dict[str, Reading] = {"points": points_table(tile.row, tile.col)}
        reads |= {key: Raster(_CELL_RASTERS[key], tile.window) for key in ("height", "precision", "cell_class")}
        writes = {"classes": point_classes_table(tile.row, tile.col)}
        params = {"grid": self.grid, "window": tile.window}
        return self._job(tile, "points", classify_points, reads, writes, params, 120 * tile.window.cells)

    def _sums(self, tile: Tile) -> Job:
        reads = {key: Raster(name, tile.window) for key, name in _CELL_RASTERS.items()}
        scratch = array_bytes(32, tile.window)
        return self._job(tile, "sums", sums_of_tile, reads, {"sums": _sums_table(tile)}, {}, scratch)

    @property
    def _sums_tables(self) -> tuple[Table[TerrainSums], ...]:
        return tuple(_sums_table(tile) for tile in self.tiles)

    def _report(self) -> Job:
        reads: dict[str, Reading] = {"sums": self._sums_tables, "errors": ERRORS}
        if isinstance(self.settings.contours, DrawContours):
            reads["interval"] = INTERVAL
        facts = TerrainFacts(self.grid.cell, self.rules.block)
        return Job(
            stage="terrain",
            item="report",
            function=terrain_report,
            reads=reads,
            writes={"report": report_table("terrain")},
            params={"facts": facts},
        )


def _samples_table(tile: Tile) -> Table[GroundSamples]:
    return Table(f"terrain/hidden/{tile.row}-{tile.col}.parquet", GroundSamples)


def _sums_table(tile: Tile) -> Table[TerrainSums]:
    return Table(f"terrain/sums/{tile.row}-{tile.col}.json", TerrainSums)
