"""The settings by which the side of a window is chosen from the texture of an image."""

from typing import Annotated, Literal

from pydantic import Field, model_validator

from orthomill.schemas.settings import Settings, refuse_ignored, setting


class GrowingWindow(Settings):
    """Windows between two sizes; an even side is taken as the next odd one."""

    smallest: int = setting(7, "Side of the smallest window that is tried.", "px", ge=5, le=101)
    largest: int = setting(35, "Side of the largest window that is tried.", "px", ge=5, le=101)

    @model_validator(mode="after")
    def _grows(self) -> "GrowingWindow":
        if self.smallest // 2 > self.largest // 2:
            raise ValueError(f"smallest is {self.smallest} and largest is {self.largest}; smallest must not be the larger one")
        return self

    @property
    def halves(self) -> tuple[int, ...]:
        """Half sizes that are tried, in rising order."""
        return tuple(range(self.smallest // 2, self.largest // 2 + 1))


class StatisticalWindow(GrowingWindow):
    """The size at which the range crosses the mean; else the first of enough standard deviation; else the first of enough range."""

    kind: Literal["statistical"] = "statistical"
    min_deviation: float = setting(25.0, "Standard deviation that a window must exceed.", "grey levels", ge=0.0, le=255.0)
    min_excess: float = setting(40.0, "By how much the range must exceed the mean otherwise.", "grey levels", ge=0.0, le=255.0)


class EntropyWindow(GrowingWindow):
    """The first window whose grey levels have enough entropy."""

    kind: Literal["entropy"] = "entropy"
    min_entropy: float = setting(4.0, "Entropy that a window must exceed.", "nats", ge=0.0, le=6.0)
    min_gain: float = setting(
        0.0,
        "A window whose entropy grew by less than this from the size before is accepted as well; 0: no such rule.",
        "nats",
        ge=0.0,
        le=1.0,
    )
    min_stalled: float = setting(3.0, "Entropy that a window accepted for its small gain must have.", "nats", ge=0.0, le=6.0)

    @model_validator(mode="after")
    def _everything_has_an_effect(self) -> "EntropyWindow":
        if self.min_gain == 0.0:
            refuse_ignored(self, ("min_stalled",), "min_gain: 0", "set a min_gain, or leave it out")
        return self


class FoerstnerWindow(GrowingWindow):
    """The first window whose gradients determine both coordinates: weight and roundness of Foerstner's operator."""

    kind: Literal["foerstner"] = "foerstner"
    min_weight: float = setting(
        2000.0,
        "Weight that a window must exceed; noise of s grey levels leaves s / sqrt(weight) px.",
        "grey levels^2 / px^2",
        ge=0.0,
    )
    min_roundness: float = setting(
        0.5, "Roundness of the error ellipse that a window must exceed: 0 is a straight edge, 1 a circle.", ge=0.0, lt=1.0
    )


class CombinedWindow(Settings):
    """The larger of two windows, one determined by gradients and one rich in grey levels; none where one of them is missing."""

    kind: Literal["combined"] = "combined"
    foerstner: FoerstnerWindow = setting(FoerstnerWindow(), "The window that determines both coordinates.")
    entropy: EntropyWindow = setting(EntropyWindow(min_entropy=3.5), "The window that is rich in grey levels.")

    @property
    def halves(self) -> tuple[int, ...]:
        return tuple(sorted({*self.foerstner.halves, *self.entropy.halves}))


class FixedWindow(Settings):
    """The same window for every point."""

    kind: Literal["fixed"] = "fixed"
    window: int = setting(21, "Side of the window; an even number is taken as the next odd one.", "px", ge=5, le=101)

    @property
    def halves(self) -> tuple[int, ...]:
        return (self.window // 2,)


LimitedWindow = StatisticalWindow | EntropyWindow | FoerstnerWindow
SingleWindow = FixedWindow | LimitedWindow
WindowSizing = Annotated[SingleWindow | CombinedWindow, Field(discriminator="kind")]
ChosenWindow = Annotated[LimitedWindow | CombinedWindow, Field(discriminator="kind")]
"""The ways that choose a size point by point."""
