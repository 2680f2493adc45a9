"""What guided densification is asked to do, and its levels.

Source: Karfis 2009, chapter 7 (sources/epipolar.md#row-band to #per-pixel).
"""

from dataclasses import dataclass
from itertools import pairwise
from math import ceil
from typing import Annotated, Literal

from pydantic import Field, field_validator

from orthomill.schemas.epipolar import EpipolarPair
from orthomill.schemas.settings import Settings, setting
from orthomill.tasks.densification.settings.guide_settings import GuideFile, TiePointGuide
from orthomill.tasks.matching.guided.guided_settings import BandCorrelation, ColumnInterval, OutlierDetector
from orthomill.tasks.matching.points.point_settings import HarrisPoints

Patch = tuple[float, float, float, float]
_PER_PIXEL = BandCorrelation(template=9)


class LevelsGuide(Settings):
    """Nothing but the levels themselves: the points of the first one are searched along the whole epipolar line."""

    kind: Literal["levels"]


FirstGuide = Annotated[TiePointGuide | GuideFile | LevelsGuide, Field(discriminator="kind")]


class PixelPass(Settings):
    """The last step: every pixel of the full images that has enough texture."""

    step: int = setting(2, "Distance of the pixels that are matched; 1 is every one.", "px", ge=1, le=16)
    min_entropy: float = setting(4.0, "Entropy that the template must exceed; blank roofs have less.", "bits", ge=0.0, le=8.0)
    correlation: BandCorrelation = setting(_PER_PIXEL, "How a pixel is matched; the template is that of the entropy as well.")
    patches: tuple[Patch, ...] = setting(
        (), "Rectangles (west, south, east, north) outside of which nothing is matched; none: everywhere.", "m"
    )

    @field_validator("patches")
    @classmethod
    def _have_an_area(cls, patches: tuple[Patch, ...]) -> tuple[Patch, ...]:
        for west, south, east, north in patches:
            if not (west < east and south < north):
                raise ValueError(f"the patch {west:g}, {south:g}, {east:g}, {north:g} has no area; west < east and south < north")
        return patches


class Guided(Settings):
    """Points level by level with falling thresholds, each guided by the height model of the level before; then every pixel."""

    kind: Literal["guided"]
    guide: FirstGuide = setting(TiePointGuide(), "What guides the first level.")
    thresholds: tuple[float, ...] = setting(
        (20000.0, 10000.0, 5000.0, 2000.0, 1000.0),
        "Noble's measure that the points of every level must exceed, falling; as many levels.",
        "grey values^2",
        min_length=1,
    )
    reduction: int = setting(
        1, "How often the images of these levels are halved; one more level in full images follows.", ge=0, le=4
    )
    sigma: float = setting(1.5, "Sigma of the Gaussian of the interest operator.", "px of the matched images", ge=0.5, le=5.0)
    radius: int = setting(3, "A point is the strongest within this distance.", "px of the matched images", ge=1, le=50)
    interval: ColumnInterval = setting(ColumnInterval(), "How far along its row a point is searched.")
    rows: Literal["auto"] | Annotated[int, Field(ge=1, le=31)] = setting(
        "auto",
        "Rows that are searched, an odd number; auto is 3, or more where the orientation is worse.",
        "px of the matched images",
    )
    points: BandCorrelation = setting(BandCorrelation(), "How a point is matched within its interval.")
    outliers: OutlierDetector = setting(OutlierDetector(), "Removal of spikes from the points of a level.")
    pixels: PixelPass = setting(PixelPass(), "How every pixel is matched in the end.")
    parallax_sigma: Literal["measured"] | Annotated[float, Field(gt=0.0)] = setting(
        "measured", "Standard error of a parallax; measured follows from the correlation of every point, published is 1.", "px"
    )

    @field_validator("thresholds")
    @classmethod
    def _fall(cls, thresholds: tuple[float, ...]) -> tuple[float, ...]:
        if thresholds[-1] <= 0 or any(before <= after for before, after in pairwise(thresholds)):
            raise ValueError("thresholds must fall from level to level and be above 0")
        return thresholds

    @property
    def levels(self) -> tuple["GuidedLevel", ...]:
        """The levels of points, the first one first."""
        reduced = [GuidedLevel(k + 1, limit, self.reduction) for k, limit in enumerate(self.thresholds)]
        full = [GuidedLevel(len(reduced) + 1, self.thresholds[-1], 0)] if self.reduction else []
        return (*reduced, *full)

    def detector(self, level: "GuidedLevel") -> HarrisPoints:
        """The detector of interest points with the threshold of a level."""
        return HarrisPoints(sigma=self.sigma, radius=self.radius, min_strength=level.threshold)

    def beside(self, pair: EpipolarPair, reduction: int) -> int:
        """Rows that are searched to either side of the homologous one."""
        return max(1, ceil(pair.row_sigma / 2**reduction)) if self.rows == "auto" else int(self.rows) // 2

    def halo(self, pair: EpipolarPair, level: "GuidedLevel") -> int:
        """Pixels of the full image around its points that a part of it needs to give what the whole gives."""
        around = self.detector(level).reach + self.points.half + self.beside(pair, level.reduction) + 2
        return around * level.factor

    def pixel_halo(self, pair: EpipolarPair) -> int:
        """The same for the pixels of the last step."""
        return self.pixels.correlation.half + self.beside(pair, 0) + 2


@dataclass(frozen=True)
class GuidedLevel:
    """A level of points: its number from 1, the threshold of the interest operator, and how often its images are halved."""

    number: int
    threshold: float
    reduction: int

    @property
    def factor(self) -> int:
        """Pixels of the full image along a pixel of the level."""
        return 2**self.reduction
