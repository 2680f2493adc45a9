"""The jobs of the stage: which tile of which output reads what. No numerics beyond boxes and windows.

Planning waits three times: for the mesh (how many blocks it has), for the frames, and for the depth rasters, which tell the blocks
and photographs that a tile needs. Sight, limits, samples, balance and colours follow from these.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from math import nan, prod

import numpy as np

from orthomill.schemas.job import Export, Job, Raster, Reading, Stream, Table
from orthomill.schemas.orientation import BLOCK, Block
from orthomill.schemas.photo import Photos, photo_raster
from orthomill.schemas.raster import RasterSpec, Tile, Window, map_raster, tiles_of
from orthomill.schemas.solid.census import MeshCensus
from orthomill.schemas.solid.frames import AnyFrame, FlatFrame, ViewFrame
from orthomill.tasks.colouring.balance.radiometric_balance import Samples
from orthomill.tasks.colouring.sight.facing import MeshFacing
from orthomill.tasks.colouring.sight.output_tile import (
    OutputTile,
    blocks_of_photograph,
    blocks_of_window,
    ideal_part,
    photo_part,
    union_of,
)
from orthomill.tasks.colouring.sight.sight_rasters import sight_tile
from orthomill.tasks.colouring.surface_colours import (
    PROJECTION_RADIOMETRY,
    ColourRules,
    ProjectionTile,
    colour_tile,
    left_out_tile,
    sample_surface,
)
from orthomill.tasks.colouring.widening.hidden_edges import ChosenWidth
from orthomill.tasks.geometry.photograph_part import PhotoPart, PhotoSource, photo_level
from orthomill.tasks.geometry.view import View, block_view
from orthomill.tasks.imagery.pyramid import level_shape
from orthomill.tasks.projection.border_masks import BorderFacts, border_mask
from orthomill.tasks.projection.chosen_photographs import PhotographMask
from orthomill.tasks.projection.depth_rasters import depth_picture, output_depth, photograph_depth, shown_surfaces
from orthomill.tasks.projection.lines.sections import AnySection
from orthomill.tasks.visibility.mesh_blocks import MeshBlocks, PhotoDepth, ShownSurfaces, TileSurface
from orthomill.tasks.visibility.mesh_sight import SightTolerance
from orthomill.tasks.visibility.output_frame import ideal_window
from orthomill.tasks.visibility.triangle_blocks import SIDE

CORNERS = "projection/corners"
"""float32 (128 per block, 128, 9): the corners of all triangles, m relative to the mesh's origin"""
CENSUS = Table("projection/census.json", MeshCensus)
BLOCKS = Table("projection/blocks.json", MeshBlocks)
FACING = Table("projection/facing.json", MeshFacing)
SURFACES = Table("projection/surfaces.json", ShownSurfaces)
_COARSER = 4
"""output pixels per sample pixel of the balance: averaging removes noise and the effect of mismatches of a pixel"""


def depth_table(name: str) -> Table[PhotoDepth]:
    """What a photograph shows of the mesh."""
    return Table(f"projection/photographs/{name}.json", PhotoDepth)


def photograph_layer(name: str, layer: str) -> str:
    """A raster of a photograph: nearness, triangle."""
    return f"projection/photographs/{name}/{layer}"


def output_layer(name: str, layer: str) -> str:
    """A raster of an output: nearness, triangle, sight, ortho, coverage, rejected."""
    return f"projection/{name}/{layer}"


def surface_table(name: str, tile: Tile) -> Table[TileSurface]:
    """What a tile of an output shows of the mesh."""
    return Table(f"projection/surface/{name}/{tile.row}-{tile.col}.json", TileSurface)


def statistics_table(name: str, tile: Tile) -> Table[ProjectionTile]:
    """Sums over a tile of an output."""
    return Table(f"projection/statistics/{name}/{tile.row}-{tile.col}.json", ProjectionTile)


def samples_table(name: str, tile: Tile) -> Table[Samples]:
    """Samples of a tile of an output for the balance."""
    return Table(f"projection/samples/{name}/{tile.row}-{tile.col}.parquet", Samples)


def zones_layer(name: str, photo: str) -> str:
    """The zones of a photograph next to the limits of what it does not see of an output."""
    return output_layer(name, f"limits/{photo}")


def block_window(number: int) -> Window:
    """A block in the raster of corners."""
    return Window(number * SIDE, 0, SIDE, SIDE)


def _blocks(numbers: tuple[int, ...]) -> tuple[Raster, ...]:
    return tuple(Raster(CORNERS, block_window(number)) for number in numbers)


@dataclass(frozen=True, eq=False)
class ProjectionBasis:
    """What all jobs rest on: the block and its photographs `names`, the mesh and its blocks, the side of tiles."""

    block: Block
    photos: Photos
    names: tuple[str, ...]
    census: MeshCensus
    blocks: MeshBlocks
    tile: int
    crs: str

    @cached_property
    def origin(self) -> np.ndarray:
        """(3,) m"""
        return np.array(self.census.origin)

    @cached_property
    def views(self) -> dict[str, View]:
        """The photographs that take part."""
        return {name: block_view(self.block, name) for name in self.names}

    @cached_property
    def ideal(self) -> dict[str, Window]:
        """Their windows without distortion."""
        return {name: ideal_window(view.camera) for name, view in self.views.items()}


def photograph_jobs(basis: ProjectionBasis) -> Iterator[RasterSpec | Job]:
    """Depth and triangle of every photograph."""
    for name, view in basis.views.items():
        window = basis.ideal[name]
        whole = Window(0, 0, *window.shape)
        for layer, kind, unit in (("nearness", "float32", "1/m"), ("triangle", "int32", "")):
            yield RasterSpec(name=photograph_layer(name, layer), shape=window.shape, dtype=kind, chunk=basis.tile, unit=unit)
        numbers = blocks_of_photograph(view, basis.blocks.corners, basis.origin)
        reads: dict[str, Reading] = {"blocks": Stream(_blocks(numbers)), "block": BLOCK, "census": CENSUS}
        writes: dict[str, Raster | Table] = {
            layer: Raster(photograph_layer(name, layer), whole) for layer in ("nearness", "triangle")
        }
        yield Job(
            "projection",
            f"depth-{name}",
            photograph_depth,
            reads,
            {**writes, "seen": depth_table(name)},
            {"numbers": numbers, "name": name, "window": window},
            # Projected corners of a block, the fronts of all triangles, the marks of squares and blocks.
            scratch=4 * 2**20 + basis.census.triangles + window.height * window.width // 16384 * len(basis.blocks.boxes),
        )


def surfaces_job(frames: Iterable["FrameJobs"]) -> Job:
    """What all tiles of all frames show, in their order."""
    every = Stream(tuple(surface_table(jobs.name, tile) for jobs in frames for tile in jobs.tiles))
    return Job("projection", "surfaces", shown_surfaces, {"surfaces": every}, {"surfaces": SURFACES})


def border_layer(name: str) -> str:
    """The mask of a photograph's black border."""
    return f"projection/photographs/{name}/border"


def border_table(name: str) -> Table[BorderFacts]:
    """How much of a photograph is black border."""
    return Table(f"projection/borders/{name}.json", BorderFacts)


def border_jobs(basis: ProjectionBasis) -> Iterator[RasterSpec | Job]:
    """The black borders of all photographs."""
    for name in basis.names:
        photo = basis.photos[name]
        whole = Window(0, 0, photo.height, photo.width)
        spec = RasterSpec(name=border_layer(name), shape=(*whole.shape, 1), dtype="uint8", chunk=basis.tile)
        yield spec
        reads: dict[str, Reading] = {"pixels": Raster(photo_raster(name, 0), whole)}
        writes: dict[str, Raster | Table] = {"mask": Raster(border_layer(name), whole), "facts": border_table(name)}
        yield Job("projection", f"border-{name}", border_mask, reads, writes, scratch=24 * prod(whole.shape))


def photograph_picture(basis: ProjectionBasis, name: str) -> Iterator[RasterSpec | Job | Export]:
    """The depth of a photograph as a picture, without its distortion."""
    shape, layer = basis.ideal[name].shape, photograph_layer(name, "picture")
    whole = Window(0, 0, *shape)
    yield RasterSpec(name=layer, shape=(*shape, 4), dtype="uint8", chunk=max(shape))
    reads: dict[str, Reading] = {"nearness": Raster(photograph_layer(name, "nearness"), whole)}
    writes = {"picture": Raster(layer, whole)}
    yield Job("projection", f"picture-{name}", depth_picture, reads, writes, {"central": True}, scratch=40 * prod(shape))
    yield Export("projection", f"depth-png-{name}", f"products/depth/{name}.png", "png", {"rgba": layer})


@dataclass(frozen=True, eq=False)
class FrameJobs:
    """The jobs of one output."""

    basis: ProjectionBasis
    frame: AnyFrame
    section: AnySection

    @property
    def name(self) -> str:
        return self.frame.name

    @cached_property
    def tiles(self) -> tuple[Tile, ...]:
        return tuple(tiles_of(self.frame.shape, self.basis.tile))

    @cached_property
    def photographs(self) -> tuple[str, ...]:
        """Those that may colour this output."""
        return tuple(name for name in self.basis.names if name not in self.frame.without)

    def raster(self, layer: str, dtype: str, bands: int = 0, nodata: float | None = None, unit: str = "") -> RasterSpec:
        """A raster of the output: on the map, on a plane with its own coordinates, or plain pixels."""
        name, frame, tile = output_layer(self.name, layer), self.frame, self.basis.tile
        if isinstance(frame, FlatFrame):
            # Coordinates on a plane are metres from its lower left corner, in no system of the earth.
            spec = map_raster(name, frame.grid, dtype, self.basis.crs, tile, nodata=nodata, unit=unit, bands=bands)
            return spec if frame.level else spec.model_copy(update={"crs": None, "tags": frame.tags})
        shape = (*frame.shape, bands) if bands else frame.shape
        return RasterSpec(name=name, shape=shape, dtype=dtype, chunk=tile, nodata=nodata, unit=unit)

    def depth(self) -> Iterator[RasterSpec | Job]:
        """Depth and triangle of all tiles."""
        yield self.raster("nearness", "float32", nodata=nan, unit="m")
        yield self.raster("triangle", "int32")
        for tile in self.tiles:
            numbers = blocks_of_window(self.frame, tile.window, self.basis.blocks.corners, self.basis.origin)
            writes: dict[str, Raster | Table] = {
                layer: Raster(output_layer(self.name, layer), tile.window) for layer in ("nearness", "triangle")
            }
            yield self.job(
                "depth",
                tile,
                output_depth,
                {"blocks": Stream(_blocks(numbers)), "census": CENSUS},
                {**writes, "surface": surface_table(self.name, tile)},
                {"numbers": numbers, "frame": self.frame, "section": self.section, "window": tile.window},
                scratch=160 * prod(tile.window.shape) + 40 * 2**20,
            )

    def job(self, item: str, tile: Tile, function, reads: dict, writes: dict, params: dict, scratch: int = 0) -> Job:
        return Job("projection", f"{self.name}-{item}", function, reads, writes, params, tile.row, tile.col, scratch=scratch)


@dataclass(frozen=True, eq=False)
class ColourJobs:
    """The jobs that follow once the depth rasters are there. `surfaces`: by tile, in the order of `frame.tiles`."""

    frame: FrameJobs
    surfaces: tuple[TileSurface, ...]
    seen: dict[str, PhotoDepth]
    masks: dict[str, PhotographMask]
    """by photograph"""

    @property
    def basis(self) -> ProjectionBasis:
        return self.frame.basis

    @cached_property
    def middle(self) -> np.ndarray:
        """Middle of the surface that is shown (3,) m; the mesh's where none is."""
        shown = [surface for surface in self.surfaces if surface.covered]
        if not shown:
            return np.asarray(self.basis.census.middle)
        low = np.min([surface.low for surface in shown], axis=0)
        return np.asarray(0.5 * (low + np.max([surface.high for surface in shown], axis=0)) + self.basis.origin)

    @cached_property
    def pixel(self) -> float:
        """Side of a pixel on the surface, m."""
        frame = self.frame.frame
        if isinstance(frame, ViewFrame):
            return float(np.linalg.norm(self.middle - frame.centre)) / frame.camera.c
        return frame.pixel

    def sources(self, pixel: float) -> Iterator[PhotoSource]:
        """The photographs at the level whose pixels on the surface are about `pixel` m large."""
        for name in self.frame.photographs:
            view, photo = self.basis.views[name], self.basis.photos[name]
            size = float(np.linalg.norm(self.middle - view.centre)) / view.camera.c
            level = photo_level(pixel, size, photo.levels)
            yield PhotoSource(view, level, level_shape((photo.height, photo.width), level))

    def photo_parts(self, surface: TileSurface, pixel: float) -> tuple[PhotoPart, ...]:
        """The parts of photographs that show a tile."""
        if not surface.covered:
            return ()
        parts = (photo_part(source, surface, self.basis.origin) for source in self.sources(pixel))
        return tuple(part for part in parts if part is not None)

    def tile(self, tile: Tile, surface: TileSurface) -> OutputTile:
        """A tile with the blocks that it shows itself."""
        return OutputTile(self.frame.frame, tile.window, surface.blocks, self.frame.photographs)

    def pairs(self) -> Iterator[tuple[Tile, TileSurface]]:
        """Tiles and what they show."""
        return zip(self.frame.tiles, self.surfaces, strict=True)

    def depth_pictures(self) -> Iterator[RasterSpec | Job | Export]:
        """The depth of the output as a picture, in one range of grey for all tiles."""
        name, covered = self.frame.name, [surface for surface in self.surfaces if surface.covered]
        near = min((s.near[0] for s in covered), default=0.0), max((s.near[1] for s in covered), default=0.0)
        params = {"central": isinstance(self.frame.frame, ViewFrame), "near": near}
        yield self.frame.raster("picture", "uint8", bands=4)
        for tile in self.frame.tiles:
            reads: dict[str, Reading] = {"nearness": Raster(output_layer(name, "nearness"), tile.window)}
            writes: dict[str, Raster | Table] = {"picture": Raster(output_layer(name, "picture"), tile.window)}
            scratch = 40 * prod(tile.window.shape)
            yield self.frame.job("picture", tile, depth_picture, reads, writes, params, scratch=scratch)
        yield Export(
            "projection", f"{name}-depth-png", f"products/depth/{name}.png", "png", {"rgba": output_layer(name, "picture")}
        )

    def sight(self, tolerance: SightTolerance) -> Iterator[RasterSpec | Job]:
        """How every photograph sees every pixel."""
        count = len(self.frame.photographs)
        # A band for every photograph, however few there are.
        yield self.frame.raster("sight", "uint8", bands=count).model_copy(update={"colours": False})
        for tile, surface in self.pairs():
            own = self.tile(tile, surface)
            found = [
                ideal_part(self.basis.views[name], surface, self.basis.ideal[name], self.basis.origin)
                for name in (self.frame.photographs if surface.covered else ())
            ]
            parts = tuple(part for part in found if part is not None)
            inner = [(part.name, part.window.within(self.basis.ideal[part.name])) for part in parts]
            numbers = union_of([surface.blocks, *(self.seen[name].blocks_in(window) for name, window in inner)])
            shown = {part.name for part in parts} & set(self.masks)
            masked = tuple(part for part in self.full_parts(surface) if part.name in shown)
            reads: dict[str, Reading] = {
                "triangle": Raster(output_layer(self.frame.name, "triangle"), tile.window),
                "blocks": _blocks(numbers),
                "nearness": Stream(tuple(Raster(photograph_layer(name, "nearness"), window) for name, window in inner)),
                "drawn": Stream(tuple(Raster(photograph_layer(name, "triangle"), window) for name, window in inner)),
                "block": BLOCK,
                "census": CENSUS,
                "facing": FACING,
            }
            if masked:
                reads["masks"] = Stream(tuple(self.masks[part.name].region(part.window) for part in masked))
            numbered = OutputTile(own.frame, own.window, numbers, own.names, parts, masked)
            yield self.frame.job(
                "sight",
                tile,
                sight_tile,
                reads,
                {"sight": Raster(output_layer(self.frame.name, "sight"), tile.window)},
                {"tile": numbered, "tolerance": tolerance},
                scratch=(400 + count) * prod(tile.window.shape) + len(numbers) * 2**20,
            )

    def full_parts(self, surface: TileSurface) -> tuple[PhotoPart, ...]:
        """The parts of photographs in full size that show a tile."""
        return self.photo_parts(surface, 0.0)

    def samples(self, spacing: int, first: int) -> Iterator[Job]:
        """Samples for the balance; their numbers begin with `first`."""
        for tile, surface in self.pairs():
            parts = self.photo_parts(surface, _COARSER * self.pixel)
            yield self.frame.job(
                "samples",
                tile,
                sample_surface,
                {**self._reads(tile, surface, parts), "facing": FACING},
                {"samples": samples_table(self.frame.name, tile)},
                {"tile": self.tile(tile, surface).with_parts(parts), "spacing": spacing, "first": first},
                scratch=16 * prod(tile.window.shape) + 2**20,
            )

    def surface_reads(self, surface: TileSurface) -> dict[str, Reading]:
        """The triangles that a tile shows, and where they and the photographs are."""
        return {"blocks": _blocks(surface.blocks), "block": BLOCK, "census": CENSUS}

    def _reads(self, tile: Tile, surface: TileSurface, parts: tuple[PhotoPart, ...]) -> dict[str, Reading]:
        return {
            "triangle": Raster(output_layer(self.frame.name, "triangle"), tile.window),
            "sight": Raster(output_layer(self.frame.name, "sight"), tile.window),
            "photos": tuple(Raster(photo_raster(part.name, part.level), part.window) for part in parts),
            **self.surface_reads(surface),
        }

    def zoned_reads(self, tile: Tile, surface: TileSurface) -> tuple[OutputTile, dict[str, Reading]]:
        """A tile with its photographs and their zones, and what a job reads to colour it."""
        parts, zones = self.photo_parts(surface, self.pixel), self.full_parts(surface)
        reads: dict[str, Reading] = {
            **self._reads(tile, surface, parts),
            "zones": tuple(Raster(zones_layer(self.frame.name, part.name), part.window) for part in zones),
            "facing": FACING,
            "radiometry": PROJECTION_RADIOMETRY,
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
            layers = {layer: Raster(output_layer(frame.name, layer), tile.window) for layer in ("ortho", "coverage", "rejected")}
            writes = {**layers, "statistics": statistics_table(frame.name, tile)}
            params = {"tile": zoned, "rules": rules}
            yield frame.job("colours", tile, colour_tile, reads, writes, params, scratch=self.colour_scratch(tile, zoned.parts))

    def left_out(self, rules: ColourRules, widening: Table[ChosenWidth] | None) -> Iterator[RasterSpec | Job]:
        """The tiles of a photograph from all others, blended and from the nearest one."""
        frame = self.frame
        yield frame.raster("blended", "uint8", bands=4)
        yield frame.raster("nearest", "uint8", bands=4)
        for tile, surface in self.pairs():
            parts = self.photo_parts(surface, self.pixel)
            reads: dict[str, Reading] = {**self._reads(tile, surface, parts), "facing": FACING, "radiometry": PROJECTION_RADIOMETRY}
            if widening:
                reads["widening"] = widening
            writes = {layer: Raster(output_layer(frame.name, layer), tile.window) for layer in ("blended", "nearest")}
            params = {"tile": self.tile(tile, surface).with_parts(parts), "rules": rules}
            yield frame.job("left-out", tile, left_out_tile, reads, writes, params, scratch=self.colour_scratch(tile, parts))

    def colour_scratch(self, tile: Tile, parts: tuple[PhotoPart, ...]) -> int:
        # Points, normals and corners in float64, and for every photograph colours, weights and breaks.
        return (300 + 20 * len(parts)) * prod(tile.window.shape) + 8 * 2**20
