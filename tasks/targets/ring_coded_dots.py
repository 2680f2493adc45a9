"""Dots with a code on a ring about them: circular targets as photogrammetric programs print them.

The edge of the dot is an ellipse, which tells how the target leans. About it, in units of its radius, lie a plain ring (to 2), the
code (2 to 3) and a plain border. Stones and rivets are dots as well: what counts is that everything plain is plain, that every
segment is one of two colours, and that the steps between them lie on the grid of one family and of no other.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from orthomill.schemas.marks import FoundTarget
from orthomill.tasks.targets.leaning_circle import WIDE, centre_sigma
from orthomill.tasks.targets.ring_code_words import FAMILIES, least_rotation, word_numbers
from orthomill.tasks.targets.target_centre import LEAST_SIGMA

BLOCK, DARKER = 51, 5.0
"""px and grey values: dots are looked for where they differ from the mean of so large a neighbourhood"""
LEAST_RADIUS, MOST_RADIUS = 3.0, 60.0
"""px of a dot, along its shorter and its longer axis"""
LEAST_RATIO = 0.45
"""of the axes: a target that leans by 63 degrees"""
LEAST_CONTRAST = 20.0
"""grey values between dot and surroundings, of 255"""
RAYS = 64
SAMPLES = 336
"""about the ring: a multiple of the segments of every family"""
GAP, CODE, BORDER = (1.45, 1.6), (2.35, 2.5, 2.65), (3.4, 3.55)
"""Where plain ring, code and border are read, in radii of the dot."""
PLAIN, ONE_COLOUR = 0.3, 0.3
"""How much of the contrast may be on plain rings, and how far a segment may be from its colour."""
INSIDE = 0.25
"""of a segment at either side that is not judged: the lens smooths its edge"""
OFF_GRID = 0.12
"""rms of the inside of segments about their colours, of the contrast"""
RIVAL, NOISE = 1.5, 0.02
"""The grid of any other family fits worse by this factor; what is below the noise counts as this."""
CORRELATED = 2.0
"""Neighbouring rays share their errors: standard errors of independent ones, times this."""


@dataclass(frozen=True, eq=False)
class _Dot:
    """`place` (2,) px, `axes` (2, 2) px: its columns are the images of radii along x and y, up to a turn; `sigma` px."""

    place: np.ndarray
    axes: np.ndarray
    sigma: float


def ring_coded_dots(grey: np.ndarray, c: float = WIDE) -> list[FoundTarget]:
    """The ring codes of a grey image (rows, cols) uint8, each as often as it shows; c: the camera constant, px."""
    found: list[FoundTarget] = []
    for rough in _candidates(grey):
        dot = _measured(grey, rough)
        code = _read(grey, dot) if dot is not None else None
        if dot is None or code is None or any(np.hypot(*(dot.place - other.place)) < other.radius for other in found):
            continue
        long, short = map(float, np.linalg.svd(dot.axes, compute_uv=False))
        sigma = float(np.hypot(dot.sigma, centre_sigma(long, short, c)))
        found.append(FoundTarget("coded", (float(dot.place[0]), float(dot.place[1])), sigma, 3.0 * short, 1.0, code))
    return found


def _candidates(grey: np.ndarray) -> list[_Dot]:
    """Outlines that are nearly ellipses, of dark dots and of bright ones."""
    if min(grey.shape) < BLOCK:
        return []
    dark = cv2.adaptiveThreshold(grey, 1, cv2.ADAPTIVE_THRESH_MEAN_C, cv2.THRESH_BINARY_INV, BLOCK, DARKER)
    outlines, _ = cv2.findContours(dark, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
    most = 2.0 * np.pi * MOST_RADIUS
    return [dot for outline in outlines if 12 <= len(outline) <= most and (dot := _ellipse(outline)) is not None]


def _ellipse(points: np.ndarray) -> _Dot | None:
    """The ellipse through points (n, 1, 2), if it is one that a dot may have."""
    area, length = cv2.contourArea(points), cv2.arcLength(points, True)
    if area < np.pi * LEAST_RADIUS**2 or 4.0 * np.pi * area < 0.55 * length**2:
        return None
    (col, row), (first, second), turn = cv2.fitEllipse(points)
    low, high = sorted((first, second))
    if not 2 * LEAST_RADIUS * 0.8 <= low <= high <= 2 * MOST_RADIUS or low < LEAST_RATIO * high:
        return None
    if abs(np.pi / 4 * low * high - area) > 0.25 * area + length:
        return None
    angle = np.radians(turn)
    along, across = np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])
    # The symmetric root: a leaning circle is turned by it no more than it has to be.
    axes = first / 2 * np.outer(along, along) + second / 2 * np.outer(across, across)
    return _Dot(np.array([col, row]), axes, 0.0)


def _values(grey: np.ndarray, dot: _Dot, reach: tuple[float, ...] | np.ndarray, count: int) -> np.ndarray:
    """(count, reaches) grey values clockwise about a dot, in its radii; NaN outside of the image."""
    angle = np.arange(count) * (2.0 * np.pi / count)
    round_ = np.stack([np.cos(angle), np.sin(angle)])
    x, y = dot.place[:, None, None] + np.einsum("ij,jn,r->inr", dot.axes, round_, np.asarray(reach))
    rows, cols = grey.shape
    shown = cv2.remap(grey, x.astype(np.float32), y.astype(np.float32), cv2.INTER_LINEAR).astype(np.float64)
    return np.where((x < 0) | (y < 0) | (x > cols - 1) | (y > rows - 1), np.nan, shown)


def _measured(grey: np.ndarray, rough: _Dot) -> _Dot | None:
    """A dot by where rays from its middle cross its edge."""
    dot: _Dot | None = rough
    for _ in range(2):
        dot = _by_rays(grey, dot) if dot is not None else None
    return dot


def _by_rays(grey: np.ndarray, dot: _Dot) -> _Dot | None:
    reach = np.linspace(0.0, 1.8, 37)
    values = _values(grey, dot, reach, RAYS)
    inside, outside = np.median(values[:, reach < 0.5]), np.median(values[:, (reach > 1.4) & (reach < 1.65)])
    if not abs(inside - outside) > LEAST_CONTRAST:
        return None
    share = (values - outside) / (inside - outside)
    beyond = share < 0.5
    first = beyond.argmax(axis=1)
    if not beyond.any(axis=1).all() or (first < 4).any():
        return None
    row = np.arange(RAYS)
    before, after = share[row, first - 1], share[row, first]
    edge = reach[first - 1] + (reach[1] - reach[0]) * (before - 0.5) / np.maximum(before - after, 1e-6)
    angle = row * (2.0 * np.pi / RAYS)
    points = dot.place + edge[:, None] * (np.stack([np.cos(angle), np.sin(angle)], axis=1) @ dot.axes.T)
    fitted = _ellipse(points.astype(np.float32)[:, None])
    if fitted is None:
        return None
    away = np.linalg.norm(np.linalg.solve(fitted.axes, (points - fitted.place).T), axis=0) - 1.0
    size = float(np.sqrt(np.linalg.det(fitted.axes)))
    rms = float(np.sqrt((away**2).mean()))
    if rms > 0.03 + 0.2 / size:
        return None
    sigma = max(float(CORRELATED * rms * size * np.sqrt(2.0 / RAYS)), LEAST_SIGMA)
    return _Dot(fitted.place, fitted.axes, sigma)


def _read(grey: np.ndarray, dot: _Dot) -> str | None:
    """The name of the code about a dot; None where there is none."""
    middle, gap, code, border = (_values(grey, dot, reach, SAMPLES) for reach in ((0.0, 0.3, 0.5), GAP, CODE, BORDER))
    plain, own = np.median(gap), np.median(middle)
    if not abs(own - plain) > LEAST_CONTRAST:
        return None
    gap, border, ring = ((one - plain) / (own - plain) for one in (gap, border, code))
    # A border in shadow or in another light is plain all the same, if it is not the colour of the dot.
    if not (np.abs(gap).max() < PLAIN and np.abs(border).max() < 1.5 * PLAIN and np.isfinite(ring).all()):
        return None
    fits = sorted((_fit(ring.mean(axis=1), segments) for segments in FAMILIES), key=lambda fit: fit[0])
    (off, bits), (rival, _) = fits[0], fits[1]
    if off > OFF_GRID or rival < RIVAL * max(off, NOISE):
        return None
    number = word_numbers(len(bits)).get(least_rotation(bits))
    return None if number is None else f"ring{len(bits)}-{number}"


def _fit(ring: np.ndarray, segments: int) -> tuple[float, np.ndarray]:
    """How far a ring (SAMPLES,) of 0 to 1 is from segments of two colours at the best turn (rms; 1 where a segment is of neither),
    and these colours (segments,)."""
    width = SAMPLES // segments
    turned = np.stack([np.roll(ring, -turn) for turn in range(width)]).reshape(width, segments, width)
    cut = int(np.ceil(INSIDE * width))
    inside = turned[:, :, cut : width - cut]
    colour = inside.mean(axis=2) > 0.5
    off = np.sqrt(((inside - colour[..., None]) ** 2).mean(axis=(1, 2)))
    best = int(off.argmin())
    unclear = np.abs(inside[best].mean(axis=1) - colour[best]).max() > ONE_COLOUR
    return (1.0 if unclear else float(off[best])), colour[best].astype(np.int64)
