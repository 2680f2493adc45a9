"""Trends in the differences between given and adjusted positions: a shift, a tilt, a bend.

Random errors of positions have no trend in plan. A trend that stands out from the scatter about it has one cause for all positions:
another height system, a flight whose heights are shifted, a camera that bends the block. The scatter of the differences
themselves is the yardstick, not the standard errors that somebody stated: a receiver's errors are mostly common to a flight, and
drop out.

Source: the quadratic term is the dome of self-calibrated nadir blocks (James and Robson 2014).
"""

from dataclasses import dataclass

import numpy as np

LEAST = 8
"""Positions from which on a bend can be told from scatter: four coefficients, and as many differences left."""
SIGNIFICANT = 5.0
"""Standard errors by which a trend stands out. Not three: errors of a receiver are correlated in time, which the autocorrelation
of the differences shows in part only."""
SMOOTH = 0.95
"""Largest autocorrelation of the differences that is believed: beyond it nothing but the trend would be left."""


@dataclass(frozen=True)
class HeightTrend:
    """A height difference a + b x + c y + q r^2 (r: distance from the middle, m): its `coefficients` (4,), their standard errors
    `sigma` (4,) by the scatter about it, this `scatter` (m), and the `radius` (m) of the farthest position."""

    coefficients: np.ndarray
    sigma: np.ndarray
    scatter: float
    radius: float

    @property
    def bend(self) -> float:
        """m from the middle to the farthest position, by the quadratic term alone."""
        return float(self.coefficients[3] * self.radius**2)

    @property
    def ratio(self) -> float:
        """The quadratic term in its standard errors."""
        return float(self.coefficients[3] / max(self.sigma[3], 1e-300))

    @property
    def is_bent(self) -> bool:
        """Whether the quadratic term stands out."""
        return abs(self.ratio) > SIGNIFICANT

    def at(self, xy: np.ndarray, middle: np.ndarray) -> np.ndarray:
        """(n,) m: the trend at places (n, 2) about the middle (2,) of the positions that it was fitted to."""
        return _design(xy - middle) @ self.coefficients


def height_trend(xy: np.ndarray, difference: np.ndarray) -> HeightTrend | None:
    """The trend of height differences (n,) m at places (n, 2) m, in the order of exposure; None for fewer than LEAST, and where
    they lie in one place."""
    if len(xy) < LEAST:
        return None
    away = xy - xy.mean(axis=0)
    radius = float(np.linalg.norm(away, axis=1).max())
    if not radius > 0:
        return None
    # In units of the radius, so that constant, tilt and bend are of one size; the smallest norm for positions on one line.
    unit = np.array([1.0, radius, radius, radius**2])
    design = _design(away) / unit
    inverse = np.linalg.pinv(design, rcond=1e-6)
    found = inverse @ difference
    rest = difference - design @ found
    fitted = int(np.linalg.matrix_rank(design, tol=1e-6 * np.linalg.norm(design)))
    redundancy = len(xy) - fitted
    scatter = float(np.sqrt((rest**2).sum() / redundancy)) if redundancy > 0 else np.inf
    alike = np.sqrt((1.0 + (r := autocorrelation(rest, fitted))) / (1.0 - r))
    sigma = scatter * alike * np.linalg.norm(inverse, axis=1)
    return HeightTrend(found / unit, sigma / unit, scatter, radius)


def _design(away: np.ndarray) -> np.ndarray:
    return np.column_stack([np.ones(len(away)), away, (away**2).sum(axis=1)])


def autocorrelation(rest: np.ndarray, fitted: int) -> float:
    """That of neighbours in time of residuals (n,) after `fitted` coefficients, 0 to SMOOTH: the standard error of a mean grows
    with its positive values only."""
    square = float((rest**2).sum())
    if not square > 0:
        return 0.0
    found = float((rest[1:] * rest[:-1]).sum() / square)
    # Every one of the `fitted` coefficients takes a slow part of the differences along (Marriott and Pope 1954).
    return float(np.clip(found + fitted * (1.0 + found) / len(rest), 0.0, SMOOTH))


def without_bend(xy: np.ndarray, difference: np.ndarray) -> np.ndarray:
    """Height differences (n,) without their trend where this is bent, else as they are."""
    trend = height_trend(xy, difference)
    return difference if trend is None or not trend.is_bent else difference - trend.at(xy, xy.mean(axis=0))
