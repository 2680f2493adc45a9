"""Which of two surfaces the photographs show at a pixel: at which height their colours are those of the surface beside it.

At the height of a roof all photographs show the roof, and where it ends what lies behind it: ground, or the wall below. So the
colours of every photograph at either height are compared with colours of places nearby that belong to the roof and to the ground.
The likeness to a surface is the distance to the nearest of these colours, for a surface has several. Of the photographs at the
lower height only the better half counts, because the building hides the ground beside it from the others.

The scores are then averaged over the pixels around, with weights that fall with the difference of colours at both heights: within
an object they support each other, across its outline they do not (adaptive support).

Source: support weights of Yoon and Kweon 2006 (Adaptive support-weight approach for correspondence search), two hypotheses only.
"""

from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numba import njit

REACH = 8
"""cells around a pixel from which colours of the surfaces are taken"""
SPREAD = 11
"""colours along the side of that window"""
OTHER = 40.0
"""grey levels from which on a colour is that of another object, however different it is"""
_ALIKE = 5.0  # grey levels: colours that differ by less may be the same; a few times the noise of photographs


class Side(IntEnum):
    """Of which surface a pixel is an example."""

    NEITHER = 0
    LOWER = 1
    UPPER = 2


@njit(cache=True, inline="always")
def _distance(colour, examples, count):
    """Mean absolute difference from the nearest of the examples, OTHER at most."""
    nearest, bands = OTHER, colour.size
    for k in range(count):
        apart = 0.0
        for band in range(bands):
            apart += abs(colour[band] - examples[k, band])
        nearest = min(nearest, apart / bands)
    return nearest


@njit(cache=True)
def _gather(examples, sides, side, place, step, out):
    """Copies the examples of a side at the nodes of a window around a place (row, col) to `out`; returns their number."""
    rows, cols = sides.shape
    count, half = 0, SPREAD // 2
    for i in range(-half, half + 1):
        r = place[0] + i * step
        if r < 0 or r >= rows:
            continue
        for j in range(-half, half + 1):
            c = place[1] + j * step
            if c >= 0 and c < cols and sides[r, c] == side:
                out[count] = examples[r, c]
                count += 1
    return count


@njit(cache=True)
def _mean_of_better_half(distances, count):
    ordered, half = np.sort(distances[:count]), (count + 1) // 2
    return ordered[:half].mean()


@njit(cache=True)
def _score(upper, lower, shown, examples, sides, first, step, chosen, out, alike):
    photos, rows, cols, bands = upper.shape
    highs, lows = np.empty((SPREAD * SPREAD, bands), np.float32), np.empty((SPREAD * SPREAD, bands), np.float32)
    low = np.empty(photos)
    for r in range(rows):
        for c in range(cols):
            if not chosen[r, c]:
                continue
            place = (r + first[0], c + first[1])
            above = _gather(examples, sides, Side.UPPER, place, step, highs)
            below = _gather(examples, sides, Side.LOWER, place, step, lows)
            if not above or not below:
                continue
            count, own, other = 0, 0.0, 0.0
            for p in range(photos):
                if shown[p, r, c]:
                    roof, ground = _distance(upper[p, r, c], highs, above), _distance(upper[p, r, c], lows, below)
                    own += roof
                    other += ground
                    low[count] = _distance(lower[p, r, c], lows, below)
                    # A wall or a car is like neither; where both surfaces look the same, the photograph is like either.
                    alike[Side.UPPER - 1, p, r, c] = roof < OTHER and roof <= ground + _ALIKE
                    high = _distance(lower[p, r, c], highs, above)
                    alike[Side.LOWER - 1, p, r, c] = low[count] < OTHER and low[count] <= high + _ALIKE
                    count += 1
            if count:
                out[r, c] = (2.0 * own - other) / count - _mean_of_better_half(low, count)


class Likeness(NamedTuple):
    """`score` float32 (rows, cols) grey levels: negative where the photographs show the upper surface, positive for the lower one;
    NaN where they cannot tell. `alike` bool (2, photos, rows, cols): whether the photo's colour at the lower (0) and at the upper
    height (1) is that of the lower, and upper, surface rather than the other's."""

    score: np.ndarray
    alike: np.ndarray


def likeness(
    upper: np.ndarray,
    lower: np.ndarray,
    shown: np.ndarray,
    examples: np.ndarray,
    sides: np.ndarray,
    first: tuple[int, int],
    step: int,
    chosen: np.ndarray,
) -> Likeness:
    """The likeness of the `chosen` pixels (rows, cols) to the surfaces around.

    upper, lower (photos, rows, cols, bands): colours at either height; shown (photos, rows, cols) bool: both lie in the photo;
    examples (height, width, bands) and sides (height, width; codes of Side) in a larger window in which `first` is the first row
    and column of the others; step: px between the examples that are compared.
    """
    found = Likeness(np.full(chosen.shape, np.nan, np.float32), np.zeros((2, *shown.shape), bool))
    _score(upper, lower, shown, examples, sides, first, step, chosen, *found)
    return found


@njit(cache=True)
def _support(scores, upper, lower, reach, out):
    rows, cols, bands = upper.shape
    scale = 1.0 / (2.0 * bands * _ALIKE)
    for r in range(rows):
        for c in range(cols):
            if np.isnan(scores[r, c]):
                continue
            total, weights = 0.0, 0.0
            for i in range(max(r - reach, 0), min(r + reach + 1, rows)):
                for j in range(max(c - reach, 0), min(c + reach + 1, cols)):
                    if np.isnan(scores[i, j]):
                        continue
                    apart = 0.0
                    for band in range(bands):
                        apart += abs(upper[i, j, band] - upper[r, c, band]) + abs(lower[i, j, band] - lower[r, c, band])
                    weight = np.exp(-apart * scale)
                    total += weight * scores[i, j]
                    weights += weight
            out[r, c] = total / weights


def supported(scores: np.ndarray, upper: np.ndarray, lower: np.ndarray, reach: int) -> np.ndarray:
    """Scores (rows, cols) averaged over the pixels within `reach` that look alike at both heights; NaN remains NaN.

    upper, lower (rows, cols, bands): mean colours at either height.
    """
    out = np.full(scores.shape, np.nan, np.float32)
    _support(scores, upper, lower, reach, out)
    return out
