"""The jobs that colour an output once its depth rasters are there: sight, samples, colours; or a photograph from the others."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

from orthomill.schemas.job import Export, Job, Raster, Reading, Stream, Table
from orthomill.schemas.memory import MIB, array_bytes
from orthomill.schemas.orientation import BLOCK
from orthomill.schemas.raster import RasterSpec, Tile
from orthomill.schemas.solid.frames import ViewFrame
from orthomill.tasks.colouring.blending.colour_rules import ColourRules
from orthomill.tasks.colouring.plan.balance_jobs import COARSER, photo_pixels
from orthomill.tasks.colouring.sight.output_tile import OutputTile
from orthomill.tasks.colouring.sight.sight_rasters import sight_tile
from orthomill.tasks.colouring.widening.hidden_edges import ChosenWidth
from orthomill.tasks.geometry.photograph_part import PhotoPart
from orthomill.tasks.projection.mesh.depth_rasters import depth_picture
from orthomill.tasks.projection.photographs.chosen_photographs import PhotographMask
from orthomill.tasks.projection.plan.frame_jobs import FrameJobs
from orthomill.tasks.projection.plan.projection_tables import (
    CENSUS,
    FACING,
    RADIOMETRY,
    mesh_blocks,
    output_layer,
    samples_table,
    statistics_table,
    zones_layer,
)
from orthomill.tasks.projection.plan.sight_regions import sight_regions
from orthomill.tasks.projection.projection_basis import Place, ProjectionBasis, frame_pixel
from orthomill.tasks.projection.tiles.output_colours import colour_tile, left_out_tile, sample_surface
from orthomill.tasks.visibility.mesh_blocks import PhotoDepth, TileSurface
from orthomill.tasks.visibility.mesh_sight import SightTolerance


@dataclass(frozen=True, eq=False)
class OutputJobs:
    """The jobs of an output. `surfaces`: by tile, in the order of `frame.tiles`; `seen`: what photographs show of the mesh."""

    frame: FrameJobs
    surfaces: tuple[TileSurface, ...]
    seen: dict[str, PhotoDepth]
    masks: dict[str, PhotographMask]
    """by photograph"""

    @property
    def basis(self) -> ProjectionBasis:
        """What the jobs rest on."""
        return self.frame.basis

    @cached_property
    def middle(self) -> Place:
        """Middle of the surface that is shown (3,) m."""
        return self.basis.middle_of_all(self.surfaces)

    @cached_property
    def pixel(self) -> float:
        """Side of a pixel on the surface, m."""
        return frame_pixel(self.frame.frame, self.middle)

    def photo_parts(self, surface: TileSurface, wanted: float) -> tuple[PhotoPart, ...]:
        """The parts of photographs that show a tile, at the level whose pixels on the surface are about `wanted` m large."""
        if not surface.covered:
            return ()
        return self.basis.photo_parts(self.frame.photographs, surface, self.middle, wanted)

    def full_parts(self, surface: TileSurface) -> tuple[PhotoPart, ...]:
        """The parts of photographs in full size that show a tile."""
        return self.photo_parts(surface, 0.0)

    def tile(self, tile: Tile, surface: TileSurface) -> OutputTile:
        """A tile with the blocks that it shows itself."""
        return OutputTile(self.frame.frame, tile.window, surface.blocks, self.frame.photographs)

    def pairs(self) -> Iterator[tuple[Tile, TileSurface]]:
        """Tiles and what they show."""
        return zip(self.frame.tiles, self.surfaces, strict=True)

    def sight(self, tolerance: SightTolerance) -> Iterator[RasterSpec | Job]:
        """How every photograph sees every pixel."""
        frame, count = self.frame, len(self.frame.photographs)
        # A band for every photograph, however few there are.
        yield frame.raster("sight", "uint8", bands=count).model_copy(update={"colours": False})
        for tile, surface in self.pairs():
            names = frame.photographs if surface.covered else ()
            regions = sight_regions(self.basis, names, surface, self.seen, self.masks, self.full_parts(surface))
            reads: dict[str, Reading] = {
                "triangle": frame.at("triangle", tile),
                "blocks": mesh_blocks(regions.blocks),
                "nearness": Stream(regions.rasters("nearness")),
                "drawn": Stream(regions.rasters("triangle")),
                "block": BLOCK,
                "census": CENSUS,
                "facing": FACING,
            }
            if regions.masks:
                reads["masks"] = Stream(regions.masks)
            numbered = OutputTile(frame.frame, tile.window, regions.blocks, frame.photographs, regions.parts, regions.masked)
            yield frame.job(
                "sight",
                tile,
                function=sight_tile,
                reads=reads,
                writes={"sight": frame.at("sight", tile)},
                params={"tile": numbered, "tolerance": tolerance},
                scratch=array_bytes(400 + count, tile.window) + len(regions.blocks) * MIB,
            )

    def samples(self, spacing: int, first: int) -> Iterator[Job]:
        """Samples for the balance; their numbers begin with `first`."""
        for tile, surface in self.pairs():
            parts = self.photo_parts(surface, COARSER * self.pixel)
            yield self.frame.job(
                "samples",
                tile,
                function=sample_surface,
                reads={**self._reads(tile, surface, parts), "facing": FACING},
                writes={"samples": samples_table(self.frame.name, tile)},
                params={"tile": self.tile(tile, surface).with_parts(parts), "spacing": spacing, "first": first},
                scratch=array_bytes(16, tile.window) + MIB,
            )

    def surface_reads(self, surface: TileSurface) -> dict[str, Reading]:
        """The triangles that a tile shows, and where they and the photographs are."""
        return {"blocks": mesh_blocks(surface.blocks), "block": BLOCK, "census": CENSUS}

    def _reads(self, tile: Tile, surface: TileSurface, parts: tuple[PhotoPart, ...]) -> dict[str, Reading]:
        return {
            "triangle": self.frame.at("triangle", tile),
            "sight": self.frame.at("sight", tile),
            "photos": photo_pixels(parts),
            **self.surface_reads(surface),
        }

    def zoned_reads(self, tile: Tile, surface: TileSurface) -> tuple[OutputTile, dict[str, Reading]]:
        """A tile with its photographs and their zones, and what a job reads to colour it."""
        parts, zones = self.photo_parts(surface, self.pixel), self.full_parts(surface)
        reads: dict[str, Reading] = {
            **self._reads(tile, surface, parts),
            "zones": tuple(Raster(zones_layer(self.frame.name, part.name), part.window) for part in zones),
            "facing": FACING,
            "radiometry": RADIOMETRY,
        }
        return self.tile(tile, surface).with_parts(parts, zones), reads

    def colours(self, rules: ColourRules, widening: Table[ChosenWidth] | None) -> Iterator[RasterSpec | Job]:
        """The tiles of the output; `widening`: which of the zones are used, None without any."""
        frame = self.frame
        yield frame.raster("ortho", "uint8", bands=4)
        yield frame.raster("coverage", "uint8", unit="photos")
        yield frame.raster("rejected", "uint8", unit="colours")
        for tile, surface in self.pairs():
            zoned, reads = self.zoned_reads(tile, surface)
            if widening:
                reads["widening"] = widening
            else:
                zoned, reads["zones"] = zoned.with_parts(zoned.parts), ()
            yield frame.job(
                "colours",
                tile,
                function=colour_tile,
                reads=reads,
                writes={
                    **{layer: frame.at(layer, tile) for layer in ("ortho", "coverage", "rejected")},
                    "statistics": statistics_table(frame.name, tile),
                },
                params={"tile": zoned, "rules": rules},
                scratch=self.colour_scratch(tile, zoned.parts),
            )

    def left_out(self, rules: ColourRules, widening: Table[ChosenWidth] | None) -> Iterator[RasterSpec | Job]:
        """The tiles of a photograph from all others, blended and from the nearest one."""
        frame = self.frame
        yield frame.raster("blended", "uint8", bands=4)
        yield frame.raster("nearest", "uint8", bands=4)
        for tile, surface in self.pairs():
            parts = self.photo_parts(surface, self.pixel)
            reads: dict[str, Reading] = {**self._reads(tile, surface, parts), "facing": FACING, "radiometry": RADIOMETRY}
            if widening:
                reads["widening"] = widening
            yield frame.job(
                "left-out",
                tile,
                function=left_out_tile,
                reads=reads,
                writes={layer: frame.at(layer, tile) for layer in ("blended", "nearest")},
                params={"tile": self.tile(tile, surface).with_parts(parts), "rules": rules},
                scratch=self.colour_scratch(tile, parts),
            )

    def colour_scratch(self, tile: Tile, parts: tuple[PhotoPart, ...]) -> int:
        """Bytes for points, normals and corners in float64, and for every photograph colours, weights and breaks."""
        return array_bytes(300 + 20 * len(parts), tile.window) + 8 * MIB

    def depth_pictures(self) -> Iterator[RasterSpec | Job | Export]:
        """The depth of the output as a picture, in one range of grey for all tiles."""
        frame, covered = self.frame, [surface for surface in self.surfaces if surface.covered]
        near = min((s.near[0] for s in covered), default=0.0), max((s.near[1] for s in covered), default=0.0)
        yield frame.raster("picture", "uint8", bands=4)
        for tile in frame.tiles:
            yield frame.job(
                "picture",
                tile,
                function=depth_picture,
                reads={"nearness": frame.at("nearness", tile)},
                writes={"picture": frame.at("picture", tile)},
                params={"central": isinstance(frame.frame, ViewFrame), "near": near},
                scratch=array_bytes(40, tile.window),
            )
        path, picture = f"products/depth/{frame.name}.png", output_layer(frame.name, "picture")
        yield Export("projection", f"{frame.name}-depth-png", path, "png", {"rgba": picture})
