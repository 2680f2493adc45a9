"""What the standard errors of matching are worth on a block, from its own photographs: pairs that share none of them.

Strategy. Two pairs without a common photograph measure a cell independently of each other. How far their heights differ, as a share
of the standard error that matching states for the difference, is counted on squares that are spread evenly over the block: by how
uneven the surface is there for what one pair can tell, and by whether a wall is near. Of every class the ratio below which 68.3 %
lie is the factor of what matching states. A class of few cells has, by degrees, the factor of the blocks on which it was measured
before.

Counts of cells add up alike in any order; what they say changes no height.
"""

from itertools import combinations

import numpy as np
from pydantic import BaseModel, ConfigDict

from orthomill.tasks.densification.precision.matched_ground import MatchedGround

_EDGES = (0.01, 0.02, 0.05, 0.15)
"""unevenness, standard errors of one pair, at which classes of roughness end; the last is open"""
_MIDDLES = np.log((0.007, 0.014, 0.03, 0.08, 0.25))
"""of the classes, between which factors are interpolated"""
CLASSES = len(_MIDDLES)
_USUAL = np.array([[0.36, 0.48, 0.58, 0.63, 0.60], [0.30, 0.38, 0.48, 0.54, 0.57]])
"""(2, CLASSES): factors on ground without and with a wall near, of a simulated town, a simulated wood and a drone flight"""
_ALIKE = 1000
"""cells of a class that say as much as other blocks do: windows overlap, so that neighbours differ alike"""
_BINS, _WIDTH = 100, 0.04
"""classes of the ratio of difference and standard error; the last is open"""
_WITHIN = 0.683
"""share within one standard error"""


class MatchingDifferences(BaseModel):
    """Differences of pairs that share no photograph, of a square or of the whole block: (2 CLASSES, _BINS) cells, those of ground
    without a wall first, by class of roughness and ratio. Empty: none."""

    model_config = ConfigDict(frozen=True)

    counts: tuple[tuple[int, ...], ...] = ()

    @property
    def cells(self) -> int:
        """Cells on which two such pairs have a height."""
        return sum(map(sum, self.counts))


NO_DIFFERENCES = MatchingDifferences()
"""of a block of which nothing is known"""


def pair_differences(
    heights: np.ndarray, sigmas: np.ndarray, photographs: list[frozenset[str]], ground: MatchedGround, judged: np.ndarray
) -> MatchingDifferences:
    """The counts of the cells `judged` (rows, cols) bool: in each the two most precise pairs without a common photograph.

    heights, sigmas (pairs, rows, cols) m, NaN where a pair has none; photographs: of each pair.
    """
    ratio = np.full(judged.shape, np.nan)
    least = np.full(judged.shape, np.inf)
    for one, other in combinations(range(len(photographs)), 2):
        if photographs[one] & photographs[other]:
            continue
        variance = sigmas[one].astype(np.float64) ** 2 + sigmas[other].astype(np.float64) ** 2
        better = variance < least
        ratio = np.where(better, np.abs(heights[one] - heights[other]) / np.sqrt(variance), ratio)
        least = np.where(better, variance, least)
    counted = judged & np.isfinite(ratio)
    kinds = (CLASSES * ground.walled + np.digitize(ground.roughness, _EDGES))[counted]
    bins = np.minimum(ratio[counted] / _WIDTH, _BINS - 1).astype(np.int64)
    counts = np.bincount(kinds * _BINS + bins, minlength=2 * CLASSES * _BINS).reshape(2 * CLASSES, _BINS)
    return MatchingDifferences(counts=tuple(map(tuple, counts.tolist())))


def sum_differences(parts: tuple[MatchingDifferences, ...]) -> MatchingDifferences:
    """The counts of all squares together."""
    known = [np.array(part.counts) for part in parts if part.counts]
    return MatchingDifferences(counts=tuple(map(tuple, np.sum(known, axis=0).tolist())) if known else ())


def factors(differences: MatchingDifferences) -> np.ndarray:
    """(2, CLASSES): what stated standard errors of matching are to be multiplied with, without and with a wall near."""
    if not differences.counts:
        return _USUAL
    counts = np.array(differences.counts, np.float64)
    cells, edges = counts.sum(axis=1), _WIDTH * np.arange(_BINS + 1)
    own = [np.interp(_WITHIN * n, np.concatenate([[0.0], np.cumsum(row)]), edges) for row, n in zip(counts, cells, strict=True)]
    cells = cells.reshape(2, CLASSES)
    return np.asarray((cells * np.reshape(own, (2, CLASSES)) + _ALIKE * _USUAL) / (cells + _ALIKE))


def usual_factor(differences: MatchingDifferences) -> float:
    """The mean factor of the cells that were compared."""
    cells = np.array(differences.counts).sum(axis=1).reshape(2, CLASSES)
    return float((factors(differences) * cells).sum() / cells.sum())


def factor_of(ground: MatchedGround, differences: MatchingDifferences) -> np.ndarray:
    """(rows, cols): the factor of the standard errors of one pair at every cell."""
    table = factors(differences)
    rough = np.log(np.maximum(ground.roughness, 1e-9))
    return np.where(ground.walled, *(np.interp(rough, _MIDDLES, table[kind]) for kind in (1, 0)))
