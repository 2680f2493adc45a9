"""From the heights of the pairs to a complete surface: where no pair has a height, the volume has, measured or estimated."""

from typing import NamedTuple

import numpy as np

from orthomill.schemas.surface import Provenance
from orthomill.tasks.densification.fusion import FusedCells
from orthomill.tasks.densification.height_differences import even
from orthomill.tasks.densification.volume.confidence import Confidence
from orthomill.tasks.densification.volume.quality import LEVEL_UNIT, STRETCH_UNIT, Judgement, coheres_less

_COMPANY, _IN_COMPANY = 50, 40
"""% of the cells around that go along with a height, below which it stands alone: in general, and where heights go along with each
other far and wide, as in a town, where the rim of a roof has fewer than half; below leaves and on water such heights are wrong"""
_COHERENT = 80
"""%, the mean coherence far and wide from which on they do"""


class VolumeWindow(NamedTuple):
    """The volume over the cells of a tile: heights (rows, cols) float32 m, NaN where fewer than two photographs see the
    place; judgement (rows, cols, 5) uint8; confidence (rows, cols) uint8 codes of Confidence."""

    height: np.ndarray
    judgement: np.ndarray
    confidence: np.ndarray

    def confident(self, matched: np.ndarray, even: np.ndarray) -> np.ndarray:
        """(rows, cols) bool: measured; matched and even (rows, cols) bool: where a pair has a height near it, and where there is no
        second surface next to it."""
        faint = (self.confidence == Confidence.FAINT) & even
        return (self.confidence == Confidence.HIGH) | ((self.confidence == Confidence.BLURRED) | faint) & matched

    @property
    def stray(self) -> np.ndarray:
        """(rows, cols) bool: estimates with which too few of the cells around go along."""
        coherence = self.judgement[..., Judgement.COHERENCE]
        apart = coheres_less(coherence, np.ones(coherence.shape, bool), _COHERENT)
        return (self.confidence == Confidence.LOW) & (coherence < np.where(apart, _COMPANY, _IN_COMPANY))

    @property
    def size(self) -> np.ndarray:
        """(rows, cols) float32: cells along the side of what a height stands for; where bases are narrow, steps that are as one."""
        stretch = np.maximum(self.judgement[..., Judgement.STRETCH] * np.float32(1.0 / STRETCH_UNIT), np.float32(1.0))
        return np.where(self.alone, np.maximum(np.exp2(self.level), stretch), stretch)

    @property
    def alone(self) -> np.ndarray:
        """(rows, cols) bool: heights of places where no finest height goes along with its neighbours."""
        return np.isin(self.confidence, (Confidence.CALMED, Confidence.COARSE)) & np.isfinite(self.height)

    @property
    def level(self) -> np.ndarray:
        """(rows, cols) float32: the level whose steps say what heights are worth that stand alone."""
        return self.judgement[..., Judgement.LEVEL] * np.float32(1.0 / LEVEL_UNIT)

    @property
    def distinctiveness(self) -> np.ndarray:
        """(rows, cols) float32: how clearly a height beats its rivals, share of what is usual around."""
        return self.judgement[..., Judgement.DISTINCTIVENESS] * np.float32(0.01)

    @classmethod
    def unknown(cls, shape: tuple[int, int]) -> "VolumeWindow":
        """No height anywhere."""
        nothing = np.full(shape, np.nan, np.float32), np.zeros((*shape, len(Judgement)), np.uint8)
        return cls(*nothing, np.full(shape, Confidence.LOW, np.uint8))


def completed(cells: FusedCells, volume: VolumeWindow, cell: float) -> FusedCells:
    """The fused cells with heights of the volume where they have none; standard errors there are NaN until modelled; cell: its
    side, m.

    Where the volume is not confident, what pairs found near it is an estimate as well: they started from there. Where it stands
    alone, pairs do not enter: each would follow another leaf.
    """
    matched = np.isfinite(cells.height) & ~volume.alone
    added = ~matched & np.isfinite(volume.height)
    height = np.where(added, volume.height, cells.height)
    unsure = np.isfinite(volume.height) & ~volume.confident(matched, even(height, cell))
    code = np.where(added, np.uint8(Provenance.VOLUME), cells.provenance)
    estimate = np.where(volume.confidence == Confidence.COARSE, np.uint8(Provenance.COARSE), np.uint8(Provenance.INCOHERENT))
    return FusedCells(
        height,
        np.where(volume.alone, np.float32(np.nan), cells.precision),
        np.where(volume.alone, np.uint8(0), cells.count),
        np.where(unsure, estimate, code),
    )
