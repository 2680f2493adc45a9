"""One colour from many: gross errors are rejected, the remaining colours averaged with weights.

Strategy, per ortho pixel: (1) values of negligible weight are reserves and not used while better ones exist; (2) of three values or
more those far from the centre of all are rejected; (3) the best N of the remaining ones are averaged with their weights.

Where the colours of a pixel agree, which is nearly everywhere, no rule has an effect and the colour is the weighted mean of
all: a row of pixels is first averaged as a whole, photograph by photograph, and only the others are looked at one by one.

Source: Petsa et al. 2007 (sources/blending.md): M7 rejection (`rejection.py`), M9 two values, M12 weights, M13 best N.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from orthomill.kernels.kernel_compilation import njit
from orthomill.tasks.colouring.blending.rejection import CENTRES, PUBLISHED, Centre, Rejection, reject

RESERVE = 0.01
"""Values whose weight is below this share of the greatest are not used."""
MOST = 64
"""Photographs that one ortho pixel may have."""


@dataclass(frozen=True)
class Blend:
    """How the colours of a pixel are combined. `power` of the area: 1 or 2; `best` 0: all; `two_limit` grey levels (0: two values
    are averaged)."""

    rejection: Rejection = PUBLISHED
    power: int = 1
    best: int = 0
    two_limit: float = 0.0


class Blended(NamedTuple):
    """Blended pixels.

    `colour` (rows, cols, bands) float32; `seen`, `used`, `rejected` (rows, cols) uint8 counts of values; `share` (photos,) float64,
    sum over pixels of each photo's part in the colour; `difference` (rows, cols) float32, mean absolute difference of the used
    values from the colour, NaN where fewer than two were used.
    """

    colour: np.ndarray
    used: np.ndarray
    rejected: np.ndarray
    share: np.ndarray
    seen: np.ndarray
    difference: np.ndarray


class _Rules(NamedTuple):
    """`Blend` for the kernels."""

    centre: int
    k: float
    least: float
    power: int
    best: int
    two_limit: float


class _Work(NamedTuple):
    """Arrays of MOST elements that the kernels reuse for every pixel: `keep` says which values are used."""

    keep: np.ndarray
    distance: np.ndarray
    line: np.ndarray
    sorted: np.ndarray
    weight: np.ndarray
    photo: np.ndarray


class _Row(NamedTuple):
    """A row of pixels (cols,) float32: greatest and total weight, number of values; centre and mean colour (cols, bands); the
    greatest squared distance from the centre, the sum of absolute differences from the mean; `odd` uint8: whether a rule
    changes the pixel."""

    greatest: np.ndarray
    total: np.ndarray
    number: np.ndarray
    centre: np.ndarray
    colour: np.ndarray
    farthest: np.ndarray
    apart: np.ndarray
    odd: np.ndarray


@njit()
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


@njit()
def _drop_broken(values, photo, broken, i, j, two_limit, keep):
    """Drops the one of two values (2, bands) that differ by more than `two_limit` whose photo alone sees the place at a break of
    the depth; returns how many are left (M9)."""
    bands = values.shape[1]
    apart = 0.0
    for band in range(bands):
        apart += abs(values[0, band] - values[1, band]) / bands
    first, second = broken[photo[0], i, j], broken[photo[1], i, j]
    if apart <= two_limit or first == second:
        return 2
    keep[0 if first else 1] = False
    return 1


@njit()
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


@njit()
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


@njit()
def _blend_pixel(colours, weights, broken, i, j, greatest, rules, images, values, work):
    """Blends one pixel by all the rules; `greatest`: its greatest weight."""
    photos, _, _, bands = colours.shape
    keep, weight, photo, count = work.keep, work.weight, work.photo, 0
    for p in range(photos):
        if weights[p, i, j] > RESERVE * greatest and count < MOST:
            photo[count] = p
            # The power of the area is applied after the choice of reserves: it would square the limit as well.
            weight[count] = weights[p, i, j] if rules.power == 1 else weights[p, i, j] ** rules.power
            for band in range(bands):
                values[count, band] = colours[p, i, j, band]
            count += 1
    left = reject(values, count, rules, work)
    if count == 2 and rules.two_limit > 0.0:
        if broken.shape[0]:
            left = _drop_broken(values, photo, broken, i, j, rules.two_limit, keep)
        else:
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


@njit(error_model="numpy", inline="always")
def _average_row(colours, weights, i, power, bands, row, seen):
    """Fills `row` for the pixels of row i as if no value were rejected, and counts the photos that see them."""
    photos, cols = weights.shape[0], weights.shape[2]
    zero, one, least = np.float32(0.0), np.float32(1.0), np.float32(RESERVE)
    row.greatest[:], row.total[:], row.number[:], row.farthest[:], row.apart[:] = zero, zero, zero, zero, zero
    row.centre[:], row.colour[:] = zero, zero
    for p in range(photos):
        weight = weights[p, i]
        for j in range(cols):
            row.greatest[j] = max(row.greatest[j], weight[j])
            seen[j] += weight[j] > zero
    for p in range(photos):
        weight, value = weights[p, i], colours[p, i]
        for j in range(cols):
            keep = weight[j] > least * row.greatest[j]
            own = weight[j] if keep else zero
            if power == 2:
                own *= own
            here = one if keep else zero
            row.total[j] += own
            row.number[j] += here
            for band in range(bands):
                row.centre[j, band] += here * value[j, band]
                row.colour[j, band] += own * value[j, band]
    for j in range(cols):
        for band in range(bands):
            row.centre[j, band] /= max(row.number[j], one)
            row.colour[j, band] /= row.total[j] if row.total[j] > zero else one
    for p in range(photos):
        weight, value = weights[p, i], colours[p, i]
        for j in range(cols):
            square, apart = zero, zero
            for band in range(bands):
                square += (value[j, band] - row.centre[j, band]) ** 2
                apart += abs(value[j, band] - row.colour[j, band])
            keep = weight[j] > least * row.greatest[j]
            row.farthest[j] = max(row.farthest[j], square if keep else zero)
            row.apart[j] += apart if keep else zero


@njit(error_model="numpy", inline="always")
def _tell_row(row, images, i, bands):
    """Writes the pixels of row i as if no value were rejected."""
    # One plain loop for each array: what several of them write could overlap, and would be computed pixel by pixel.
    colour, used, difference = images.colour[i], images.used[i], images.difference[i]
    for j in range(row.number.size):
        for band in range(bands):
            colour[j, band] = row.colour[j, band]
    for j in range(row.number.size):
        used[j] = np.uint8(row.number[j])
    for j in range(row.number.size):
        difference[j] = (
            row.apart[j] / (row.number[j] * np.float32(bands)) if row.number[j] > np.float32(1.0) else np.float32(np.nan)
        )


@njit(error_model="numpy", inline="always")
def _find_odd(row, rules, bands):
    """Marks in `row.odd` the pixels that a rule changes, or may change, and turns the total weights of the others into inverse
    ones; 0 for those without any."""
    one, two, zero = np.float32(1.0), np.float32(2.0), np.float32(0.0)
    # About a median, a value is at most twice as far in every band as the farthest one is from the mean.
    agreed = np.float32(rules.least**2 * (bands if rules.centre == Centre.MEAN else 0.25))
    agreed = np.float32(np.inf) if rules.centre == Centre.NONE else agreed
    alike = two if rules.two_limit > 0.0 else zero
    best = np.float32(0.0 if rules.power > 2 else min(rules.best, MOST) if rules.best > 0 else MOST)
    for j in range(row.number.size):
        count = row.number[j]
        row.odd[j] = ((count > two) & (row.farthest[j] > agreed)) | (count > best) | ((count == alike) & (count > zero))
    for j in range(row.number.size):
        row.total[j] = one / row.total[j] if (row.total[j] > zero) & (row.odd[j] == 0) else zero


@njit(error_model="numpy")
def _plain_row(colours, weights, i, rules, row, images):
    """Blends the pixels of row i as if no value were rejected."""
    # The number of bands is written out, so that the compiler sees the few loops over them as one block.
    bands = colours.shape[3]
    if bands == 3:
        _average_row(colours, weights, i, rules.power, 3, row, images.seen[i])
        _tell_row(row, images, i, 3)
    else:
        _average_row(colours, weights, i, rules.power, bands, row, images.seen[i])
        _tell_row(row, images, i, bands)
    _find_odd(row, rules, bands)


# The order of a sum of shares is free, so that many of them are added at a time.
@njit(error_model="numpy", fastmath={"reassoc", "contract"})
def _share(weight, row, power):
    """The sum over a row of pixels of a photo's part in the colour; row.total: the inverse total weight, 0 where it has none."""
    share, least, zero = np.float32(0.0), np.float32(RESERVE), np.float32(0.0)
    for j in range(weight.size):
        own = weight[j] if weight[j] > least * row.greatest[j] else zero
        share += (own * own if power == 2 else own) * row.total[j]
    return share


@njit()
def _blend(colours, weights, broken, rules, images, row, values, work):
    """Fills `images` from colours (photos, rows, cols, bands) and weights (photos, rows, cols); `row`, `values` (MOST, bands) and
    `work` are work space."""
    photos, rows, cols, _ = colours.shape
    for i in range(rows):
        _plain_row(colours, weights, i, rules, row, images)
        for j in range(cols):
            if row.odd[j]:
                images.difference[i, j] = np.nan
                _blend_pixel(colours, weights, broken, i, j, row.greatest[j], rules, images, values, work)
        for p in range(photos):
            images.share[p] += _share(weights[p, i], row, rules.power)


def blend(colours: np.ndarray, weights: np.ndarray, how: Blend, broken: np.ndarray | None = None) -> Blended:
    """Blends `colours` (photos, rows, cols, bands) with `weights` (photos, rows, cols), 0 where a photo does not see the pixel.

    Of two colours that disagree the heavier one is used; with `broken` (photos, rows, cols) bool, where a photo sees the pixel next
    to a break of its depth, the one that does not (and both where that tells nothing). Pixels without any weight are 0 with
    `used` 0. Source: g = sum(e^p g) / sum(e^p), M12.
    """
    photos, rows, cols, bands = colours.shape
    result = Blended(
        colour=np.zeros((rows, cols, bands), np.float32),
        used=np.zeros((rows, cols), np.uint8),
        rejected=np.zeros((rows, cols), np.uint8),
        share=np.zeros(photos),
        seen=np.zeros((rows, cols), np.uint8),
        difference=np.full((rows, cols), np.nan, np.float32),
    )
    rejection = how.rejection
    # Plain numbers, always of the same types: the kernel is compiled once and found in the cache.
    rules = _Rules(
        int(CENTRES[rejection.centre]), float(rejection.k), float(rejection.least), how.power, how.best, float(how.two_limit)
    )
    kinds = [(cols, np.float32)] * 3 + [((cols, bands), np.float32)] * 2 + [(cols, np.float32)] * 2 + [(cols, np.uint8)]
    lines: list[np.ndarray] = [np.empty(shape, kind) for shape, kind in kinds]
    work = _Work(np.empty(MOST, np.bool_), *(np.empty(MOST, kind) for kind in (float, float, float, float, np.int64)))
    pixels = np.ascontiguousarray(colours, np.float32), np.ascontiguousarray(weights, np.float32)
    breaks = np.zeros((0, 0, 0), np.bool_) if broken is None else np.ascontiguousarray(broken, np.bool_)
    _blend(*pixels, breaks, rules, result, _Row(*lines), np.empty((MOST, bands)), work)
    return result
