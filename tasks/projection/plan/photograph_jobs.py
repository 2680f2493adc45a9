"""The jobs of the photographs: depth and triangle of every pixel, black borders, and depths as pictures."""

from collections.abc import Iterator

from orthomill.schemas.job import Export, Job, Raster, Stream
from orthomill.schemas.memory import MIB, array_bytes
from orthomill.schemas.orientation import BLOCK
from orthomill.schemas.photo import photo_raster
from orthomill.schemas.raster import RasterSpec, Window
from orthomill.tasks.colouring.sight.output_tile import blocks_of_photograph
from orthomill.tasks.projection.mesh.depth_rasters import depth_picture, photograph_depth
from orthomill.tasks.projection.photographs.border_masks import border_mask
from orthomill.tasks.projection.plan.projection_tables import (
    CENSUS,
    border_layer,
    border_table,
    depth_table,
    mesh_blocks,
    photograph_layer,
)
from orthomill.tasks.projection.projection_basis import ProjectionBasis


def photograph_jobs(basis: ProjectionBasis) -> Iterator[RasterSpec | Job]:
    """Depth and triangle of every photograph."""
    for name, view in basis.views.items():
        window = basis.ideal[name]
        whole = Window(0, 0, *window.shape)
        for layer, kind, unit in (("nearness", "float32", "1/m"), ("triangle", "int32", "")):
            yield RasterSpec(name=photograph_layer(name, layer), shape=window.shape, dtype=kind, chunk=basis.tile, unit=unit)
        numbers = blocks_of_photograph(view, basis.blocks.corners, basis.origin)
        squares = array_bytes(1, window.cells // 16384, len(basis.blocks.boxes))
        yield Job(
            stage="projection",
            item=f"depth-{name}",
            function=photograph_depth,
            reads={"blocks": Stream(mesh_blocks(numbers)), "block": BLOCK, "census": CENSUS},
            writes={
                **{layer: Raster(photograph_layer(name, layer), whole) for layer in ("nearness", "triangle")},
                "seen": depth_table(name),
            },
            params={"numbers": numbers, "name": name, "window": window},
            # Projected corners of a block, the fronts of all triangles, the marks of squares and blocks.
            scratch=4 * MIB + array_bytes(1, basis.census.triangles) + squares,
        )


def border_jobs(basis: ProjectionBasis) -> Iterator[RasterSpec | Job]:
    """The black borders of all photographs."""
    for name in basis.names:
        photo = basis.photos[name]
        whole = Window(0, 0, photo.height, photo.width)
        yield RasterSpec(name=border_layer(name), shape=(*whole.shape, 1), dtype="uint8", chunk=basis.tile)
        yield Job(
            stage="projection",
            item=f"border-{name}",
            function=border_mask,
            reads={"pixels": Raster(photo_raster(name, 0), whole)},
            writes={"mask": Raster(border_layer(name), whole), "facts": border_table(name)},
            scratch=array_bytes(24, whole),
        )


def picture_jobs(basis: ProjectionBasis) -> Iterator[RasterSpec | Job | Export]:
    """The depth of every photograph as a picture, without its distortion."""
    for name in basis.names:
        shape, layer = basis.ideal[name].shape, photograph_layer(name, "picture")
        whole = Window(0, 0, *shape)
        yield RasterSpec(name=layer, shape=(*shape, 4), dtype="uint8", chunk=max(shape))
        yield Job(
            stage="projection",
            item=f"picture-{name}",
            function=depth_picture,
            reads={"nearness": Raster(photograph_layer(name, "nearness"), whole)},
            writes={"picture": Raster(layer, whole)},
            params={"central": True},
            scratch=array_bytes(40, shape),
        )
        yield Export("projection", f"depth-png-{name}", f"products/depth/{name}.png", "png", {"rgba": layer})
