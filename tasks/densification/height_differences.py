"""How far heights around a place differ, and where the surface is even: it goes on around a place as a plane would, no steeper than
a roof.

Beside a wall every window shows two surfaces, and all photographs together may still prefer the wrong one; on even ground there is
no second surface that a height could belong to.
"""

import numpy as np
from scipy import ndimage

EVEN_REACH = 3
"""cells around a cell that must go on evenly"""
_BEND, _RISE = 0.3, 4.0
"""cells that a height may lie off the middle of two opposite ones, and between the highest and the lowest one around"""
_OPPOSITE = ((0, 1), (1, 0), (1, 1), (1, -1))
"""directions (row, col) in which opposite heights are compared"""


def even(height: np.ndarray, cell: float) -> np.ndarray:
    """(rows, cols) bool from heights (rows, cols) m, NaN where unknown; cell: its side, m. Unknown neighbours say nothing."""
    known = np.isfinite(height)
    return known & (height_range(height, EVEN_REACH) <= _RISE * cell) & (_bend(height) <= _BEND * cell)


def height_range(height: np.ndarray, reach: int) -> np.ndarray:
    """Highest minus lowest height (rows, cols) float32, m, of the cells up to `reach` away in rows and columns; unknown ones do not
    count."""
    known = np.isfinite(height)
    highest, lowest = extremes(height, known, reach)
    return np.where(known, highest - lowest, 0.0).astype(np.float32)


def extremes(height: np.ndarray, counted: np.ndarray, reach: int) -> tuple[np.ndarray, np.ndarray]:
    """Highest and lowest height (rows, cols) m of the `counted` cells up to `reach` away; -inf and inf where there is none."""
    size = 2 * reach + 1
    highest = ndimage.maximum_filter(np.where(counted, height, -np.inf), size, mode="nearest")
    return highest, ndimage.minimum_filter(np.where(counted, height, np.inf), size, mode="nearest")


def _bend(height: np.ndarray) -> np.ndarray:
    """How far heights (rows, cols) m lie at most off the middle of two opposite ones up to EVEN_REACH away; 0 without any."""
    rows, cols = height.shape
    wide = np.pad(height, EVEN_REACH, constant_values=np.nan)

    def moved(row: int, col: int) -> np.ndarray:
        return wide[EVEN_REACH + row : EVEN_REACH + row + rows, EVEN_REACH + col : EVEN_REACH + col + cols]

    away = np.zeros(height.shape, np.float32)
    for row, col in ((k * row, k * col) for k in range(1, EVEN_REACH + 1) for row, col in _OPPOSITE):
        away = np.fmax(away, np.abs(np.float32(0.5) * (moved(row, col) + moved(-row, -col)) - height))
    return away
