"""One colour from many: gross errors are rejected, the remaining colours averaged with weights.

Strategy, per ortho pixel: (1) values of negligible weight are reserves and not used while better ones exist; (2) of three values or
more those far from the centre of all are rejected; (3) the best N of the remaining ones are averaged with their weights.

Colours are vectors: the centre is the mean or the channel-wise median, sigma the root mean square distance from it, so one grey
channel gives exactly the published rule.

Source: Petsa et al. 2007 (methods/texture_blending.md): M7 rejection, M9 two values, M12 weights, M13 best N.
"""

from dataclasses import dataclass
from enum import IntEnum
from typing import Literal, NamedTuple

import numpy as np
from numba import njit

RESERVE = 0.01
"""Values whose weight is below this share of the greatest are not used."""
MOST = 64
"""Photographs that one ortho pixel may have."""
_MAD_TO_SIGMA = 1.4826  # of a normal distribution


class Centre(IntEnum):
    """From what colours deviate, as the kernels know it."""

    NONE = 0
    MEAN = 1
    MEDIAN = 2
    DEVIATION = 3


CentreName = Literal["none", "mean", "median", "deviation"]
_CENTRES: dict[CentreName, Centre] = {
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


@dataclass(frozen=True)
class Blend:
    """How the colours of a pixel are combined. `power` of the area: 1 or 2; `best` 0: all; `two_limit` grey levels (0: two values
    are averaged)."""

    rejection: Rejection = Rejection()
    power: int = 1
    best: int = 0
    two_limit: float = 0.0


@dataclass(frozen=True)
class Blended:
    """Blended pixels.

    `colour` (rows, cols, bands) float32; `used`, `rejected` (rows, cols) uint8 counts of values; `share` (photos,) float64, sum
    over pixels of each photo's part in the colour; `difference` (rows, cols) float32, mean absolute difference of the used values
    from the colour, NaN where fewer than two were used.
    """

    colour: np.ndarray
    used: np.ndarray
    rejected: np.ndarray
    share: np.ndarray
    difference: np.ndarray


class _Rules(NamedTuple):
    """`Blend` for the kernels."""

    centre: int
    k: float
    least: float
    power: int
    best: int
    two_limit: float


class _Images(NamedTuple):
    """The arrays of `Blended` for the kernels, which fill them."""

    colour: np.ndarray
    used: np.ndarray
    rejected: np.ndarray
    share: np.ndarray
    difference: np.ndarray


class _Work(NamedTuple):
    """Arrays of MOST elements that the kernels reuse for every pixel: `keep` says which values are used."""

    keep: np.ndarray
    distance: np.ndarray
    line: np.ndarray
    sorted: np.ndarray


@njit(cache=True, inline="always")
def _median_of(values, count, scratch):
    # Insertion sort: a pixel has a handful of values, for which it is faster than any other.
    for i in range(count):
        v = values[i]
        k = i
        while k > 0 and scratch[k - 1] > v:
            scratch[k] = scratch[k - 1]
            k -= 1
        scratch[k] = v
    return scratch[count // 2] if count % 2 else 0.5 * (scratch[count // 2 - 1] + scratch[count // 2])


@njit(cache=True)
def _reject(values, count, rules, work):
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


@njit(cache=True)
def _prefer_heavier(values, weight, two_limit, keep):
    """Drops the lighter of two values (2, bands) that differ by more than `two_limit`; returns how many are left (M9)."""
    bands = values.shape[1]
    apart = 0.0
    for band in range(bands):
        apart += abs(values[0, band] - values[1, band]) / bands
    if apart <= two_limit:
        return 2
    keep[1 if weight[0] >= weight[1] else 0] = False
    return 1


@njit(cache=True)
def _keep_best(weight, count, left, best, keep):
    """Drops the lightest of the kept values until `best` are left; returns how many are left (M13)."""
    while left > best:
        worst = -1
        for m in range(count):
            if keep[m] and (worst < 0 or weight[m] < weight[worst]):
                worst = m
        keep[worst] = False
        left -= 1
    return left


@njit(cache=True)
def _average(values, weight, count, keep, colour):
    """Fills `colour` (bands) with the weighted mean of the kept values; returns the sum of weights and of absolute differences."""
    bands = values.shape[1]
    total = 0.0
    for m in range(count):
        if keep[m]:
            total += weight[m]
    for band in range(bands):
        mean = 0.0
        for m in range(count):
            if keep[m]:
                mean += weight[m] * values[m, band]
        colour[band] = mean / total
    apart = 0.0
    for m in range(count):
        if keep[m]:
            for band in range(bands):
                apart += abs(values[m, band] - colour[band])
    return total, apart


@njit(cache=True)
def _blend(colours, weights, rules, images):
    photos, rows, cols, bands = colours.shape
    values = np.empty((MOST, bands))
    weight, photo = np.empty(MOST), np.empty(MOST, np.int64)
    work = _Work(np.empty(MOST, np.bool_), np.empty(MOST), np.empty(MOST), np.empty(MOST))
    keep = work.keep
    for i in range(rows):
        for j in range(cols):
            greatest = 0.0
            for p in range(photos):
                greatest = max(greatest, weights[p, i, j])
            if greatest <= 0.0:
                continue
            count = 0
            for p in range(photos):
                if weights[p, i, j] > RESERVE * greatest and count < MOST:
                    photo[count] = p
                    # The power of the area is applied after the choice of reserves: it would square the limit as well.
                    weight[count] = weights[p, i, j] ** rules.power
                    for band in range(bands):
                        values[count, band] = colours[p, i, j, band]
                    count += 1
            left = _reject(values, count, rules, work)
            if count == 2 and rules.two_limit > 0.0:
                left = _prefer_heavier(values, weight, rules.two_limit, keep)
            # Counted before the best are chosen: those left out there are no errors.
            images.rejected[i, j] = count - left
            if rules.best > 0:
                left = _keep_best(weight, count, left, rules.best, keep)
            images.used[i, j] = left
            total, apart = _average(values, weight, count, keep, images.colour[i, j])
            for m in range(count):
                if keep[m]:
                    images.share[photo[m]] += weight[m] / total
            if left > 1:
                images.difference[i, j] = apart / (left * bands)


def blend(colours: np.ndarray, weights: np.ndarray, how: Blend) -> Blended:
    """Blends `colours` (photos, rows, cols, bands) with `weights` (photos, rows, cols), 0 where a photo does not see the pixel.

    Pixels without any weight are 0 with `used` 0. Source: g = sum(e^p g) / sum(e^p), M12.
    """
    photos, rows, cols, bands = colours.shape
    result = Blended(
        colour=np.zeros((rows, cols, bands), np.float32),
        used=np.zeros((rows, cols), np.uint8),
        rejected=np.zeros((rows, cols), np.uint8),
        share=np.zeros(photos),
        difference=np.full((rows, cols), np.nan, np.float32),
    )
    rejection = how.rejection
    # Plain numbers, always of the same types: the kernel is compiled once and found in the cache.
    rules = _Rules(
        int(_CENTRES[rejection.centre]), float(rejection.k), float(rejection.least), how.power, how.best, float(how.two_limit)
    )
    images = _Images(result.colour, result.used, result.rejected, result.share, result.difference)
    _blend(np.ascontiguousarray(colours, np.float32), np.ascontiguousarray(weights, np.float32), rules, images)
    return result
