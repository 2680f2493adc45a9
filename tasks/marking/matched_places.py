"""Where other photographs show a place of one, by the features that both share around it: before anything is oriented.

Ground and walls are smooth enough for an affine transformation of a few dozen pixels; how well the features follow it says how far
it can be trusted.
"""

from dataclasses import dataclass

import numpy as np

from orthomill.schemas.observations import TiePoints

NEAREST = 14
"""Shared features about the place that determine the transformation."""
LEAST = 6
ROUNDS = 4
LEAST_SIGMA = 0.7
"""px: no transferred place is better; the ground between features is not known"""
FARTHEST = 400.0
"""px: standard error beyond which a place is of no use"""


@dataclass(frozen=True, eq=False)
class SharedFeatures:
    """Features by photograph: `tracks` and `places` (m, 2) px of each, sorted by track."""

    tracks: dict[int, np.ndarray]
    places: dict[int, np.ndarray]


def shared_features(tie_points: TiePoints) -> SharedFeatures:
    """Tie points, arranged by photograph."""
    order = np.lexsort((tie_points.track, tie_points.photo))
    photos, first = np.unique(tie_points.photo[order], return_index=True)
    pixels = np.column_stack([tie_points.col, tie_points.row])[order]
    tracks = tie_points.track[order]
    ends = [*first[1:], len(order)]
    parts = {int(p): slice(a, b) for p, a, b in zip(photos, first, ends, strict=True)}
    return SharedFeatures({p: tracks[part] for p, part in parts.items()}, {p: pixels[part] for p, part in parts.items()})


def transferred(features: SharedFeatures, photo: int, place: np.ndarray, other: int) -> tuple[np.ndarray, np.ndarray] | None:
    """The place (2,) px in the photograph `other` of a `place` (2,) px in `photo`, and its covariance (2, 2) px^2; None where they
    share too little around it."""
    if photo not in features.tracks or other not in features.tracks:
        return None
    _, here, there = np.intersect1d(features.tracks[photo], features.tracks[other], assume_unique=False, return_indices=True)
    if len(here) < LEAST:
        return None
    source, target = features.places[photo][here], features.places[other][there]
    nearest = np.argsort(np.linalg.norm(source - place, axis=1))[:NEAREST]
    away, target = source[nearest] - place, target[nearest]
    A = np.column_stack([np.ones(len(away)), away])
    weight = np.ones(len(away))
    for _ in range(ROUNDS):
        root = np.sqrt(weight)[:, None]
        values = np.linalg.lstsq(root * A, root * target, rcond=None)[0]
        size = np.linalg.norm(target - A @ values, axis=1)
        # Redescending, for one wrong match among them must not bend the rest.
        usual = max(1.5 * float(np.median(size)), 0.3)
        weight = 1.0 / (1.0 + (size / usual) ** 2) ** 2
    normal = A.T @ (weight[:, None] * A)
    if np.linalg.cond(normal) > 1e12:
        return None
    variance = max(float((weight * size**2).sum() / max(weight.sum() - 3.0, 1.0)) / 2.0, LEAST_SIGMA**2)
    spread = variance * (1.0 + np.linalg.inv(normal)[0, 0])
    return (values[0], spread * np.eye(2)) if spread < FARTHEST**2 else None
