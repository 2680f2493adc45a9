"""Standard errors of heights among their neighbours: what matching states, and what the surface around makes doubtful.

Strategy. Independent parts are added as variances. Of every height:
- the standard error that matching and the rays gave; of a height of the volume how far the volume lies from the pairs around, and
  not less than a share of the distance between its heights;
- the roughness next to it: within a cell the surface itself varies;
- doubt: where rivals fit almost as well (a low standing), the height may be that of the surface next door, and the error is of
  the order of the height differences around;
- edges: a window that reaches over an edge bends towards what lies behind it, in all pairs alike.
Of a measured height also:
- unevenness, at least: below leaves, and beside them, windows show two surfaces in part and are drawn to the other one by amounts
  that change from cell to cell. Slopes and walls are no unevenness, so what counts is the middle one of the departures around from
  what neighbours let expect; and only where something around could not be measured, as in every crown.
Of an estimate also:
- the distance to heights that were measured: where photographs disagree something stands or moves, about as high as it is wide.

The numbers below were fitted to the west half of a simulated scene and tested on the east half and on another scene (benchmarks);
but for SHARE, which was set with all of them and with disjoint strips of a real block in view.
"""

import cv2
import numpy as np
from scipy import ndimage

from orthomill.schemas.surface import ESTIMATED, MEASURED
from orthomill.tasks.densification.completion import VolumeWindow
from orthomill.tasks.densification.fusion import FusedCells
from orthomill.tasks.densification.volume.quality import box_sums

SHARE = 0.45
"""factor of the standard errors of matching: those of neighbouring nodes, between which a cell is interpolated, partly cancel"""
_OF_STEP = 0.45
"""standard error of a height of the volume, share of the distance between its heights"""
_BESIDE, _ENOUGH = 16, 10
"""cells around a height of the volume from which pairs tell how far the volume lies from them, and how many of these cells there
must be: on real photographs it scatters more than its steps let expect, by grass more than by asphalt"""
_PARTS = 256
"""of the distance between the heights of the volume, in which differences are summed: a sum of floats depends on its beginning"""
_ROUGHNESS = 0.2
"""share of the height differences to the cells next to it that the surface varies within a cell"""
_DOUBT, _CLEAR, _DOUBTFUL = 3.5, 0.19, 2
"""share of the height differences around that a height without standing may be wrong, the standing at which this falls to 37 %,
and how many cells away these differences count"""
_MOST = 1.0
"""no height is farther from the truth than the heights around differ"""
_EDGE, _WINDOW = 0.03, 5
"""share of the height differences within half a window of matching, cells, by which it bends"""
_UNEVEN, _AROUND = 20.0, 5
"""times the departure of heights from the mean of their four neighbours of which half of the cells around fall short, and the side
of the square of these cells"""
_UNMEASURED = 8
"""cells away from the nearest cell without a measured height, beyond which windows show one surface"""
_GONE = 0.4
"""share of the cells around without a height, from which on slopes explain nothing: windows fail where they see two surfaces"""
_RISE = 2.2
"""m per m of distance that what was not measured may rise"""
_FARTHEST, _TALLEST = 64, 10.0
"""cells and m; farther away, or once as uncertain as trees and houses are high, an estimate gets no worse"""
_CORE, _MOSTLY = 2, 0.75
"""a cell counts as measured ground if most of the cells up to two away are measured: single ones in a crown are no ground"""
REACH = max(_WINDOW, _BESIDE, _UNMEASURED)
"""cells around a cell whose heights enter its standard error"""
CODE_REACH = _FARTHEST + _CORE
"""cells around an estimate whose codes enter its standard error"""


def relative_precision(cells: FusedCells, volume: VolumeWindow, step: float) -> np.ndarray:
    """Standard errors (rows, cols) float32, m, of all cells with a height; step: of the volume's heights at its finest level, m."""
    of_volume = np.maximum(np.float32(_OF_STEP * step) * volume.size, _beside(cells, volume, step))
    matching = np.where(np.isfinite(cells.precision), SHARE * cells.precision, of_volume)
    doubt = np.minimum(_DOUBT * np.exp(-volume.standing / np.float32(_CLEAR)), _MOST) * height_range(cells.height, _DOUBTFUL)
    roughness, edge = _ROUGHNESS * height_range(cells.height, 1), _EDGE * height_range(cells.height, _WINDOW)
    sigma = np.sqrt(matching**2 + roughness**2 + doubt**2 + edge**2)
    sigma = np.maximum(sigma, np.minimum(_uneven(cells), _MOST * height_range(cells.height, _DOUBTFUL)))
    return np.where(np.isfinite(cells.height), sigma, np.nan).astype(np.float32)


def _uneven(cells: FusedCells) -> np.ndarray:
    """Standard errors (rows, cols) m, at least, of measured heights near others that could not be measured; 0 elsewhere."""
    measured = np.isin(cells.provenance, MEASURED)
    near = measured & (box_sums(~measured, _UNMEASURED) > 0)
    return np.where(near, np.float32(_UNEVEN) * unevenness(cells.height), np.float32(0))


def unevenness(height: np.ndarray) -> np.ndarray:
    """How far heights lie from the mean of their four neighbours, the median of the square around every cell; (rows, cols) float32,
    m. Cells with an unknown one among them count as even."""
    wide = np.pad(height, 1, mode="edge").astype(np.float32)
    mean = ((wide[:-2, 1:-1] + wide[2:, 1:-1]) + (wide[1:-1, :-2] + wide[1:-1, 2:])) * np.float32(0.25)
    return np.asarray(cv2.medianBlur(np.nan_to_num(np.abs(height.astype(np.float32) - mean)), _AROUND))


def window_doubt(height: np.ndarray, window: int) -> np.ndarray:
    """Standard errors (rows, cols) float32, m, that windows which know no walls leave: a height may be that of anything within a
    window of it, so that it is one of those around, all alike likely. heights (rows, cols) m, NaN where nothing was measured;
    window: its side in cells.

    What the even slope of the ground explains is no doubt, unless much around was not found.
    """
    reach = min(window, REACH - 1)
    known, around = np.isfinite(height), box_sums(np.ones(height.shape, bool), reach)
    gone = np.minimum((1.0 - box_sums(known, reach) / around) / _GONE, 1.0)
    # Beside a wall the calmest cells within the window tell the slope of the ground; their neighbours are one cell away.
    calmest = ndimage.minimum_filter(np.where(known, height_range(height, 1), np.inf), 2 * reach + 1, mode="nearest")
    slope = np.where(known, 2 * reach * calmest, 0.0)
    beyond = np.maximum(height_range(height, reach) - (1.0 - gone) * slope, 0.0)
    return (beyond / np.float32(np.sqrt(12.0))).astype(np.float32)


def _beside(cells: FusedCells, volume: VolumeWindow, step: float) -> np.ndarray:
    """How far the volume lies from the pairs around every cell, root mean square (rows, cols) m; 0 where too few cells tell."""
    if not step > 0:
        return np.zeros(cells.height.shape)
    both = np.isfinite(cells.precision) & np.isfinite(volume.height)
    apart = np.where(both, np.rint((volume.height - cells.height) * (_PARTS / step)), 0).astype(np.int64)
    count = box_sums(both, _BESIDE)
    return np.where(count >= _ENOUGH, np.sqrt(box_sums(apart**2, _BESIDE) / np.maximum(count, 1)), 0.0) * (step / _PARTS)


def with_distance(cells: FusedCells, cell: float) -> FusedCells:
    """The cells with the standard errors of estimates widened by their distance to measured ones; cell: its side, m."""
    estimated = np.isin(cells.provenance, ESTIMATED)
    if not estimated.any():
        return cells
    measured = box_sums(np.isin(cells.provenance, MEASURED), _CORE)
    ground = measured > _MOSTLY * box_sums(np.ones(measured.shape, bool), _CORE)
    # Without any measured cell the distance would be that to the edge of the array.
    distance = ndimage.distance_transform_edt(~ground) if ground.any() else np.full(ground.shape, _FARTHEST)
    widened = np.hypot(cells.precision, np.minimum(_RISE * cell * np.minimum(distance, _FARTHEST), _TALLEST))
    return FusedCells(cells.height, np.where(estimated, widened, cells.precision).astype(np.float32), cells.count, cells.provenance)


def groundless(cells: FusedCells) -> np.ndarray:
    """(rows, cols) bool: heights that know less than their surroundings do. They are more uncertain than trees and houses are high,
    and farther than that from every height that was measured around; cells with standard errors among neighbours, m."""
    measured = np.isin(cells.provenance, MEASURED)
    highest, lowest = _extremes(cells.height, measured, REACH)
    outside = (cells.height > highest + _TALLEST) | (cells.height < lowest - _TALLEST)
    # Where nothing was measured around, nothing is known better.
    return outside & (cells.precision > _TALLEST) & (lowest <= highest)


def height_range(height: np.ndarray, reach: int) -> np.ndarray:
    """Highest minus lowest height (rows, cols) float32, m, of the cells up to `reach` away in rows and columns; unknown ones do not
    count."""
    known = np.isfinite(height)
    highest, lowest = _extremes(height, known, reach)
    return np.where(known, highest - lowest, 0.0).astype(np.float32)


def _extremes(height: np.ndarray, counted: np.ndarray, reach: int) -> tuple[np.ndarray, np.ndarray]:
    """Highest and lowest height (rows, cols) m of the `counted` cells up to `reach` away; -inf and inf where there is none."""
    size = 2 * reach + 1
    highest = ndimage.maximum_filter(np.where(counted, height, -np.inf), size, mode="nearest")
    return highest, ndimage.minimum_filter(np.where(counted, height, np.inf), size, mode="nearest")
