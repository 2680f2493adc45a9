"""Codes on a ring: segments of equal width in the colour of the dot (1) or of its surroundings (0), read from anywhere.

The words of the expired patent DE 197 33 466 A1 (Schneider 1998), which makers of circular targets use: of all beginnings the least
number counts; an even number of segments is set, and two of these lie opposite each other. A word's number is its rank by value,
from 1.
"""

from functools import cache

import numpy as np

FAMILIES = (12, 14)
"""segments of a ring"""


def least_rotation(bits: np.ndarray) -> int:
    """The least number that segments (n,) of 0 and 1 give, clockwise from any of them."""
    powers = 1 << np.arange(len(bits) - 1, -1, -1)
    return min(int(np.roll(bits, -k) @ powers) for k in range(len(bits)))


@cache
def word_numbers(segments: int) -> dict[int, int]:
    """The numbers of the words of a family, by word."""
    half, full = segments // 2, (1 << segments) - 1
    words = []
    for word in range(1, full):  # a full ring has no beginning
        turned = [((word << k) | (word >> (segments - k))) & full for k in range(1, segments)]
        opposite = word & (word >> half) & ((1 << half) - 1)
        if word <= min(turned) and opposite and word.bit_count() % 2 == 0:
            words.append(word)
    return {word: rank for rank, word in enumerate(words, 1)}
