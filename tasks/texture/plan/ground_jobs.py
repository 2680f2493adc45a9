"""The jobs that make the surface model ready for the orthoimage: its ground without holes, and its relief."""

from collections.abc import Iterator
from math import nan

from orthomill.schemas.job import Job, Raster, Reading
from orthomill.schemas.memory import array_bytes
from orthomill.schemas.raster import MapGrid, RasterSpec, Window, map_raster, tiles_of
from orthomill.tasks.texture.ground.draping import BLOCK, block_grid, block_heights, blocks_of
from orthomill.tasks.texture.ground.gentle_ground import gentle_ground
from orthomill.tasks.texture.ground.relief import RELIEF, relief_table, tile_relief, whole_relief

BLOCK_HEIGHTS, BLOCK_WEIGHTS, GROUND = "texture/block_heights", "texture/block_weights", "texture/ground"
"""float32: mean heights of blocks of 16 x 16 cells of the surface model (m), NaN in holes; their weights (1/m2); the heights as
gentle as their weights allow (m), with every hole closed"""


def ground_jobs(dsm: MapGrid, crs: str, size: int, heights: str, precision: str) -> Iterator[RasterSpec | Job]:
    """The mean heights of the blocks of the whole model, tile by tile, and its gentle ground; `heights` and their standard errors
    among neighbours are rasters."""
    grid, chunk = block_grid(dsm), size // BLOCK
    for name, unit in ((BLOCK_HEIGHTS, "m"), (BLOCK_WEIGHTS, "1/m2"), (GROUND, "m")):
        yield map_raster(name, grid, "float32", crs, chunk, nodata=nan, unit=unit, axes=("ground_y", "ground_x"))
    for tile in tiles_of(dsm.shape, size):
        blocks = blocks_of(tile.window)
        yield Job(
            stage="texture",
            item="blocks",
            function=block_heights,
            reads={"heights": Raster(heights, tile.window), "precision": Raster(precision, tile.window)},
            writes={"blocks": Raster(BLOCK_HEIGHTS, blocks), "weights": Raster(BLOCK_WEIGHTS, blocks)},
            params={"cell": dsm.cell},
            row=tile.row,
            col=tile.col,
            # Weights, differences and their product, and for the first of the halvings a flag, its sum and the sum in float64.
            scratch=array_bytes(32, tile.window),
        )
    whole = Window(0, 0, *grid.shape)
    yield Job(
        stage="texture",
        item="ground",
        function=gentle_ground,
        reads={"values": Raster(BLOCK_HEIGHTS, whole), "weights": Raster(BLOCK_WEIGHTS, whole)},
        writes={"ground": Raster(GROUND, whole)},
        params={"block": grid.cell},
        scratch=array_bytes(64, grid),
    )


def relief_jobs(dsm: MapGrid, size: int, heights: str, draped: bool) -> Iterator[Job]:
    """The relief of the whole model, tile by tile and then together: what the tiles of the orthoimage read follows from it."""
    tables = []
    for tile in tiles_of(dsm.shape, size):
        reads: dict[str, Reading] = {"heights": Raster(heights, tile.window)}
        if draped:
            reads["ground"] = Raster(GROUND, blocks_of(tile.window))
        tables.append(relief_table(tile.row, tile.col))
        yield Job(
            stage="texture",
            item="relief",
            function=tile_relief,
            reads=reads,
            writes={"relief": tables[-1]},
            params={"window": tile.window},
            row=tile.row,
            col=tile.col,
            scratch=array_bytes(8, tile.window),
        )
    yield Job(
        stage="texture", item="whole-relief", function=whole_relief, reads={"parts": tuple(tables)}, writes={"relief": RELIEF}
    )
