"""Heights that no photographs measured: kept apart by their own codes, or left out on request.

Strategy. Where the photographs together prefer a height that its neighbours contradict (leaves, water, a blank wall), that height
is an estimate. Where there is none, the nearest heights are sought in eight directions, up to the largest gap; the cell is filled
if they lie on opposite sides, by their mean weighted with 1 / distance^2, and its standard error is theirs, widened by their
spread. For estimates that can only be wrong, heights on one side will do.
"""

import numpy as np

from orthomill.kernels.kernel_compilation import njit
from orthomill.schemas.surface import ESTIMATED, Provenance
from orthomill.tasks.densification.fusion import FusedCells
from orthomill.tasks.densification.settings.surface_settings import EstimateGaps, MeasuredOnly
from orthomill.tasks.densification.surroundings import look_around


@njit(inline="always")
def _enclosed(found):
    """Whether heights were `found` (8,) in two opposite directions."""
    # Heights on one side only would be extrapolated: at the border of the block and at roof edges that invents ground.
    return (found[0] and found[4]) or (found[1] and found[5]) or (found[2] and found[6]) or (found[3] and found[7])


@njit()
def _fill(height, precision, wrong, reach, out_height, out_precision):
    """Fills NaN cells of height (rows, cols) m into `out_height` and `out_precision`, the `wrong` ones from one side too; reach in
    cells."""
    values, errors, lengths, found = np.zeros(8), np.zeros(8), np.zeros(8), np.zeros(8, np.bool_)
    for r in range(height.shape[0]):
        for c in range(height.shape[1]):
            if height[r, c] == height[r, c]:
                continue
            look_around(height, precision, r, c, reach, values, errors, lengths, found)
            if not (_enclosed(found) or (wrong[r, c] and found.any())):
                continue
            error, total, mean, spread = 0.0, 0.0, 0.0, 0.0
            for k in range(8):
                if found[k]:
                    error = max(error, errors[k])
                    total += 1.0 / lengths[k] ** 2
                    mean += values[k] / lengths[k] ** 2
            mean /= total
            for k in range(8):
                if found[k]:
                    spread += (values[k] - mean) ** 2 / lengths[k] ** 2
            # The greatest error of the neighbours, not the error of their mean: their errors are correlated, and what lies in
            # the gap was never measured.
            out_height[r, c], out_precision[r, c] = mean, np.sqrt(error * error + spread / total)


def fill(cells: FusedCells, stray: np.ndarray, wrong: np.ndarray, filling: MeasuredOnly | EstimateGaps) -> FusedCells:
    """The cells with their gaps interpolated, or without any estimated height.

    stray, wrong (rows, cols) bool: estimates that stand alone among their neighbours, as on water, where what surrounds them is
    the better guess if it is within reach; and such that anything near is better, be it on one side only.
    """
    if filling.kind == "none":
        return without(cells, np.isin(cells.provenance, ESTIMATED))
    known = without(cells, stray | wrong)
    height, precision = known.height.copy(), known.precision.copy()
    _fill(known.height, known.precision, wrong, filling.reach, height, precision)
    filled = np.isnan(known.height) & np.isfinite(height)
    # The count becomes 0: no pair measured these cells, and whoever counts support must see that.
    return FusedCells(
        np.where(filled, height, cells.height),
        np.where(filled, precision, cells.precision),
        np.where(filled, np.uint8(0), cells.count),
        np.where(filled, np.uint8(Provenance.INTERPOLATED), cells.provenance),
    )


def without(cells: FusedCells, unwanted: np.ndarray) -> FusedCells:
    """The cells with those of the mask (rows, cols) bool emptied."""
    empty = np.float32(np.nan)
    return FusedCells(
        np.where(unwanted, empty, cells.height),
        np.where(unwanted, empty, cells.precision),
        np.where(unwanted, np.uint8(0), cells.count),
        np.where(unwanted, np.uint8(Provenance.EMPTY), cells.provenance),
    )
