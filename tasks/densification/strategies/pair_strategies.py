"""The strategies by which a pair can be matched without knowing the ground: coarse to fine, region growing, and the cascade.

All of them match the nodes of the left epipolar image; where each one begins differs. None of them uses that homologous rows are
known beyond bounding the search, so that the y-parallax of a match tells of its quality.

Source: Skarlatos (sources/matching.md#region-growing, #pyramids); sources/measured.md#windows (cascade).
"""

from typing import Literal

import numpy as np

from orthomill.schemas.settings import Settings, setting
from orthomill.tasks.densification.volume.guide_heights import Guide, TiePointGuide
from orthomill.tasks.matching.least_squares.matching import Matches
from orthomill.tasks.matching.strategies.cascade import CascadeMatching, match_cascade
from orthomill.tasks.matching.strategies.coarse_to_fine import PyramidMatching, SearchRange, coarse_field, match_pyramid
from orthomill.tasks.matching.strategies.coarse_to_fine import halo as pyramid_halo
from orthomill.tasks.matching.strategies.match_tables import moved, taken
from orthomill.tasks.matching.strategies.node_grid import ImagePart, NodeGrid
from orthomill.tasks.matching.strategies.region_growing import RegionGrowing, found_seeds, grow, region_cover
from orthomill.tasks.matching.strategies.region_growing import halo as growing_halo


class PairStrategy(Settings):
    """What the strategies of a pair share."""

    step: int = setting(4, "Distance of the nodes of a pair.", "px", ge=1, le=64)
    pyramid: PyramidMatching = setting(PyramidMatching(), "The coarser levels, on which nothing need be known.")
    guide: Guide = setting(
        TiePointGuide(), "What bounds the search on the coarsest level; with tie points, the range of parallaxes of the pair."
    )

    @property
    def whole(self) -> bool:
        """Whether a pair is matched in one piece."""
        return False

    @property
    def window(self) -> int:
        """Side of the windows in which the heights are measured in the end, or of the largest of them, px."""
        raise NotImplementedError

    def halo(self) -> int:
        """Pixels around its nodes that a part of the left image needs to give what the whole gives."""
        return pyramid_halo(self.pyramid, self.step)

    def matches(self, left: ImagePart, right: ImagePart, grid: NodeGrid, search: SearchRange) -> Matches:
        """The nodes of a grid, row by row; positions in pixels of the photographs."""
        raise NotImplementedError


class CoarseToFine(PairStrategy):
    """Every node from level to level of an image pyramid."""

    kind: Literal["pyramid"]

    @property
    def window(self) -> int:
        return 2 * self.pyramid.fine.half + 1

    def matches(self, left: ImagePart, right: ImagePart, grid: NodeGrid, search: SearchRange) -> Matches:
        return match_pyramid(left, right, grid, search, self.pyramid)


class Cascade(PairStrategy):
    """Every node from the coarser levels, found with a large window, measured, and sharpened with a small one."""

    kind: Literal["cascade"]
    cascade: CascadeMatching = setting(CascadeMatching(), "The three steps.")

    @property
    def window(self) -> int:
        return 2 * self.cascade.measure.half + 1

    def matches(self, left: ImagePart, right: ImagePart, grid: NodeGrid, search: SearchRange) -> Matches:
        points = grid.points()
        starts, affine = coarse_field(left, right, points, search, self.pyramid).below(points)
        known = np.isfinite(starts).all(axis=1)
        # Nodes of which nothing is known start where they are: their outcome says that they were not found.
        starts = np.where(known[:, None], starts, points)
        found = match_cascade(left.pixels, right.pixels, points - left.origin, starts - right.origin, self.cascade, affine)
        return moved(found, left.origin, right.origin)


class Growing(PairStrategy):
    """Region growing from a few seeds over all ground that can be matched, and over nothing else (Otto & Chau 1989)."""

    kind: Literal["region_growing"]
    growing: RegionGrowing = setting(RegionGrowing(), "How regions grow.")

    @property
    def window(self) -> int:
        return 2 * self.growing.matching.half + 1

    @property
    def whole(self) -> bool:
        return self.growing.region == 0

    def halo(self) -> int:
        return 0 if self.whole else growing_halo(self.growing, self.step, self.pyramid)

    def matches(self, left: ImagePart, right: ImagePart, grid: NodeGrid, search: SearchRange) -> Matches:
        cover = region_cover(grid, self.growing)
        seeds = found_seeds(left, right, cover, search, self.growing, self.pyramid)
        found = grow(left, right, cover, seeds, self.growing)
        inner = np.zeros(cover.shape, bool)
        inner[grid.row - cover.row :, grid.col - cover.col :][: grid.rows, : grid.cols] = True
        return taken(found, inner.ravel())
