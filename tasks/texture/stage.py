"""The stage `texture`: a true orthoimage, blended from every photograph that sees the ground."""

from collections.abc import Iterator
from math import ceil, inf, nan, sqrt
from statistics import median
from typing import Annotated, ClassVar, Literal

from pydantic import Field, model_validator

from orthomill.schemas.job import Export, Job, Raster, Region, Table
from orthomill.schemas.orientation import BLOCK, Block
from orthomill.schemas.photo import PHOTOS, Photos, photo_raster
from orthomill.schemas.raster import MapGrid, RasterSpec, Tile, Window, map_raster, tiles_of
from orthomill.schemas.settings import Settings, setting
from orthomill.schemas.stage_contract import ProjectView, Stage
from orthomill.schemas.stage_report import report_table
from orthomill.schemas.surface import (
    CORRECTED,
    COUNT,
    HEIGHT,
    HEIGHT_SOURCE,
    ORTHO,
    PRECISION,
    PROVENANCE,
    RELATIVE_PRECISION,
    SURFACE,
    Surface,
    points_table,
)
from orthomill.tasks.colouring.balance.radiometric_balance import Samples
from orthomill.tasks.colouring.blending.blending import Blend
from orthomill.tasks.colouring.colour_settings import (
    AboutMean,
    AverageTwo,
    Balance,
    BlockBalance,
    ByArea,
    PreferHeavier,
    PreferUnbroken,
    Rejections,
    Weights,
    power_of,
    rejection_of,
)
from orthomill.tasks.colouring.sampling.balanced_photograph import RADIOMETRY
from orthomill.tasks.geometry.photograph_part import PhotoSource, photo_level
from orthomill.tasks.geometry.view import block_view
from orthomill.tasks.imagery.pull_push import filled
from orthomill.tasks.texture.draping import BLOCK as GROUND_BLOCK
from orthomill.tasks.texture.draping import block_grid, block_heights, blocks_of
from orthomill.tasks.texture.extent import TileExtent, ground_pixels, ortho_grid, tile_extent
from orthomill.tasks.texture.mosaic import TextureRules, TileTexture, balance, sample_tile, texture_tile
from orthomill.tasks.texture.relief import RELIEF, ReliefMap, relief_table, tile_relief, whole_relief
from orthomill.tasks.texture.report import COVERAGE, REJECTED, TextureFacts, texture_report

BLOCK_HEIGHTS, GROUND = "texture/block_heights", "texture/ground"
"""float32 m: mean heights of blocks of 16 x 16 cells of the surface model, NaN in holes; the same with every hole closed"""
CELLS_OF_ONE_FILE = 40_000_000
"""Cells of the surface model up to which its points are one file; about as many points, of about ten bytes each."""
SAMPLES_AT_MOST = 60000
"""Ground samples of the whole block for the radiometric balance."""
_COARSER = 4  # ortho pixels per sample pixel: averaging removes noise and the effect of mismatches of a pixel
_SPACING_OF_RANGE = 64  # px between samples that serve for the range of 16 bits only


class LeaveHoles(Settings):
    """No texture where the surface model has no height."""

    kind: Literal["leave"]


class DrapeHoles(Settings):
    """Holes get an interpolated height for the texture only; `texture/height_source` marks them."""

    kind: Literal["drape"] = "drape"
    max_gap: Annotated[float, Field(gt=0)] | Literal["unlimited"] = setting(
        "unlimited", "Largest distance to a height of the surface model. unlimited: wherever a photo sees the ground.", "m"
    )


class KeepEdges(Settings):
    """Every pixel lies on the surface model, whose cells blur walls."""

    kind: Literal["keep"]


class SharpenEdges(Settings):
    """Near walls every pixel lies on the upper or the lower surface, whichever the photographs show there."""

    kind: Literal["sharpen"] = "sharpen"


Holes = Annotated[LeaveHoles | DrapeHoles, Field(discriminator="kind")]
Edges = Annotated[KeepEdges | SharpenEdges, Field(discriminator="kind")]
TwoColours = Annotated[AverageTwo | PreferHeavier | PreferUnbroken, Field(discriminator="kind")]


class TextureStage(Stage):
    """Colours every ground cell from all photos that actually see it: a true orthoimage."""

    title: ClassVar[str] = "True orthoimage"

    kind: Literal["texture"] = "texture"
    cell: Annotated[float, Field(gt=0)] | Literal["auto"] = setting(
        "auto",
        "Pixel of the orthoimage; must divide the cell of the surface model. auto: about the ground pixel of the photos.",
        "m",
    )
    holes: Holes = setting(DrapeHoles(), "What happens where the surface model has no height.")
    edges: Edges = setting(SharpenEdges(), "On which surface a pixel near a wall lies.")
    weights: Weights = setting(ByArea(), "Weight of a photo's colour (Petsa et al. 2007).")
    rejection: Rejections = setting(AboutMean(), "Which colours are rejected as gross errors.")
    two_colours: TwoColours = setting(AverageTwo(), "What happens where exactly two photos see the ground and disagree.")
    best: int = setting(0, "Number of photos of the greatest weight that are blended; 0 for all.", ge=0, le=64)
    balance: Balance = setting(BlockBalance(), "How the photos are adjusted to one brightness.")
    feather: float = setting(
        0.15,
        "Width of the border of a photo in which its weight rises from 0, as a share of the photo's shorter side.",
        ge=0,
        le=0.5,
    )
    occlusion_margin: float = setting(
        1.0, "Cells of the surface model next to an occlusion whose colour is used only if there is no other.", "cells", ge=0, le=32
    )
    occlusion_ramp: float = setting(
        2.0, "Width beyond the margin in which the weight rises to its full value.", "cells", ge=0, le=32
    )
    tolerance: Annotated[float, Field(ge=0)] | Literal["auto"] = setting(
        "auto", "How deep a ray may dip below the surface before it counts as hidden. auto: half a cell of the surface model.", "m"
    )
    bridge: int = setting(
        24, "Holes are bridged for the visibility test from heights at most this far away.", "cells", ge=0, le=256
    )

    @model_validator(mode="after")
    def _has_an_effect(self) -> "TextureStage":
        """Raises ValueError for settings that the others leave without effect."""
        if self.two_colours.kind == "prefer" and self.best == 1:
            raise ValueError(
                "two_colours: prefer without effect with best: 1, which always uses the one colour of the greatest weight: remove "
                "two_colours, or set best to 0 or to 2 and more"
            )
        return self

    def plan(self, view: ProjectView) -> Iterator[RasterSpec | Job | Export]:
        """Samples of all tiles, the balance of the block, then the tiles of the orthoimage."""
        block, surface, photos = view.table(BLOCK), view.table(SURFACE), view.table(PHOTOS)
        views = [block_view(block, name) for name in block.names]
        pixels = ground_pixels(views, block.ground_mean)
        ortho = ortho_grid(surface.grid, None if self.cell == "auto" else self.cell, median(pixels))
        rules = self._rules(surface)
        yield from self._rasters(ortho, block.crs, view.project.tile)
        draped = self.holes.kind == "drape"
        # The raster named here decides which stage the tiles wait for.
        heights = CORRECTED if view.has_stage("dsm_check") else HEIGHT
        if draped:
            yield from _ground(surface.grid, block.crs, view.project.tile, heights)
        yield from _relief(surface.grid, view.project.tile, heights, draped)
        relief = ReliefMap(view.table(RELIEF), surface.grid)
        tiles = list(tiles_of(ortho.shape, view.project.tile))
        coarse = [_source(view, block, photos, name, _COARSER * ortho.cell, size) for name, size in _by_name(block, pixels)]
        for tile in tiles:
            extent = tile_extent(relief, ortho, tile.window, coarse, rules.halo)
            yield _sample_job(tile, heights, extent, rules, self._spacing(ortho))
        deep = any(view.raster(photo_raster(name, 0)).dtype == "uint16" for name in block.names)
        yield self._balance_job(tiles, block, deep)
        fine = [_source(view, block, photos, name, ortho.cell, size) for name, size in _by_name(block, pixels)]
        for tile in tiles:
            yield _ortho_job(tile, heights, tile_extent(relief, ortho, tile.window, fine, rules.halo, rules.around), rules, draped)
        facts = TextureFacts(cell=ortho.cell, dsm_cell=surface.grid.cell, ground_pixel=median(pixels), heights=heights)
        yield from _results(tiles, facts)
        yield from _clouds(surface.grid, view.project.tile, heights)

    def _balance_job(self, tiles: list[Tile], block: Block, deep: bool) -> Job:
        return Job(
            "texture",
            "balance",
            balance,
            {"samples": tuple(_samples_table(tile) for tile in tiles), "block": BLOCK},
            {"radiometry": RADIOMETRY},
            {"deep": deep, "method": self.balance.kind, "vignetting": self.balance.kind == "block" and self.balance.vignetting},
            # Bytes per sample and photo that sees it; more than a dozen photos hardly see the same ground.
            scratch=250 * SAMPLES_AT_MOST * min(len(block.names), 12),
        )

    def _rules(self, surface: Surface) -> TextureRules:
        cell = surface.grid.cell
        two = self.two_colours.limit if self.two_colours.kind != "average" else 0.0
        return TextureRules(
            # Between two cells the interpolated surface may exceed the true one by half a cell on a slope of one.
            tolerance=0.5 * cell if self.tolerance == "auto" else self.tolerance,
            bridge=self.bridge,
            drape_reach=self._reach(cell),
            widening_margin=self.occlusion_margin,
            widening_ramp=self.occlusion_ramp,
            feather=self.feather,
            sharpen=self.edges.kind == "sharpen",
            blend=Blend(rejection_of(self.rejection), power_of(self.weights), self.best, two),
            breaks=self.two_colours.kind == "depth_break",
        )

    def _reach(self, cell: float) -> float:
        """How far holes are draped, in cells of the surface model."""
        if self.holes.kind == "leave":
            return 0.0
        return inf if self.holes.max_gap == "unlimited" else self.holes.max_gap / cell

    def _spacing(self, ortho: MapGrid) -> int:
        """px between samples: that of the setting, or as many as keep to SAMPLES_AT_MOST."""
        wanted = self.balance.spacing if self.balance.kind != "none" else _SPACING_OF_RANGE
        # The unknown brightness of every sample is eliminated, but time and memory still grow with their number.
        return max(wanted, ceil(sqrt(ortho.rows * ortho.cols / SAMPLES_AT_MOST)))

    def _rasters(self, ortho: MapGrid, crs: str, tile: int) -> Iterator[RasterSpec]:
        yield map_raster(ORTHO, ortho, "uint8", crs, tile, bands=4)
        yield map_raster(COVERAGE, ortho, "uint8", crs, tile, unit="photos")
        yield map_raster(REJECTED, ortho, "uint8", crs, tile, unit="colours")
        yield map_raster(HEIGHT_SOURCE, ortho, "uint8", crs, tile)


def _source(view: ProjectView, block: Block, photos: Photos, name: str, cell: float, ground_pixel: float) -> PhotoSource:
    level = photo_level(cell, ground_pixel, photos[name].levels)
    return PhotoSource(block_view(block, name), level, view.raster(photo_raster(name, level)).shape)


def _sample_job(tile: Tile, heights: str, extent: TileExtent, rules: TextureRules, spacing: int) -> Job:
    return Job(
        "texture",
        "samples",
        sample_tile,
        _reads(heights, extent),
        {"samples": _samples_table(tile)},
        {"extent": extent, "rules": rules, "spacing": spacing},
        tile.row,
        tile.col,
        scratch=_sample_scratch(extent),
    )


def _ground(dsm: MapGrid, crs: str, size: int, heights: str) -> Iterator[RasterSpec | Job]:
    """The mean heights of the blocks of the whole model, tile by tile, and their gaps closed over the whole model."""
    grid, chunk = block_grid(dsm), size // GROUND_BLOCK
    for name in (BLOCK_HEIGHTS, GROUND):
        yield map_raster(name, grid, "float32", crs, chunk, nodata=nan, unit="m", axes=("ground_y", "ground_x"))
    for tile in tiles_of(dsm.shape, size):
        blocks = blocks_of(tile.window)
        reads, writes = {"heights": Raster(heights, tile.window)}, {"blocks": Raster(BLOCK_HEIGHTS, blocks)}
        # A known flag, its sum and the sum of heights in float64 per cell, for the first of the halvings.
        scratch = 16 * tile.window.height * tile.window.width
        yield Job("texture", "blocks", block_heights, reads, writes, {}, tile.row, tile.col, scratch)
    whole = Window(0, 0, *grid.shape)
    scratch = 40 * grid.rows * grid.cols
    yield Job(
        "texture", "ground", filled, {"values": Raster(BLOCK_HEIGHTS, whole)}, {"ground": Raster(GROUND, whole)}, scratch=scratch
    )


def _relief(dsm: MapGrid, size: int, heights: str, draped: bool) -> Iterator[Job]:
    """The relief of the whole model, tile by tile and then together: what the tiles of the orthoimage read follows from it."""
    tables = []
    for tile in tiles_of(dsm.shape, size):
        reads: dict[str, Region | tuple[Region, ...]] = {"heights": Raster(heights, tile.window)}
        if draped:
            reads["ground"] = Raster(GROUND, blocks_of(tile.window))
        tables.append(relief_table(tile.row, tile.col))
        writes, scratch = {"relief": tables[-1]}, 8 * tile.window.height * tile.window.width
        yield Job("texture", "relief", tile_relief, reads, writes, {"window": tile.window}, tile.row, tile.col, scratch)
    yield Job("texture", "whole-relief", whole_relief, {"parts": tuple(tables)}, {"relief": RELIEF}, {})


def _ortho_job(tile: Tile, heights: str, extent: TileExtent, rules: TextureRules, draped: bool) -> Job:
    rasters = {"ortho": ORTHO, "coverage": COVERAGE, "rejected": REJECTED, "height_source": HEIGHT_SOURCE}
    codes = {"precision": Raster(RELATIVE_PRECISION, extent.heights), "provenance": Raster(PROVENANCE, extent.heights)}
    reads: dict[str, Region | tuple[Region, ...]] = {**_reads(heights, extent), **codes, "radiometry": RADIOMETRY}
    if draped:
        reads["ground"] = Raster(GROUND, extent.ground)
    return Job(
        "texture",
        "ortho",
        texture_tile,
        reads,
        {**{key: Raster(name, tile.window) for key, name in rasters.items()}, "statistics": _statistics_table(tile)},
        {"extent": extent, "rules": rules},
        tile.row,
        tile.col,
        scratch=_scratch(extent) + (_edge_scratch(extent, rules) if rules.sharpen else 0),
    )


def _results(tiles: list[Tile], facts: TextureFacts) -> Iterator[Job | Export]:
    """The report and the products."""
    reads: dict[str, Region | tuple[Region, ...]] = {
        "statistics": tuple(_statistics_table(tile) for tile in tiles),
        "radiometry": RADIOMETRY,
    }
    yield Job("texture", "report", texture_report, reads, {"report": report_table("texture")}, {"facts": facts})
    yield Export("texture", "ortho_cog", "products/ortho.tif", "cog", {"rgba": ORTHO})
    yield Export("texture", "height_source_cog", "products/ortho_height_source.tif", "cog", {"height_source": HEIGHT_SOURCE})


def _clouds(dsm: MapGrid, size: int, heights: str) -> Iterator[Export]:
    """The matched points and the cells of the surface model, coloured; large models in one file of points for each tile."""
    tables = {(tile.row, tile.col): points_table(tile.row, tile.col) for tile in tiles_of(dsm.shape, size)}
    if dsm.rows * dsm.cols <= CELLS_OF_ONE_FILE:
        yield Export("texture", "points", "products/points.laz", "laz", {"rgb": ORTHO}, tuple(tables.values()))
    else:
        for (row, col), table in tables.items():
            path = f"products/points/{row}-{col}.laz"
            yield Export("texture", f"points-{row}-{col}", path, "laz", {"rgb": ORTHO}, (table,))
    attributes = {"z": heights, "rgb": ORTHO, "precision": PRECISION, "pairs": COUNT, "code": PROVENANCE}
    yield Export("texture", "cells", "products/dsm_cells.laz", "laz", attributes)


def _samples_table(tile: Tile) -> Table[Samples]:
    return Table(f"texture/samples/{tile.row}-{tile.col}.parquet", Samples)


def _statistics_table(tile: Tile) -> Table[TileTexture]:
    return Table(f"texture/statistics/{tile.row}-{tile.col}.json", TileTexture)


def _by_name(block: Block, pixels: list[float]) -> Iterator[tuple[str, float]]:
    """The photos of the block and their ground pixels."""
    return zip(block.names, pixels, strict=True)


def _reads(heights: str, extent: TileExtent) -> dict[str, Region | tuple[Region, ...]]:
    photos = tuple(Raster(photo_raster(part.name, part.level), part.window) for part in extent.photos)
    return {"heights": Raster(heights, extent.heights), "block": BLOCK, "photos": photos}


def _sample_scratch(extent: TileExtent) -> int:
    """Bytes for the bridged model and the ground of the tile."""
    return 64 * extent.heights.height * extent.heights.width + 16 * extent.window.height * extent.window.width


def _scratch(extent: TileExtent) -> int:
    """Bytes for the bridged models, ground and weight factors of the tile, and the colours of one strip."""
    photos = len(extent.photos)
    cells = extent.heights.height * extent.heights.width
    pixels = extent.window.height * extent.window.width
    # Draping holds the cells, their sums in float64 and two levels at a time; visibility the model and its measured part, as they
    # are and as low as they may well be.
    return (32 + 52) * cells + (48 + 7 * photos) * pixels + 64 * extent.window.width * (photos * 40 + 40)


def _edge_scratch(extent: TileExtent, rules: TextureRules) -> int:
    """Bytes for both surfaces, examples and scores of the pixels around the tile, and the colours of one strip at both heights."""
    wide = extent.window.grown(rules.around * extent.divisor)
    photos, cells = len(extent.photos), wide.height * wide.width // extent.divisor**2
    return 80 * cells + (90 + 3 * photos) * wide.height * wide.width + 32 * wide.width * photos * 40
