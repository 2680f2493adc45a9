"""Pairs without a base: does a mere turn of the camera explain the matches?

Rays of homologous points then differ by a rotation only. Seeded samples of two matches give rotations; the best is refined on the
matches that agree with it (Horn 1987 / Umeyama 1991 for directions).
"""

from dataclasses import dataclass

import numpy as np

from orthomill.tasks.geometry.rotation import nearest_rotation
from orthomill.tasks.orientation.relative.relative_forms import directions

SAMPLES = 60
SAME = 0.05
"""px; homologous points of one photograph given twice lie no farther apart than this, in the median"""


@dataclass(frozen=True, eq=False)
class Turned:
    """A rotation (3, 3) left to right, the matches (s,) that it explains, and whether these lie at the same place in both."""

    rotation: np.ndarray
    kept: np.ndarray
    same: bool


def turn_only(observations: np.ndarray, c_left: float, c_right: float, threshold: float, seed: int = 5) -> Turned:
    """The rotation that explains most of the matches (s, 4) within `threshold` px of the right image."""
    rng, best = np.random.default_rng(seed), None
    left, right = directions(observations, c_left, c_right)
    left, right = (rays / np.linalg.norm(rays, axis=1, keepdims=True) for rays in (left, right))
    for _ in range(SAMPLES):
        own = rng.choice(len(left), 2, replace=False)
        kept = _miss(nearest_rotation(right[own].T @ left[own]), left, right, c_right) < threshold
        if best is None or kept.sum() > best.sum():
            best = kept
    rotation = np.eye(3)
    for _ in range(3):
        if best.sum() < 2:
            break
        rotation = nearest_rotation(right[best].T @ left[best])
        best = _miss(rotation, left, right, c_right) < threshold
    apart = np.abs(observations[:, :2] - observations[:, 2:])[best]
    return Turned(rotation, best, bool(len(apart) and np.median(apart.max(axis=1)) < SAME))


def _miss(rotation: np.ndarray, left: np.ndarray, right: np.ndarray, c: float) -> np.ndarray:
    """(s,) px near the image centre."""
    return c * np.linalg.norm(left @ rotation.T - right, axis=1)
