"""The depth maps of narrow pairs, and what a tile of the volume reads of them."""

from collections.abc import Iterator

from orthomill.schemas.epipolar import EpipolarPair, epipolar_raster
from orthomill.schemas.job import Job, Raster, Stream
from orthomill.schemas.raster import RasterSpec, tiles_of
from orthomill.tasks.densification.canopy.canopy_heights import CanopyTile
from orthomill.tasks.densification.canopy.depth_map import NARROW, SIDE, STEP, DepthBlock, depth_block
from orthomill.tasks.geometry.epipolar_window import nodes_shape


def depth_raster(pair: str) -> str:
    """float32 parallaxes of the depth map of a pair, px of its epipolar images; NaN where the right image confirms none."""
    return f"densification/depth/{pair}"


def narrow(pairs: tuple[EpipolarPair, ...]) -> tuple[EpipolarPair, ...]:
    """The pairs whose photographs see the same leaves."""
    return tuple(pair for pair in pairs if pair.base_height <= NARROW)


def depth_plan(pairs: tuple[EpipolarPair, ...], stage: str) -> Iterator[RasterSpec | Job]:
    """The depth maps of the pairs."""
    for pair in pairs:
        name, shape = depth_raster(pair.name), nodes_shape(pair, STEP)
        yield RasterSpec(name=name, shape=shape, dtype="float32", chunk=SIDE, nodata=float("nan"))
        for tile in tiles_of(shape, SIDE):
            block = DepthBlock(pair, tile.window)
            reads = {"left": Raster(epipolar_raster(pair.name, "left"), block.left)}
            if not block.right.empty:
                reads["right"] = Raster(epipolar_raster(pair.name, "right"), block.right)
            yield Job(
                stage=stage,
                item=f"depth {pair.name}",
                function=depth_block,
                reads=reads,
                writes={"parallax": Raster(name, tile.window)},
                params={"block": block},
                row=tile.row,
                col=tile.col,
                scratch=block.scratch,
            )


def depth_maps(tile: CanopyTile) -> Stream:
    """The parts of the depth maps that a tile needs, twice one after the other, read where its heights stand alone."""
    return Stream(2 * tuple(Raster(depth_raster(piece.pair.name), piece.window) for piece in tile.pieces))
