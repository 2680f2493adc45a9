"""Standard errors of heights from windows that know no walls: what matching states, and what the surface around makes doubtful.

Strategy. Such a window may show any of the heights within it, so that beside a wall its height may be that of the other side. That
is likely close to the wall and not at the rim of the window: a doubt is a share of what something around is higher or lower, which
falls with its distance. Independent parts are added as variances:
- the standard error that matching and the rays gave, of which a part is common to all pairs;
- unevenness: windows overlap, so that a sound surface is smooth, and where it is not windows are drawn from one surface to another;
- rivals: where a height beats them less clearly, it may be one of theirs;
- doubt, the sum of four: about what is lower, the larger one, for in the end the higher side of a wall fills most windows; about
  what is higher, next to it; about a height between both, which no window shows alone; and everywhere where much around was not
  found, for photographs disagree there.
What the even slope of the ground explains is no doubt.

A window that shows nothing of a roof, as those of coarse levels do not, leaves no trace beside it: such roofs stay wrong without
telling. The numbers below were fitted to the centre of a simulated town and tested beside it and on another one (`python -m
benchmarks class_honesty`).
"""

import numpy as np
from scipy import ndimage

from orthomill.tasks.densification.completion import VolumeWindow
from orthomill.tasks.densification.fusion import FusedCells
from orthomill.tasks.densification.height_differences import extremes, height_range
from orthomill.tasks.densification.precision.standard_errors import REACH
from orthomill.tasks.densification.volume.quality import box_sums
from orthomill.tasks.matching.dense.unevenness import unevenness

_COMMON = 0.4
"""share of the standard error of one pair that all pairs have in common"""
_UNEVEN = 3.6
"""times the unevenness of the heights around"""
_CLEAR, _RIVALS = 0.19, 2
"""distinctiveness at which the doubt about rivals falls to 37 % of the height differences up to so many cells away"""
_LOWER, _LOWER_AWAY = 2.4, 0.28
"""times what something around is lower, and the share of the reach of a window at which this falls to 37 %"""
_HIGHER, _HIGHER_AWAY = 1.3, 0.08
"""the same of what is higher"""
_BETWEEN = 0.15
"""share of what is higher and lower at once, anywhere within reach"""
_HOLED, _GONE = 0.07, 0.4
"""share of the height differences within reach where so much and more of the cells around was not found"""
_SHIFTED = 2
"""cells beyond half a window up to which a wall matters: heights that are wrong show it half a window off"""


def wall_blind_precision(cells: FusedCells, volume: VolumeWindow, window: int) -> np.ndarray:
    """Standard errors (rows, cols) float32, m, of all cells with a height; window: side of the windows in cells. Of the volume its
    distinctiveness counts alone."""
    pairs = np.maximum(cells.count, 1)
    matching = cells.precision * np.sqrt(1.0 + _COMMON**2 * pairs)
    rivals = np.exp(-volume.distinctiveness / np.float32(_CLEAR)) * height_range(cells.height, _RIVALS)
    sigma = np.sqrt(matching**2 + (_UNEVEN * unevenness(cells.height)) ** 2 + rivals**2 + window_doubt(cells.height, window) ** 2)
    return np.where(np.isfinite(cells.height), sigma, np.nan).astype(np.float32)


def window_doubt(height: np.ndarray, window: int) -> np.ndarray:
    """Standard errors (rows, cols) float64, m, that windows which know no walls leave. height (rows, cols) m, NaN where nothing was
    measured; window: its side in cells, none below 2."""
    reach = min(window // 2 + _SHIFTED, REACH - 1) if window > 1 else 0
    known = np.isfinite(height)
    # Beside a wall the calmest cells within the window tell the slope of the ground; their neighbours are one cell away.
    calmest = ndimage.minimum_filter(np.where(known, height_range(height, 1), np.inf), 2 * reach + 1, mode="nearest")
    slope = np.where(known, calmest, 0.0)
    lower, higher, rise, fall = (np.zeros(height.shape) for _ in range(4))
    for away in range(1, reach + 1):
        highest, lowest = extremes(height, known, away)
        rise = np.where(known, np.maximum(highest - height - away * slope, 0.0), 0.0)
        fall = np.where(known, np.maximum(height - lowest - away * slope, 0.0), 0.0)
        higher = np.maximum(higher, _HIGHER * np.exp(-away / (_HIGHER_AWAY * reach)) * rise)
        lower = np.maximum(lower, _LOWER * np.exp(-away / (_LOWER_AWAY * reach)) * fall)
    gone = 1.0 - box_sums(known, reach) / box_sums(np.ones(height.shape, bool), reach)
    holed = _HOLED * np.minimum(gone / _GONE, 1.0) * (rise + fall)
    # No height is farther from the truth than the heights around differ.
    return np.minimum(np.hypot(lower, higher) + _BETWEEN * np.minimum(rise, fall) + holed, rise + fall)
