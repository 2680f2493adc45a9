"""Standard errors of guesses: how far they lie from what was measured around them; and those that know nothing at all.

Strategy. A guess is a height that nothing confirms; what was measured around may go on in its place. So it is as uncertain as it
differs from the nearest measured heights in eight directions (root mean square), and no better than the best of these. All of it is
the block's own: a guess on a lawn is good to decimetres, one beside a wall to a good half of the wall, and one in a crown to what
the crown rises above the ground. Where nothing around was measured, it is as uncertain as trees and houses are high, or as coarser
levels say.

A height of which photographs say something themselves is no guess and keeps what they say: that of a coarser level; one that a pair
matched where neighbours go along with it or no wall is near; and one with which its neighbours go along where nothing around is as
high as a house, good to what grass and leaves are deep: the deeper, the fewer of them do.
"""

import numpy as np

from orthomill.schemas.surface import GUESSED, MEASURED, Provenance
from orthomill.tasks.densification.completion import VolumeWindow
from orthomill.tasks.densification.fusion import FusedCells
from orthomill.tasks.densification.height_differences import extremes
from orthomill.tasks.densification.precision.matched_ground import MatchedGround
from orthomill.tasks.densification.precision.natural_sizes import GRASS, HOUSE, TALLEST, natural
from orthomill.tasks.densification.precision.standard_errors import REACH
from orthomill.tasks.densification.surroundings import differences_from
from orthomill.tasks.densification.volume.quality import Judgement

_FARTHEST = 64
"""cells up to which what was measured tells of a guess; where nothing is as near it is as uncertain as trees and houses are high"""
_AGREEING, _THIN = 60, 40
"""% of the cells around that go along with a height, from which on it is more than a guess; and how many fewer of them make it deep
twice"""
GUESS_REACH = REACH + _FARTHEST
"""cells around a guess that enter its standard error"""


def with_shown(cells: FusedCells, volume: VolumeWindow, ground: MatchedGround) -> FusedCells:
    """The cells with those of which photographs say something themselves told from mere guesses: coded as shown on a coarser
    scale."""
    matched = cells.count > 0
    agreeing = volume.judgement[..., Judgement.COHERENCE].astype(np.float32)
    shown = (agreeing >= _AGREEING) & (matched | (ground.torn < natural(HOUSE, ground.cell))) | (matched & ~ground.walled)
    shown &= (cells.provenance == Provenance.INCOHERENT) & ~volume.alone
    grass = np.float32(natural(GRASS, ground.cell)) * (1 + (100 - agreeing) / np.float32(_THIN))
    deep = np.where(shown & ~matched, np.hypot(cells.precision, grass), cells.precision).astype(np.float32)
    return FusedCells(cells.height, deep, cells.count, np.where(shown, np.uint8(Provenance.COARSE), cells.provenance))


def with_surroundings(cells: FusedCells, alone: np.ndarray, cell: float) -> FusedCells:
    """The cells, `cell` m wide, with the standard errors of guesses; alone (rows, cols) bool: heights that were made from coarser
    levels, whose own standard errors stand where nothing measured is near."""
    guessed = np.isin(cells.provenance, GUESSED)
    if not guessed.any():
        return cells
    measured = np.where(np.isin(cells.provenance, MEASURED), cells.height, np.float32(np.nan))
    differing, best = differences_from(cells.height, measured, cells.precision, guessed, _FARTHEST)
    own = alone & (cells.provenance == Provenance.INCOHERENT)
    lonely = np.where(own, cells.precision, np.hypot(cells.precision, natural(TALLEST, cell)))
    sigma = np.where(np.isfinite(differing), np.hypot(differing, best), lonely)
    return FusedCells(cells.height, np.where(guessed, sigma, cells.precision).astype(np.float32), cells.count, cells.provenance)


def groundless(cells: FusedCells, cell: float) -> np.ndarray:
    """(rows, cols) bool: heights that know less than their surroundings do. They are more uncertain than trees and houses are high,
    and farther than that from every height that was measured around; cells, `cell` m wide, with standard errors among neighbours,
    m."""
    measured = np.isin(cells.provenance, MEASURED)
    highest, lowest = extremes(cells.height, measured, REACH)
    tallest = natural(TALLEST, cell)
    outside = (cells.height > highest + tallest) | (cells.height < lowest - tallest)
    # Where nothing was measured around, nothing is known better.
    return outside & (cells.precision > tallest) & (lowest <= highest)
