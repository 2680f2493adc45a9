"""Filling of gaps, only on request; filled cells carry their own provenance code.

Strategy: from an empty cell the nearest measured cell is sought in eight directions, up to the largest gap. The cell is filled if
measured cells lie on opposite sides, by the mean weighted with 1 / distance^2; its precision is theirs, widened by their spread.
"""

from typing import Annotated, Literal

import numpy as np
from numba import njit
from pydantic import Field

from orthomill.schemas.settings import Settings, setting
from orthomill.schemas.surface import Provenance
from orthomill.tasks.densification.fusion import FusedCells


class NoFill(Settings):
    """Gaps stay empty."""

    kind: Literal["none"] = "none"

    def reach(self, cell: float) -> int:
        """Distance from a gap, in cells, within which measured heights are used."""
        return 0


class Interpolate(Settings):
    """Gaps are filled from the heights around them."""

    kind: Literal["interpolate"]
    max_gap: float = setting(10.0, "How far from a measured height a cell may be filled.", "m", gt=0.0, le=1000.0)

    def reach(self, cell: float) -> int:
        """Distance from a gap, in cells, within which measured heights are used; cell: side of a cell, m."""
        return int(np.ceil(self.max_gap / cell))


Filling = Annotated[NoFill | Interpolate, Field(discriminator="kind")]

_DIRECTIONS = ((0, 1), (1, 1), (1, 0), (1, -1), (0, -1), (-1, -1), (-1, 0), (-1, 1))
"""(row, col) steps around a cell; those four places apart are opposite"""


@njit(cache=True, inline="always")
def _enclosed(found):
    # Heights on one side only would be extrapolated: at the border of the block and at roof edges that invents ground.
    return (found[0] and found[4]) or (found[1] and found[5]) or (found[2] and found[6]) or (found[3] and found[7])


@njit(cache=True)
def _fill(height, precision, reach, out_height, out_precision):
    """Fills NaN cells of height (rows, cols) m into `out_height` and `out_precision`; reach in cells."""
    values, weights, found = np.zeros(8), np.zeros(8), np.zeros(8, np.bool_)
    for r in range(height.shape[0]):
        for c in range(height.shape[1]):
            if height[r, c] == height[r, c]:
                continue
            error = 0.0
            for k in range(8):
                down, right = _DIRECTIONS[k]
                length = np.sqrt(down * down + right * right)
                found[k] = False
                for i in range(1, int(reach / length) + 1):
                    y, x = r + i * down, c + i * right
                    if not (0 <= y < height.shape[0] and 0 <= x < height.shape[1]):
                        break
                    if height[y, x] == height[y, x]:
                        found[k], values[k], weights[k] = True, height[y, x], 1.0 / (i * length) ** 2
                        error = max(error, np.float64(precision[y, x]))
                        break
            if not _enclosed(found):
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
            # The greatest error of the neighbours, not the error of their mean: their errors are correlated, and what lies in
            # the gap was never measured.
            out_height[r, c], out_precision[r, c] = mean, np.sqrt(error * error + spread / total)


def fill(cells: FusedCells, cell: float, filling: NoFill | Interpolate) -> FusedCells:
    """The cells with their gaps filled as `filling` says; cell: side of a cell, m."""
    reach = filling.reach(cell)
    if reach == 0:
        return cells
    height, precision = cells.height.copy(), cells.precision.copy()
    _fill(cells.height, cells.precision, reach, height, precision)
    # The count stays 0: no pair measured these cells, and whoever counts support must see that.
    filled = np.isnan(cells.height) & np.isfinite(height)
    return FusedCells(height, precision, cells.count, np.where(filled, np.uint8(Provenance.INTERPOLATED), cells.provenance))
