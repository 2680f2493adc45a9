"""Pairs without a base: the test whether a pure rotation of the camera explains the matches.

Homologous rays then differ by a rotation only. Seeded samples of two matches give rotations; the one that most matches agree with
is refined on these matches. Source: Horn 1987 / Umeyama 1991 for the rotation between directions.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from orthomill.tasks.geometry.rotation import nearest_rotation
from orthomill.tasks.orientation.relative.relative_forms import directions

# Two matches fix a rotation, so even with 75 % wrong ones a sample of two right ones is among 60 with 98 % probability.
SAMPLES = 60
SAME = 0.05
"""px: homologous points of one photograph given twice differ by less, in the median; matches of different exposures never do"""


@dataclass(frozen=True, eq=False)
class PureRotation:
    """A rotation (3, 3) left to right, the matches (s,) bool that it explains, and whether these have the same pixel coordinates in
    both photographs."""

    rotation: np.ndarray
    kept: np.ndarray
    same: bool


def pure_rotation(observations: np.ndarray, c_left: float, c_right: float, threshold: float, seed: int = 5) -> PureRotation:
    """The rotation that explains most of the matches (s, 4) within `threshold` px in the right image."""
    left, right = (rays / np.linalg.norm(rays, axis=1, keepdims=True) for rays in directions(observations, c_left, c_right))
    kept = _best_sample(left, right, c_right, threshold, seed)
    rotation = np.eye(3)
    for _ in range(3):
        if kept.sum() < 2:
            break
        rotation = nearest_rotation(right[kept].T @ left[kept])
        kept = _misfit(rotation, left, right, c_right) < threshold
    apart = np.abs(observations[:, :2] - observations[:, 2:])[kept]
    return PureRotation(rotation, kept, bool(len(apart) and np.median(apart.max(axis=1)) < SAME))


def _best_sample(left: np.ndarray, right: np.ndarray, c: float, threshold: float, seed: int) -> np.ndarray:
    """(s,) bool: the matches that agree with the best of the sampled rotations."""
    own = _samples(len(left), seed)
    rotations = np.einsum("nki,nkj->nij", _triads(right[own]), _triads(left[own]))
    # Cosines of the angles between rotated left rays and right rays, of all samples and matches in one product.
    cosines = (right[:, :, None] * left[:, None, :]).reshape(-1, 9) @ rotations.reshape(-1, 9).T
    kept = c * np.sqrt(np.maximum(2.0 - 2.0 * cosines, 0.0)) < threshold
    return np.asarray(kept[:, kept.sum(axis=0).argmax()])


@lru_cache(maxsize=4096)
def _samples(count: int, seed: int) -> np.ndarray:
    """(SAMPLES, 2) numbers of two different matches out of `count`; kept, for pairs are related again with other cameras."""
    rng = np.random.default_rng(seed)
    return np.array([rng.choice(count, 2, replace=False) for _ in range(SAMPLES)])


def _triads(pairs: np.ndarray) -> np.ndarray:
    """(n, 3, 3) orthonormal rows by pairs of unit vectors (n, 2, 3): along their sum, along their difference, across both.

    The rotation between the triads of two pairs is the one nearest to both pairs at once. NaN for a vector twice.
    """
    along, apart = pairs[:, 0] + pairs[:, 1], pairs[:, 1] - pairs[:, 0]
    with np.errstate(invalid="ignore"):
        along, apart = (axis / np.linalg.norm(axis, axis=1, keepdims=True) for axis in (along, apart))
    return np.stack([along, apart, np.cross(along, apart)], axis=1)


def _misfit(rotation: np.ndarray, left: np.ndarray, right: np.ndarray, c: float) -> np.ndarray:
    """(s,) px: angles between rotated left rays and right rays, as distances at the image centre."""
    return c * np.linalg.norm(left @ rotation.T - right, axis=1)
