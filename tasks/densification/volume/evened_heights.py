"""Heights of the volume where bases are narrow: averaged with those around that are the same within what photographs can tell.

Strategy. Where two photographs were taken close together, heights several steps apart fit as well as each other, and which of them
wins is chance from cell to cell: even ground looks hatched. The heights of a window as wide as the signatures that were compared,
and no farther from that in its middle than narrow bases leave open, are averaged; what lies beyond is another surface.

Source: Lee 1983 (averages of what lies within two standard deviations).
"""

import numpy as np

from orthomill.kernels.kernel_compilation import njit

WIDEST = 4
"""cells on every side at most, about as far as signatures reach"""
_LEAST = 1.25
"""steps that count as one, below which a height stays as it is"""
_SAME = 2.0
"""times the steps that count as one by which heights may differ"""


@njit()
def evened(height, stretch, step, where):
    """(rows, cols) float32: the heights (rows, cols) float32 m, those `where` (rows, cols) bool averaged; stretch (rows, cols)
    float32: steps that count as one; step: between heights, m. A cell takes part of up to WIDEST cells around it."""
    rows, cols = height.shape
    out = height.copy()
    for r in range(rows):
        for c in range(cols):
            if not where[r, c] or stretch[r, c] < _LEAST:
                continue
            half, same = min(WIDEST, int(np.ceil(stretch[r, c]))), _SAME * stretch[r, c] * step
            total, count = 0.0, 0
            for y in range(max(0, r - half), min(rows, r + half + 1)):
                for x in range(max(0, c - half), min(cols, c + half + 1)):
                    # A comparison with NaN is false.
                    if abs(height[y, x] - height[r, c]) <= same:
                        total += height[y, x]
                        count += 1
            if count:
                out[r, c] = total / count
    return out
