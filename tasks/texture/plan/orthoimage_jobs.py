"""The jobs of the orthoimage: samples of all tiles, the balance of the block, its tiles, and what is taken away."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from statistics import median

from orthomill.schemas.bare_ground import CELL_CLASS, point_classes_table
from orthomill.schemas.job import Export, Job, Raster, Reading, Table
from orthomill.schemas.maps.coded_areas import CodedAreas
from orthomill.schemas.maps.straight_edges import edge_sheets
from orthomill.schemas.memory import array_bytes
from orthomill.schemas.orientation import BLOCK, Block
from orthomill.schemas.photo import PHOTOS, Photos, photo_raster
from orthomill.schemas.raster import MapGrid, RasterSpec, Tile, map_raster, tiles_of
from orthomill.schemas.stage_contract import ProjectView
from orthomill.schemas.stage_report import report_table
from orthomill.schemas.surface import (
    CHECKED_SURFACE,
    CORRECTED,
    COUNT,
    GIVEN_CODE,
    GIVEN_HEIGHT,
    GIVEN_PRECISION,
    HEIGHT,
    HEIGHT_SOURCE,
    ORTHO,
    ORTHO_SOURCE,
    PRECISION,
    PROVENANCE,
    RELATIVE_PRECISION,
    SURFACE,
    Surface,
    points_table,
)
from orthomill.tasks.colouring.balance.shared_ground import Samples
from orthomill.tasks.colouring.colour_settings import ColourSettings
from orthomill.tasks.colouring.plan.balance_jobs import COARSER, balance_job, photo_pixels, radiometry_table
from orthomill.tasks.colouring.sampling.photo_levels import photo_source
from orthomill.tasks.geometry.photograph_part import PhotoSource
from orthomill.tasks.geometry.view import View, block_view
from orthomill.tasks.texture.ground.extent import TileExtent, ground_pixels, ortho_grid, tile_extent
from orthomill.tasks.texture.ground.relief import RELIEF, ReliefMap
from orthomill.tasks.texture.mosaic import TextureRules, TileTexture, sample_tile, texture_tile
from orthomill.tasks.texture.plan.edge_jobs import edge_jobs, places_table, sums_table
from orthomill.tasks.texture.plan.ground_jobs import GROUND, ground_jobs, relief_jobs
from orthomill.tasks.texture.report.texture_report import COVERAGE, REJECTED, TextureFacts, texture_report

CELLS_OF_ONE_FILE = 40_000_000
"""Cells of the surface model up to which its points are one file; about as many points, of about ten bytes each."""
RADIOMETRY = radiometry_table("texture")


SOURCE_AREAS = Table("texture/sources.json", CodedAreas)


def photographs_of_codes(block: Block, photos: Photos) -> CodedAreas:
    """Name and time of the photographs by their number in `ORTHO_SOURCE`."""
    taken = {name: photos[name].time or "" for name in block.names}
    return CodedAreas(attributes={k: {"photograph": name, "taken": taken[name]} for k, name in enumerate(block.names, 1)})


def samples_table(tile: Tile) -> Table[Samples]:
    """Samples of a tile for the balance."""
    return Table(f"texture/samples/{tile.row}-{tile.col}.parquet", Samples)


def statistics_table(tile: Tile) -> Table[TileTexture]:
    """Sums over a tile."""
    return Table(f"texture/statistics/{tile.row}-{tile.col}.json", TileTexture)


@dataclass(frozen=True, eq=False)
class OrthoimageJobs:
    """The jobs of an orthoimage with pixels of `cell` m (None: about those of the photographs), `draped` over holes."""

    view: ProjectView
    settings: ColourSettings
    cell: float | None
    draped: bool

    @cached_property
    def block(self) -> Block:
        """The oriented photographs."""
        return self.view.table(BLOCK)

    @cached_property
    def surface(self) -> Surface:
        """The surface model."""
        return self.view.table(SURFACE if self.measured else CHECKED_SURFACE)

    @property
    def measured(self) -> bool:
        """Whether the project has matched the surface, and not only checked one from a file."""
        return self.view.has_stage("densification") or not self.view.has_stage("dsm_check")

    @cached_property
    def photos(self) -> Photos:
        """What is known of the photographs."""
        return self.view.table(PHOTOS)

    @cached_property
    def heights(self) -> str:
        """The raster of heights; the one named here decides which stage the tiles wait for."""
        if not self.measured:
            return GIVEN_HEIGHT
        return CORRECTED if self.view.has_stage("dsm_check") else HEIGHT

    @property
    def precision(self) -> str:
        """The raster of their standard errors among neighbours."""
        return RELATIVE_PRECISION if self.measured else GIVEN_PRECISION

    @cached_property
    def views(self) -> list[View]:
        """The photographs in the order of the block."""
        return [block_view(self.block, name) for name in self.block.names]

    @cached_property
    def pixels(self) -> list[float]:
        """Side of their pixels on the ground, m."""
        return ground_pixels(self.views, self.block.ground_mean)

    @cached_property
    def ortho(self) -> MapGrid:
        """The pixels of the orthoimage."""
        return ortho_grid(self.surface.grid, self.cell, median(self.pixels))

    @cached_property
    def tiles(self) -> list[Tile]:
        """Of the orthoimage."""
        return list(tiles_of(self.ortho.shape, self.view.project.tile))

    def all(self, rules: TextureRules) -> Iterator[RasterSpec | Job | Export]:
        """All jobs; planning waits for the relief, from which it follows what the tiles read."""
        dsm, size = self.surface.grid, self.view.project.tile
        yield from self._rasters()
        if self.draped:
            yield from ground_jobs(dsm, self.block.crs, size, self.heights, self.precision)
        yield from relief_jobs(dsm, size, self.heights, self.draped)
        relief = ReliefMap(self.view.table(RELIEF), dsm)
        yield from self._samples(relief, rules)
        yield balance_job("texture", self.settings, self.block.names, self._dtypes, map(samples_table, self.tiles))
        yield from self._orthoimage(relief, replace(rules, bits=self.bits))
        if rules.sharpen:
            yield from edge_jobs(self.ortho, size, dsm.cell)
        yield self._report(edge_sheets(self.ortho.shape, size) if rules.sharpen else ())
        yield from self._products()

    @cached_property
    def _dtypes(self) -> list[str]:
        return [self.view.raster(photo_raster(name, 0)).dtype for name in self.block.names]

    @property
    def bits(self) -> int:
        """Of a colour of the orthoimage: as many as the photographs have."""
        return 16 if "uint16" in self._dtypes else 8

    def _rasters(self) -> Iterator[RasterSpec]:
        ortho, crs, size = self.ortho, self.block.crs, self.view.project.tile
        yield map_raster(ORTHO, ortho, f"uint{self.bits}", crs, size, bands=4)
        yield map_raster(COVERAGE, ortho, "uint8", crs, size, unit="photos")
        yield map_raster(REJECTED, ortho, "uint8", crs, size, unit="colours")
        yield map_raster(HEIGHT_SOURCE, ortho, "uint8", crs, size)
        names = {f"photograph {k}": name for k, name in enumerate(self.block.names, 1)}
        yield map_raster(ORTHO_SOURCE, ortho, "uint16", crs, size).model_copy(update={"tags": names})

    def _sources(self, wanted: float) -> list[PhotoSource]:
        """The photographs at the level with pixels of about `wanted` m."""
        known = zip(self.views, self.pixels, strict=True)
        return [photo_source(view, self.photos[view.name], pixel, wanted) for view, pixel in known]

    def _samples(self, relief: ReliefMap, rules: TextureRules) -> Iterator[Job]:
        spacing = self.settings.sample_spacing(self.ortho.cells)
        coarse = self._sources(COARSER * self.ortho.cell)
        for tile in self.tiles:
            extent = tile_extent(relief, self.ortho, tile.window, coarse, rules.halo)
            yield Job(
                stage="texture",
                item="samples",
                function=sample_tile,
                reads=self._reads(extent),
                writes={"samples": samples_table(tile)},
                params={"extent": extent, "rules": rules, "spacing": spacing},
                row=tile.row,
                col=tile.col,
                scratch=_sample_scratch(extent),
            )

    def _orthoimage(self, relief: ReliefMap, rules: TextureRules) -> Iterator[Job]:
        rasters = {"ortho": ORTHO, "coverage": COVERAGE, "rejected": REJECTED, "height_source": HEIGHT_SOURCE}
        rasters["source"] = ORTHO_SOURCE
        fine = self._sources(self.ortho.cell)
        for tile in self.tiles:
            extent = tile_extent(relief, self.ortho, tile.window, fine, rules.halo, rules.around)
            reads = {
                **self._reads(extent),
                "precision": Raster(self.precision, extent.heights),
                "provenance": Raster(PROVENANCE if self.measured else GIVEN_CODE, extent.heights),
                "radiometry": RADIOMETRY,
            }
            if self.draped:
                reads["ground"] = Raster(GROUND, extent.ground)
            yield Job(
                stage="texture",
                item="ortho",
                function=texture_tile,
                reads=reads,
                writes={
                    **{key: Raster(name, tile.window) for key, name in rasters.items()},
                    "statistics": statistics_table(tile),
                    "edges": places_table(tile),
                },
                params={"extent": extent, "rules": rules},
                row=tile.row,
                col=tile.col,
                scratch=_tile_scratch(extent) + (_edge_scratch(extent, rules) if rules.sharpen else 0),
            )

    def _reads(self, extent: TileExtent) -> dict[str, Reading]:
        return {"heights": Raster(self.heights, extent.heights), "block": BLOCK, "photos": photo_pixels(extent.photos)}

    def _report(self, sheets: tuple[Tile, ...]) -> Job:
        facts = TextureFacts(
            cell=self.ortho.cell, dsm_cell=self.surface.grid.cell, ground_pixel=median(self.pixels), heights=self.heights
        )
        return Job(
            stage="texture",
            item="report",
            function=texture_report,
            reads={
                "statistics": tuple(map(statistics_table, self.tiles)),
                "radiometry": RADIOMETRY,
                "edges": tuple(map(sums_table, sheets)),
            },
            writes={"report": report_table("texture")},
            params={"facts": facts},
        )

    def _products(self) -> Iterator[Job | Export]:
        """The orthoimage; the matched points, in a file for each tile where the model is large, and its cells, coloured."""
        dsm = self.surface.grid
        yield Export("texture", "ortho_cog", "products/ortho.tif", "cog", {"rgba": ORTHO})
        yield Export("texture", "height_source_cog", "products/ortho_height_source.tif", "cog", {"height_source": HEIGHT_SOURCE})
        yield Job(
            stage="texture",
            item="photographs",
            function=photographs_of_codes,
            reads={"block": BLOCK, "photos": PHOTOS},
            writes={"areas": SOURCE_AREAS},
        )
        sources = {"photograph": ORTHO_SOURCE, "photographs": COVERAGE}
        yield Export("texture", "source_cog", "products/ortho_source.tif", "cog", sources)
        yield Export("texture", "seams", "products/ortho_seams.gpkg", "areas", {"codes": ORTHO_SOURCE}, (SOURCE_AREAS,))
        if not self.measured:
            return
        tiles = tiles_of(dsm.shape, self.view.project.tile)
        classed = self.view.has_stage("terrain")
        places = [(tile.row, tile.col) for tile in tiles]
        tables = [points_table(*place) for place in places]
        classes = [point_classes_table(*place) for place in places] if classed else []
        if dsm.cells <= CELLS_OF_ONE_FILE:
            yield Export("texture", "points", "products/points.laz", "laz", {"rgb": ORTHO}, tuple(tables), tuple(classes))
        else:
            for k, (row, col) in enumerate(places):
                path, one = f"products/points/{row}-{col}.laz", slice(k, k + 1)
                yield Export("texture", f"points-{row}-{col}", path, "laz", {"rgb": ORTHO}, tuple(tables[one]), tuple(classes[one]))
        attributes = {"z": self.heights, "rgb": ORTHO, "precision": PRECISION, "pairs": COUNT, "code": PROVENANCE}
        if classed:
            attributes["class"] = CELL_CLASS
        yield Export("texture", "cells", "products/dsm_cells.laz", "laz", attributes)


def _sample_scratch(extent: TileExtent) -> int:
    """Bytes for the bridged model and the ground of the tile."""
    return array_bytes(64, extent.heights) + array_bytes(16, extent.window)


def _tile_scratch(extent: TileExtent) -> int:
    """Bytes for the bridged models, ground and weight factors of the tile, and the colours of one strip."""
    photos = len(extent.photos)
    # Draping holds the cells, their sums in float64 and two levels at a time; visibility the model and its measured part, as they
    # are and as low as they may well be.
    strip = array_bytes(40 * (photos + 1), 64, extent.window.width)
    return array_bytes(32 + 52, extent.heights) + array_bytes(48 + 7 * photos, extent.window) + strip


def _edge_scratch(extent: TileExtent, rules: TextureRules) -> int:
    """Bytes for both surfaces, examples and scores of the pixels around the tile, and the colours of one strip at both heights."""
    wide = extent.window.grown(rules.around * extent.divisor)
    photos, cells = len(extent.photos), wide.cells // extent.divisor**2
    strip = array_bytes(40 * photos, 32, wide.width)
    return array_bytes(80, cells) + array_bytes(100 + 3 * photos, wide) + strip
