"""The settings of the strategies by which a pair is matched without knowing the ground."""

from typing import ClassVar, Literal, Self

from pydantic import model_validator

from orthomill.schemas.settings import Settings, setting
from orthomill.tasks.densification.settings.guide_settings import Guide, TiePointGuide
from orthomill.tasks.matching.least_squares.least_squares_settings import LeastSquaresMatching
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

    assigned: float | None = setting(
        None,
        "Share of the points that get a window, where `window` of a step names a way to choose one: its limit is then found in the "
        "left image of each pair; null: the limit that is given.",
        "%",
        gt=0,
        le=100,
    )
    steps: ClassVar[tuple[str, ...]] = ()
    """the steps that work on the photographs themselves, as part.matching"""
    reach: ClassVar[int] = 1
    """windows wide is the ground of which a height may be that of anything"""

    @model_validator(mode="after")
    def _chooses_what_is_assigned(self) -> Self:
        if self.assigned is not None and not self.sized:
            first = self.steps[0]
            raise ValueError(
                f"assigned gives a share of the points a window, but every window here has one size; name a way to choose it, as "
                f"{first}.window: {{kind: statistical}}, or leave assigned out"
            )
        return self

    @property
    def matchings(self) -> dict[str, LeastSquaresMatching]:
        """The least-squares matching of every step on the photographs themselves."""
        parts = (step.split(".") for step in self.steps)
        return {f"{part}.{name}": getattr(getattr(self, part), name) for part, name in parts}

    @property
    def sized(self) -> dict[str, LeastSquaresMatching]:
        """Those that choose the size of their window point by point."""
        return {step: matching for step, matching in self.matchings.items() if not isinstance(matching.window, int)}

    def with_matchings(self, changed: dict[str, LeastSquaresMatching]) -> Self:
        """The strategy with other matching in some steps."""
        found = self
        for step, matching in changed.items():
            part, name = step.split(".")
            inner = getattr(found, part).model_copy(update={name: matching})
            found = found.model_copy(update={part: inner})
        return found

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
    steps: ClassVar[tuple[str, ...]] = ("pyramid.fine",)
    # The finest level searches a few pixels about what the next coarser one found with windows twice as wide on the ground.
    reach: ClassVar[int] = 2

    @property
    def window(self) -> int:
        return 2 * self.pyramid.fine.half + 1


class Cascade(PairStrategy):
    """Every node from the coarser levels, found with a large window, measured, and sharpened with a small one."""

    kind: Literal["cascade"]
    steps: ClassVar[tuple[str, ...]] = ("cascade.find", "cascade.measure", "cascade.sharpen")
    cascade: CascadeMatching = setting(CascadeMatching(), "The three steps.")

    @property
    def window(self) -> int:
        return 2 * self.cascade.measure.half + 1


class Growing(PairStrategy):
    """Region growing from a few seeds over all ground that can be matched, and over nothing else (Otto & Chau 1989)."""

    kind: Literal["region_growing"]
    steps: ClassVar[tuple[str, ...]] = ("growing.matching",)
    growing: RegionGrowing = setting(RegionGrowing(), "How regions grow.")

    @property
    def window(self) -> int:
        return 2 * self.growing.matching.half + 1

    @property
    def whole(self) -> bool:
        return self.growing.region == 0
