"""What a job reads to find how photographs see a part of the surface: drawn depths, blocks of the mesh, masks."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from orthomill.schemas.job import PhotoPixels, Raster
from orthomill.schemas.raster import Window
from orthomill.tasks.colouring.sight.output_tile import union_of
from orthomill.tasks.geometry.photograph_part import PhotoPart
from orthomill.tasks.projection.photographs.chosen_photographs import PhotographMask
from orthomill.tasks.projection.plan.projection_tables import photograph_layer
from orthomill.tasks.projection.projection_basis import ProjectionBasis
from orthomill.tasks.visibility.mesh_blocks import PhotoDepth, TileSurface


@dataclass(frozen=True)
class SightRegions:
    """`parts`: windows of the photographs' pictures without distortion, `drawn` the same within their rasters; `blocks` that are in
    sight; `masked`: windows of the photographs with a mask, and the `masks` there."""

    parts: tuple[PhotoPart, ...]
    drawn: tuple[tuple[str, Window], ...]
    blocks: tuple[int, ...]
    masked: tuple[PhotoPart, ...]
    masks: tuple[PhotoPixels | Raster, ...]

    def rasters(self, layer: str) -> tuple[Raster, ...]:
        """The parts in a raster of the photographs: nearness, triangle."""
        return tuple(Raster(photograph_layer(name, layer), window) for name, window in self.drawn)


def sight_regions(
    basis: ProjectionBasis,
    names: Sequence[str],
    surface: TileSurface,
    seen: Mapping[str, PhotoDepth],
    masks: Mapping[str, PhotographMask],
    full: Sequence[PhotoPart],
) -> SightRegions:
    """Of the photographs `names` and a surface; `seen`: what photographs show of the mesh; `full`: their parts in full size."""
    parts = basis.ideal_parts(names, surface)
    drawn = tuple((part.name, part.window.within(basis.ideal[part.name])) for part in parts)
    blocks = union_of([surface.blocks, *(seen[name].blocks_in(window) for name, window in drawn)])
    shown = {part.name for part in parts} & set(masks)
    masked = tuple(part for part in full if part.name in shown)
    return SightRegions(parts, drawn, blocks, masked, tuple(masks[part.name].region(part.window) for part in masked))
