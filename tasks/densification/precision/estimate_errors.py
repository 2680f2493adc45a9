"""Standard errors of guesses: the farther from what was measured, the worse; and those that know nothing at all.

Strategy. Where photographs disagree something stands or moves, about as high as it is wide: what lies a distance away from measured
ground may be that much higher, until it is as uncertain as trees and houses are high. A height of which photographs say something
themselves keeps what they say: that of a coarser level; one that a pair matched where neighbours go along with it or no wall is
near; and one with which its neighbours go along where nothing around is as high as a house, good to what grass and leaves are deep:
the deeper, the fewer of them do.
"""

import numpy as np
from scipy import ndimage

from orthomill.schemas.surface import GUESSED, MEASURED, Provenance
from orthomill.tasks.densification.completion import VolumeWindow
from orthomill.tasks.densification.fusion import FusedCells
from orthomill.tasks.densification.height_differences import extremes
from orthomill.tasks.densification.precision.matched_ground import MatchedGround
from orthomill.tasks.densification.precision.standard_errors import REACH
from orthomill.tasks.densification.volume.quality import Judgement, box_sums

_RISE = 2.2
"""m per m of distance that what was not measured may rise"""
_FARTHEST, _TALLEST = 64, 10.0
"""cells and m; farther away, or once as uncertain as trees and houses are high, an estimate gets no worse"""
_CORE, _MOSTLY = 2, 0.75
"""a cell counts as measured ground if most of the cells up to two away are measured: single ones in a crown are no ground"""
_HOUSE, _GRASS = 2.5, 0.4
"""m that the surface rises and falls beside what may be a house, and that what no pair matched is deep"""
_AGREEING, _THIN = 60, 40
"""% of the cells around that go along with a height, from which on it is more than a guess; and how many fewer of them make it deep
twice"""
CODE_REACH = _FARTHEST + _CORE
"""cells around an estimate whose codes enter its standard error"""


def with_shown(cells: FusedCells, volume: VolumeWindow, ground: MatchedGround) -> FusedCells:
    """The cells with those of which photographs say something themselves told from mere guesses: coded as shown on a coarser
    scale."""
    matched = cells.count > 0
    agreeing = volume.judgement[..., Judgement.COHERENCE].astype(np.float32)
    shown = (agreeing >= _AGREEING) & (matched | (ground.torn < _HOUSE)) | (matched & ~ground.walled)
    shown &= (cells.provenance == Provenance.INCOHERENT) & ~volume.alone
    grass = np.float32(_GRASS) * (1 + (100 - agreeing) / np.float32(_THIN))
    deep = np.where(shown & ~matched, np.hypot(cells.precision, grass), cells.precision).astype(np.float32)
    return FusedCells(cells.height, deep, cells.count, np.where(shown, np.uint8(Provenance.COARSE), cells.provenance))


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
