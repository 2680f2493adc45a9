"""The rasters and jobs of a pair that is matched by a strategy."""

from collections.abc import Iterator

from orthomill.schemas.epipolar import EpipolarPair, epipolar_raster
from orthomill.schemas.job import Job, Raster, Reading
from orthomill.schemas.raster import RasterSpec, Tile, tiles_of
from orthomill.tasks.densification.planning.pair_plan import block_writes, counts_job, node_specs
from orthomill.tasks.densification.strategies.pair_strategies import PairStrategy
from orthomill.tasks.densification.strategies.strategy_block import SIDE, StrategyBlock, match_by_strategy
from orthomill.tasks.geometry.epipolar_window import nodes_shape


def strategy_plan(pair: EpipolarPair, strategy: PairStrategy, stage: str) -> Iterator[RasterSpec | Job]:
    """The blocks of a pair, or the whole pair as one block."""
    shape = nodes_shape(pair, strategy.step)
    chunk = max(shape) if strategy.whole else max(SIDE // strategy.step, 1)
    yield from node_specs(pair, strategy.step, chunk)
    tiles = list(tiles_of(shape, chunk))
    for tile in tiles:
        yield _block_job(pair, strategy, tile, stage)
    yield counts_job(stage, pair, tiles)


def _block_job(pair: EpipolarPair, strategy: PairStrategy, tile: Tile, stage: str) -> Job:
    block = StrategyBlock(pair, tile.window, strategy.step, strategy.halo(), strategy.pyramid.levels)
    reads: dict[str, Reading] = {}
    for side, window in (("left", block.left), ("right", block.right)):
        if not window.empty:
            reads[side] = Raster(epipolar_raster(pair.name, side), window)
    return Job(
        stage,
        pair.name,
        match_by_strategy,
        reads,
        block_writes(pair, tile),
        {"block": block, "strategy": strategy},
        row=tile.row,
        col=tile.col,
        scratch=block.scratch,
    )
