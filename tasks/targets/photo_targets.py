"""All targets of a photograph: coded ones by their codes, others by their rings and their symmetry."""

import cv2
import numpy as np

from orthomill.schemas.marks import FoundTarget, TargetKind
from orthomill.tasks.targets.coded_targets import coded_targets
from orthomill.tasks.targets.field_edges import crossing_edges
from orthomill.tasks.targets.leaning_circle import WIDE, centre_sigma
from orthomill.tasks.targets.ring_patterns import KINDS, RingTargets, as_lens, ring_targets, ring_values
from orthomill.tasks.targets.ring_templates import DISCS, RINGS, edge_directions, likeness
from orthomill.tasks.targets.symmetric_centre import symmetric_centre
from orthomill.tasks.targets.target_centre import TargetCentre

PARTS = (1.0, 0.8, 0.62)
"""of the reach: what lies about a small target is no part of its symmetry"""
LEAST_PART = 2.4
"""px"""
EDGES = 0.85
"""of the reach in which the edges of fields are fitted: inside of the border of the plate"""
# Set on one block of 20 photographs with five plates, and on drawn targets.
MOST_SIGMA, MOST_ASYMMETRY = 0.18, 0.06
"""What may be a target where one is expected: standard error (px), and the variance that is not symmetric."""
LIKE_BEFORE_EDGES = 0.88
"""Likeness, about a place that is known to a pixel, of what is worth the fit of edges."""
MOST_EDGE_SIGMA, MOST_UNEXPLAINED = 0.25, 0.1
"""And what may be a plate that is not symmetric: standard error (px), and the variance that its four fields do not explain."""
LEAST_LIKE: dict[TargetKind, float] = {"chequered": 0.91, "cross": 0.9, "circle": 0.9}
"""Correlation with a template about the centre; what is drawn has more (benchmarks/results/drawn_targets.md)."""


def photo_targets(grey: np.ndarray, c: float = WIDE) -> tuple[FoundTarget, ...]:
    """The targets of a grey image (rows, cols) float32 of 0 to 255, NaN for no picture: coded ones first, then the most certain; c:
    the camera constant, px."""
    whole = np.ascontiguousarray(np.nan_to_num(grey, nan=0.0), np.float32)
    coded = coded_targets(np.clip(whole, 0, 255).astype(np.uint8), c)
    rings = ring_targets(whole)
    out = [one for i in range(len(rings)) if (one := _target(whole, rings, i, c)) is not None]
    # The squares and the dot of a code are no targets of their own.
    apart = [one for one in out if all(np.hypot(*np.subtract(one.place, code.place)) >= 1.6 * code.radius for code in coded)]
    return (*coded, *_apart(sorted(apart, key=lambda one: -one.score)))


def _target(whole: np.ndarray, rings: RingTargets, i: int, c: float) -> FoundTarget | None:
    """A candidate about its centre, if it is a target there."""
    kind, radius = KINDS[int(rings.kind[i])], float(rings.radius[i])
    centre = _centre(whole, rings.place[i], radius, kind)
    if centre is None:
        return None
    like = likeness_about(whole, centre.place, radius, kind)
    if like < LEAST_LIKE[kind]:
        return None
    sigma = centre.sigma if kind != "circle" else float(np.hypot(centre.sigma, centre_sigma(*_usual_disc(radius), c)))
    sure = like * (1.0 - 4.0 * centre.unexplained) * min(1.0, float(rings.contrast[i]) / 40.0)
    return FoundTarget(kind, (float(centre.place[0]), float(centre.place[1])), sigma, radius, sure)


def _centre(whole: np.ndarray, place: np.ndarray, radius: float, kind: TargetKind) -> TargetCentre | None:
    """The centre of what may be a target: by symmetry, and that of a plate whose fields differ by their edges."""
    found = best_centre(whole, place, radius)
    if found is not None and found.sigma <= MOST_SIGMA and found.unexplained <= MOST_ASYMMETRY:
        return found
    values = _values_about(whole, place, radius, kind)
    if kind != "chequered" or float(likeness(values[None], kind)[0]) < LIKE_BEFORE_EDGES:
        return None
    edges = crossing_edges(whole, place, EDGES * radius, edge_directions(values))
    return edges if edges is not None and edges.sigma <= MOST_EDGE_SIGMA and edges.unexplained <= MOST_UNEXPLAINED else None


def _usual_disc(radius: float) -> tuple[float, float]:
    """The semi-axes of a disc that is found by this reach, leaning by 30 degrees."""
    long = radius * float(np.mean(DISCS))
    return long, long * float(np.cos(np.radians(30.0)))


def likeness_about(whole: np.ndarray, place: np.ndarray, radius: float, kind: TargetKind) -> float:
    """-1 to 1: how much a grey image looks like a target of a kind about a place (2,) px."""
    return float(likeness(_values_about(whole, place, radius, kind)[None], kind)[0])


def _values_about(whole: np.ndarray, place: np.ndarray, radius: float, kind: TargetKind) -> np.ndarray:
    """(rings, SAMPLES) of a grey image about a place, as templates of a kind are compared with."""
    reach = int(np.ceil(1.5 * radius)) + 4
    col, row = np.round(place).astype(int)
    top, left = max(row - reach, 0), max(col - reach, 0)
    part = as_lens(whole[top : row + reach + 1, left : col + reach + 1], radius)
    return ring_values(part, (place - (left, top))[None], radius, RINGS[kind])[0]


def _apart(ranked: list[FoundTarget]) -> list[FoundTarget]:
    """Without targets that lie within a better one."""
    kept: list[FoundTarget] = []
    for one in ranked:
        if all(np.hypot(one.place[0] - other.place[0], one.place[1] - other.place[1]) > other.radius for other in kept):
            kept.append(one)
    return kept


def best_centre(grey: np.ndarray, place: np.ndarray, radius: float) -> TargetCentre | None:
    """The centre by the part of a target that is most symmetric."""
    found = [symmetric_centre(grey, place, part * radius) for part in PARTS if part * radius > LEAST_PART]
    return min((one for one in found if one is not None), key=lambda one: one.sigma + one.unexplained, default=None)


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
