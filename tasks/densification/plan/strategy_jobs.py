"""The rasters and jobs of a pair that is matched by a strategy."""

from collections.abc import Iterator
from dataclasses import replace

from orthomill.schemas.epipolar import EpipolarPair, epipolar_raster
from orthomill.schemas.job import Job, Raster, Reading, Stream
from orthomill.schemas.memory import array_bytes
from orthomill.schemas.raster import RasterSpec, Tile, tiles_of
from orthomill.schemas.surface import Surface
from orthomill.tasks.densification.plan.near_model_jobs import MODEL
from orthomill.tasks.densification.plan.pair_jobs import block_writes, counts_job, node_specs
from orthomill.tasks.densification.settings.guide_settings import GuideFile
from orthomill.tasks.densification.settings.pair_strategy_settings import PairStrategy
from orthomill.tasks.densification.strategies.assigned_windows import assigned_windows, strips_of, windows_table
from orthomill.tasks.densification.strategies.near_model import model_area
from orthomill.tasks.densification.strategies.pair_strategies import fitted, halo
from orthomill.tasks.densification.strategies.strategy_block import SIDE, StrategyBlock, match_by_strategy
from orthomill.tasks.geometry.epipolar_window import nodes_shape


def strategy_plan(pair: EpipolarPair, strategy: PairStrategy, surface: Surface, stage: str) -> Iterator[RasterSpec | Job]:
    """The blocks of a pair, or the whole pair as one block."""
    strategy = fitted(strategy, pair)
    shape = nodes_shape(pair, strategy.step)
    chunk = max(shape) if strategy.whole else max(SIDE // strategy.step, 1)
    yield from node_specs(pair, strategy.step, chunk)
    if strategy.assigned is not None:
        yield _windows_job(pair, strategy, stage)
    tiles = list(tiles_of(shape, chunk))
    for tile in tiles:
        yield _block_job(pair, strategy, tile, surface, stage)
    yield counts_job(stage, pair, tiles)


def _windows_job(pair: EpipolarPair, strategy: PairStrategy, stage: str) -> Job:
    """The limits that give the wanted share of the points of a pair a window."""
    strips = strips_of(pair, strategy)
    return Job(
        stage=stage,
        item=f"{pair.name}-windows",
        function=assigned_windows,
        reads={"left": Stream(tuple(Raster(epipolar_raster(pair.name, "left"), strip) for strip in strips))},
        writes={"windows": windows_table(pair.name)},
        params={"pair": pair, "strategy": strategy},
        scratch=max(array_bytes(64, strip) for strip in strips),
    )


def _block_job(pair: EpipolarPair, strategy: PairStrategy, tile: Tile, surface: Surface, stage: str) -> Job:
    block = StrategyBlock(pair, tile.window, strategy.step, halo(strategy), strategy.pyramid.levels)
    if isinstance(strategy.guide, GuideFile):
        block = replace(block, model=model_area(pair, block.left, surface))
    reads: dict[str, Reading] = {}
    for side, window in (("left", block.left), ("right", block.right)):
        if not window.empty:
            reads[side] = Raster(epipolar_raster(pair.name, side), window)
    if block.model is not None and not block.model.window.empty:
        reads["posts"] = Raster(MODEL, block.model.window)
    if strategy.assigned is not None:
        reads["windows"] = windows_table(pair.name)
    return Job(
        stage=stage,
        item=pair.name,
        function=match_by_strategy,
        reads=reads,
        writes=block_writes(pair, tile),
        params={"block": block, "strategy": strategy},
        row=tile.row,
        col=tile.col,
        scratch=block.scratch,
    )
