"""Distances that contradict each other, found before they take part.

A distance is known to centimetres and its ends hang on a few pointings: one that is wrong by metres pulls its ends away from
their rays, which then look wrong themselves, and where it gives the scale it takes the whole block along. So the rays alone place
the ends first, and all distances are compared with one common scale. Of three or more the wrong ones can be told; of two that
disagree neither can, and both are taken for as rough as they differ.
"""

from dataclasses import dataclass

import numpy as np

BENDS = 1e-3
"""Share of its length by which a block may stretch one distance against another before anything holds it."""
CLEARER = 3.0
"""A distance is wrong where the others agree so many times better without it."""


@dataclass(frozen=True, eq=False)
class Agreement:
    """`scale`: measured by model length; `misfit` (D,) from it in standard errors, 0 where the model has no such distance; `wrong`
    (D,) bool: contradict the others; `sigma` (D,): standard errors to go on with."""

    scale: float
    misfit: np.ndarray
    wrong: np.ndarray
    sigma: np.ndarray


def agreement(length: np.ndarray, sigma: np.ndarray, model: np.ndarray, model_sigma: np.ndarray, limit: float) -> Agreement:
    """How measured distances (D,) with standard errors fit those of a model in a scale of its own (D,), NaN where it has none.

    `limit`: how many standard errors a distance may miss the common scale.
    """
    compared = np.isfinite(model) & np.isfinite(model_sigma) & (model > 0)
    wrong, enlarged = np.zeros(len(length), bool), sigma.copy()
    if not compared.any():
        return Agreement(1.0, np.zeros(len(length)), wrong, enlarged)
    model = np.where(compared, model, 1.0)
    ratio, rough = length / model, np.sqrt((sigma / length) ** 2 + (model_sigma / model) ** 2 + BENDS**2)
    while compared.sum() > 2 and _misfits(ratio, rough, compared).max() > limit:
        rest = {int(i): _misfits(ratio, rough, compared & (np.arange(len(ratio)) != i)).max() for i in np.flatnonzero(compared)}
        worst, second = sorted(rest, key=rest.__getitem__)[:2]
        if rest[worst] * CLEARER > rest[second]:
            break
        wrong[worst], compared[worst] = True, False
    scale = float(np.median(ratio[compared]))
    misfit = np.where(wrong, np.abs(ratio / scale - 1.0) / rough, _misfits(ratio, rough, compared))
    if misfit[compared].max() > limit:
        enlarged[compared] = np.maximum(sigma, np.abs(length - scale * model))[compared]
    return Agreement(scale, misfit, wrong, enlarged)


def _misfits(ratio: np.ndarray, rough: np.ndarray, chosen: np.ndarray) -> np.ndarray:
    """(D,) how far each of the `chosen` lies from the median scale of the others, in standard errors; 0 for all that are not."""
    misfit, number = np.zeros(len(ratio)), np.flatnonzero(chosen)
    for i in number if len(number) > 1 else ():
        others = number[number != i]
        scale = float(np.median(ratio[others]))
        sigma = np.hypot(rough[i], np.median(rough[others]) / np.sqrt(len(others)))
        misfit[i] = abs(ratio[i] / scale - 1.0) / sigma
    return misfit
