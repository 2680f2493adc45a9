"""Weights of colours that are set back: next to the limit of what is hidden, and of photographs much coarser than the finest ones.

Source: Petsa et al. 2007 (sources/blending.md): M10, M13.
"""

import numpy as np

from orthomill.tasks.colouring.blending.blending import RESERVE
from orthomill.tasks.colouring.sampling.photograph_colours import LEAST_WEIGHT

ZONE_WEIGHT = 1.02 * RESERVE
"""Weight next to the limit of what is hidden, of the greatest one there: such a colour hardly shows beside others, but still votes
on gross errors, which two photographs alone could not find"""
_CLEAR = 3
"""colours far from all limits that find the gross errors among themselves: then those next to a limit have no vote"""
COARSE, FINE = 1 / 9, 1 / 4
"""Shares of the greatest area: pixels three times as large as the finest ones do not colour, those twice as large do."""


def reserved(weights: np.ndarray, near: np.ndarray) -> np.ndarray:
    """Weights (photographs, rows, cols) of which those that are `near` a limit do not count: with fewer than three others they keep
    their vote on gross errors, and where there are no others their weight."""
    clear = np.where(near, np.float32(0.0), weights)
    vote = (clear > 0).sum(axis=0) < _CLEAR
    greatest = clear.max(axis=0, initial=0.0)
    weight = np.where(vote, np.float32(ZONE_WEIGHT) * greatest, np.float32(0.0))
    return np.where(near & (weights > 0) & (greatest > 0), weight, weights)


def fading(weights: np.ndarray) -> np.ndarray:
    """Weights (photographs, rows, cols) of which those below FINE of the greatest fade out towards COARSE.

    They stay just above the share from which a colour is used at all: their vote on gross errors counts, their blur does not.
    """
    share = weights / np.maximum(weights.max(axis=0, initial=0.0), np.float32(LEAST_WEIGHT))
    factor = np.clip((share - COARSE) / (FINE - COARSE), 0.0, 1.0)
    least = np.where(share > RESERVE, 1.01 * RESERVE / np.maximum(share, RESERVE), 1.0)
    return (weights * np.maximum(factor, np.minimum(least, 1.0))).astype(np.float32)
