"""Filling of gaps, only where it is asked for; filled cells carry their own provenance code.

Strategy: from an empty cell one looks in eight directions for the nearest measured cell within the largest gap. A cell is filled if
something is found on opposite sides, by the mean weighted with 1 / distance^2; its precision is theirs, widened by their spread.
"""

from typing import Annotated, Literal

import numpy as np
from numba import njit
from pydantic import Field

from orthomill.schemas.settings import Settings, setting
from orthomill.tasks.densification.fusion import FILLED, FusedCells


class NoFill(Settings):
    """Gaps stay empty."""

    kind: Literal["none"] = "none"

    def reach(self, cell: float) -> int:
        """Cells away from a gap that filling looks at."""
        return 0


class Interpolate(Settings):
    """Gaps are filled from the heights around them."""

    kind: Literal["interpolate"]
    max_gap: float = setting(10.0, "How far from a measured height a cell may be filled.", "m", gt=0.0, le=1000.0)

    def reach(self, cell: float) -> int:
        """Cells away from a gap that filling looks at."""
        return int(np.ceil(self.max_gap / cell))


Filling = Annotated[NoFill | Interpolate, Field(discriminator="kind")]


@njit(cache=True)
def _fill(height, precision, reach, out_height, out_precision):
    steps = ((0, 1), (1, 1), (1, 0), (1, -1), (0, -1), (-1, -1), (-1, 0), (-1, 1))
    values, weights, found = np.zeros(8), np.zeros(8), np.zeros(8, np.bool_)
    for r in range(height.shape[0]):
        for c in range(height.shape[1]):
            if height[r, c] == height[r, c]:
                continue
            error = 0.0
            for k in range(8):
                dr, dc = steps[k]
                length = np.sqrt(dr * dr + dc * dc)
                found[k] = False
                for i in range(1, int(reach / length) + 1):
                    y, x = r + i * dr, c + i * dc
                    if not (0 <= y < height.shape[0] and 0 <= x < height.shape[1]):
                        break
                    if height[y, x] == height[y, x]:
                        found[k], values[k], weights[k] = True, height[y, x], 1.0 / (i * length) ** 2
                        error = max(error, np.float64(precision[y, x]))
                        break
            between = (found[0] and found[4]) or (found[1] and found[5]) or (found[2] and found[6]) or (found[3] and found[7])
            if not between:
                continue
            total, mean, spread = 0.0, 0.0, 0.0
            for k in range(8):
                if found[k]:
                    total += weights[k]
                    mean += weights[k] * values[k]
            mean /= total
            for k in range(8):
                if found[k]:
                    spread += weights[k] * (values[k] - mean) ** 2
            out_height[r, c], out_precision[r, c] = mean, np.sqrt(error * error + spread / total)


def fill(cells: FusedCells, cell: float, filling: NoFill | Interpolate) -> FusedCells:
    """The cells with their gaps filled as `filling` says; cell: side of a cell, m."""
    reach = filling.reach(cell)
    if reach == 0:
        return cells
    height, precision = cells.height.copy(), cells.precision.copy()
    _fill(cells.height, cells.precision, reach, height, precision)
    filled = np.isnan(cells.height) & np.isfinite(height)
    return FusedCells(height, precision, cells.count, np.where(filled, np.uint8(FILLED), cells.provenance))
