"""What the ground around a height says of how well windows measure it: how uneven it is, and what rises or falls beside it."""

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from orthomill.tasks.densification.fusion import FusedCells
from orthomill.tasks.densification.height_differences import extremes, height_range
from orthomill.tasks.matching.dense.unevenness import AROUND, unevenness

_WINDOW = 5
"""cells on every side that half a window of matching shows"""
_WALL = 2.0
"""distances between the heights of the volume that something must rise or fall beside a cell to be a wall"""
GROUND_REACH = max(2 * _WINDOW + 1, AROUND // 2 + 1)
"""cells around a cell whose heights count"""


@dataclass(frozen=True, eq=False)
class MatchedGround:
    """Of every cell (rows, cols): `single`, the standard error (m) that matching states for one pair, NaN without one; `uneven`,
    the unevenness (m); `rise` and `fall`, how much higher and lower (m) something within half a window is, beyond a slope."""

    single: np.ndarray
    uneven: np.ndarray
    rise: np.ndarray
    fall: np.ndarray
    step: float
    """between the heights of the volume, m"""
    cell: float
    """m"""

    @property
    def roughness(self) -> np.ndarray:
        """(rows, cols): unevenness as a share of what one pair can tell; 0 without a pair."""
        known = self.single > 0
        return np.where(known, self.uneven / np.where(known, self.single, 1.0), 0.0)

    @property
    def torn(self) -> np.ndarray:
        """(rows, cols) m: how far the surface rises and falls within half a window."""
        return self.rise + self.fall

    @property
    def walled(self) -> np.ndarray:
        """(rows, cols) bool: whether a wall is near."""
        return self.torn > _WALL * self.step


def matched_ground(cells: FusedCells, step: float, cell: float) -> MatchedGround:
    """The ground around the cells, which have the standard errors that matching states and are `cell` m wide; step: between the
    heights of the volume, m."""
    height = cells.height
    known = np.isfinite(height)
    highest, lowest = extremes(height, known, _WINDOW)
    # Beside a wall the calmest cells within the window tell the slope of the ground.
    calmest = ndimage.minimum_filter(np.where(known, height_range(height, 1), np.inf), 2 * _WINDOW + 1, mode="nearest")
    slope = np.where(known, _WINDOW * calmest, 0.0)
    return MatchedGround(
        single=cells.precision * np.sqrt(np.maximum(cells.count, 1)),
        uneven=unevenness(height),
        rise=np.where(known, np.maximum(highest - height - slope, 0.0), 0.0),
        fall=np.where(known, np.maximum(height - lowest - slope, 0.0), 0.0),
        step=step,
        cell=cell,
    )
