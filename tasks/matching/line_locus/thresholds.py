"""From which correlation on a node counts as found: a fixed value, the published t test, or one that knows what pixels are.

Strategy. The t test asks whether a correlation could be chance among n independent pixels and in one trial, so that large windows
pass nearly anything (0.04 at 85 x 85). Pixels are not independent and the height is the best of many trials. The third threshold
counts the pixels that a window is worth (Bartlett: n over the sum of the products of both autocorrelations) and the heights that
are really different, and tests with these. It is a table over that worth, so that kernels look it up.

Source: Tumska, Procyk, Janczak (sources/line_locus.md#v2, #v3); Bartlett 1946; Sidak 1967.
"""

from typing import Literal

import numpy as np
from scipy.special import stdtrit

from orthomill.tasks.matching.line_locus.height_search_settings import Threshold

WORTHS = np.geomspace(1.0, 40000.0, 256)
"""independent pixels at which limits are tabulated; between them they are interpolated"""
TRIALS = np.geomspace(1.0, 400.0, 48)
"""different heights at which limits are tabulated"""


def threshold_limits(threshold: Threshold, pixels: int) -> np.ndarray:
    """Correlations (TRIALS, WORTHS) from which on a node counts as found, for windows of so many pixels."""
    if threshold.kind == "independent_pixels":
        single = 1.0 - (1.0 - threshold.error_probability) ** (1.0 / TRIALS[:, None])
        return critical_correlation(WORTHS[None, :], single, "one")
    same: float | np.ndarray = threshold.value if threshold.kind == "fixed" else 0.0
    if threshold.kind == "t_test":
        same = critical_correlation(pixels, threshold.error_probability, threshold.sides)
    return np.full((len(TRIALS), len(WORTHS)), same)


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
