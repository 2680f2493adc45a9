"""Several pairs, one height: the best supported group of heights that agree, its weighted mean and its precision.

Strategy: every height seeds a group, which consists of the heights that agree with it within k standard errors of their difference.
The group of greatest weight (sum of 1 / sigma^2) wins; a single height never wins against two or more that agree. The fused
precision is that of the weighted mean, widened when the group scatters more than its standard errors predict.
"""

from dataclasses import dataclass

import numpy as np

from orthomill.kernels.kernel_compilation import njit
from orthomill.schemas.surface import Provenance
from orthomill.tasks.densification.height_stack import HeightStack
from orthomill.tasks.densification.settings.surface_settings import Fusion

_LEAST_SIGMA = 1e-4
"""m; a standard error of zero would give a weight of infinity"""


@dataclass(frozen=True)
class FusedCells:
    """(rows, cols): height and precision float32 m (NaN where empty), count of agreeing pairs and provenance uint8."""

    height: np.ndarray
    precision: np.ndarray
    count: np.ndarray
    provenance: np.ndarray


@njit(inline="always")
def _agree(seed, other, seed_sigma, other_sigma, agreement, tolerance):
    """Whether two heights (m) with their standard errors differ by no more than chance, or than `tolerance` (m)."""
    # Within a cell the ground itself varies, so very precise heights of two pairs may differ without contradiction: hence the
    # floor `tolerance` besides the statistical test.
    return abs(seed - other) <= max(agreement * np.sqrt(seed_sigma**2 + other_sigma**2), tolerance)


@njit(inline="always")
def _better(members, weight, best_members, best_weight):
    """Whether a group beats the best so far: agreement first, weight second."""
    # Matching errors are not normal: a blunder can report a tiny sigma, and by weight alone it would outvote two good heights.
    return (members > 1) > (best_members > 1) or ((members > 1) == (best_members > 1) and weight > best_weight)


@njit()
def _fuse(heights, sigmas, agreement, tolerance, height, precision, count, provenance):
    """Fills the last four (rows, cols) from heights and sigmas (pairs, rows, cols) m."""
    pairs = heights.shape[0]
    values, errors = np.empty(pairs), np.empty(pairs)
    for r in range(height.shape[0]):
        for c in range(height.shape[1]):
            n = 0
            for k in range(pairs):
                if heights[k, r, c] == heights[k, r, c]:
                    values[n], errors[n] = heights[k, r, c], max(sigmas[k, r, c], _LEAST_SIGMA)
                    n += 1
            if n == 0:
                continue
            best, best_members, best_weight = 0, 0, 0.0
            for i in range(n):
                weight, members = 0.0, 0
                for j in range(n):
                    if _agree(values[i], values[j], errors[i], errors[j], agreement, tolerance):
                        weight += 1.0 / errors[j] ** 2
                        members += 1
                if _better(members, weight, best_members, best_weight):
                    best, best_members, best_weight = i, members, weight
            mean = 0.0
            for j in range(n):
                if _agree(values[best], values[j], errors[best], errors[j], agreement, tolerance):
                    mean += values[j] / errors[j] ** 2 / best_weight
            scatter = 0.0
            for j in range(n):
                if _agree(values[best], values[j], errors[best], errors[j], agreement, tolerance):
                    scatter += ((values[j] - mean) / errors[j]) ** 2
            # Only ever widened: with two or three members a small scatter is chance, not evidence of a better precision.
            widening = max(1.0, np.sqrt(scatter / (best_members - 1))) if best_members > 1 else 1.0
            height[r, c], precision[r, c], count[r, c] = mean, widening / np.sqrt(best_weight), best_members
            if n == 1:
                provenance[r, c] = Provenance.ONE_PAIR
            elif best_members > 1 and 2 * best_members > n:
                provenance[r, c] = Provenance.AGREED
            else:
                provenance[r, c] = Provenance.DISPUTED


def fuse(stack: HeightStack, cell: float, settings: Fusion) -> FusedCells:
    """Fuse the heights that several pairs gave to the same cells; cell: side of a cell, m."""
    shape = stack.reference.shape
    fused = FusedCells(
        np.full(shape, np.nan, np.float32), np.full(shape, np.nan, np.float32), np.zeros(shape, np.uint8), np.zeros(shape, np.uint8)
    )
    _fuse(
        stack.height,
        stack.sigma,
        settings.agreement,
        settings.tolerance * cell,
        fused.height,
        fused.precision,
        fused.count,
        fused.provenance,
    )
    return fused
