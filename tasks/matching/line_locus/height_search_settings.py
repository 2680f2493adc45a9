"""How heights are sought on a vertical line: equal steps to both sides of the start, halved until they are below what is required;
and from which correlation on they count as found.

Every choice that the publication leaves open is a setting.

Source: Tumska, Procyk, Janczak (sources/line_locus.md#v1).
"""

from math import ceil, floor, log2
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from orthomill.schemas.settings import Settings, setting


class FixedThreshold(Settings):
    """The same correlation for every window."""

    kind: Literal["fixed"] = "fixed"
    value: float = setting(0.6, "Correlation from which on a node counts as found.", ge=0.0, le=1.0)


class TTestThreshold(Settings):
    """The published t test: whether the correlation of so many pixels, taken as independent, could be chance in one trial."""

    kind: Literal["t_test"] = "t_test"
    error_probability: float = setting(0.001, "Probability that chance passes.", gt=0.0, lt=0.5)
    sides: Literal["two", "one"] = setting("two", "Whether a negative correlation counts as significant as well.")


class IndependentPixelsThreshold(Settings):
    """A t test with the number of pixels that the texture makes independent, for the best of all heights that were tried."""

    kind: Literal["independent_pixels"] = "independent_pixels"
    error_probability: float = setting(0.01, "Probability that the best of all heights passes by chance.", gt=0.0, lt=0.5)


Threshold = Annotated[FixedThreshold | TTestThreshold | IndependentPixelsThreshold, Field(discriminator="kind")]


STEP_PIXELS = 1.5
"""parallax between the first heights when nothing else is asked: a peak of the correlation is some three pixels wide"""
ACCURACY_PIXELS = 0.1
"""parallax below which steps are fine enough when nothing else is asked"""
SLOPE, _SMALLEST, _LARGEST = 0.3, 3, 12
"""rise of the ground over which windows of an automatic size may reach: at their edges it is then seen one pixel of parallax away
from level ground, where correlation ends; and half sizes between which they stay"""
_MOST = 100
"""heights on either side of the start"""
Auto = Literal["auto"] | Annotated[float, Field(gt=0)]


class HeightSearch(Settings):
    """How the height of a node is sought on its vertical line, and when it counts as found."""

    window: Literal["auto"] | Annotated[int, Field(ge=5, le=201)] = setting(
        "auto",
        "Side of the windows that are compared; an even number is taken as the next odd one; auto is as large as ground rising 3 "
        "in 10 allows, 9 px at a base of 0.8 times the height.",
        "px",
    )
    alignment: Literal["ground", "image"] = setting(
        "ground",
        "Windows with the axes of the map, or with those of the photographs (as published; for photographs that are not turned "
        "against one another).",
    )
    interpolation: Literal["bilinear", "nearest"] = setting(
        "bilinear", "Grey values between pixels, or those of the nearest pixels."
    )
    level: int = setting(0, "Pyramid level of the photographs; each halves them.", ge=0, le=8)
    photographs: int = setting(
        3,
        "Photographs that are compared at a node, at most; all of them must be alike, so that more are more precise and find less.",
        ge=2,
        le=16,
    )
    step: Auto = setting("auto", "First distance between the heights of a line; auto is 1.5 px of parallax.", "m")
    side_points: int = setting(
        5, "Heights on either side of the start, in every round; the first one has more on a rough existing model.", ge=1, le=_MOST
    )
    accuracy: Auto = setting("auto", "The steps are halved until they are below this; auto is 0.1 px of parallax.", "m")
    fit: Literal["parabola", "none"] = setting(
        "parabola", "The top of a parabola through the last correlations, or the best height itself (as published)."
    )
    measure: Literal["signed", "absolute", "published"] = setting(
        "signed",
        "What is sought and tested: the correlation, its absolute value, or as published (the largest correlation is sought, its "
        "absolute value is tested).",
    )
    threshold: Threshold = setting(IndependentPixelsThreshold(), "From which correlation on a node counts as found.")
    start: Literal["neighbour", "terrain"] = setting(
        "neighbour",
        "Where a line is entered: at the height of the node before (as published), or on the terrain of the tie points.",
    )
    passed_on: Literal["accepted", "found"] = setting(
        "accepted", "What a rejected node hands to the next one: the height that it was given, or the height that it found."
    )
    order: Literal["rings", "rows", "serpentine"] = setting(
        "rings", "Order of the nodes: away from the first one on all sides, along the rows, or along the rows there and back."
    )

    @model_validator(mode="after")
    def _refines(self) -> "HeightSearch":
        if self.step != "auto" and self.accuracy != "auto" and self.step < self.accuracy:
            raise ValueError(
                f"step is {self.step} m and accuracy {self.accuracy} m; the first step must not be smaller than the accuracy"
            )
        return self

    def sized(self, base: float) -> Self:
        """The same search with windows of a known size; base: widest base over height of the photographs that are compared."""
        if self.window != "auto":
            return self
        half = min(max(floor(1.0 / (SLOPE * base)), _SMALLEST), _LARGEST)
        return self.model_copy(update={"window": 2 * half + 1})

    def first_points(self, reach: float, metres_per_pixel: float) -> int:
        """Heights on either side of the start in a first round that covers `reach` m, a hundred at most."""
        first = float(self.spacings(metres_per_pixel)[0])
        wanted = _MOST if reach > _MOST * first else ceil(reach / first)
        return max(self.side_points, wanted)

    @property
    def half(self) -> int:
        """Half the side of the windows, whose size must be known (`sized`)."""
        assert self.window != "auto"
        return self.window // 2

    @property
    def pixels(self) -> int:
        """Pixels of a window."""
        return (2 * self.half + 1) ** 2

    def spacings(self, metres_per_pixel: float) -> np.ndarray:
        """(rounds,) m: the distances between heights, round by round; metres_per_pixel: height that a pixel of parallax stands
        for."""
        step = STEP_PIXELS * metres_per_pixel if self.step == "auto" else self.step
        accuracy = ACCURACY_PIXELS * metres_per_pixel if self.accuracy == "auto" else self.accuracy
        return step / 2.0 ** np.arange(rounds(step, accuracy))


def rounds(step: float, accuracy: float) -> int:
    """Rounds of a search: the last one is the first whose spacing is below `accuracy`, and it is still evaluated."""
    # Steps that were halved can equal the accuracy but for rounding; such a round is not yet below it.
    return max(floor(log2(step / accuracy) + 1e-9) + 2, 1)
