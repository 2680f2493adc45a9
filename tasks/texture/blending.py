"""One colour from many: gross errors out, then the weighted mean.

Strategy, per ortho pixel: (1) values of next to no weight are reserves and take no part while better ones exist; (2) of three
values or more those far from the centre of all are rejected; (3) the best N of the rest are averaged with their weights.

Colours are vectors: the centre is the mean or the channel-wise median, sigma the root mean square distance from it, so one grey
channel gives exactly the published rule.

Source: Petsa et al. 2007 (methods/texture_blending.md): M7 rejection, M9 two values, M12 weights, M13 best N.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numba import njit

RESERVE = 0.01
"""Values whose weight is below this share of the greatest take no part."""
MOST = 64
"""Photographs that one ortho pixel may have."""

_CENTRES = {"none": 0, "mean": 1, "median": 2, "deviation": 3}


@dataclass(frozen=True)
class Rejection:
    """How deviating colours are found.

    `centre`: "mean" or "median" with sigma about the same centre (published), "deviation" for the median with 1.4826 times the
    median distance in place of sigma (robust), "none" for no rejection. Values nearer than `least` grey levels to the centre always
    stay.
    """

    centre: Literal["none", "mean", "median", "deviation"] = "mean"
    k: float = 1.0
    least: float = 0.0


@dataclass(frozen=True)
class Blend:
    """How the colours of a pixel become one. `power` of the area: 1 or 2; `best` 0: all; `two_limit` grey levels (0: two values are
    averaged)."""

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


@njit(cache=True, inline="always")
def _median_of(values, count, scratch):
    for i in range(count):
        v = values[i]
        k = i
        while k > 0 and scratch[k - 1] > v:
            scratch[k] = scratch[k - 1]
            k -= 1
        scratch[k] = v
    return scratch[count // 2] if count % 2 else 0.5 * (scratch[count // 2 - 1] + scratch[count // 2])


@njit(cache=True)
def _keep(values, count, centre_kind, k, least, distance, line, scratch, keep):
    """Marks in `keep` which of `count` values (count, bands) are not gross errors; returns how many stay."""
    bands = values.shape[1]
    for m in range(count):
        keep[m] = True
        distance[m] = 0.0
    if centre_kind == 0 or count < 3:
        return count
    for band in range(bands):
        total = 0.0
        for m in range(count):
            line[m] = values[m, band]
            total += values[m, band]
        centre = total / count if centre_kind == 1 else _median_of(line, count, scratch)
        for m in range(count):
            distance[m] += (values[m, band] - centre) ** 2
    total = 0.0
    for m in range(count):
        total += distance[m]
        distance[m] = np.sqrt(distance[m] / bands)
    sigma = 1.4826 * _median_of(distance, count, scratch) if centre_kind == 3 else np.sqrt(total / bands / count)
    # a value exactly on the limit stays, whatever the rounding of the root
    limit = max(k * sigma * (1.0 + 1e-9) + 1e-9, least)
    left = 0
    for m in range(count):
        keep[m] = distance[m] <= limit
        left += keep[m]
    if left == 0:
        for m in range(count):
            keep[m] = True
        left = count
    return left


@njit(cache=True)
def _blend(colours, weights, centre_kind, k, least, power, best, two_limit, colour, used, rejected, share, difference):
    photos, rows, cols, bands = colours.shape
    values = np.empty((MOST, bands))
    weight, distance, line, scratch = np.empty(MOST), np.empty(MOST), np.empty(MOST), np.empty(MOST)
    keep, who = np.empty(MOST, np.bool_), np.empty(MOST, np.int64)
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
                    who[count] = p
                    weight[count] = weights[p, i, j] ** power
                    for band in range(bands):
                        values[count, band] = colours[p, i, j, band]
                    count += 1
            left = _keep(values, count, centre_kind, k, least, distance, line, scratch, keep)
            rejected[i, j] = count - left
            if count == 2 and two_limit > 0.0:
                apart = 0.0
                for band in range(bands):
                    apart += abs(values[0, band] - values[1, band]) / bands
                if apart > two_limit:
                    keep[1 if weight[0] >= weight[1] else 0] = False
                    left = 1
                    rejected[i, j] = 1
            while best > 0 and left > best:
                worst = -1
                for m in range(count):
                    if keep[m] and (worst < 0 or weight[m] < weight[worst]):
                        worst = m
                keep[worst] = False
                left -= 1
            total = 0.0
            for m in range(count):
                if keep[m]:
                    total += weight[m]
            for band in range(bands):
                mean = 0.0
                for m in range(count):
                    if keep[m]:
                        mean += weight[m] * values[m, band]
                colour[i, j, band] = mean / total
            used[i, j] = left
            apart = 0.0
            for m in range(count):
                if keep[m]:
                    share[who[m]] += weight[m] / total
                    for band in range(bands):
                        apart += abs(values[m, band] - colour[i, j, band])
            if left > 1:
                difference[i, j] = apart / (left * bands)


def blend(colours: np.ndarray, weights: np.ndarray, how: Blend) -> Blended:
    """Blends `colours` (photos, rows, cols, bands) with `weights` (photos, rows, cols), 0 where a photo has nothing to say.

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
    rule = how.rejection
    colours, weights = np.ascontiguousarray(colours, np.float32), np.ascontiguousarray(weights, np.float32)
    _blend(
        colours,
        weights,
        _CENTRES[rule.centre],
        rule.k,
        rule.least,
        how.power,
        how.best,
        how.two_limit,
        result.colour,
        result.used,
        result.rejected,
        result.share,
        result.difference,
    )
    return result
