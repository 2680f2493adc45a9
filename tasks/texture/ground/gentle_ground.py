"""The ground that the texture lies on where heights are guesses: as gentle as these allow.

Strategy. A guess of metres has slopes of its own, up to walls beside the next one; photographs put on them are smeared over the
flank. What a height is worth is known: the surface whose heights agree with all of them by their standard errors, and which rises
from block to block by no more than land and crowns usually do, passes through whatever was measured, and is calm in between.
Unknown blocks are bridged by the same rule.
"""

import numpy as np

from orthomill.kernels.kernel_compilation import njit
from orthomill.tasks.imagery.pull_push import filled

RISE = 0.5
"""standard deviation of the slope of land and crowns"""
SURE, GUESSED = 8.0, 32.0
"""standard errors of a height, cells, up to which a cell is as it was found, and from which on it is that of the gentle ground"""
_SWEEPS = 400
_RELAXATION = 1.8
"""of successive over-relaxation: blocks as far as guesses of metres reach, some twenty, are settled long before the last sweep"""


@njit()
def _settle(surface, heights, weights, bond, sweeps, relaxation):
    """Moves `surface` (rows, cols) float64 m towards the least sum of the squares of its differences from `heights` by `weights`,
    and of the steps between neighbours by `bond` (1/m2)."""
    rows, cols = surface.shape
    for _ in range(sweeps):
        for r in range(rows):
            for c in range(cols):
                total, count = 0.0, 0
                if r > 0:
                    total, count = total + surface[r - 1, c], count + 1
                if r + 1 < rows:
                    total, count = total + surface[r + 1, c], count + 1
                if c > 0:
                    total, count = total + surface[r, c - 1], count + 1
                if c + 1 < cols:
                    total, count = total + surface[r, c + 1], count + 1
                wanted = (weights[r, c] * heights[r, c] + bond * total) / (weights[r, c] + bond * count)
                surface[r, c] += relaxation * (wanted - surface[r, c])


def gentle_ground(values: np.ndarray, weights: np.ndarray, block: float) -> np.ndarray:
    """float32 (rows, cols) m: the gentle heights of blocks, from `values` (rows, cols) m, NaN where there is none, and their
    `weights` (rows, cols) 1/m2; `block` is their side, m. All NaN only where there is no height at all."""
    closed = filled(values)
    if np.isnan(closed).any() or closed.size == 1:
        return closed
    surface = closed.astype(np.float64)
    bond = 1.0 / (RISE * block) ** 2
    _settle(surface, closed.astype(np.float64), weights.astype(np.float64), bond, _SWEEPS, _RELAXATION)
    return surface.astype(np.float32)


def calmed(heights: np.ndarray, precision: np.ndarray, ground: np.ndarray, cell: float) -> np.ndarray:
    """The heights (rows, cols) float32 m, those of guesses on the `ground` (rows, cols) m: by their standard errors `precision`
    (rows, cols) m, in units of the `cell` (m)."""
    return (heights + guessed(precision, cell) * (ground - heights)).astype(np.float32)


def guessed(precision: np.ndarray, cell: float) -> np.ndarray:
    """(rows, cols): the share of the gentle ground in heights, 0 of what is sure to 1 of guesses; `precision` and `cell` in m."""
    return np.asarray(np.clip((np.nan_to_num(precision, nan=0.0) / cell - SURE) / (GUESSED - SURE), 0.0, 1.0))
