"""The start of a rectified pair that has nothing but itself: the volume of the object space with parallaxes in place of heights.

Strategy: cells are the pixels of the left image, planes are parallaxes; the two images are the two photographs. Coarse to fine,
each pixel with the parallaxes that the coarser level found around it. Nothing is given up: every pixel that both images can show
gets a parallax, and its coherence with the 9 x 9 pixels around it says what it is worth.

Source: as tasks/matching/volume.
"""

from typing import NamedTuple

import numpy as np

from orthomill.tasks.matching.dense.blocks import reduced
from orthomill.tasks.matching.volume.candidates import CellRanges, all_planes, narrowed
from orthomill.tasks.matching.volume.costs import Choice
from orthomill.tasks.matching.volume.height_volume import optimised, ranges_of
from orthomill.tasks.matching.volume.paths import UNIT
from orthomill.tasks.matching.volume.rectified_photograph import RectifiedPhotograph
from orthomill.tasks.matching.volume.signatures import signatures
from orthomill.tasks.matching.volume.volume_settings import HeightVolume
from orthomill.tasks.matching.volume.winners import coherence

PAIR_VOLUME = HeightVolume(window=7, small_penalty=0.42, large_penalty=1.25)
"""Two images alone: a larger window and larger penalties than on the map, where other photographs tell texture from noise."""
_SMALLEST = 32
"""px: shorter side of the coarsest level at least"""


class PairStart(NamedTuple):
    """Per pixel of the left image (rows, cols), float32: `parallax` px, NaN where the images cannot show it; `coherence`, the share
    of the 9 x 9 pixels around it that go along."""

    parallax: np.ndarray
    coherence: np.ndarray


def pair_start(left: np.ndarray, right: np.ndarray, low: float, high: float, volume: HeightVolume = PAIR_VOLUME) -> PairStart:
    """Parallaxes (column left - column right) of a left image between `low` and `high` px.

    left (H, W), right (H, W'): float32, NaN without data, rows homologous.
    """
    level = _coarsest(left.shape, high - low, volume.widest)
    coarser = None
    while True:
        found, first = _level(left, right, (low, high), level, coarser, volume)
        if level == 0:
            parallax = found + np.float32(first)
            tolerance = np.full(found.shape, volume.coherence, np.float32)
            return PairStart(parallax, coherence(found, tolerance, np.float32(volume.coherence_slope)))
        coarser, level = 2.0 * (found + np.float32(first)), level - 1


def _coarsest(shape: tuple[int, ...], candidates: float, widest: int) -> int:
    """The level from which on the parallaxes fit; small images are not reduced any further."""
    level = 0
    while candidates / 2**level > widest and min(shape) // 2 ** (level + 1) >= _SMALLEST:
        level += 1
    return level


def _level(
    left: np.ndarray, right: np.ndarray, bounds: tuple[float, float], level: int, coarser: np.ndarray | None, volume: HeightVolume
) -> tuple[np.ndarray, int]:
    """Candidate numbers (rows, cols) of a level, and the parallax of number 0, px of the level.

    coarser: parallaxes of the next coarser level in px of this one; None on the coarsest.
    """
    images = [reduced(image, level) for image in (left, right)]
    first, last = int(np.floor(bounds[0] / 2**level)), int(np.ceil(bounds[1] / 2**level))
    planes = -(-(last - first + 1) // UNIT) * UNIT
    shown = np.isfinite(images[0])
    candidates = all_planes(shown, planes) if coarser is None else _near(coarser - np.float32(first), shown, planes, volume)
    flat = np.column_stack([np.ones(planes), np.zeros((planes, 2))])
    moved = flat - np.array([0.0, 1.0, 0.0]) * (first + np.arange(planes))[:, None]
    photographs = [
        RectifiedPhotograph(signatures(image, volume.half, 1), places) for image, places in zip(images, (flat, moved), strict=True)
    ]
    everywhere = Choice(max(shown.shape), np.array([[[0, 1]]]), np.zeros((2, *shown.shape), bool))
    pixels = sum(photograph.signatures.size for photograph in photographs)
    found = optimised(photographs, pixels, everywhere, candidates, volume)
    return found.plane, first


def _near(coarser: np.ndarray, shown: np.ndarray, planes: int, volume: HeightVolume) -> CellRanges:
    """Candidates of every pixel near those that the coarser level found around it."""
    cells = tuple(np.minimum(np.arange(n) // 2, m - 1) for n, m in zip(shown.shape, coarser.shape, strict=True))
    return narrowed(coarser, cells, planes, ranges_of(volume))
