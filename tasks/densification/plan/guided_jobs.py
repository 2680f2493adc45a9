"""The rasters and jobs of guided densification: the first guide, points and guide of every level, then every pixel."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from math import ceil
from statistics import median
from typing import Any

from orthomill.schemas.epipolar import EpipolarPair, epipolar_raster
from orthomill.schemas.job import Job, MapFile, Raster, Reading, Stream, Table
from orthomill.schemas.memory import array_bytes
from orthomill.schemas.observations import GROUND_POINTS
from orthomill.schemas.orientation import BLOCK as BLOCK_TABLE
from orthomill.schemas.raster import MapGrid, RasterSpec, Tile, Window, map_raster, tiles_of
from orthomill.schemas.surface import Surface
from orthomill.tasks.densification.guided.guide_model import (
    HALO_RADII,
    SQUARE_POSTS,
    GuideTile,
    level_guide,
    no_guide,
    tie_point_guide,
)
from orthomill.tasks.densification.guided.pixel_block import AT_ONCE, match_every_pixel
from orthomill.tasks.densification.guided.point_block import (
    GuidedBlock,
    GuidedPoints,
    GuidedStatistics,
    match_guided_points,
    sum_guided,
)
from orthomill.tasks.densification.plan.pair_jobs import block_writes, counts_job, node_specs
from orthomill.tasks.densification.settings.guide_settings import GuideFile
from orthomill.tasks.densification.settings.guided_matching import Guided, GuidedLevel, LevelsGuide
from orthomill.tasks.densification.strategies.strategy_block import SIDE, StrategyBlock
from orthomill.tasks.densification.surface_grid import ground_pixel
from orthomill.tasks.densification.volume.guide_posts import file_guide, post_grid
from orthomill.tasks.geometry.epipolar_window import box_corners, map_window, node_window, nodes_shape

POSTS_PER_SQUARE = 8
"""posts along the side of the square of the interval"""


def guide_raster(level: int) -> str:
    """(rows, cols, 4) float32 m at posts of the map: middle, lowest and highest height of the points of a post, and their number.

    Level 0 is the guide of the first level; level k is made from the points of level k.
    """
    return f"densification/guided/{level}/guide"


def points_of_block(level: int, pair: str, tile: Tile) -> Table[GuidedPoints]:
    """The matched points of a block of a pair."""
    return Table(f"densification/guided/{level}/{pair}/{tile.row}-{tile.col}.parquet", GuidedPoints)


def cloud_table(level: int, tile: Tile) -> Table[GuidedPoints]:
    """The points of a level in a square of the map, without spikes."""
    return Table(f"densification/guided/{level}/cloud/{tile.row}-{tile.col}.parquet", GuidedPoints)


def level_table(level: int) -> Table[GuidedStatistics]:
    """The counts of a level."""
    return Table(f"densification/guided/{level}.json", GuidedStatistics)


@dataclass(frozen=True, eq=False)
class GuidedPlan:
    """What the rasters and jobs are planned from."""

    stage: str
    crs: str
    surface: Surface
    pairs: tuple[EpipolarPair, ...]
    settings: Guided

    @cached_property
    def pixel(self) -> float:
        """Ground pixel of the epipolar images, m: the median of the pairs."""
        return median(ground_pixel(pair) for pair in self.pairs)

    @cached_property
    def posts(self) -> MapGrid:
        """One grid of posts for all levels, that of the full images."""
        return post_grid(self.surface.grid, self.settings.interval.side(self.pixel) / POSTS_PER_SQUARE)

    def jobs(self) -> Iterator[RasterSpec | Job]:
        """Everything up to the nodes of all pairs."""
        for number in range(len(self.settings.levels) + 1):
            yield self._spec(number)
        yield self._first_guide()
        for level in self.settings.levels:
            yield from self._level(level)
        for pair in self.pairs:
            yield from self._pixels(pair)

    def _spec(self, number: int) -> RasterSpec:
        axes = "post_y", "post_x"
        return map_raster(
            guide_raster(number), self.posts, "float32", self.crs, SQUARE_POSTS, nodata=float("nan"), unit="m", bands=4, axes=axes
        )

    def _first_guide(self) -> Job:
        """The guide of the first level, in one piece."""
        guide, whole = self.settings.guide, Window(0, 0, *self.posts.shape)
        reads: dict[str, Reading] = {"block": BLOCK_TABLE}
        params: dict[str, Any] = {"grid": self.posts, "surface": self.surface}
        function: Callable[..., Any] = no_guide if isinstance(guide, LevelsGuide) else tie_point_guide
        if not isinstance(guide, LevelsGuide):
            reads["points"] = GROUND_POINTS
        if isinstance(guide, GuideFile):
            function = file_guide
            reads["guide"] = MapFile(guide.path, self.crs, self.posts, whole)
            params["path"] = guide.path
        scratch = array_bytes(100, self.posts)
        return Job(
            stage=self.stage,
            item="guide 0",
            function=function,
            reads=reads,
            writes={"guide": Raster(guide_raster(0), whole)},
            params=params,
            scratch=scratch,
        )

    def _level(self, level: GuidedLevel) -> Iterator[Job]:
        counts: list[Table[GuidedStatistics]] = []
        for pair in self.pairs:
            for tile in _blocks(pair):
                counts.append(
                    Table(f"densification/guided/{level.number}/{pair.name}/{tile.row}-{tile.col}.json", GuidedStatistics)
                )
                yield self._points(pair, tile, level, counts[-1])
        for tile in tiles_of(self.posts.shape, SQUARE_POSTS):
            counts.append(Table(f"densification/guided/{level.number}/cloud/{tile.row}-{tile.col}.json", GuidedStatistics))
            yield self._guide(tile, level, counts[-1])
        yield Job(
            stage=self.stage,
            item=f"level {level.number}",
            function=sum_guided,
            reads={"parts": tuple(counts)},
            writes={"sum": level_table(level.number)},
        )

    def _points(self, pair: EpipolarPair, tile: Tile, level: GuidedLevel, counts: Table[GuidedStatistics]) -> Job:
        part = StrategyBlock(pair, tile.window, 1, self.settings.halo(pair, level), level.reduction)
        block = self._block(part, level.factor)
        return Job(
            stage=self.stage,
            item=f"points {level.number} {pair.name}",
            function=match_guided_points,
            reads=self._reads(block, level.number - 1),
            writes={"points": points_of_block(level.number, pair.name, tile), "statistics": counts},
            params={"block": block, "level": level, "settings": self.settings},
            row=tile.row,
            col=tile.col,
            scratch=block.scratch(tile.window.cells // 16),
        )

    def _block(self, part: StrategyBlock, factor: int) -> GuidedBlock:
        side = self.settings.interval.side(self.pixel * factor)
        margin = ceil(self.settings.interval.reach(side) / self.posts.cell) + 2
        core = part.nodes.scaled(part.step)
        posts = map_window(part.pair, core, self.posts, self.surface.height_low, self.surface.height_high, margin)
        return GuidedBlock(part, self.posts, posts, side)

    def _reads(self, block: GuidedBlock, guide: int) -> dict[str, Reading]:
        reads: dict[str, Reading] = {}
        for side, window in (("left", block.part.left), ("right", block.part.right)):
            if not window.empty:
                reads[side] = Raster(epipolar_raster(block.pair.name, side), window)
        if not block.posts.empty:
            reads["guide"] = Raster(guide_raster(guide), block.posts)
        return reads

    def _guide(self, tile: Tile, level: GuidedLevel, counts: Table[GuidedStatistics]) -> Job:
        radius = self.settings.outliers.reach(self.pixel * level.factor)
        around = tile.window.grown(ceil(HALO_RADII * radius / self.posts.cell))
        corners = box_corners(self.posts, around, self.surface.height_low, self.surface.height_high)
        shown = [
            points_of_block(level.number, pair.name, block)
            for pair in self.pairs
            for window in [node_window(pair, SIDE, corners, margin=1)]
            for block in _blocks(pair)
            if window.row <= block.row < window.row + window.height and window.col <= block.col < window.col + window.width
        ]
        return Job(
            stage=self.stage,
            item=f"guide {level.number}",
            function=level_guide,
            reads={"before": Raster(guide_raster(level.number - 1), tile.window), "points": Stream(tuple(shown))},
            writes={
                "guide": Raster(guide_raster(level.number), tile.window),
                "cloud": cloud_table(level.number, tile),
                "statistics": counts,
            },
            params={
                "tile": GuideTile(self.posts, tile.window, around, radius),
                "outliers": self.settings.outliers,
                "surface": self.surface,
            },
            row=tile.row,
            col=tile.col,
            # Pairs of neighbours: a circle holds a few tens of points of the densest level.
            scratch=array_bytes(2000, around),
        )

    def _pixels(self, pair: EpipolarPair) -> Iterator[RasterSpec | Job]:
        step = self.settings.pixels.step
        chunk = max(SIDE // step, 1)
        yield from node_specs(pair, step, chunk)
        tiles = list(tiles_of(nodes_shape(pair, step), chunk))
        for tile in tiles:
            block = self._block(StrategyBlock(pair, tile.window, step, self.settings.pixel_halo(pair), 0), 1)
            yield Job(
                stage=self.stage,
                item=pair.name,
                function=match_every_pixel,
                reads=self._reads(block, len(self.settings.levels)),
                writes=block_writes(pair, tile),
                params={"block": block, "settings": self.settings},
                row=tile.row,
                col=tile.col,
                scratch=block.scratch(AT_ONCE),
            )
        yield counts_job(self.stage, pair, tiles)


def _blocks(pair: EpipolarPair) -> Iterator[Tile]:
    """The blocks of the left image of a pair."""
    return tiles_of((pair.rows, pair.left_cols), SIDE)
