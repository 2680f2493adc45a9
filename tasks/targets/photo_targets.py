"""All targets of a photograph: coded ones by their codes, others by their rings and their symmetry."""

import cv2
import numpy as np

from orthomill.schemas.marks import FoundTarget, TargetKind
from orthomill.tasks.targets.coded_targets import coded_targets
from orthomill.tasks.targets.ring_patterns import KINDS, ring_targets
from orthomill.tasks.targets.symmetric_centre import SymmetricCentre, symmetric_centre

PARTS = (1.0, 0.8, 0.62)
"""of the reach: what lies about a small target is no part of its symmetry"""
LEAST_PART = 2.4
"""px"""
# Set on one block of 20 photographs with five plates, and on drawn targets.
OFF_CENTRE = 0.08
"""px: the centre of an ellipse is not that of the circle that leans (benchmarks/results/drawn_targets.md)"""
MOST_SIGMA, MOST_ASYMMETRY, LEAST_SCORE = 0.18, 0.06, 0.75
"""What may be a target where one is expected: standard error (px), asymmetry, score."""


def photo_targets(grey: np.ndarray) -> tuple[FoundTarget, ...]:
    """The targets of a grey image (rows, cols) float32 of 0 to 255, NaN for no picture: coded ones first, then the most certain."""
    whole = np.ascontiguousarray(np.nan_to_num(grey, nan=0.0), np.float32)
    coded = coded_targets(np.clip(whole, 0, 255).astype(np.uint8))
    rings = ring_targets(whole)
    out = []
    for i in range(len(rings)):
        centre = best_centre(whole, rings.place[i], float(rings.radius[i]))
        if centre is None or centre.sigma > MOST_SIGMA or centre.asymmetry > MOST_ASYMMETRY or rings.score[i] < LEAST_SCORE:
            continue
        # The squares of a code are no targets of their own.
        if any(np.hypot(*(centre.place - one.place)) < 1.6 * one.radius for one in coded):
            continue
        kind: TargetKind = KINDS[int(rings.kind[i])]
        col, row = map(float, centre.place)
        sigma = centre.sigma if kind != "circle" else float(np.hypot(centre.sigma, OFF_CENTRE))
        sure = float(rings.score[i]) * (1.0 - 4.0 * centre.asymmetry) * min(1.0, float(rings.contrast[i]) / 40.0)
        out.append(FoundTarget(kind, (col, row), sigma, float(rings.radius[i]), sure))
    return (*coded, *_apart(sorted(out, key=lambda one: -one.score)))


def _apart(ranked: list[FoundTarget]) -> list[FoundTarget]:
    """Without targets that lie within a better one."""
    kept: list[FoundTarget] = []
    for one in ranked:
        if all(np.hypot(one.place[0] - other.place[0], one.place[1] - other.place[1]) > other.radius for other in kept):
            kept.append(one)
    return kept


def best_centre(grey: np.ndarray, place: np.ndarray, radius: float) -> SymmetricCentre | None:
    """The centre by the part of a target that is most symmetric."""
    found = [symmetric_centre(grey, place, part * radius) for part in PARTS if part * radius > LEAST_PART]
    return min((one for one in found if one is not None), key=lambda one: one.sigma + one.asymmetry, default=None)


def stretched(grey: np.ndarray) -> np.ndarray:
    """A grey image of any range as float32 of 0 to 255; one of 8 bits as it is."""
    if grey.dtype == np.uint8 or (np.nanmax(grey) <= 255.0 and np.nanmax(grey) > 64.0):
        return grey.astype(np.float32)
    low, high = np.nanpercentile(grey, (0.5, 99.5))
    return np.clip((grey.astype(np.float32) - low) * (255.0 / max(float(high - low), 1e-6)), 0.0, 255.0)


def grey_of(pixels: np.ndarray) -> np.ndarray:
    """(rows, cols) float32 of 0 to 255 of pixels (rows, cols, bands) of any type."""
    colours = pixels[..., 0] if pixels.ndim == 3 and pixels.shape[2] < 3 else pixels
    if colours.ndim == 3:
        colours = cv2.cvtColor(np.ascontiguousarray(colours[..., :3]), cv2.COLOR_RGB2GRAY)
    return stretched(colours)


def targets_in(pixels: np.ndarray) -> tuple[FoundTarget, ...]:
    """The targets of a photograph, pixels (rows, cols, bands) of any type."""
    return photo_targets(grey_of(pixels))
