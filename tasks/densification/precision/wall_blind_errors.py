"""Standard errors of heights among their neighbours where windows know no walls: a height may be that of anything within a window.

Strategy. Beside what matching and the rays gave, independent parts are added as variances:
- the roughness next to a cell: within it the surface itself varies;
- doubt: where rivals fit almost as well (low distinctiveness), the height may be that of the surface next door, and the error is of
  the order of the height differences around;
- edges: a window that reaches over an edge bends towards what lies behind it, in all pairs alike;
- the height differences within a window, but for what the even slope of the ground explains.
Of a measured height also unevenness, at least, but only where something around could not be measured, as in every crown: nodes of
such windows are not joined to a surface, so that noise makes them uneven everywhere.

The numbers below were set on the centre of a simulated town and tested beside it and on another one (benchmarks).
"""

import numpy as np
from scipy import ndimage

from orthomill.schemas.surface import MEASURED
from orthomill.tasks.densification.completion import VolumeWindow
from orthomill.tasks.densification.fusion import FusedCells
from orthomill.tasks.densification.height_differences import height_range
from orthomill.tasks.densification.precision.standard_errors import REACH, volume_error
from orthomill.tasks.densification.volume.quality import box_sums
from orthomill.tasks.matching.dense.unevenness import unevenness

SHARE = 0.45
"""factor of the standard errors of matching: those of neighbouring nodes, between which a cell is interpolated, partly cancel"""
_ROUGHNESS = 0.2
"""share of the height differences to the cells next to it that the surface varies within a cell"""
_DOUBT, _CLEAR, _DOUBTFUL = 3.5, 0.19, 2
"""share of the height differences around that a height of no distinctiveness may be wrong, the one at which this falls to 37 %,
and how many cells away these differences count"""
_MOST = 1.0
"""no height is farther from the truth than the heights around differ"""
_EDGE, _WINDOW = 0.03, 5
"""share of the height differences within half a window of matching, cells, by which it bends"""
_UNEVEN = 20.0
"""times the unevenness of the heights around"""
_UNMEASURED = 8
"""cells away from the nearest cell without a measured height, beyond which windows show one surface"""
_SHIFTED = 2
"""cells beyond half a window up to which a wall matters: a window no longer reaches it from farther away, and the heights found
show it there or half a window off, where those that are wrong have it within half a window as well"""
_GONE = 0.4
"""share of the cells around without a height, from which on slopes explain nothing: windows fail where they see two surfaces"""


def wall_blind_precision(cells: FusedCells, volume: VolumeWindow, step: float, window: int) -> np.ndarray:
    """Standard errors (rows, cols) float32, m, of all cells with a height. step: of the volume's heights at its finest level, m, 0
    without a volume; window: side of the windows in cells."""
    matching = np.where(np.isfinite(cells.precision), SHARE * cells.precision, volume_error(cells, volume, step))
    doubt = np.minimum(_DOUBT * np.exp(-volume.distinctiveness / np.float32(_CLEAR)), _MOST) * height_range(cells.height, _DOUBTFUL)
    roughness, edge = _ROUGHNESS * height_range(cells.height, 1), _EDGE * height_range(cells.height, _WINDOW)
    sigma = np.sqrt(matching**2 + roughness**2 + doubt**2 + edge**2)
    sigma = np.maximum(sigma, np.minimum(_uneven(cells), _MOST * height_range(cells.height, _DOUBTFUL)))
    sigma = np.hypot(sigma, window_doubt(cells.height, window))
    return np.where(np.isfinite(cells.height), sigma, np.nan).astype(np.float32)


def _uneven(cells: FusedCells) -> np.ndarray:
    """Standard errors (rows, cols) m, at least, of measured heights near others that could not be measured; 0 elsewhere."""
    measured = np.isin(cells.provenance, MEASURED)
    near = measured & (box_sums(~measured, _UNMEASURED) > 0)
    return np.where(near, np.float32(_UNEVEN) * unevenness(cells.height), np.float32(0))


def window_doubt(height: np.ndarray, window: int) -> np.ndarray:
    """Standard errors (rows, cols) float32, m, that windows which know no walls leave: a height may be that of anything within half
    a window of it, so that it is one of those around, all alike likely. heights (rows, cols) m, NaN where nothing was measured;
    window: its side in cells.

    What the even slope of the ground explains is no doubt, unless much around was not found.
    """
    reach = min(window // 2 + _SHIFTED, REACH - 1) if window > 1 else 0
    known, around = np.isfinite(height), box_sums(np.ones(height.shape, bool), reach)
    gone = np.minimum((1.0 - box_sums(known, reach) / around) / _GONE, 1.0)
    # Beside a wall the calmest cells within the window tell the slope of the ground; their neighbours are one cell away.
    calmest = ndimage.minimum_filter(np.where(known, height_range(height, 1), np.inf), 2 * reach + 1, mode="nearest")
    slope = 2 * reach * np.where(known, calmest, 0.0)
    beyond = np.maximum(height_range(height, reach) - (1.0 - gone) * slope, 0.0)
    return (beyond / np.float32(np.sqrt(12.0))).astype(np.float32)
