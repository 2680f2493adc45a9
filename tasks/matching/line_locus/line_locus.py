"""Vertical line locus: the heights of a block of nodes, each on its vertical line, each started from a node before it.

Strategy. Heights are the start plus whole numbers of the finest spacing, so that rounds with half the spacing meet heights that
were compared before and need not compare them again. The precision of a height follows from the curvature of the correlation at its
top and from the number of independent pixels: correlation falls by noise, and noise moves the top the less the sharper it is.

Source: Tumska, Procyk, Janczak (sources/line_locus.md#v1); Foerstner 1982 (precision of a correlation's maximum).
"""

from typing import NamedTuple

import numpy as np

from orthomill.kernels.kernel_compilation import njit
from orthomill.schemas.outcome import Outcome
from orthomill.tasks.matching.line_locus.height_search_settings import HeightSearch
from orthomill.tasks.matching.line_locus.node_order import Visits
from orthomill.tasks.matching.line_locus.thresholds import TRIALS, WORTHS, threshold_limits
from orthomill.tasks.matching.line_locus.window_correlation import (
    GreyImages,
    WindowBuffers,
    correlated_pixels,
    correlation_at,
    holds,
    image_place,
    window_values,
)

_CONVERGED, _LOW_TEXTURE, _OUTSIDE = np.uint8(Outcome.CONVERGED), np.uint8(Outcome.LOW_TEXTURE), np.uint8(Outcome.OUTSIDE)
_LOW_CORRELATION = np.uint8(Outcome.LOW_CORRELATION)
_SIGNED, _ABSOLUTE, _PUBLISHED = range(3)
_MEASURES = {"signed": _SIGNED, "absolute": _ABSOLUTE, "published": _PUBLISHED}


_INTERPOLATED, _ROUNDED = 0.04, 0.41
"""px of parallax; interpolated grey values are smoother between pixels than on them, and rounded places are half a pixel off in
each of two photographs"""


class NodeLines(NamedTuple):
    """The vertical lines of a block of nodes (rows, cols): X of the columns, Y of the rows (float64 m), the heights at which they
    are entered (rows, cols) float64 m, NaN for that of the node before, and lowest and highest height."""

    x: np.ndarray
    y: np.ndarray
    start: np.ndarray
    low: float
    high: float


class FoundHeights(NamedTuple):
    """Per node (rows, cols): `height`, its `sigma` m, `correlation` and the `limit` that it was compared with, float32, NaN where
    no height could be compared; `photographs` compared, uint8; `outcome` uint8 codes of Outcome."""

    height: np.ndarray
    sigma: np.ndarray
    correlation: np.ndarray
    limit: np.ndarray
    photographs: np.ndarray
    outcome: np.ndarray

    @classmethod
    def empty(cls, shape: tuple[int, int]) -> "FoundHeights":
        """Nothing found."""
        height, sigma, correlation, limit = (np.full(shape, np.nan, np.float32) for _ in range(4))
        return cls(height, sigma, correlation, limit, np.zeros(shape, np.uint8), np.full(shape, Outcome.OUTSIDE, np.uint8))


class _SearchRules(NamedTuple):
    half: int
    bilinear: bool
    photographs: int
    first_points: int
    side_points: int
    rounds: int
    finest: float
    """m"""
    per_pixel: float
    """m of height per pixel of parallax"""
    parabola: bool
    measure: int
    limits: np.ndarray
    found_passes: bool


def found_heights(
    images: GreyImages,
    lines: NodeLines,
    order: Visits,
    settings: HeightSearch,
    metres_per_pixel: float,
    first_points: int | None = None,
) -> FoundHeights:
    """The heights of a block of nodes.

    images: the best photographs first; of those that show a node at its start the first ones are compared. metres_per_pixel: height
    that one pixel of parallax stands for. first_points: heights on either side of the start in the first round, those of the
    settings if None.
    """
    out = FoundHeights.empty(lines.start.shape)
    spacings = settings.spacings(metres_per_pixel)
    rules = _SearchRules(
        half=settings.half,
        bilinear=settings.interpolation == "bilinear",
        photographs=settings.photographs,
        first_points=settings.side_points if first_points is None else first_points,
        side_points=settings.side_points,
        rounds=len(spacings),
        finest=float(spacings[-1]),
        per_pixel=metres_per_pixel,
        parabola=settings.fit == "parabola",
        measure=_MEASURES[settings.measure],
        limits=threshold_limits(settings.threshold, settings.pixels),
        found_passes=settings.passed_on == "found",
    )
    if len(images.frames):
        _search(images, lines, order, rules, np.log(WORTHS), np.log(TRIALS), WindowBuffers.of(settings.half), out)
    return out


@njit(error_model="numpy")
def _search(images, lines, order, rules, worths, trials, scratch, out):
    """The best height of every node along its vertical line, in `order`, from its own start or that of a node before, into `out`.
    images: the photographs; worths, trials: logarithms along the axes of the table of limits."""
    cols = lines.start.shape[1]
    passed = lines.start.copy()
    tried = np.empty(2 * rules.first_points + 1 + (2 * rules.side_points + 1) * rules.rounds, np.int64)
    values = np.empty(tried.size)
    chosen = np.empty(rules.photographs, np.int64)
    for n in range(order.node.size):
        r, c = divmod(order.node[n], cols)
        start = lines.start[r, c]
        if start != start:
            b, a = divmod(order.before[n], cols)
            start = passed[b, a]
        passed[r, c] = start
        x, y = lines.x[c], lines.y[r]
        count = _shown(images, x, y, start, rules, chosen)
        out.photographs[r, c] = count
        if count < 2:
            continue
        used = chosen[:count]
        best, top, textured = _best_height(images, used, x, y, start, lines, rules, scratch, tried, values)
        if top != top:
            if not textured:
                out.outcome[r, c] = _LOW_TEXTURE
            continue
        z = start + best * rules.finest
        worth, different = _worth(images, used, x, y, z, rules, scratch)
        limit = _looked_up(rules.limits, trials, worths, different, worth)
        shift, sigma = _top(images, used, x, y, z, top, worth, rules, scratch)
        out.height[r, c], out.sigma[r, c] = z + shift, sigma
        out.correlation[r, c], out.limit[r, c] = top, limit
        tested = top if rules.measure == 0 else abs(top)
        accepted = tested > limit
        out.outcome[r, c] = _CONVERGED if accepted else _LOW_CORRELATION
        if accepted or rules.found_passes:
            passed[r, c] = z + shift


@njit(error_model="numpy")
def _shown(images, x, y, z, rules, chosen):
    """How many of the first photographs show a node at its start; `chosen` gets their numbers."""
    count = 0
    for k in range(images.frames.shape[0]):
        if count == rules.photographs:
            break
        c, r = image_place(images, k, x, y, z)
        if holds(images, k, c, r, rules.half):
            chosen[count] = k
            count += 1
    return count


@njit(error_model="numpy")
def _best_height(images, used, x, y, start, lines, rules, scratch, tried, values):
    """The best height in finest spacings from the start, its correlation (NaN: none), and whether there was any texture."""
    count, best, top, textured = 0, 0, np.nan, True
    for turn in range(rules.rounds):
        stride, centre = 2 ** (rules.rounds - 1 - turn), best
        # From the middle outwards, so that of equal correlations the one nearest to the start is kept.
        points = rules.first_points if turn == 0 else rules.side_points
        for p in range(2 * points + 1):
            at = centre + stride * ((p + 1) // 2) * (1 if p % 2 else -1)
            z = start + at * rules.finest
            if z < lines.low or z > lines.high:
                continue
            known = False
            for q in range(count):
                known = known or tried[q] == at
            if known:
                continue
            r, texture = correlation_at(images, used, x, y, z, rules.half, rules.bilinear, scratch)
            tried[count], count = at, count + 1
            if not texture:
                textured = False
                continue
            value, highest = (abs(r), abs(top)) if rules.measure == 1 else (r, top)
            if r == r and (highest != highest or value > highest):
                best, top = at, r
    return best, top, textured


@njit(error_model="numpy")
def _worth(images, used, x, y, z, rules, scratch):
    """Independent pixels of the windows, and how many of the heights of the first round are different for their texture."""
    along, across = 0.0, 0.0
    side = 2 * rules.half + 1
    for n in range(used.size):
        c, r = image_place(images, used[n], x, y, z)
        window_values(images, used[n], c, r, rules.half, rules.bilinear, scratch.one)
        along += correlated_pixels(scratch.one, side, False) / used.size
        across += correlated_pixels(scratch.one, side, True) / used.size
    # Texture that changes slowly makes neighbouring heights the same trial.
    span = 2 * rules.first_points * rules.finest * 2 ** (rules.rounds - 1) / rules.per_pixel
    return side * side / (along * across), 1.0 + span / max(along, across)


@njit(error_model="numpy")
def _looked_up(table, rows, cols, row, col):
    """Bilinear in a table over logarithms that are equally far apart."""
    i = min(max((np.log(max(row, 1e-9)) - rows[0]) / (rows[1] - rows[0]), 0.0), rows.size - 1.000001)
    j = min(max((np.log(max(col, 1e-9)) - cols[0]) / (cols[1] - cols[0]), 0.0), cols.size - 1.000001)
    r, c = int(i), int(j)
    u, v = j - c, i - r
    upper = table[r, c] + u * (table[r, c + 1] - table[r, c])
    lower = table[r + 1, c] + u * (table[r + 1, c + 1] - table[r + 1, c])
    return upper + v * (lower - upper)


@njit(error_model="numpy")
def _top(images, used, x, y, z, top, worth, rules, scratch):
    """How far the top of the parabola lies from z, and the standard error of the height, m."""
    # Half a pixel of parallax: nearer by, interpolation and rounding show instead of the texture.
    step = 0.5 * rules.per_pixel
    before, _ = correlation_at(images, used, x, y, z - step, rules.half, rules.bilinear, scratch)
    after, _ = correlation_at(images, used, x, y, z + step, rules.half, rules.bilinear, scratch)
    sign = -1.0 if top < 0.0 else 1.0
    curvature = -sign * (before + after - 2.0 * top) / (step * step)
    # NaN at the border of a photograph and a top that is none: nothing is known but that the steps went here.
    if not curvature > 0.0:
        return 0.0, np.inf
    shift = 0.5 * sign * (after - before) / step / curvature
    rho = max(abs(top), 1e-3)
    # What makes windows differ is not noise alone but ground that is not level, and that is as correlated as the texture.
    noise = max(1.0 - rho * rho, 1e-6) / (max(worth, 1.0) * rho * curvature * (used.size - 1))
    # The best height itself is one of a ladder; the parabola stands between its rungs.
    rung = 0.0 if rules.parabola else rules.finest**2 / 12.0
    placing = (_INTERPOLATED if rules.bilinear else _ROUNDED) * rules.per_pixel
    shift = min(max(shift, -step), step) if rules.parabola else 0.0
    return shift, np.sqrt(noise + rung + placing * placing)
