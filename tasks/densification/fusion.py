"""Several pairs, one height: the best supported group of heights that agree, its weighted mean, its precision.

Strategy: every height is the seed of a group, the heights that agree with it within k standard errors of their difference; the
group of the greatest weight (sum of 1 / sigma^2) wins, a lone height never against two or more that agree. The fused precision is
that of the weighted mean, widened when the group scatters more than its standard errors say.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit

from orthomill.schemas.settings import Settings, setting
from orthomill.tasks.densification.gridding import HeightCells

EMPTY, ONE_PAIR, AGREED, DISPUTED, FILLED = 0, 1, 2, 3, 4
"""codes of `orthomill.schemas.surface.PROVENANCE_CODES`"""


class Fusion(Settings):
    """How the heights of several pairs become one."""

    agreement: float = setting(3.0, "Heights agree when they differ by no more than this many standard errors.", gt=0.0, le=10.0)
    tolerance: float = setting(0.3, "Heights also agree when they differ by less than this.", "cells", ge=0.0, le=10.0)


@dataclass(frozen=True)
class FusedCells:
    """(rows, cols): height and precision float32 m (NaN empty), count and provenance uint8."""

    height: np.ndarray
    precision: np.ndarray
    count: np.ndarray
    provenance: np.ndarray


@njit(cache=True)
def _fuse(heights, sigmas, agreement, tolerance, height, precision, count, provenance):
    pairs = heights.shape[0]
    values, errors = np.empty(pairs), np.empty(pairs)
    for r in range(height.shape[0]):
        for c in range(height.shape[1]):
            n = 0
            for k in range(pairs):
                if heights[k, r, c] == heights[k, r, c]:
                    values[n], errors[n] = heights[k, r, c], max(sigmas[k, r, c], 1e-4)
                    n += 1
            if n == 0:
                continue
            best, best_members, best_weight = 0, 0, 0.0
            for i in range(n):
                weight, members = 0.0, 0
                for j in range(n):
                    if abs(values[i] - values[j]) <= max(agreement * np.sqrt(errors[i] ** 2 + errors[j] ** 2), tolerance):
                        weight += 1.0 / errors[j] ** 2
                        members += 1
                if (members > 1) > (best_members > 1) or ((members > 1) == (best_members > 1) and weight > best_weight):
                    best, best_members, best_weight = i, members, weight
            mean = 0.0
            for j in range(n):
                if abs(values[best] - values[j]) <= max(agreement * np.sqrt(errors[best] ** 2 + errors[j] ** 2), tolerance):
                    mean += values[j] / errors[j] ** 2 / best_weight
            scatter = 0.0
            for j in range(n):
                if abs(values[best] - values[j]) <= max(agreement * np.sqrt(errors[best] ** 2 + errors[j] ** 2), tolerance):
                    scatter += ((values[j] - mean) / errors[j]) ** 2
            widening = max(1.0, np.sqrt(scatter / (best_members - 1))) if best_members > 1 else 1.0
            height[r, c], precision[r, c], count[r, c] = mean, widening / np.sqrt(best_weight), best_members
            if n == 1:
                provenance[r, c] = 1
            else:
                provenance[r, c] = 2 if best_members > 1 and 2 * best_members > n else 3


def fuse(pairs: tuple[HeightCells, ...], shape: tuple[int, int], cell: float, settings: Fusion) -> FusedCells:
    """Fuse the heights of several pairs on the same cells of `shape`; cell: side of a cell, m. No pairs: all empty."""
    fused = FusedCells(
        np.full(shape, np.nan, np.float32), np.full(shape, np.nan, np.float32), np.zeros(shape, np.uint8), np.zeros(shape, np.uint8)
    )
    if pairs:
        _fuse(
            np.stack([pair.height for pair in pairs]),
            np.stack([pair.sigma for pair in pairs]),
            settings.agreement,
            settings.tolerance * cell,
            fused.height,
            fused.precision,
            fused.count,
            fused.provenance,
        )
    return fused
