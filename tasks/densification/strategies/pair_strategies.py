"""The strategies by which a pair can be matched without knowing the ground: coarse to fine, region growing, and the cascade.

All of them match the nodes of the left epipolar image; where each one begins differs. None of them uses that homologous rows are
known beyond bounding the search, so that the y-parallax of a match tells of its quality.

Source: Skarlatos (sources/matching.md#region-growing, #pyramids); sources/measured.md#windows (cascade).
"""

import numpy as np

from orthomill.schemas.epipolar import EpipolarPair
from orthomill.tasks.densification.settings.pair_strategy_settings import Cascade, CoarseToFine, Growing, PairStrategy
from orthomill.tasks.matching.least_squares.matching import Matches
from orthomill.tasks.matching.strategies.cascade import match_cascade
from orthomill.tasks.matching.strategies.coarse_to_fine import SearchRange, coarse_field, match_pyramid
from orthomill.tasks.matching.strategies.coarse_to_fine import halo as pyramid_halo
from orthomill.tasks.matching.strategies.match_tables import moved, taken
from orthomill.tasks.matching.strategies.node_grid import ImagePart, NodeGrid
from orthomill.tasks.matching.strategies.region_growing import found_seeds, grow, region_cover
from orthomill.tasks.matching.strategies.region_growing import halo as growing_halo


def fitted(strategy: PairStrategy, pair: EpipolarPair) -> PairStrategy:
    """The strategy with no more pyramid levels than the images of a pair can hold: the coarsest must have room for two windows side
    by side, or nothing is found on it, and region growing has no seeds."""
    side, least = min(pair.rows, pair.left_cols, pair.right_cols), 2 * (2 * strategy.pyramid.coarse.half + 1)
    levels = next((n for n in range(strategy.pyramid.levels, 1, -1) if side >> n >= least), min(strategy.pyramid.levels, 1))
    return strategy.model_copy(update={"pyramid": strategy.pyramid.model_copy(update={"levels": levels})})


def halo(strategy: PairStrategy) -> int:
    """Pixels around its nodes that a part of the left image needs to give what the whole gives."""
    if isinstance(strategy, Growing):
        return 0 if strategy.whole else growing_halo(strategy.growing, strategy.step, strategy.pyramid)
    return pyramid_halo(strategy.pyramid, strategy.step)


def matches(strategy: PairStrategy, left: ImagePart, right: ImagePart, grid: NodeGrid, search: SearchRange) -> Matches:
    """The nodes of a grid, row by row; positions in pixels of the photographs."""
    if isinstance(strategy, CoarseToFine):
        return match_pyramid(left, right, grid, search, strategy.pyramid)
    if isinstance(strategy, Cascade):
        return _cascade(strategy, left, right, grid, search)
    assert isinstance(strategy, Growing)
    return _grown(strategy, left, right, grid, search)


def _cascade(strategy: Cascade, left: ImagePart, right: ImagePart, grid: NodeGrid, search: SearchRange) -> Matches:
    points = grid.points()
    starts, affine = coarse_field(left, right, points, search, strategy.pyramid).below(points)
    known = np.isfinite(starts).all(axis=1)
    # Nodes of which nothing is known start where they are: their outcome says that they were not found.
    starts = np.where(known[:, None], starts, points)
    found = match_cascade(left.pixels, right.pixels, points - left.origin, starts - right.origin, strategy.cascade, affine)
    return moved(found, left.origin, right.origin)


def _grown(strategy: Growing, left: ImagePart, right: ImagePart, grid: NodeGrid, search: SearchRange) -> Matches:
    cover = region_cover(grid, strategy.growing)
    seeds = found_seeds(left, right, cover, search, strategy.growing, strategy.pyramid)
    found = grow(left, right, cover, seeds, strategy.growing)
    inner = np.zeros(cover.shape, bool)
    inner[grid.row - cover.row :, grid.col - cover.col :][: grid.rows, : grid.cols] = True
    return taken(found, inner.ravel())
