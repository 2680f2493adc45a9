"""Gross errors among the colours of a place: those far from the centre of all, where there are three or more.

Colours are vectors: the centre is the mean or the channel-wise median, sigma the root mean square distance from it, so one grey
channel gives exactly the published rule.

Source: Petsa et al. 2007 (sources/blending.md): M7.
"""

from dataclasses import dataclass
from enum import IntEnum
from typing import Literal

import numpy as np

from orthomill.kernels.kernel_compilation import njit

_MAD_TO_SIGMA = 1.4826  # of a normal distribution


class Centre(IntEnum):
    """From what colours deviate, as the kernels know it."""

    NONE = 0
    MEAN = 1
    MEDIAN = 2
    DEVIATION = 3


CentreName = Literal["none", "mean", "median", "deviation"]
CENTRES: dict[CentreName, Centre] = {
    "none": Centre.NONE,
    "mean": Centre.MEAN,
    "median": Centre.MEDIAN,
    "deviation": Centre.DEVIATION,
}


@dataclass(frozen=True)
class Rejection:
    """How deviating colours are found.

    `centre`: "mean" or "median" with sigma about the same centre (published), "deviation" for the median with 1.4826 times the
    median distance instead of sigma (robust), "none" for no rejection. Values nearer than `least` grey levels to the centre are
    never rejected.
    """

    centre: CentreName = "mean"
    k: float = 1.0
    least: float = 0.0


PUBLISHED = Rejection()
"""One standard deviation about the mean."""


@njit(inline="always")
def _median_of(values, count, scratch):
    """The median of the first `count` values (N,); scratch (N,)."""
    # Insertion sort: a pixel has a handful of values, for which it is faster than any other.
    for i in range(count):
        v = values[i]
        k = i
        while k > 0 and scratch[k - 1] > v:
            scratch[k] = scratch[k - 1]
            k -= 1
        scratch[k] = v
    return scratch[count // 2] if count % 2 else 0.5 * (scratch[count // 2 - 1] + scratch[count // 2])


@njit()
def reject(values, count, rules, work):
    """Marks in `work.keep` which of `count` values (count, bands) are no gross errors; returns their number."""
    bands = values.shape[1]
    keep, distance, line = work.keep, work.distance, work.line
    for m in range(count):
        keep[m] = True
        distance[m] = 0.0
    # Of two values that differ, neither is nearer to the centre (M7): they have a rule of their own.
    if rules.centre == Centre.NONE or count < 3:
        return count
    for band in range(bands):
        total = 0.0
        for m in range(count):
            line[m] = values[m, band]
            total += values[m, band]
        centre = total / count if rules.centre == Centre.MEAN else _median_of(line, count, work.sorted)
        for m in range(count):
            distance[m] += (values[m, band] - centre) ** 2
    total = 0.0
    for m in range(count):
        total += distance[m]
        distance[m] = np.sqrt(distance[m] / bands)
    if rules.centre == Centre.DEVIATION:
        sigma = _MAD_TO_SIGMA * _median_of(distance, count, work.sorted)
    else:
        sigma = np.sqrt(total / bands / count)
    # A value exactly on the limit is kept, whatever the rounding of the root.
    limit = max(rules.k * sigma * (1.0 + 1e-9) + 1e-9, rules.least)
    left = 0
    for m in range(count):
        keep[m] = distance[m] <= limit
        left += keep[m]
    # With k below 1 all values may lie outside: then nothing distinguishes an error from the others.
    if left == 0:
        for m in range(count):
            keep[m] = True
        left = count
    return left
