"""The type of a chessboard: its corners and its size."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class BoardType:
    """A board: inner corners (columns, rows), side of a square and width of the white margin, m."""

    corners: tuple[int, int]
    square: float
    quiet: float

    @property
    def local(self) -> np.ndarray:
        """(N, 2) m: inner corners row by row, from the centre of the board."""
        col, row = np.meshgrid(np.arange(self.corners[0]), np.arange(self.corners[1]))
        return (np.column_stack([col.ravel(), row.ravel()]) - (np.array(self.corners) - 1) / 2.0) * self.square

    @property
    def reach(self) -> float:
        """m from the centre to the outer corner of the margin."""
        # Inner corners are one fewer than squares on either side.
        return float(np.hypot(*((np.array(self.corners) + 1) * self.square / 2 + self.quiet)))
