"""Heights at the foot of walls: those of the pairs and that of the volume, together.

Strategy. Windows of matching that stand at the foot of a wall show its top in part, in every pair alike, and their heights are
drawn upwards; no number of pairs averages that out. The volume compares small surroundings in all photographs at once: on open
ground its steps are coarser than what pairs tell, at a foot they are better, the more photographs there are. So both are
weighted by their variances where something rises beside a cell, the more the less falls there: on top of a wall the volume
prefers the ground below, and pairs alone tell.
"""

import numpy as np

from orthomill.tasks.densification.completion import VolumeWindow
from orthomill.tasks.densification.fusion import FusedCells
from orthomill.tasks.densification.precision.matched_ground import MatchedGround
from orthomill.tasks.densification.precision.standard_errors import off_pairs
from orthomill.tasks.densification.volume.quality import Judgement

_OF_STEP = 0.5
"""standard error of a height of the volume at a foot, share of the distance between its heights, and no less than it is off the
pairs around: below trees it is off by more"""
_NEAR = 2.0
"""distances between the heights of the volume by which something rises when its foot is one to 63 %"""

_ALONE, _TOGETHER = 50, 90
"""% of the cells around that go along with a height of the volume, up to which it says nothing, and from which on all: below
leaves it is no better than pairs"""


def volume_share(cells: FusedCells, volume: VolumeWindow, ground: MatchedGround, matched: np.ndarray) -> np.ndarray:
    """(rows, cols) float64, 0 to 1: the share of the volume in the heights that pairs found; 0 where there is none.

    ground: around the cells; matched (rows, cols): standard errors of the pairs' heights, m.
    """
    both = np.isfinite(cells.precision) & np.isfinite(cells.height) & np.isfinite(volume.height) & ~volume.alone
    foot = np.clip((ground.rise - ground.fall) / np.maximum(ground.rise + ground.fall, 1e-9), 0, 1)
    foot *= 1 - np.exp(-ground.rise / max(_NEAR * ground.step, 1e-9))
    foot *= np.clip((volume.judgement[..., Judgement.COHERENCE] - float(_ALONE)) / (_TOGETHER - _ALONE), 0, 1)
    squared = np.where(both, matched, 0.0) ** 2 * foot
    sigma = np.maximum(_OF_STEP * ground.step * volume.size, off_pairs(cells, volume, ground.step))
    return squared / np.maximum(squared + sigma**2, 1e-18)


def with_volume(height: np.ndarray, volume: VolumeWindow, share: np.ndarray) -> np.ndarray:
    """The heights (rows, cols) float32, m, moved towards the volume by its share."""
    return np.where(share > 0, height + share * (volume.height - height), height).astype(np.float32)
