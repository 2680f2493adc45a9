"""How the colours of photographs become one, as a workflow says it, for whatever surface they lie on."""

from math import ceil, sqrt
from typing import Annotated, Literal

from pydantic import Field

from orthomill.schemas.settings import Settings, setting


class ByArea(Settings):
    """Weights are the area of the surface element in each photo."""

    kind: Literal["area"] = "area"


class BySquaredArea(Settings):
    """Weights are the squared area, which favours photos of larger scale more strongly."""

    kind: Literal["area_squared"]


class KeepAllColours(Settings):
    """No colour is rejected."""

    kind: Literal["none"]


class AboutMean(Settings):
    """Colours farther than k standard deviations from the mean are rejected where three photos or more see the ground."""

    kind: Literal["mean"] = "mean"
    k: float = setting(1.0, "Tolerated deviation of a colour, in standard deviations.", gt=0)
    least: float = setting(
        12.0, "Deviations up to this are never rejected, so that noise continues to be averaged.", "grey levels", ge=0
    )


class AboutMedian(Settings):
    """As `mean`, about the median of each channel."""

    kind: Literal["median"]
    k: float = setting(1.0, "Tolerated deviation of a colour, in standard deviations about the median.", gt=0)
    least: float = setting(12.0, "Deviations up to this are never rejected.", "grey levels", ge=0)


class AboutMedianRobust(Settings):
    """About the median, with the median distance instead of the standard deviation: tolerates several bad colours among many."""

    kind: Literal["robust"]
    k: float = setting(3.0, "Tolerated deviation of a colour, in robust standard deviations.", gt=0)
    least: float = setting(12.0, "Deviations up to this are never rejected.", "grey levels", ge=0)


class AverageTwo(Settings):
    """Two colours are averaged, however different they are."""

    kind: Literal["average"] = "average"


class PreferHeavier(Settings):
    """Of two colours that disagree only the one of greater weight is used."""

    kind: Literal["prefer"]
    limit: float = setting(40.0, "Mean difference over the channels beyond which two colours disagree.", "grey levels", gt=0)


class PreferUnbroken(Settings):
    """Of two colours that disagree the one goes whose photo alone sees the place next to a break of its depth."""

    kind: Literal["depth_break"] = "depth_break"
    limit: float = setting(24.0, "Mean difference over the channels beyond which two colours disagree.", "grey levels", gt=0)


class NoBalance(Settings):
    """The photos keep their grey values."""

    kind: Literal["none"]


class BlockBalance(Settings):
    """Gain and offset per photo and channel, adjusted over the whole block from the ground that photos share."""

    kind: Literal["block"] = "block"
    vignetting: bool = setting(True, "Also estimate a radial falloff (r^2 and r^4) per photo and channel.")
    spacing: int = setting(24, "Distance between samples; larger where the block is large.", "px", ge=4, le=1024)


class HistogramBalance(Settings):
    """The histograms of the photos are made alike on the ground that they share, channel by channel (Petsa et al. 2007)."""

    kind: Literal["histogram"]
    spacing: int = setting(24, "Distance between samples; larger where the block is large.", "px", ge=4, le=1024)


Weights = Annotated[ByArea | BySquaredArea, Field(discriminator="kind")]
Rejections = Annotated[KeepAllColours | AboutMean | AboutMedian | AboutMedianRobust, Field(discriminator="kind")]
Balance = Annotated[NoBalance | BlockBalance | HistogramBalance, Field(discriminator="kind")]
TwoColours = Annotated[AverageTwo | PreferHeavier | PreferUnbroken, Field(discriminator="kind")]
SAMPLES_AT_MOST = 60_000
"""Samples of a whole block for its balance."""
_SPACING_OF_RANGE = 64  # px between samples that serve for the range of 16 bits only


class ColourSettings(Settings):
    """How the photographs that see a place become its colour: the settings of every stage that colours a surface."""

    weights: Weights = setting(ByArea(), "Weight of a photo's colour (Petsa et al. 2007).")
    rejection: Rejections = setting(AboutMean(), "Which colours are rejected as gross errors.")
    two_colours: TwoColours = setting(AverageTwo(), "What happens where exactly two photos see the surface and disagree.")
    best: Annotated[int, Field(ge=0, le=64)] | Literal["auto"] = setting(
        0, "Number of photos of the greatest weight that are blended; 0 for all."
    )
    balance: Balance = setting(BlockBalance(), "How the photos are adjusted to one brightness.")
    feather: float = setting(
        0.15,
        "Width of the border of a photo in which its weight rises from 0, as a share of the photo's shorter side.",
        ge=0,
        le=0.5,
    )

    @property
    def vignetting(self) -> bool:
        """Whether the falloff of the photographs is estimated."""
        return self.balance.kind == "block" and self.balance.vignetting

    def sample_spacing(self, pixels: int) -> int:
        """px between the samples for the balance on a surface of so many pixels."""
        wanted = self.balance.spacing if self.balance.kind != "none" else _SPACING_OF_RANGE
        # The unknown brightness of every sample is eliminated, but time and memory still grow with their number.
        return max(wanted, ceil(sqrt(pixels / SAMPLES_AT_MOST)))
