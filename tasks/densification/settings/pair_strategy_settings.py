"""The settings of the strategies by which a pair is matched without knowing the ground."""

from typing import Literal

from orthomill.schemas.settings import Settings, setting
from orthomill.tasks.densification.settings.guide_settings import Guide, TiePointGuide
from orthomill.tasks.matching.strategies.cascade_settings import CascadeMatching
from orthomill.tasks.matching.strategies.growing_settings import RegionGrowing
from orthomill.tasks.matching.strategies.pyramid_settings import PyramidMatching


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


class CoarseToFine(PairStrategy):
    """Every node from level to level of an image pyramid."""

    kind: Literal["pyramid"]

    @property
    def window(self) -> int:
        return 2 * self.pyramid.fine.half + 1


class Cascade(PairStrategy):
    """Every node from the coarser levels, found with a large window, measured, and sharpened with a small one."""

    kind: Literal["cascade"]
    cascade: CascadeMatching = setting(CascadeMatching(), "The three steps.")

    @property
    def window(self) -> int:
        return 2 * self.cascade.measure.half + 1


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
