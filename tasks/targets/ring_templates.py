"""What targets look like on rings about their centre, in all directions and widths: the banks that candidates are compared with.

A plate that leans shows its fields sheared: edges and arms that do not meet at right angles, and ellipses. A bank holds these
patterns, smoothed as by a lens, at zero mean and unit length, so that a product with the values of a candidate is a correlation.
"""

from functools import cache

import numpy as np

from orthomill.schemas.marks import TargetKind

SAMPLES = 48
RINGS: dict[TargetKind, tuple[float, ...]] = {
    "chequered": (0.4, 0.6, 0.8, 1.0),
    "cross": (0.4, 0.6, 0.8, 1.0),
    "circle": (0.3, 0.5, 0.7, 0.9, 1.1, 1.3),
}
"""where values are taken, in units of the reach of a target"""
DIRECTIONS = np.arange(24) * np.pi / 24
LEAN = np.radians(np.arange(50.0, 131.0, 10.0))
"""angles between the edges or arms of plates that lean up to about 50 degrees"""
ARMS = (0.1, 0.16, 0.24, 0.36)
"""half of the width of arms, in units of the reach"""
DISCS = (0.55, 0.65, 0.78, 0.92)
"""the longer semi-axis of discs, in units of the reach"""
RATIOS = (1.0, 0.88, 0.76, 0.65)
SOFT = 0.12
"""width of an edge that a lens has smoothed, in units of the reach"""


@cache
def bank(kind: TargetKind) -> np.ndarray:
    """(templates, rings * SAMPLES) float32 of a kind, each of zero mean and unit length."""
    angle = np.arange(SAMPLES) * (2.0 * np.pi / SAMPLES)
    reach = np.array(RINGS[kind])[:, None]
    x, y = (reach * np.cos(angle)).ravel(), (reach * np.sin(angle)).ravel()
    patterns = {"chequered": _fields, "cross": _arms, "circle": _discs}[kind](x, y)
    centred = patterns - patterns.mean(axis=1, keepdims=True)
    return (centred / np.linalg.norm(centred, axis=1, keepdims=True)).astype(np.float32)


def _fields(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return np.array([_side(x, y, a) * _side(x, y, a + between) for a in DIRECTIONS for between in LEAN])


def _arms(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return np.array(
        [np.maximum(_arm(x, y, a, width), _arm(x, y, a + between, width)) for a in DIRECTIONS for between in LEAN for width in ARMS]
    )


def _discs(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return np.array(
        [
            _step(long - np.hypot(x * np.cos(a) + y * np.sin(a), (y * np.cos(a) - x * np.sin(a)) / ratio))
            for long in DISCS
            for ratio in RATIOS
            for a in (DIRECTIONS[::2] if ratio < 1 else DIRECTIONS[:1])
        ]
    )


def _side(x: np.ndarray, y: np.ndarray, angle: float) -> np.ndarray:
    """-1 to 1: on which side of a line through the centre."""
    return 2.0 * _step(y * np.cos(angle) - x * np.sin(angle)) - 1.0


def _arm(x: np.ndarray, y: np.ndarray, angle: float, width: float) -> np.ndarray:
    return _step(width - np.abs(y * np.cos(angle) - x * np.sin(angle)))


def _step(away: np.ndarray) -> np.ndarray:
    """0 to 1 over an edge."""
    return 1.0 / (1.0 + np.exp(-away * (3.4 / SOFT)))


def likeness(values: np.ndarray, kind: TargetKind) -> np.ndarray:
    """(n,) -1 to 1: the correlation of values (n, rings, SAMPLES) of grey with the template that is most alike, bright on dark or
    the reverse."""
    return np.abs(_correlations(values, kind)).max(axis=1) if len(values) else np.zeros(0, np.float32)


def edge_directions(values: np.ndarray) -> np.ndarray:
    """(2,) radians: the directions of the edges of a chequered plate by its values (rings, SAMPLES), to a step of the templates."""
    first, between = divmod(int(np.abs(_correlations(values[None], "chequered")).argmax()), len(LEAN))
    return DIRECTIONS[first] + np.array([0.0, LEAN[between]])


def _correlations(values: np.ndarray, kind: TargetKind) -> np.ndarray:
    flat = values.reshape(len(values), -1)
    centred = flat - flat.mean(axis=1, keepdims=True)
    normed = centred / np.maximum(np.linalg.norm(centred, axis=1, keepdims=True), 1e-6)
    return normed.astype(np.float32) @ bank(kind).T
