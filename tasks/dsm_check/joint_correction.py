"""The corrections of several pairs in one cell become one, with a standard error and the number of pairs behind it.

Strategy. Every pair sees a place from two directions: what a house hides from one is open to another. Pairs that agree are averaged
by their precision. Where three or more disagree, the one farthest from the others is left out as long as it contradicts them; two
that contradict each other cannot be told apart: the cell keeps the more precise one, with the difference in its standard error, and
counts as disputed. Pairs share photographs and the texture of the ground, so that their errors are partly the same: three pairs of
three photographs are no three observations.
"""

import numpy as np
from numba import njit

from orthomill.tasks.dsm_check.correction_map import CorrectionMap

SHARED = 0.5
"""part of the variance that two pairs have in common: that of the photograph in which they meet"""
_CONTRADICTS = 4.0
"""standard errors of a difference"""


def joint(maps: list[CorrectionMap], shape: tuple[int, int]) -> tuple[CorrectionMap, np.ndarray]:
    """The corrections of all pairs together, and disputed cells (rows, cols) bool."""
    disputed = np.zeros(shape, np.bool_)
    if not maps:
        return CorrectionMap(np.full(shape, np.nan, np.float32), np.full(shape, np.nan, np.float32)), disputed
    if len(maps) == 1:
        return maps[0], disputed
    dh, sigma = np.full(shape, np.nan, np.float32), np.full(shape, np.nan, np.float32)
    _join(np.stack([m.dh for m in maps]), np.stack([m.sigma for m in maps]), dh, sigma, disputed)
    return CorrectionMap(dh, sigma), disputed


@njit(cache=True)
def _join(all_dh, all_sigma, dh, sigma, disputed):
    values, errors = np.empty(all_dh.shape[0]), np.empty(all_dh.shape[0])
    for r in range(dh.shape[0]):
        for c in range(dh.shape[1]):
            n = 0
            for k in range(all_dh.shape[0]):
                if np.isfinite(all_dh[k, r, c]):
                    values[n], errors[n] = all_dh[k, r, c], all_sigma[k, r, c]
                    n += 1
            if n == 0:
                continue
            given = n
            while n >= 3:
                worst, by = 0, 0.0
                for k in range(n):
                    # Against the mean of the others: an error in the mean itself would hide the pair that makes it.
                    total, weight = 0.0, 0.0
                    for m in range(n):
                        if m != k:
                            total += values[m] / errors[m] ** 2
                            weight += 1.0 / errors[m] ** 2
                    away = abs(values[k] - total / weight) / np.sqrt(errors[k] ** 2 + 1.0 / weight)
                    if away > by:
                        worst, by = k, away
                if by <= _CONTRADICTS:
                    break
                n -= 1
                values[worst], errors[worst] = values[n], errors[n]
            total, weight, best = 0.0, 0.0, 0
            for k in range(n):
                total += values[k] / errors[k] ** 2
                weight += 1.0 / errors[k] ** 2
                if errors[k] < errors[best]:
                    best = k
            mean, chi = total / weight, 0.0
            for k in range(n):
                chi += (values[k] - mean) ** 2 / errors[k] ** 2
            # Between independent and identical observations; never worse than the best of them alone.
            variance = min((1.0 + (n - 1) * SHARED) / weight, errors[best] ** 2)
            if n == 2 and abs(values[0] - values[1]) > _CONTRADICTS * np.sqrt(errors[0] ** 2 + errors[1] ** 2):
                disputed[r, c] = given == 2
                dh[r, c] = values[best]
                sigma[r, c] = np.sqrt(errors[best] ** 2 + (values[0] - values[1]) ** 2)
                continue
            dh[r, c] = mean
            sigma[r, c] = np.sqrt(variance * max(1.0, chi / max(n - 1, 1)))
