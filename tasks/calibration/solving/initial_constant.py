"""The initial camera constant from homographies of a plane, with the principal point at the image centre.

Two methods. (1) Each photo gives c1, as the columns of its homography are perpendicular, and c2, as they are equally long; medians
of both are taken after one rejection of values beyond their spread, and the one with the smaller spread is used. For a photo that
looks straight down both are quotients of two values near zero: it is left out. (2) The image of the absolute conic with one
unknown, 1 / c^2, in one least-squares fit over all photos, where such photos have no weight by themselves.

Source: Kawka 2021, S7 and S8, equations 3.24 and 3.27 (sources/calibration.md); Zhang 2000.
"""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class ConstantEstimate:
    """`c` px; `c1`, `c2` (P,) px of the photos, NaN where a photo does not determine it; `sigma1`, `sigma2` px, their spreads after
    rejection."""

    c: float
    c1: np.ndarray
    c2: np.ndarray
    sigma1: float
    sigma2: float


def constants(H: np.ndarray) -> tuple[float, float]:
    """c1 and c2 (px) of one homography (3, 3), NaN where the photo does not determine it (S8, equations 3.24 and 3.27)."""
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = np.linalg.norm(H[:2, :2]) ** 2
        below1, below2 = -H[2, 0] * H[2, 1], H[2, 1] ** 2 - H[2, 0] ** 2
        square1 = (H[0, 0] * H[0, 1] + H[1, 0] * H[1, 1]) / below1
        square2 = (H[0, 0] ** 2 - H[0, 1] ** 2 + H[1, 0] ** 2 - H[1, 1] ** 2) / below2
    # The denominators vanish for a photo without tilt, and noise makes squares negative for a photo with little.
    least = 1e-12 * scale
    c1 = np.sqrt(square1) if abs(below1) > least and square1 > 0 else np.nan
    c2 = np.sqrt(square2) if abs(below2) > least and square2 > 0 else np.nan
    return float(c1), float(c2)


def estimate(c1: np.ndarray, c2: np.ndarray) -> ConstantEstimate:
    """The published rule over all photos: median, one rejection, the one with the smaller spread (S8). NaN when no photo determines
    it."""
    first, second = _after_rejection(c1), _after_rejection(c2)
    c = first[0] if first[1] < second[1] or not np.isfinite(second[0]) else second[0]
    return ConstantEstimate(c, c1, c2, first[1], second[1])


def _after_rejection(values: np.ndarray) -> tuple[float, float]:
    """Median and spread of the values within one spread of the median of all."""
    values = values[np.isfinite(values)]
    if not len(values):
        return np.nan, np.inf
    median, sigma = median_and_spread(values)
    return median_and_spread(values[np.abs(values - median) <= sigma]) if np.isfinite(sigma) else (median, sigma)


def median_and_spread(values: np.ndarray) -> tuple[float, float]:
    """Median, and the root mean square deviation from it (divisor n - 1); infinite for a single value."""
    median = float(np.median(values))
    return median, float(np.sqrt(((values - median) ** 2).sum() / (len(values) - 1))) if len(values) > 1 else np.inf


def constant_from_conic(homographies: list[np.ndarray]) -> float:
    """c (px) from the image of the absolute conic with the principal point in the centre and square pixels; NaN without tilt.

    h1' diag(s, s, 1) h2 = 0 and h1' diag(s, s, 1) h1 = h2' diag(s, s, 1) h2 are linear in s = 1 / c^2.
    """
    A, b = [], []
    for H in homographies:
        # Each photo counts alike, whatever the units of its plane and its distance.
        size = np.linalg.norm(H[:2, :2]) ** 2
        A += [(H[0, 0] * H[0, 1] + H[1, 0] * H[1, 1]) / size, ((H[:2, 0] ** 2).sum() - (H[:2, 1] ** 2).sum()) / size]
        b += [-H[2, 0] * H[2, 1] / size, (H[2, 1] ** 2 - H[2, 0] ** 2) / size]
    s = float(np.dot(A, b) / max(np.dot(A, A), 1e-300))
    return float(1.0 / np.sqrt(s)) if s > 0 else np.nan
