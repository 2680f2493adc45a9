"""Uncoded targets by what rings about their centre show: plates of four fields, crosses, and circles.

On a ring about the centre of a chequered plate grey values go up and down twice, about that of a cross four times; on all rings
within the target alike, and the same on opposite sides. Corners of tiles and shadows rarely do all of that. The disc of
a circle is even on its rings, and so is the ground about it.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from orthomill.schemas.marks import TargetKind

KINDS: tuple[TargetKind, ...] = ("chequered", "cross", "circle")
"""by the numbers of `RingTargets.kind`"""
CHEQUERED, CROSS, CIRCLE = 0, 1, 2
SAMPLES = 48
RADII = (3.0, 4.5, 6.5, 9.5, 14.0)
"""px: reach of the targets that are looked for; each is found from a third to half of its width"""
RINGS = (0.55, 0.75, 1.0)
"""where rings are sampled, in units of the reach"""
MOST_CANDIDATES = 3000
"""in a photograph and reach; the strongest"""
LEAST_CONTRAST = 12.0
"""grey values between the fields, from darkest to brightest of 255"""
EVEN = 0.75
"""Lowest evenness of a disc and the ground about it."""
SYMMETRIC, ALIKE, PURE = 0.85, 0.7, 0.5
"""Shares: of the variance of rings that is the same on opposite sides; correlation of rings; variance in the one frequency."""


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
        return RingTargets(self.place[index], self.radius[index], self.contrast[index], self.score[index], self.kind[index])


def ring_targets(grey: np.ndarray, radii: tuple[float, ...] = RADII) -> RingTargets:
    """Candidates of a grey image (rows, cols) float32 of 0 to 255, the best of each kind at one place."""
    found = [_of_radius(grey, radius) for radius in radii if min(grey.shape) > 6 * radius]
    if not found:
        return RingTargets(np.zeros((0, 2)), np.zeros(0), np.zeros(0), np.zeros(0), np.zeros(0, int))
    parts = [np.concatenate([getattr(one, name) for one in found]) for name in ("place", "radius", "contrast", "score", "kind")]
    return _best_of_places(RingTargets(*parts))


def _of_radius(grey: np.ndarray, radius: float) -> RingTargets:
    smooth = cv2.GaussianBlur(grey, (0, 0), max(0.3 * radius, 0.7))
    xx, yy = cv2.Sobel(smooth, cv2.CV_32F, 2, 0), cv2.Sobel(smooth, cv2.CV_32F, 0, 2)
    xy = cv2.Sobel(smooth, cv2.CV_32F, 1, 1)
    # Saddles: the product of the principal curvatures is negative. Lines and discs have curvatures of one sign.
    saddle = xy * xy - xx * yy
    peaks = [_peaks(np.maximum(saddle, 0.0), radius), _peaks(np.maximum(-saddle, 0.0), radius)]
    place = np.concatenate([peaks[0], peaks[1], peaks[1]]).astype(np.float32)
    kind = np.repeat([CHEQUERED, CROSS, CIRCLE], [len(peaks[0]), len(peaks[1]), len(peaks[1])])
    return _tested(smooth if radius > 6 else cv2.GaussianBlur(grey, (0, 0), 0.7), place, np.full(len(place), radius), kind)


def _peaks(response: np.ndarray, radius: float) -> np.ndarray:
    """(n, 2) (col, row) of the strongest local maxima, away from the border."""
    side = 2 * int(max(round(0.7 * radius), 1)) + 1
    peak = (response >= cv2.dilate(response, np.ones((side, side), np.uint8))) & (response > 1.0)
    edge = int(np.ceil(radius)) + 3
    peak[:edge], peak[-edge:], peak[:, :edge], peak[:, -edge:] = False, False, False, False
    rows, cols = np.nonzero(peak)
    strongest = np.argsort(-response[rows, cols], kind="stable")[:MOST_CANDIDATES]
    return np.column_stack([cols, rows])[strongest]


def _tested(grey: np.ndarray, place: np.ndarray, radius: np.ndarray, kind: np.ndarray) -> RingTargets:
    """The candidates whose rings are those of a target."""
    if not len(place):
        return RingTargets(place, radius, radius, radius, kind)
    values = _rings(grey, place, radius, RINGS)
    rings = values - values.mean(axis=2, keepdims=True)
    energy = np.abs(np.fft.rfft(rings, axis=2)) ** 2
    total = np.maximum(energy[:, :, 1:].sum(axis=2), 1e-6)
    even = energy[:, :, 2::2].sum(axis=2) / total
    # The third harmonic of a square wave belongs to it, and the second one of narrow lines.
    pure = np.where((kind == CROSS)[:, None], energy[:, :, 4] + energy[:, :, 8], energy[:, :, 2] + energy[:, :, 6]) / total
    normed = rings / np.maximum(np.linalg.norm(rings, axis=2, keepdims=True), 1e-6)
    alike = np.minimum((normed[:, 0] * normed[:, 1]).sum(axis=1), (normed[:, 1] * normed[:, 2]).sum(axis=1))
    contrast = np.percentile(rings, 90, axis=2).min(axis=1) - np.percentile(rings, 10, axis=2).max(axis=1)
    score = np.minimum.reduce([even.min(axis=1), alike, pure.min(axis=1)])
    good = (even.min(axis=1) > SYMMETRIC) & (alike > ALIKE) & (pure.min(axis=1) > PURE) & (contrast > LEAST_CONTRAST)
    disc, disc_contrast = _discs(grey, place, radius)
    circle = kind == CIRCLE
    good = np.where(circle, (disc > EVEN) & (disc_contrast > 2.0 * LEAST_CONTRAST), good)
    found = RingTargets(place, radius, np.where(circle, disc_contrast, contrast), np.where(circle, disc, score), kind)
    return found.take(np.flatnonzero(good))


def _rings(grey: np.ndarray, place: np.ndarray, radius: np.ndarray, rings: tuple[float, ...]) -> np.ndarray:
    """(n, len(rings), SAMPLES) grey values on rings about places (n, 2), in units of the radius (n,) px."""
    angle = np.arange(SAMPLES) * (2.0 * np.pi / SAMPLES)
    reach = radius[:, None, None] * np.array(rings)[None, :, None]
    col, row = place[:, :1, None] + reach * np.cos(angle), place[:, 1:, None] + reach * np.sin(angle)
    x, y = (plane.reshape(len(place), -1).astype(np.float32) for plane in (col, row))
    return cv2.remap(grey, x, y, cv2.INTER_LINEAR).reshape(col.shape)


def _discs(grey: np.ndarray, place: np.ndarray, radius: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """How even discs of half the radius and the ground at one and a half are (n,), 0 to 1, and their difference (n,) grey
    values."""
    inner, outer = np.moveaxis(_rings(grey, place, radius, (0.45, 1.4)), 1, 0)
    difference = np.abs(inner.mean(axis=1) - outer.mean(axis=1))
    uneven = np.maximum(inner.std(axis=1), outer.std(axis=1))
    return np.clip(1.0 - uneven / np.maximum(difference, 1e-6), 0.0, 1.0), difference


def _best_of_places(found: RingTargets) -> RingTargets:
    """Without candidates that lie within another one that is better (larger, at similar scores)."""
    worth = found.score * np.sqrt(found.radius)
    kept: list[int] = []
    for i in np.argsort(-worth, kind="stable"):
        near = [
            j
            for j in kept
            if found.kind[i] == found.kind[j]
            and np.linalg.norm(found.place[i] - found.place[j]) < max(found.radius[i], found.radius[j])
        ]
        if not near:
            kept.append(int(i))
    return found.take(np.array(sorted(kept), int))
