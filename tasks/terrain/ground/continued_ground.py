"""Ground that the filter took for an object: a hilltop, a bank.

Strategy. An object has a step all around, a hilltop has none. Cells next to ground whose height continues it, rising no more than
the steepest ground can, are ground as well, and so on from cell to cell, a bounded number of times.
"""

import numpy as np

STEPS = 64
"""how often ground grows by a cell: hilltops up to twice as wide are found again"""
_NEIGHBOURS = 3
"""cells of ground among the eight around that a cell needs: nothing climbs a wall over a single cell"""
_FAR = np.float32(1e9)


def continued(ground: np.ndarray, heights: np.ndarray, steepest: float, step: float, cell: float) -> np.ndarray:
    """The `ground` (rows, cols) bool with the measured cells that continue it.

    heights (rows, cols) float32 m, NaN where none was measured; `steepest` as a ratio, `step` and `cell` in m.
    """
    import cv2

    around = np.ones((3, 3), np.uint8)
    limit = np.float32(steepest * np.sqrt(2.0) * cell + step)
    found, candidates = ground.copy(), np.isfinite(heights)
    for _ in range(STEPS):
        high = cv2.dilate(np.where(found, heights, -_FAR), around)
        low = cv2.erode(np.where(found, heights, _FAR), around)
        # Zero beyond the border: a mirrored row would be counted twice, and a tile would differ from the whole.
        count = cv2.boxFilter(found.astype(np.float32), -1, (3, 3), normalize=False, borderType=cv2.BORDER_CONSTANT)
        joins = candidates & ~found & (count > _NEIGHBOURS - 0.5) & (heights - low <= limit) & (high - heights <= limit)
        if not joins.any():
            break
        found |= joins
    return found
