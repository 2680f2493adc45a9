"""From the heights of the pairs to a complete surface: where no pair has a height, the volume has, measured or estimated."""

from typing import NamedTuple

import numpy as np

from orthomill.schemas.settings import Settings, setting
from orthomill.schemas.surface import Provenance
from orthomill.tasks.densification.fusion import FusedCells
from orthomill.tasks.densification.volume.confidence import SQUARE, Confidence
from orthomill.tasks.densification.volume.quality import STRETCH_UNIT, Judgement


class Completion(Settings):
    """How the heights of pairs and those of the volume go together."""

    nearness: float = setting(1.0, "Heights of a pair count only within this distance of the volume's.", "cells", gt=0.0, le=20.0)


_COMPANY = 50
"""% of the cells around that go along with a height, below which it stands alone"""


class VolumeWindow(NamedTuple):
    """The volume over the cells of a tile: heights (rows, cols) float32 m, NaN where fewer than two photographs see the
    place; judgement (rows, cols, 4) uint8; confidence (rows, cols) uint8 codes of Confidence."""

    height: np.ndarray
    judgement: np.ndarray
    confidence: np.ndarray

    def confident(self, matched: np.ndarray) -> np.ndarray:
        """(rows, cols) bool: measured; matched (rows, cols) bool: where a pair has a height near it."""
        return (self.confidence == Confidence.HIGH) | ((self.confidence == Confidence.BLURRED) & matched)

    @property
    def stray(self) -> np.ndarray:
        """(rows, cols) bool: estimates with which most of the cells around do not go along."""
        return (self.confidence == Confidence.LOW) & (self.judgement[..., Judgement.COHERENCE] < _COMPANY)

    @property
    def size(self) -> np.ndarray:
        """(rows, cols) float32: cells along the side of what a height stands for; where bases are narrow, steps that are as one."""
        stretch = np.maximum(self.judgement[..., Judgement.STRETCH] * np.float32(1.0 / STRETCH_UNIT), np.float32(1.0))
        return np.where(self.confidence == Confidence.CALMED, np.float32(SQUARE), stretch)

    @property
    def distinctiveness(self) -> np.ndarray:
        """(rows, cols) float32: how clearly a height beats its rivals, share of what is usual around."""
        return self.judgement[..., Judgement.DISTINCTIVENESS] * np.float32(0.01)

    @classmethod
    def unknown(cls, shape: tuple[int, int]) -> "VolumeWindow":
        """No height anywhere."""
        nothing = np.full(shape, np.nan, np.float32), np.zeros((*shape, len(Judgement)), np.uint8)
        return cls(*nothing, np.full(shape, Confidence.LOW, np.uint8))


def completed(cells: FusedCells, volume: VolumeWindow) -> FusedCells:
    """The fused cells with heights of the volume where they have none; standard errors there are NaN until modelled.

    Where the volume is not confident, what pairs found near it is an estimate as well: they started from there.
    """
    matched = np.isfinite(cells.height)
    added = ~matched & np.isfinite(volume.height)
    unsure = np.isfinite(volume.height) & ~volume.confident(matched)
    code = np.where(added, np.uint8(Provenance.VOLUME), cells.provenance)
    return FusedCells(
        np.where(added, volume.height, cells.height),
        cells.precision,
        cells.count,
        np.where(unsure, np.uint8(Provenance.INCOHERENT), code),
    )
