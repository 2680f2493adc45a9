"""The points of a level in a block of a pair: interest points of the left image, matched within their intervals, on the ground."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from pydantic import BaseModel, ConfigDict

from orthomill.schemas.epipolar import EpipolarPair
from orthomill.schemas.job import Columns
from orthomill.schemas.memory import array_bytes
from orthomill.schemas.outcome import Outcome
from orthomill.schemas.raster import MapGrid, Window
from orthomill.tasks.densification.settings.guided_matching import Guided, GuidedLevel
from orthomill.tasks.densification.strategies.strategy_block import StrategyBlock
from orthomill.tasks.geometry.normal_case import intersect_pair
from orthomill.tasks.matching.guided.band_correlation import BandPlaces, band_places, column_sigmas
from orthomill.tasks.matching.guided.column_interval import GuidePosts, parallax_intervals
from orthomill.tasks.matching.points.interest_points import interest_points
from orthomill.tasks.matching.smoothing import with_gaps
from orthomill.tasks.matching.strategies.coarse_to_fine import halved_part
from orthomill.tasks.matching.strategies.node_grid import ImagePart


@dataclass(frozen=True)
class GuidedPoints(Columns):
    """Matched points on the ground."""

    x: np.ndarray
    y: np.ndarray
    z: np.ndarray
    """float64 m"""
    sigma: np.ndarray
    """float32 m: standard error of the height by matching and orientation of the pair"""


class GuidedStatistics(BaseModel):
    """Counts of a block or of a level."""

    model_config = ConfigDict(frozen=True)

    outcomes: tuple[int, ...] = (0,) * len(Outcome)
    """interest points by code of Outcome"""
    places: int = 0
    """that were compared for all of them together"""
    kept: int = 0
    """points that the removal of spikes left"""


@dataclass(frozen=True)
class GuidedBlock:
    """A part of a pair: `part` says what is read of its images, `posts` is the window of the guide over it, on the grid `guide`;
    `side` of the square of the interval, m."""

    part: StrategyBlock
    guide: MapGrid
    posts: Window
    side: float

    @property
    def pair(self) -> EpipolarPair:
        return self.part.pair

    def scratch(self, nodes_at_once: int) -> int:
        """Working memory, bytes."""
        # Both images with their norms and structure tensor in float64; twenty numbers of every point that is matched at once.
        pixels = self.part.left.cells + self.part.right.cells
        return array_bytes(80, pixels) + array_bytes(200, nodes_at_once) + array_bytes(32, self.posts)


class MatchedPoints(NamedTuple):
    """What the job of a block of a level writes."""

    points: GuidedPoints
    statistics: GuidedStatistics


def no_points() -> GuidedPoints:
    """A table without a row."""
    x, y, z = np.empty((3, 0))
    return GuidedPoints(x, y, z, np.empty(0, np.float32))


def match_guided_points(
    block: GuidedBlock,
    level: GuidedLevel,
    settings: Guided,
    left: np.ndarray | None = None,
    right: np.ndarray | None = None,
    guide: np.ndarray | None = None,
) -> MatchedPoints:
    """The points of a level in a block. left, right: uint8, the windows of `block.part`; guide (rows, cols, 4): the posts."""
    if left is None or right is None or guide is None:
        return MatchedPoints(no_points(), GuidedStatistics())
    images = [ImagePart(with_gaps(pixels), at.col, at.row) for pixels, at in ((left, block.part.left), (right, block.part.right))]
    for _ in range(level.reduction):
        images = [halved_part(image) for image in images]
    one, other = images
    at = _interest_points(block, one, level, settings)
    full = (at + one.origin + 0.5) * level.factor - 0.5
    posts = GuidePosts.of(block.guide, block.posts, guide)
    intervals = parallax_intervals(block.pair, full, posts, settings.interval, block.side)
    columns = right_columns(block.part, full, other, intervals, level.factor, settings.interval.margin)
    beside = settings.beside(block.pair, level.reduction)
    places = band_places(one.pixels, other.pixels, at, columns, one.row - other.row, beside, settings.points)
    outcomes = tuple(np.bincount(places.outcome, minlength=len(Outcome)).tolist())
    points = _on_ground(block, full, places, other, level.factor, settings)
    return MatchedPoints(points, GuidedStatistics(outcomes=outcomes, places=int(places.places.sum())))


def _interest_points(block: GuidedBlock, image: ImagePart, level: GuidedLevel, settings: Guided) -> np.ndarray:
    """Pixels (N, 2) (col, row) int64 of a level's part of the left image that lie in the block itself."""
    core = block.part.nodes.scaled(block.part.step)
    # Blocks begin at multiples of the factor; a last one may end between two of its pixels.
    inside = Window(*(-(-size // level.factor) for size in (core.row, core.col, core.height, core.width)))
    inside = inside.within(Window(image.row, image.col, 0, 0)).clipped(image.pixels.shape)
    found = interest_points(image.pixels, settings.detector(level), core=inside)
    # Templates stand on whole pixels, and so do the points.
    return np.column_stack([np.rint(found.col), np.rint(found.row)]).astype(np.int64)


def right_columns(
    part: StrategyBlock, full: np.ndarray, right: ImagePart, intervals: np.ndarray, factor: int, margin: float
) -> np.ndarray:
    """(N, 2) int64 first and last column in the right part, `factor` px of the full image wide, of left pixels `full` (N, 2) of the
    full image with intervals (N, 3) of parallaxes; the last is before the first where there is none."""
    known = np.isfinite(intervals[:, :2]).all(axis=1)
    # Heights that no two photographs of the pair can see are cut off.
    bounds = part.pair.parallax_low, part.pair.parallax_high
    low, high = (np.clip(np.where(known, values, 0.0), *bounds) for values in (intervals[:, 0], intervals[:, 2]))
    first, last = ((full[:, 0] - part.offset - p + 0.5) / factor - 0.5 - right.col for p in (high, low))
    columns = np.column_stack([np.floor(first - margin), np.ceil(last + margin)]).astype(np.int64)
    columns[~known] = 0, -1
    return columns


def _on_ground(
    block: GuidedBlock, full: np.ndarray, places: BandPlaces, right: ImagePart, factor: int, settings: Guided
) -> GuidedPoints:
    good = places.outcome == Outcome.CONVERGED
    pixels, parallax = full[good], parallaxes(block.part, full, places, right, factor)[good]
    ground = intersect_pair(block.pair, pixels, parallax)
    sigma = parallax_sigmas(places, factor, settings.points.template, settings)[good]
    away = np.abs(ground[:, 2] - block.pair.left_centre[2]) / parallax
    x, y, z = ground.T
    return GuidedPoints(x, y, z, (away * np.hypot(sigma, block.pair.row_sigma)).astype(np.float32))


def parallaxes(part: StrategyBlock, full: np.ndarray, places: BandPlaces, right: ImagePart, factor: int) -> np.ndarray:
    """(N,) parallax x_left - x_right, px of the full image, of the places of left pixels `full` (N, 2)."""
    return full[:, 0] - ((places.col + right.col + 0.5) * factor - 0.5) - part.offset


def parallax_sigmas(places: BandPlaces, factor: int, template: int, settings: Guided) -> np.ndarray:
    """(N,) standard errors of parallaxes, px of the full image."""
    if settings.parallax_sigma != "measured":
        return np.full(len(places.col), float(settings.parallax_sigma) * factor)
    return column_sigmas(places, template * template) * factor


def sum_guided(parts: tuple[GuidedStatistics, ...]) -> GuidedStatistics:
    """The counts of a level."""
    return GuidedStatistics(
        outcomes=tuple(map(sum, zip(*(part.outcomes for part in parts), strict=True))),
        places=sum(part.places for part in parts),
        kept=sum(part.kept for part in parts),
    )
