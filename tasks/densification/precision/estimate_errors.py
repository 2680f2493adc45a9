"""Standard errors of guesses: the farther from what was measured, the worse; and those that know nothing at all.

Strategy. Where photographs disagree something stands or moves, about as high as it is wide: what lies a distance away from measured
ground may be that much higher, until it is as uncertain as trees and houses are high. A height of which photographs say something
themselves (neighbours go along with it and a pair matched there, or it is the height of a coarser level) keeps what they say.
"""

import numpy as np
from scipy import ndimage

from orthomill.schemas.surface import GUESSED, MEASURED, Provenance
from orthomill.tasks.densification.fusion import FusedCells
from orthomill.tasks.densification.height_differences import extremes
from orthomill.tasks.densification.precision.standard_errors import REACH
from orthomill.tasks.densification.volume.quality import box_sums

_RISE = 2.2
"""m per m of distance that what was not measured may rise"""
_FARTHEST, _TALLEST = 64, 10.0
"""cells and m; farther away, or once as uncertain as trees and houses are high, an estimate gets no worse"""
_CORE, _MOSTLY = 2, 0.75
"""a cell counts as measured ground if most of the cells up to two away are measured: single ones in a crown are no ground"""
CODE_REACH = _FARTHEST + _CORE
"""cells around an estimate whose codes enter its standard error"""


def with_distance(cells: FusedCells, cell: float, known: np.ndarray) -> FusedCells:
    """The cells with the standard errors of guesses widened by their distance to measured ones; cell: its side, m; known
    (rows, cols) bool: heights that are no mere guess."""
    guessed = np.isin(cells.provenance, GUESSED) & ~(known & (cells.provenance == Provenance.INCOHERENT))
    if not guessed.any():
        return cells
    measured = box_sums(np.isin(cells.provenance, MEASURED), _CORE)
    ground = measured > _MOSTLY * box_sums(np.ones(measured.shape, bool), _CORE)
    # Without any measured cell the distance would be that to the edge of the array.
    distance = ndimage.distance_transform_edt(~ground) if ground.any() else np.full(ground.shape, _FARTHEST)
    widened = np.hypot(cells.precision, np.minimum(_RISE * cell * np.minimum(distance, _FARTHEST), _TALLEST))
    return FusedCells(cells.height, np.where(guessed, widened, cells.precision).astype(np.float32), cells.count, cells.provenance)


def groundless(cells: FusedCells) -> np.ndarray:
    """(rows, cols) bool: heights that know less than their surroundings do. They are more uncertain than trees and houses are high,
    and farther than that from every height that was measured around; cells with standard errors among neighbours, m."""
    measured = np.isin(cells.provenance, MEASURED)
    highest, lowest = extremes(cells.height, measured, REACH)
    outside = (cells.height > highest + _TALLEST) | (cells.height < lowest - _TALLEST)
    # Where nothing was measured around, nothing is known better.
    return outside & (cells.precision > _TALLEST) & (lowest <= highest)
