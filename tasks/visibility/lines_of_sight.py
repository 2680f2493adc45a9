"""What a photograph sees of a surface whose heights are not all worth the same: estimates hide less than measurements.

An estimated height may be metres too high. A photograph that it seems to hide a place from is therefore not lost: it is set back
behind those that see the place freely, and serves where none does. A measured surface hides for certain, unless the place itself
has no height but one that was guessed: it may as well lie above what seems to hide it.
"""

from dataclasses import replace
from enum import IntEnum

import numpy as np

from orthomill.tasks.geometry.view import View
from orthomill.tasks.visibility.height_model import HeightModel, Targets, visible_targets


class LineOfSight(IntEnum):
    """How a photograph sees a place; uint8 in arrays. The higher the better."""

    HIDDEN = 0
    BEHIND_ESTIMATE = 1
    FREE = 2


def lines_of_sight(
    surface: HeightModel, measured: HeightModel, view: View, targets: Targets, guessed: np.ndarray, tolerance: float
) -> np.ndarray:
    """uint8 (R, C) codes of LineOfSight of the targets.

    `surface`: all heights; `measured`: the same model with NaN where heights are not measured; `guessed` (R, C) bool: targets whose
    height is neither measured nor estimated; `tolerance` (m) as in `visible_targets`. A target without height is HIDDEN.
    """
    free = visible_targets(surface, view, targets, tolerance) > 0
    # Only what something hides is asked again: a few per cent of the ground.
    behind = replace(targets, z=np.where(free, np.float32(np.nan), targets.z))
    certain = visible_targets(measured, view, behind, tolerance) | (guessed & np.isfinite(behind.z))
    return np.where(free, LineOfSight.FREE, certain * np.uint8(LineOfSight.BEHIND_ESTIMATE)).astype(np.uint8)
