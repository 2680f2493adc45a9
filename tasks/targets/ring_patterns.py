"""Uncoded targets by what rings about their centre show: plates of four fields, crosses, and circles.

Where curvatures are strong, grey values on rings are compared with what a target of each kind shows there in any direction and lean
(ring_templates.py). Corners of tiles, shadows and stones look like one in part; on all rings and all around, few do.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from orthomill.schemas.marks import TargetKind
from orthomill.tasks.targets.ring_templates import RINGS, SAMPLES, SOFT, likeness

KINDS: tuple[TargetKind, ...] = ("chequered", "cross", "circle")
"""by the numbers of `RingTargets.kind`"""
RADII = (3.0, 4.5, 6.5, 9.5, 14.0)
"""px: reach of the targets that are looked for; each is found from a third to half of its width"""
MOST_CANDIDATES = 3000
"""in a photograph and reach; the strongest"""
CORNER_WIDTH, DISC_WIDTH = 0.3, 0.5
"""of the reach: widths of the Gaussians under which curvature is greatest in the middle of corners and arms, and in that of discs
(at their radius / sqrt(2), Lindeberg 1998)"""
LEAST_CONTRAST = 12.0
"""grey values between the bright and the dark of a target, of 255"""
LIKE_AT_FIRST = 0.8
"""Likeness of a candidate before its centre is known to better than a pixel, in the reach that fits best."""


@dataclass(frozen=True, eq=False)
class RingTargets:
    """Candidates (n,): `place` (n, 2) (col, row) px to about a pixel, `radius` (n,) px, `contrast` (n,) grey values, `score` (n,) 0
    to 1, `kind` (n,) as in KINDS."""

    place: np.ndarray
    radius: np.ndarray
    contrast: np.ndarray
    score: np.ndarray
    kind: np.ndarray

    def __len__(self) -> int:
        return len(self.place)

    def take(self, index: np.ndarray) -> "RingTargets":
        """The candidates at `index`, numbers or a mask."""
        return RingTargets(self.place[index], self.radius[index], self.contrast[index], self.score[index], self.kind[index])


def ring_targets(grey: np.ndarray, radii: tuple[float, ...] = RADII) -> RingTargets:
    """Candidates of a grey image (rows, cols) float32 of 0 to 255; one target is several, of several reaches."""
    found = [_of_radius(grey, radius) for radius in radii if min(grey.shape) > 6 * radius]
    if not found:
        return RingTargets(np.zeros((0, 2)), np.zeros(0), np.zeros(0), np.zeros(0), np.zeros(0, int))
    return joined(found)


def joined(found: list[RingTargets]) -> RingTargets:
    """Candidates of several searches as one."""
    return RingTargets(
        *(np.concatenate([getattr(one, name) for one in found]) for name in ("place", "radius", "contrast", "score", "kind"))
    )


def _of_radius(grey: np.ndarray, radius: float) -> RingTargets:
    # Saddles: the product of the principal curvatures is negative. Crossing arms and discs have curvatures of one sign.
    corner, blob = (_gaussian_curvature(grey, share * radius) for share in (CORNER_WIDTH, DISC_WIDTH))
    shown = as_lens(grey, radius)
    found = (_peaks(np.maximum(response, 0.0), radius) for response in (-corner, corner, blob))
    return joined([_alike(shown, peaks, radius, kind) for kind, peaks in enumerate(found)])


def _gaussian_curvature(grey: np.ndarray, width: float) -> np.ndarray:
    """(rows, cols) the determinant of the second derivatives of an image smoothed by a Gaussian of this width, px."""
    smooth = cv2.GaussianBlur(grey, (0, 0), max(width, 0.7))
    xx, yy = cv2.Sobel(smooth, cv2.CV_32F, 2, 0), cv2.Sobel(smooth, cv2.CV_32F, 0, 2)
    xy = cv2.Sobel(smooth, cv2.CV_32F, 1, 1)
    return xx * yy - xy * xy


def as_lens(grey: np.ndarray, radius: float) -> np.ndarray:
    """A grey image smoothed as the templates of this reach are."""
    return cv2.GaussianBlur(grey, (0, 0), max(SOFT * radius, 0.7))


def _peaks(response: np.ndarray, radius: float) -> np.ndarray:
    """(n, 2) (col, row) of the strongest local maxima, away from the border."""
    side = 2 * int(max(round(0.7 * radius), 1)) + 1
    peak = (response >= cv2.dilate(response, np.ones((side, side), np.uint8))) & (response > 1.0)
    edge = int(np.ceil(radius)) + 3
    peak[:edge], peak[-edge:], peak[:, :edge], peak[:, -edge:] = False, False, False, False
    rows, cols = np.nonzero(peak)
    strongest = np.argsort(-response[rows, cols], kind="stable")[:MOST_CANDIDATES]
    return np.column_stack([cols, rows])[strongest]


def _alike(shown: np.ndarray, place: np.ndarray, radius: float, kind: int) -> RingTargets:
    """The candidates at `place` (n, 2) that look like the kind."""
    values = ring_values(shown, place, radius, RINGS[KINDS[kind]])
    light = contrasts(values)
    seen = np.flatnonzero(light > LEAST_CONTRAST)
    score = likeness(values[seen], KINDS[kind])
    good = score > LIKE_AT_FIRST
    kept = seen[good]
    count = len(kept)
    return RingTargets(place[kept], np.full(count, radius), light[kept], score[good], np.full(count, kind))


def ring_values(shown: np.ndarray, place: np.ndarray, radius: float, rings: tuple[float, ...]) -> np.ndarray:
    """(n, len(rings), SAMPLES) grey values on rings about places (n, 2), in units of the radius px."""
    angle = np.arange(SAMPLES) * (2.0 * np.pi / SAMPLES)
    reach = radius * np.array(rings)[:, None]
    col = np.asarray(place)[:, 0, None, None] + reach * np.cos(angle)
    row = np.asarray(place)[:, 1, None, None] + reach * np.sin(angle)
    if not len(place):
        return np.zeros(col.shape, np.float32)
    x, y = (plane.reshape(len(place), -1).astype(np.float32) for plane in (col, row))
    return cv2.remap(shown, x, y, cv2.INTER_LINEAR).reshape(col.shape)


def contrasts(values: np.ndarray) -> np.ndarray:
    """(n,) grey values between the bright and the dark of rings (n, rings, SAMPLES)."""
    if not len(values):
        return np.zeros(0)
    high, low = np.percentile(values.reshape(len(values), -1), (85, 15), axis=1)
    return high - low
