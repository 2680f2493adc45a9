"""The camera constant before the adjustment, from homographies of a plane; the principal point is taken for the image centre.

Two ways. (1) Each photo gives c1 from the columns of its homography being perpendicular and c2 from their being equally long; the
medians of both, after one rejection of what is further off than their spread, compete, and the one that spreads less wins. A photo
that looks straight down makes both a quotient of nearly nothings: it is left out. (2) The image of the absolute conic with one
unknown, 1 / c^2, over all photos in one least-squares fit, where such photos weigh nothing by themselves.

Source: Kawka 2021, S7 and S8, equations 3.24 and 3.27 (methods/calibration.md); Zhang 2000.
"""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class ConstantEstimate:
    """`c` px; `c1`, `c2` (P,) px of the photos, NaN where a photo gives none; `sigma1`, `sigma2` their spread after rejection."""

    c: float
    c1: np.ndarray
    c2: np.ndarray
    sigma1: float
    sigma2: float


def constants(H: np.ndarray) -> tuple[float, float]:
    """c1 and c2 (px) of one homography, NaN where the photo does not determine it (S8)."""
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = np.linalg.norm(H[:2, :2]) ** 2
        below1, below2 = -H[2, 0] * H[2, 1], H[2, 1] ** 2 - H[2, 0] ** 2
        square1 = (H[0, 0] * H[0, 1] + H[1, 0] * H[1, 1]) / below1
        square2 = (H[0, 0] ** 2 - H[0, 1] ** 2 + H[1, 0] ** 2 - H[1, 1] ** 2) / below2
    least = 1e-12 * scale
    c1 = np.sqrt(square1) if abs(below1) > least and square1 > 0 else np.nan
    c2 = np.sqrt(square2) if abs(below2) > least and square2 > 0 else np.nan
    return float(c1), float(c2)


def estimate(c1: np.ndarray, c2: np.ndarray) -> ConstantEstimate:
    """The published rule over all photos: median, one rejection, the steadier of the two (S8). NaN when no photo gives any."""
    first, second = _after_rejection(c1), _after_rejection(c2)
    c = first[0] if first[1] < second[1] or not np.isfinite(second[0]) else second[0]
    return ConstantEstimate(c, c1, c2, first[1], second[1])


def _after_rejection(values: np.ndarray) -> tuple[float, float]:
    """Median and spread about it of what lies within one spread of the median."""
    values = values[np.isfinite(values)]
    if not len(values):
        return np.nan, np.inf
    median, sigma = median_and_spread(values)
    return median_and_spread(values[np.abs(values - median) <= sigma]) if np.isfinite(sigma) else (median, sigma)


def median_and_spread(values: np.ndarray) -> tuple[float, float]:
    """Median, and the root mean square deviation from it (n - 1); infinite for a single value."""
    median = float(np.median(values))
    return median, float(np.sqrt(((values - median) ** 2).sum() / (len(values) - 1))) if len(values) > 1 else np.inf


def constant_from_conic(homographies: list[np.ndarray]) -> float:
    """c (px) from the image of the absolute conic with the principal point in the centre and square pixels; NaN without tilt.

    h1' diag(s, s, 1) h2 = 0 and h1' diag(s, s, 1) h1 = h2' diag(s, s, 1) h2 are linear in s = 1 / c^2.
    """
    A, b = [], []
    for H in homographies:
        size = np.linalg.norm(H[:2, :2]) ** 2
        A += [(H[0, 0] * H[0, 1] + H[1, 0] * H[1, 1]) / size, ((H[:2, 0] ** 2).sum() - (H[:2, 1] ** 2).sum()) / size]
        b += [-H[2, 0] * H[2, 1] / size, (H[2, 1] ** 2 - H[2, 0] ** 2) / size]
    s = float(np.dot(A, b) / max(np.dot(A, A), 1e-300))
    return float(1.0 / np.sqrt(s)) if s > 0 else np.nan
