"""Standard errors of heights among their neighbours: what matching states, and what the surface around makes doubtful.

Strategy. Three independent parts are added as variances:
- the standard error that matching and the rays gave; for a height of the volume a share of the distance between its heights;
- the roughness around: within a cell the surface itself varies;
- doubt: where the photographs fit almost as well at another height (a small margin), the height may be that of the surface next
door, and the error is of the order of the height differences around. Beside a wall this is the largest part by far.

The numbers below were fitted to the west half of a simulated scene and tested on the east half and on another scene (benchmarks).
"""

import numpy as np
from scipy import ndimage

from orthomill.schemas.surface import ESTIMATED, Provenance
from orthomill.tasks.densification.completion import VolumeWindow
from orthomill.tasks.densification.fusion import FusedCells

REACH = 2
"""cells around a cell whose heights enter its standard error"""
SHARE = 0.65
"""factor of the standard errors of matching: those of neighbouring nodes, between which a cell is interpolated, partly cancel"""
_OF_STEP = 0.15
"""standard error of a height of the volume, share of the distance between its heights"""
_ROUGHNESS = 0.1
"""share of the height differences around that the surface varies within a cell"""
_DOUBT, _CLEAR = 3.5, 0.19
"""share of the height differences around that a height without margin may be wrong, and the margin at which this falls to 37 %"""
_MOST = 1.0
"""no height is farther from the truth than the heights around differ"""
_GUESS = 0.5
"""the same of an estimate, whose margin says nothing"""


def relative_precision(cells: FusedCells, volume: VolumeWindow, step: float) -> np.ndarray:
    """Standard errors (rows, cols) float32, m, of all cells with a height; step: of the volume's heights at its finest level, m."""
    around = height_range(cells.height, REACH)
    of_volume = np.float32(_OF_STEP * step) * volume.size
    matching = np.where(np.isfinite(cells.precision), SHARE * cells.precision, of_volume)
    doubt = np.minimum(_DOUBT * np.exp(-volume.margin / np.float32(_CLEAR)), _MOST)
    share = np.where(np.isin(cells.provenance, ESTIMATED), np.maximum(doubt, _GUESS), doubt)
    variance = matching**2 + (_ROUGHNESS**2 + share**2) * around**2
    # An estimate is never better than the volume's own resolution.
    least = np.where(cells.provenance == Provenance.INCOHERENT, step * volume.size, 0.0)
    return np.where(np.isfinite(cells.height), np.sqrt(variance + least**2), np.nan).astype(np.float32)


def height_range(height: np.ndarray, reach: int) -> np.ndarray:
    """Highest minus lowest height (rows, cols) float32, m, of the cells up to `reach` away in rows and columns; unknown ones do not
    count."""
    known, size = np.isfinite(height), 2 * reach + 1
    highest = ndimage.maximum_filter(np.where(known, height, -np.inf), size, mode="nearest")
    lowest = ndimage.minimum_filter(np.where(known, height, np.inf), size, mode="nearest")
    return np.where(known, highest - lowest, 0.0).astype(np.float32)
