"""From which correlation on a node counts as found: a fixed value, the published t test, or one that knows what pixels are.

Strategy. The t test asks whether a correlation could be chance among n independent pixels and in one trial, so that large windows
pass nearly anything (0.04 at 85 x 85). Pixels are not independent and the height is the best of many trials. The third threshold
counts the pixels that a window is worth (Bartlett: n over the sum of the products of both autocorrelations) and the heights that
are really different, and tests with these. It is a table over that worth, so that kernels look it up.

Source: Tumska, Procyk, Janczak (sources/line_locus.md#v2, #v3); Bartlett 1946; Sidak 1967.
"""

from typing import Annotated, Literal

import numpy as np
from pydantic import Field
from scipy.special import stdtrit

from orthomill.schemas.settings import Settings, setting

WORTHS = np.geomspace(1.0, 40000.0, 256)
"""independent pixels at which limits are tabulated; between them they are interpolated"""
TRIALS = np.geomspace(1.0, 400.0, 48)
"""different heights at which limits are tabulated"""


class FixedThreshold(Settings):
    """The same correlation for every window."""

    kind: Literal["fixed"] = "fixed"
    value: float = setting(0.6, "Correlation from which on a node counts as found.", ge=0.0, le=1.0)

    def limits(self, pixels: int) -> np.ndarray:
        """As `TTestThreshold.limits`."""
        return np.full((len(TRIALS), len(WORTHS)), self.value)


class TTestThreshold(Settings):
    """The published t test: whether the correlation of so many pixels, taken as independent, could be chance in one trial."""

    kind: Literal["t_test"] = "t_test"
    error_probability: float = setting(0.001, "Probability that chance passes.", gt=0.0, lt=0.5)
    sides: Literal["two", "one"] = setting("two", "Whether a negative correlation counts as significant as well.")

    def limits(self, pixels: int) -> np.ndarray:
        """Correlations (TRIALS, WORTHS) from which on a node counts as found, for windows of so many pixels."""
        return np.full((len(TRIALS), len(WORTHS)), critical_correlation(pixels, self.error_probability, self.sides))


class IndependentPixelsThreshold(Settings):
    """A t test with the number of pixels that the texture makes independent, for the best of all heights that were tried."""

    kind: Literal["independent_pixels"] = "independent_pixels"
    error_probability: float = setting(0.01, "Probability that the best of all heights passes by chance.", gt=0.0, lt=0.5)

    def limits(self, pixels: int) -> np.ndarray:
        """As `TTestThreshold.limits`."""
        single = 1.0 - (1.0 - self.error_probability) ** (1.0 / TRIALS[:, None])
        return critical_correlation(WORTHS[None, :], single, "one")


Threshold = Annotated[FixedThreshold | TTestThreshold | IndependentPixelsThreshold, Field(discriminator="kind")]


def critical_correlation(
    pixels: float | np.ndarray, error_probability: float | np.ndarray, sides: Literal["two", "one"] = "two"
) -> np.ndarray:
    """R_c = t / sqrt(n - 2 + t^2), the correlation whose t value is critical; 1 where two pixels or fewer say nothing."""
    freedom = np.asarray(pixels, dtype=np.float64) - 2.0
    # A function of scipy.special, because importing scipy.stats takes a tenth of the time in which a process starts.
    t = -stdtrit(np.maximum(freedom, 1e-3), np.asarray(error_probability) / (2.0 if sides == "two" else 1.0))
    with np.errstate(invalid="ignore"):
        limit = 1.0 / np.sqrt(1.0 + np.maximum(freedom, 0.0) / t**2)
    return np.where(freedom > 0.0, limit, 1.0)
