"""The rasters and jobs of a pair: its nodes, some blocks a job, matched near the heights of the volume."""

from collections.abc import Iterator

from orthomill.schemas.epipolar import EpipolarPair, epipolar_raster
from orthomill.schemas.job import Job, Raster, Reading, Table
from orthomill.schemas.outcome import Outcome
from orthomill.schemas.raster import RasterSpec, Tile, tiles_of
from orthomill.schemas.surface import Surface
from orthomill.tasks.densification.matching_block import MatchingStatistics, PairTile, match_pair_tile, sum_matching
from orthomill.tasks.densification.plan.volume_jobs import JUDGED_HEIGHT
from orthomill.tasks.geometry.epipolar_window import nodes_shape
from orthomill.tasks.matching.dense.blocks import BLOCK
from orthomill.tasks.matching.dense.dense_settings import DenseMatching


def nodes_raster(pair: str) -> str:
    """(rows, cols, 3) float32 at the nodes of a pair: parallax px, its standard error px, correlation; NaN without a match."""
    return f"densification/nodes/{pair}"


def outcome_raster(pair: str) -> str:
    """uint8 `orthomill.schemas.outcome.Outcome` at the nodes of a pair."""
    return f"densification/outcome/{pair}"


def matching_table(pair: str) -> Table[MatchingStatistics]:
    """The matching statistics of a pair."""
    return Table(f"densification/matching/{pair}.json", MatchingStatistics)


def block_table(pair: str, tile: Tile) -> Table[MatchingStatistics]:
    """The matching statistics of a block of a pair."""
    return Table(f"densification/matching/{pair}/{tile.row}-{tile.col}.json", MatchingStatistics)


def node_specs(pair: EpipolarPair, step: int, chunk: int) -> tuple[RasterSpec, RasterSpec]:
    """The rasters of the nodes of a pair, `step` px apart, in chunks of so many: what one job writes."""
    shape = nodes_shape(pair, step)
    return (
        RasterSpec(name=nodes_raster(pair.name), shape=(*shape, 3), dtype="float32", chunk=chunk, nodata=float("nan")),
        RasterSpec(name=outcome_raster(pair.name), shape=shape, dtype="uint8", chunk=chunk, nodata=Outcome.NOT_TRIED),
    )


def block_writes(pair: EpipolarPair, tile: Tile) -> dict[str, Raster | Table]:
    """What the job of a block of nodes writes."""
    return {
        "nodes": Raster(nodes_raster(pair.name), tile.window),
        "outcome": Raster(outcome_raster(pair.name), tile.window),
        "statistics": block_table(pair.name, tile),
    }


def counts_job(stage: str, pair: EpipolarPair, tiles: list[Tile]) -> Job:
    """The statistics of the blocks of a pair together."""
    tables = tuple(block_table(pair.name, tile) for tile in tiles)
    return Job(
        stage=stage,
        item=f"{pair.name}-statistics",
        function=sum_matching,
        reads={"parts": tables},
        writes={"sum": matching_table(pair.name)},
    )


def pair_plan(pair: EpipolarPair, surface: Surface, matching: DenseMatching, side: int, stage: str) -> Iterator[RasterSpec | Job]:
    """The tiles of a pair, as many whole blocks as there are in `side` px: what a job stores is a chunk, and chunks are objects."""
    chunk = max(side // BLOCK, 1) * (BLOCK // matching.step)
    yield from node_specs(pair, matching.step, chunk)
    tiles = list(tiles_of(nodes_shape(pair, matching.step), chunk))
    for tile in tiles:
        yield _job(pair, surface, matching, tile, stage)
    yield counts_job(stage, pair, tiles)


def _job(pair: EpipolarPair, surface: Surface, matching: DenseMatching, tile: Tile, stage: str) -> Job:
    part = PairTile.over(pair, tile.window, matching.step, surface)
    reads: dict[str, Reading] = {"left": Raster(epipolar_raster(pair.name, "left"), part.left)}
    if not part.right.empty:
        reads["right"] = Raster(epipolar_raster(pair.name, "right"), part.right)
    if not part.cells.empty:
        reads["heights"] = Raster(JUDGED_HEIGHT, part.cells)
    return Job(
        stage=stage,
        item=pair.name,
        function=match_pair_tile,
        reads=reads,
        writes=block_writes(pair, tile),
        params={"tile": part, "matching": matching},
        row=tile.row,
        col=tile.col,
        scratch=part.scratch(matching),
    )
