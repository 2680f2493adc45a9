"""The start of a rectified pair that has nothing but itself: the volume of the object space with parallaxes in place of heights.

Strategy: cells are the pixels of the left image, planes are parallaxes; the two images are the two photographs. Coarse to fine,
each pixel with the parallaxes that the coarser level found around it. A jump between neighbours costs more where the left image is
plain, and less at its edges. Nothing is given up: every pixel that both images can show gets a parallax, and its coherence with the
9 x 9 pixels around it says what it is worth.

Source: as tasks/matching/volume; Hirschmueller 2008, who adapts the penalty to the difference of neighbouring pixels.
"""

from typing import NamedTuple

import cv2
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

PAIR_VOLUME = HeightVolume(window=5, small_penalty=0.42, large_penalty=0.9)
"""Two images alone: larger penalties than on the map, where other photographs tell texture from noise."""
PLAIN, AT_EDGES = 4.0, 0.5
"""How many times the large penalty holds where the left image is plain, and at its strongest edges: where depth breaks, brightness
mostly does. At the usual contrast of the image it holds twice. Set on eight pairs of the Middlebury data (benchmarks:
`stereo_pairs`); Motorcycle was not among them."""
_SMOOTHING = 0.8
"""px"""
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
    found = optimised(photographs, pixels, everywhere, candidates, volume, jump_factors(images[0]))
    return found.plane, first


def jump_factors(image: np.ndarray) -> np.ndarray:
    """float32 (rows, cols): how many times the large penalty holds at the pixels of an image."""
    # float32 and a little smoothed: in plain ground the noise of single pixels is all the contrast there is.
    grey = cv2.GaussianBlur(np.nan_to_num(image).astype(np.float32), (0, 0), _SMOOTHING)
    around = np.ones((3, 3), np.uint8)
    contrast = cv2.dilate(grey, around) - cv2.erode(grey, around)
    usual = np.float32(np.median(contrast)) + np.float32(1e-6)
    return np.clip(PLAIN * usual / (usual + contrast), AT_EDGES, PLAIN).astype(np.float32)


def _near(coarser: np.ndarray, shown: np.ndarray, planes: int, volume: HeightVolume) -> CellRanges:
    """Candidates of every pixel near those that the coarser level found around it."""
    cells = tuple(np.minimum(np.arange(n) // 2, m - 1) for n, m in zip(shown.shape, coarser.shape, strict=True))
    return narrowed(coarser, cells, planes, ranges_of(volume))
