"""The jobs of an output before anything is coloured: its rasters, and depth and triangle of its tiles."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from math import nan
from typing import Any

from orthomill.schemas.job import Job, Raster, Reading, Stream, Table
from orthomill.schemas.memory import MIB, array_bytes
from orthomill.schemas.raster import RasterSpec, Tile, map_raster, tiles_of
from orthomill.schemas.solid.frames import AnyFrame, FlatFrame
from orthomill.tasks.colouring.sight.output_tile import blocks_of_window
from orthomill.tasks.projection.lines.sections import AnySection
from orthomill.tasks.projection.mesh.depth_rasters import output_depth, shown_surfaces
from orthomill.tasks.projection.plan.projection_tables import CENSUS, SURFACES, mesh_blocks, output_layer, surface_table
from orthomill.tasks.projection.projection_basis import ProjectionBasis


@dataclass(frozen=True, eq=False)
class FrameJobs:
    """The jobs of one output."""

    basis: ProjectionBasis
    frame: AnyFrame
    section: AnySection

    @property
    def name(self) -> str:
        """Of the output."""
        return self.frame.name

    @cached_property
    def tiles(self) -> tuple[Tile, ...]:
        """Of the output."""
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

    def at(self, layer: str, tile: Tile) -> Raster:
        """The pixels of a tile in a raster of the output."""
        return Raster(output_layer(self.name, layer), tile.window)

    def job(
        self,
        item: str,
        tile: Tile,
        *,
        function: Callable[..., Any],
        reads: Mapping[str, Reading],
        writes: Mapping[str, Raster | Table],
        params: dict[str, Any],
        scratch: int,
    ) -> Job:
        """A job on a tile of the output."""
        return Job(
            stage="projection",
            item=f"{self.name}-{item}",
            function=function,
            reads=reads,
            writes=writes,
            params=params,
            row=tile.row,
            col=tile.col,
            scratch=scratch,
        )

    def depth(self) -> Iterator[RasterSpec | Job]:
        """Depth and triangle of all tiles."""
        yield self.raster("nearness", "float32", nodata=nan, unit="m")
        yield self.raster("triangle", "int32")
        for tile in self.tiles:
            numbers = blocks_of_window(self.frame, tile.window, self.basis.blocks.corners, self.basis.origin)
            yield self.job(
                "depth",
                tile,
                function=output_depth,
                reads={"blocks": Stream(mesh_blocks(numbers)), "census": CENSUS},
                writes={
                    "nearness": self.at("nearness", tile),
                    "triangle": self.at("triangle", tile),
                    "surface": surface_table(self.name, tile),
                },
                params={"numbers": numbers, "frame": self.frame, "section": self.section, "window": tile.window},
                scratch=array_bytes(160, tile.window) + 40 * MIB,
            )


def surfaces_job(frames: Iterable[FrameJobs]) -> Job:
    """What all tiles of all frames show, in their order."""
    return Job(
        stage="projection",
        item="surfaces",
        function=shown_surfaces,
        reads={"surfaces": Stream(tuple(surface_table(jobs.name, tile) for jobs in frames for tile in jobs.tiles))},
        writes={"surfaces": SURFACES},
    )
