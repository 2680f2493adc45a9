"""Distances that contradict each other, found before they take part in the adjustment.

A distance is known to centimetres, and its ends are determined by a few pointings. One that is wrong by metres pulls its ends away
from their rays, which then look wrong themselves; where it defines the scale, it takes the whole block with it. The ends are
therefore intersected from the rays alone first, and all distances compared with one common scale. Of three or more the wrong ones
can be identified; of two that disagree neither can, and the standard errors of both are enlarged to their difference.
"""

from dataclasses import dataclass

import numpy as np

# Deformation of a block of rays without control: a camera constant or a distortion that is still wrong by as much.
DEFORMATION = 1e-3
"""Relative error of a distance in a block that is not yet controlled."""
# With less contrast, rejecting the wrong one of two suspects would give the block the scale of the other.
CLEARER = 3.0
"""A distance is rejected where the others agree this many times better without it than without any other."""


@dataclass(frozen=True, eq=False)
class Agreement:
    """`scale`: ratio of measured to model lengths; `misfit` (D,) from it in standard errors, 0 where the model lacks the distance;
    `wrong` (D,) bool: contradicts the others; `sigma` (D,): standard errors to be used, m."""

    scale: float
    misfit: np.ndarray
    wrong: np.ndarray
    sigma: np.ndarray


def agreement(length: np.ndarray, sigma: np.ndarray, model: np.ndarray, model_sigma: np.ndarray, limit: float) -> Agreement:
    """Compares measured distances (D,) and their standard errors with those of a model in a scale of its own (D,), NaN where it
    lacks one; `limit`: the largest misfit from the common scale, in standard errors."""
    compared = np.isfinite(model) & np.isfinite(model_sigma) & (model > 0)
    wrong, enlarged = np.zeros(len(length), bool), sigma.copy()
    if not compared.any():
        return Agreement(1.0, np.zeros(len(length)), wrong, enlarged)
    model = np.where(compared, model, 1.0)
    ratio, rough = length / model, np.sqrt((sigma / length) ** 2 + (model_sigma / model) ** 2 + DEFORMATION**2)
    # Of two distances neither can be said to be the wrong one.
    while compared.sum() > 2 and _misfits(ratio, rough, compared).max() > limit:
        rest = {int(i): _misfits(ratio, rough, compared & (np.arange(len(ratio)) != i)).max() for i in np.flatnonzero(compared)}
        worst, second = sorted(rest, key=rest.__getitem__)[:2]
        if rest[worst] * CLEARER > rest[second]:
            break
        wrong[worst], compared[worst] = True, False
    # The median: up to half of the distances may be wrong without anyone knowing which.
    scale = float(np.median(ratio[compared]))
    misfit = np.where(wrong, np.abs(ratio / scale - 1.0) / rough, _misfits(ratio, rough, compared))
    if misfit[compared].max() > limit:
        enlarged[compared] = np.maximum(sigma, np.abs(length - scale * model))[compared]
    return Agreement(scale, misfit, wrong, enlarged)


def _misfits(ratio: np.ndarray, rough: np.ndarray, chosen: np.ndarray) -> np.ndarray:
    """(D,) the difference of each of the `chosen` from the median scale of the others, in standard errors; 0 for the rest."""
    misfit, number = np.zeros(len(ratio)), np.flatnonzero(chosen)
    for i in number if len(number) > 1 else ():
        # Without the distance itself, which would pull a median of few towards it.
        others = number[number != i]
        scale = float(np.median(ratio[others]))
        sigma = np.hypot(rough[i], np.median(rough[others]) / np.sqrt(len(others)))
        misfit[i] = abs(ratio[i] / scale - 1.0) / sigma
    return misfit
