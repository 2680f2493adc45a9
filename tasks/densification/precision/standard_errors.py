"""Standard errors of heights among their neighbours: what matching states, and what the surface around makes doubtful.

Strategy. Independent parts are added as variances. Of a height that pairs matched:
- the standard error that matching and the rays gave, times the factor that pairs without a common photograph show on the same block
  (pair_differences.py). A part of it is common to all pairs, so that no number of them averages it out: some on open ground, more
  where the surface rises or falls within the window, for windows show both surfaces in every pair, and where rivals fit almost as
  well;
- unevenness: windows overlap, so that heights next to each other share their errors, and a sound surface is smooth. Where it is not
  (below leaves, beside edges and wires), windows are drawn from one surface to another by amounts that change from cell to cell.
  Slopes and walls are no unevenness, so what counts is the middle one of the departures around from what neighbours let expect;
- strain: where rivals are beaten less clearly than elsewhere and a pair decided, windows see two surfaces in part; what these are
  apart is a share of the height differences around.
Of a height of the volume: how far the volume lies from the pairs around, and not less than a share of the distance between its
heights; and doubt: where rivals fit almost as well (low distinctiveness), the height may be one of theirs, some steps away.
Of both:
- strangeness: around a place that could not be measured windows show two surfaces in part, and so do the wider squares of the
  volume, each to another extent: how far the two differ, the more the larger the share of the cells around that nothing measured.
Heights that stand alone are rated by the level that shows them (coherent_levels.py) and by the depth of leaves, guesses by what was
measured around them (estimate_errors.py); windows that know no walls are rated otherwise (wall_blind_errors.py).

What all pairs of a block have in common no difference of theirs shows. Those numbers were fitted to a simulated town, so that the
shares within one and two are alike in all its classes of ground and for one pair and several, and tested on another town, on a
small one and on a wood (benchmarks).
"""

import numpy as np
from scipy import ndimage

from orthomill.schemas.surface import MEASURED
from orthomill.tasks.densification.completion import VolumeWindow
from orthomill.tasks.densification.fusion import FusedCells
from orthomill.tasks.densification.height_differences import height_range
from orthomill.tasks.densification.precision.matched_ground import GROUND_REACH, MatchedGround
from orthomill.tasks.densification.precision.natural_sizes import LEAVES, natural
from orthomill.tasks.densification.precision.pair_differences import MatchingDifferences, factor_of
from orthomill.tasks.densification.volume.coherent_levels import standard_errors
from orthomill.tasks.densification.volume.quality import box_sums

_COMMON, _BELOW, _ABOVE, _RIVALLED = 0.4, 1.0, 0.5, 1.5
"""what all pairs have in common, share of the standard error of one: everywhere, and at most more beside what rises, beside what
falls, and among rivals"""
_NEAR_WALL = 2.0
"""distances between the heights of the volume by which something rises or falls when this share is at 63 % of its most"""
_UNRIVALLED, _RIVALS = 0.85, 0.45
"""distinctiveness from which on rivals add nothing, and how much lower it is when they add the most"""
_OF_STEP, _VARIES = 0.35, 0.15
"""standard error of a height of the volume, share of the distance between its heights, and of the height differences around"""
_BESIDE, _ENOUGH = 16, 10
"""cells around a height of the volume from which pairs tell how far the volume lies from them, and how many of these cells there
must be: on real photographs it scatters more than its steps let expect, by grass more than by asphalt"""
_PARTS = 256
"""of the distance between the heights of the volume, in which differences are summed: a sum of floats depends on its beginning"""
_DOUBT, _CLEAR = 0.7, 0.25
"""distances between the heights of the volume that a height of no distinctiveness may be wrong, and the distinctiveness at which
this falls to 37 %; the least one of a cell and its neighbours counts"""
_UNEVEN = 2.0
"""times the unevenness of the heights around"""
_DIFFER = 2
"""cells away up to which heights differ by what unevenness adds at most"""
_STRANGE, _SQUARE = 0.9, 4
"""times the scatter of the volume about the pairs in cells up to so far away, where nothing measured any of these"""
_STRAINED, _STRAIN, _TORN = 0.7, 0.3, 2
"""distinctiveness below which a height is strained, the share of the height differences that this adds, and how many cells away
these count"""
REACH = max(_BESIDE, _SQUARE, _DIFFER, GROUND_REACH)
"""cells around a cell whose heights enter its standard error"""


def relative_precision(cells: FusedCells, volume: VolumeWindow, ground: MatchedGround, matched: np.ndarray) -> np.ndarray:
    """Standard errors (rows, cols) float32, m, of all cells with a height; ground: around them; matched (rows, cols): of the
    heights that pairs found, without what a decision between rivals adds."""
    step, least = ground.step, _least_distinctive(volume)
    doubt = np.float32(_DOUBT * step) * volume.size * np.exp(-least / np.float32(_CLEAR))
    own = np.where(np.isfinite(cells.precision), matched, np.hypot(volume_error(cells, volume, step), doubt))
    sigma = np.sqrt(own**2 + _strangeness(cells, volume, step) ** 2 + _strain(cells, volume, ground).astype(float) ** 2)
    # What stands alone lies below its envelope: sets of photographs agree on the leaves that they see, and the first of these begin
    # higher (`python -m benchmarks closed_wood`).
    below = natural(LEAVES, ground.cell)
    sigma = np.where(volume.alone, np.hypot(standard_errors(volume.level, step), below), sigma)
    return np.where(np.isfinite(cells.height), sigma, np.nan).astype(np.float32)


def matched_error(cells: FusedCells, volume: VolumeWindow, ground: MatchedGround, differences: MatchingDifferences) -> np.ndarray:
    """Standard errors (rows, cols) of the heights that pairs matched, m, NaN without one; differences: of the pairs of the
    block."""
    least = _least_distinctive(volume)
    below, above = (1 - np.exp(-beside / max(_NEAR_WALL * ground.step, 1e-9)) for beside in (ground.rise, ground.fall))
    rivalled = np.clip((_UNRIVALLED - least) / _RIVALS, 0, 1)
    common = _COMMON**2 + _BELOW**2 * below + _ABOVE**2 * above + _RIVALLED**2 * rivalled
    matched = factor_of(ground, differences) * ground.single * np.sqrt(1 / np.maximum(cells.count, 1) + common)
    return np.hypot(matched, np.minimum(_UNEVEN * ground.uneven, height_range(cells.height, _DIFFER)))


def _least_distinctive(volume: VolumeWindow) -> np.ndarray:
    """Distinctiveness (rows, cols) of a cell and its neighbours."""
    return np.asarray(ndimage.minimum_filter(volume.distinctiveness, 3, mode="nearest"))


def volume_error(cells: FusedCells, volume: VolumeWindow, step: float) -> np.ndarray:
    """What the volume says of its heights (rows, cols), m."""
    found = np.maximum(np.float32(_OF_STEP * step) * volume.size, off_pairs(cells, volume, step))
    return np.hypot(found, np.float32(_VARIES) * height_range(cells.height, _DIFFER))


def _strain(cells: FusedCells, volume: VolumeWindow, ground: MatchedGround) -> np.ndarray:
    """What a decision between near rivals adds to heights that pairs matched (rows, cols), m; 0 elsewhere."""
    strained = np.isfinite(cells.precision) & (volume.distinctiveness < _STRAINED) & np.isfinite(volume.height)
    # Rivals on an even slope are its own heights a few steps away.
    apart = np.minimum(height_range(cells.height, _TORN), ground.torn)
    return np.where(strained, np.float32(_STRAIN) * apart, np.float32(0))


def _strangeness(cells: FusedCells, volume: VolumeWindow, step: float) -> np.ndarray:
    """Scatter of the volume about the pairs times the share of the cells around that neither measured (rows, cols), m."""
    measured = np.isin(cells.provenance, MEASURED)
    apart, both = _apart(cells, volume, step)
    # Heights that pairs found where nothing is sure would tell of that place, not of this one.
    apart, count = np.where(measured, apart, 0), np.maximum(box_sums(both & measured, _SQUARE), 1)
    variance = (box_sums(apart**2, _SQUARE) - box_sums(apart, _SQUARE) ** 2 / count) / count
    unknown = box_sums(~measured, _SQUARE) / box_sums(np.ones(measured.shape, bool), _SQUARE)
    return _STRANGE * unknown * np.sqrt(np.maximum(variance, 0.0)) * (step / _PARTS)


def off_pairs(cells: FusedCells, volume: VolumeWindow, step: float) -> np.ndarray:
    """How far the volume lies from the pairs around every cell, as a standard error (rows, cols) m; 0 where too few cells tell."""
    apart, both = _apart(cells, volume, step)
    count = box_sums(both, _BESIDE)
    # From the mean and not from the squares: a few cells beside a wall, one surface off, would speak for all around.
    mean = box_sums(np.abs(apart), _BESIDE) / np.maximum(count, 1)
    return np.where(count >= _ENOUGH, np.sqrt(np.pi / 2) * mean, 0.0) * (step / _PARTS)


def _apart(cells: FusedCells, volume: VolumeWindow, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Volume minus pairs (rows, cols) int64, parts of a step, 0 where one is missing; and bool where both are there."""
    both = np.isfinite(cells.precision) & np.isfinite(volume.height) & (step > 0)
    return np.where(both, np.rint((volume.height - cells.height) * (_PARTS / max(step, 1e-9))), 0).astype(np.int64), both
