"""Standard errors of heights among their neighbours: what matching states, and what the surface around makes doubtful.

Strategy. Independent parts are added as variances. Of every height:
- the standard error that matching and the rays gave; of a height of the volume how far the volume lies from the pairs around, and
  not less than a share of the distance between its heights;
- doubt: where rivals fit almost as well (low distinctiveness), the height may be one of theirs, some steps of the volume away;
- strangeness: around a place that could not be measured windows show two surfaces in part, and so do the wider squares of the
  volume, each to another extent: how far the two differ, the more the larger the share of the cells around that nothing measured.
Of a height that pairs matched also:
- unevenness: windows overlap, so that heights next to each other share their errors, and a sound surface is smooth. Where it is not
  (below leaves, beside edges and wires), windows are drawn from one surface to another by amounts that change from cell to cell.
  Slopes and walls are no unevenness, so what counts is the middle one of the departures around from what neighbours let expect.
- strain: where rivals are beaten less clearly than elsewhere and a pair decided, windows see two surfaces in part; what these are
  apart is a share of the height differences around.
Heights that stand alone are rated by the level that shows them (coherent_levels.py) and by the depth of leaves, guesses are worse
by their distance to what was measured (estimate_errors.py); windows that know no walls are rated otherwise (wall_blind_errors.py).

The numbers below were fitted to a simulated scene so that the shares within two are alike in all its classes of ground and for one
pair and several, and tested on another scene and on disjoint strips of a real block (benchmarks).
"""

import numpy as np
from scipy import ndimage

from orthomill.schemas.surface import MEASURED
from orthomill.tasks.densification.completion import VolumeWindow
from orthomill.tasks.densification.fusion import FusedCells
from orthomill.tasks.densification.height_differences import height_range
from orthomill.tasks.densification.volume.coherent_levels import standard_errors
from orthomill.tasks.densification.volume.quality import box_sums
from orthomill.tasks.matching.dense.unevenness import AROUND, unevenness

SHARE = 0.45
"""factor of the standard errors of matching: those of neighbouring nodes, between which a cell is interpolated, partly cancel"""
_OF_STEP = 0.45
"""standard error of a height of the volume, share of the distance between its heights"""
_BESIDE, _ENOUGH = 16, 10
"""cells around a height of the volume from which pairs tell how far the volume lies from them, and how many of these cells there
must be: on real photographs it scatters more than its steps let expect, by grass more than by asphalt"""
_PARTS = 256
"""of the distance between the heights of the volume, in which differences are summed: a sum of floats depends on its beginning"""
_DOUBT, _CLEAR = 0.7, 0.25
"""distances between the heights of the volume that a height of no distinctiveness may be wrong, and the distinctiveness at which
this falls to 37 %; the least one of a cell and its neighbours counts"""
_UNEVEN = 14.5
"""times the unevenness of the heights around"""
_DIFFER = 2
"""cells away up to which heights differ by what unevenness adds at most"""
_STRANGE, _SQUARE = 0.9, 4
"""times the scatter of the volume about the pairs in cells up to so far away, where nothing measured any of these"""
_STRAINED, _STRAIN, _TORN = 0.7, 0.3, 2
"""distinctiveness below which a height is strained, the share of the height differences that this adds, and how many cells away
these count"""
_LEAVES = 1.5
"""m by which what stands alone lies below its envelope: sets of photographs agree on the leaves that they see, and the first of
these begin higher (`python -m benchmarks closed_wood`)"""
REACH = max(_BESIDE, _SQUARE, _DIFFER, AROUND // 2 + 1)
"""cells around a cell whose heights enter its standard error"""


def relative_precision(cells: FusedCells, volume: VolumeWindow, step: float) -> np.ndarray:
    """Standard errors (rows, cols) float32, m, of all cells with a height; step: of the volume's heights at its finest level, m."""
    least = ndimage.minimum_filter(volume.distinctiveness, 3, mode="nearest")
    doubt = np.float32(_DOUBT * step) * volume.size * np.exp(-least / np.float32(_CLEAR))
    parts = matched_precision(cells, volume, step), doubt, _strangeness(cells, volume, step), _unevenness_error(cells)
    sigma = np.sqrt(sum(part.astype(float) ** 2 for part in (*parts, _strain(cells, volume))))
    sigma = np.where(volume.alone, np.hypot(standard_errors(volume.level, step), _LEAVES), sigma)
    return np.where(np.isfinite(cells.height), sigma, np.nan).astype(np.float32)


def matched_precision(cells: FusedCells, volume: VolumeWindow, step: float) -> np.ndarray:
    """What matching says of the heights (rows, cols), m: the pairs, and where they have none the volume."""
    of_volume = np.maximum(np.float32(_OF_STEP * step) * volume.size, _beside(cells, volume, step))
    return np.where(np.isfinite(cells.precision), SHARE * cells.precision, of_volume)


def _unevenness_error(cells: FusedCells) -> np.ndarray:
    """What unevenness adds to heights that pairs matched (rows, cols), m; 0 elsewhere."""
    # The volume's heights are each cell's own, as uneven as its steps are wide.
    uneven = np.minimum(np.float32(_UNEVEN) * unevenness(cells.height), height_range(cells.height, _DIFFER))
    return np.where(np.isfinite(cells.precision), uneven, np.float32(0))


def _strain(cells: FusedCells, volume: VolumeWindow) -> np.ndarray:
    """What a decision between near rivals adds to heights that pairs matched (rows, cols), m; 0 elsewhere."""
    strained = np.isfinite(cells.precision) & (volume.distinctiveness < _STRAINED) & np.isfinite(volume.height)
    return np.where(strained, np.float32(_STRAIN) * height_range(cells.height, _TORN), np.float32(0))


def _strangeness(cells: FusedCells, volume: VolumeWindow, step: float) -> np.ndarray:
    """Scatter of the volume about the pairs times the share of the cells around that neither measured (rows, cols), m."""
    measured = np.isin(cells.provenance, MEASURED)
    apart, both = _apart(cells, volume, step)
    # Heights that pairs found where nothing is sure would tell of that place, not of this one.
    apart, count = np.where(measured, apart, 0), np.maximum(box_sums(both & measured, _SQUARE), 1)
    variance = (box_sums(apart**2, _SQUARE) - box_sums(apart, _SQUARE) ** 2 / count) / count
    unknown = box_sums(~measured, _SQUARE) / box_sums(np.ones(measured.shape, bool), _SQUARE)
    return _STRANGE * unknown * np.sqrt(np.maximum(variance, 0.0)) * (step / _PARTS)


def _beside(cells: FusedCells, volume: VolumeWindow, step: float) -> np.ndarray:
    """How far the volume lies from the pairs around every cell, root mean square (rows, cols) m; 0 where too few cells tell."""
    apart, both = _apart(cells, volume, step)
    count = box_sums(both, _BESIDE)
    return np.where(count >= _ENOUGH, np.sqrt(box_sums(apart**2, _BESIDE) / np.maximum(count, 1)), 0.0) * (step / _PARTS)


def _apart(cells: FusedCells, volume: VolumeWindow, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Volume minus pairs (rows, cols) int64, parts of a step, 0 where one is missing; and bool where both are there."""
    both = np.isfinite(cells.precision) & np.isfinite(volume.height) & (step > 0)
    return np.where(both, np.rint((volume.height - cells.height) * (_PARTS / max(step, 1e-9))), 0).astype(np.int64), both
