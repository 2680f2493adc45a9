"""Numbers that can be coordinates on the Earth, heights of a camera and standard errors.

Files hold anything: nan, 1e300, heights in millimetres. Such a number does not fail where it is read but in the middle of an
adjustment, where nobody knows any more which line it came from.
"""

import math

import numpy as np

FARTHEST = 1e8
"""m; twice the circumference of the Earth: coordinates of every projection, with zones in front, are smaller"""
LOWEST, HIGHEST = -12_000.0, 100_000.0
"""m; heights of a camera: the deepest place of the sea, and where space begins"""
SMALLEST, LARGEST = 1e-6, 1e6
"""a standard error: weights are squares of its reciprocal, and their ratios must remain within the digits of a number"""


FOOT = 0.3048
"""m, of an international foot"""
_ALIKE = 0.1
"""share of its departure in metres below which a surface counts as one in feet: it fits ten times as well when it is converted"""


def in_feet(heights: np.ndarray, known: np.ndarray) -> bool:
    """Whether heights (N,) fit what is known of them (N,), m, far better when they are taken for feet."""
    return float(np.median(np.abs(heights * FOOT - known))) < _ALIKE * float(np.median(np.abs(heights - known)))


def coordinate_mistake(value: float) -> str | None:
    """What is wrong with a coordinate in metres or degrees, as the end of a sentence."""
    if not math.isfinite(value) or abs(value) > FARTHEST:
        return f"is {value:g}, which is no coordinate on the Earth"
    return None


def height_mistake(value: float) -> str | None:
    """What is wrong with the height of a camera, m, as the end of a sentence."""
    if not LOWEST <= value <= HIGHEST:  # also when it is not a number
        return f"is {value:g}, but the height of a camera is between {LOWEST:g} and {HIGHEST:g} m"
    return None


def sigma_mistake(value: float) -> str | None:
    """What is wrong with a standard error, in any unit, as the end of a sentence."""
    if value <= 0:
        return f"is {value:g}, zero or less; a standard error is greater"
    if not SMALLEST <= value <= LARGEST:
        return f"is {value:g}, but a standard error is between {SMALLEST:g} and {LARGEST:g}"
    return None
