"""The settings by which points are matched by least squares."""

from typing import Annotated, Literal

from pydantic import Field, model_validator

from orthomill.schemas.settings import Settings, refuse_ignored, setting
from orthomill.tasks.matching.windows.window_settings import ChosenWindow

MOST_HALF = 60
"""Half side of the largest window, px."""


class InverseCompositional(Settings):
    """Gradients of the left window at its own pixels; the normal matrix belongs to the window and is factored once."""

    kind: Literal["inverse_compositional"] = "inverse_compositional"


class Forward(Settings):
    """The textbook's form: gradients of the right image, a new normal matrix in every iteration."""

    kind: Literal["forward"] = "forward"
    gradients: Literal["whole_pixels", "resampled_left", "resampled_right", "window_right"] = setting(
        "whole_pixels",
        "Central differences at whole pixels of the right image, the left one being resampled; of the resampled left window; of "
        "the resampled right window with a ring around it, carried to the right image's axes; or of the resampled right window "
        "alone, one-sided at its border and used as they are.",
    )
    max_area_change: float | None = setting(
        10.0,
        "A window that the affine mirrors, or whose area it changes by more than this factor, has gone astray; null: never.",
        gt=1.0,
    )


class Square(Settings):
    """A square window."""

    kind: Literal["square"] = "square"


class Ellipse(Settings):
    """An ellipse of the area of the square, re-shaped in every iteration from the covariance of the two shifts.

    The inverse-compositional form lets it keep its shape after five iterations.
    """

    kind: Literal["ellipse"] = "ellipse"
    major_axis: Literal["along", "across"] = setting("along", "Direction of the long axis, to that of the greatest uncertainty.")
    max_axis_ratio: float = setting(4.0, "Limit of the ratio of the axes; a straight edge would have none.", ge=1.0, le=8.0)


Formulation = Annotated[InverseCompositional | Forward, Field(discriminator="kind")]
Shape = Annotated[Square | Ellipse, Field(discriminator="kind")]


class LeastSquaresMatching(Settings):
    """How points are matched by least squares."""

    window: Annotated[int, Field(ge=5, le=2 * MOST_HALF + 1)] | ChosenWindow = setting(
        21,
        "Side of the window, an even one is taken as the next odd one; or how it is chosen from the left image, point by point.",
        "px",
    )
    shape: Shape = setting(Square(), "Shape of the window.")
    formulation: Formulation = setting(InverseCompositional(), "Where the gradients come from.")
    geometry: Literal["shift", "affine"] = setting("affine", "Geometric unknowns: two shifts, or six parameters of an affine.")
    radiometry: Literal["none", "normalised", "estimated"] = setting(
        "estimated",
        "Exposure: taken as equal; right window brought to the mean and standard deviation of the left; or gain and offset as "
        "two more unknowns.",
    )
    smoothing: float = setting(0.8, "Sigma of the Gaussian that both images are smoothed with.", "px", ge=0.0, le=5.0)
    interpolation: Literal["bilinear", "bicubic"] = setting("bicubic", "How an image is resampled.")
    max_iterations: int = setting(20, "Iterations after which a point is given up.", ge=1, le=200)
    stop: float = setting(0.02, "Converged when both shifts change by less than this.", "px", gt=0.0, le=1.0)
    max_step: float = setting(3.0, "Limit of the shift of one iteration.", "px", gt=0.0)
    max_affine_step: float = setting(0.1, "Limit of the change of the other four parameters in one iteration.", gt=0.0)
    max_shift: float = setting(6.0, "A point that moves further than this from its start is rejected.", "px", gt=0.0)
    min_correlation: float = setting(0.6, "Normalised correlation that the matched windows must reach.", ge=-1.0, le=1.0)
    min_gradient: float = setting(
        0.3, "Root mean square grey value gradient that a window must have in every direction.", "grey values per px", ge=0.0
    )

    @model_validator(mode="after")
    def _everything_has_an_effect(self) -> "LeastSquaresMatching":
        if self.geometry == "shift":
            refuse_ignored(self, ("max_affine_step",), "geometry: shift", "set geometry: affine, or leave it out")
        return self

    @property
    def half(self) -> int:
        """Half side of the window, or of the largest one that may be chosen."""
        return self.window // 2 if isinstance(self.window, int) else self.window.halves[-1]

    @property
    def reach(self) -> int:
        """Pixels to either side of its centre that a window of this size and shape can cover."""
        # One more to choose it: gradients of its border reach beyond it.
        return reach_of_window(self.half, self.shape) + (0 if isinstance(self.window, int) else 1)


def reach_of_window(half: int, shape: Square | Ellipse) -> int:
    """Pixels to either side of the centre that a window can cover: those of the longest ellipse of the square's area."""
    if isinstance(shape, Square):
        return half
    # Semi-major axis of an ellipse of that area and ratio, (side) sqrt(ratio / pi), and 2 px for its sub-pixel centre.
    return int((2 * half + 1) * (shape.max_axis_ratio / 3.141592653589793) ** 0.5) + 2
