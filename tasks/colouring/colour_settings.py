"""How the colours of photographs become one, as a workflow says it, for whatever surface they lie on."""

from typing import Annotated, Literal

from pydantic import Field

from orthomill.schemas.settings import Settings, setting
from orthomill.tasks.colouring.blending.blending import CentreName, Rejection


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

_CENTRE: dict[str, CentreName] = {"mean": "mean", "median": "median", "robust": "deviation"}


def rejection_of(choice: KeepAllColours | AboutMean | AboutMedian | AboutMedianRobust) -> Rejection:
    """The rule of a setting."""
    return Rejection("none") if choice.kind == "none" else Rejection(_CENTRE[choice.kind], choice.k, choice.least)


def power_of(choice: ByArea | BySquaredArea) -> int:
    """The power of the area that a colour weighs."""
    return 2 if choice.kind == "area_squared" else 1
