"""Which of two surfaces the photographs show at a pixel: at which height their colours are those of the surface beside it.

At the height of a roof all photographs show the roof, and where it ends what lies behind it: ground, or the wall below. So the
colours of every photograph at either height are compared with colours of places nearby that belong to the roof and to the ground.
The likeness to a surface is the distance to the nearest of these colours, for a surface has several. Of the photographs at the
lower height only the better half counts, because the building hides the ground beside it from the others.

The scores are then averaged over the pixels around, with weights that fall with the difference of colours at both heights: within
an object they support each other, across its outline they do not (adaptive support).

Source: support weights of Yoon and Kweon 2006 (Adaptive support-weight approach for correspondence search), two hypotheses only.
"""

from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

import numpy as np

from orthomill.kernels.kernel_compilation import njit
from orthomill.schemas.raster import Window

REACH = 8
"""cells around a pixel from which colours of the surfaces are taken"""
SPREAD = 11
"""colours along the side of that window, or some more where pixels are coarse"""
OTHER = 40.0
"""grey levels from which on a colour is that of another object, however different it is"""
_MOST = (2 * REACH + 1) ** 2  # nodes in a window, in the worst case a px apart
_ALIKE = 5.0  # grey levels: colours that differ by less may be the same; a few times the noise of photographs


class Side(IntEnum):
    """Of which surface a pixel is an example."""

    NEITHER = 0
    LOWER = 1
    UPPER = 2


@dataclass(frozen=True)
class Examples:
    """What the surfaces look like: pixels of the orthoimage whose rows and columns are multiples of `spacing` px.

    `colours` float32 (rows, cols, bands) and `sides` uint8 (rows, cols), codes of Side, of the nodes from `first` (row, column) on,
    counted in steps of `spacing` from the corner of the orthoimage.
    """

    colours: np.ndarray
    sides: np.ndarray
    first: tuple[int, int]
    spacing: int


class _Lattice(NamedTuple):
    """The examples for the kernel; `divisor`: px per cell."""

    colours: np.ndarray
    sides: np.ndarray
    row: int
    col: int
    spacing: int
    divisor: int


class _Palette(NamedTuple):
    """Colours of both surfaces around a cell, (3, nodes) each: by channels, so that several are compared at a time."""

    high: np.ndarray
    low: np.ndarray


def spacing_of(divisor: int) -> int:
    """px between examples, for cells of `divisor` px."""
    return max(1, 2 * REACH * divisor // (SPREAD - 1))


# Without NaN and signed zeros the least of several distances is found at once; the result is the same in any order.
@njit(fastmath={"nnan", "nsz"})
def _distance(red, green, blue, examples, count):
    """Mean absolute difference from the nearest of the first `count` examples (3, nodes), OTHER at most."""
    nearest = np.float32(3.0 * OTHER)
    reds, greens, blues = examples[0], examples[1], examples[2]
    for k in range(count):
        apart = abs(red - reds[k]) + abs(green - greens[k]) + abs(blue - blues[k])
        nearest = min(nearest, apart)
    return nearest / np.float32(3.0)


@njit()
def _gather(lattice, cell, palette):
    """Copies the examples around a cell (row, col) of the model to the palette; returns the numbers of high and low ones."""
    rows, cols, bands = lattice.colours.shape
    middle, spacing, reach = (lattice.divisor - 1) // 2, lattice.spacing, REACH * lattice.divisor
    row, col = cell[0] * lattice.divisor + middle, cell[1] * lattice.divisor + middle
    top, left = -((reach - row) // spacing) - lattice.row, -((reach - col) // spacing) - lattice.col
    bottom, right = (row + reach) // spacing - lattice.row, (col + reach) // spacing - lattice.col
    high, low = 0, 0
    for r in range(max(top, 0), min(bottom + 1, rows)):
        for c in range(max(left, 0), min(right + 1, cols)):
            if lattice.sides[r, c] == Side.UPPER:
                for band in range(3):
                    palette.high[band, high] = lattice.colours[r, c, min(band, bands - 1)]
                high += 1
            elif lattice.sides[r, c] == Side.LOWER:
                for band in range(3):
                    palette.low[band, low] = lattice.colours[r, c, min(band, bands - 1)]
                low += 1
    return high, low


@njit()
def _mean_of_better_half(distances, count):
    """The mean of the smaller half of the first `count` distances."""
    ordered, half = np.sort(distances[:count]), (count + 1) // 2
    return ordered[:half].mean()


@njit()
def _score_pixel(upper, lower, shown, place, palette, counts, low, foreign, alike):
    """The score of a pixel at `place` (row, col), of whose photos it fills `alike`; `low`, `foreign` (photos,) are work space."""
    photos, bands = upper.shape[0], upper.shape[3]
    r, c = place
    green, blue = min(1, bands - 1), bands - 1
    count, own, other, known, neither = 0, 0.0, 0.0, 0, 0
    for p in range(photos):
        if shown[p, r, c]:
            at = upper[p, r, c]
            roof = _distance(at[0], at[green], at[blue], palette.high, counts[0])
            ground = _distance(at[0], at[green], at[blue], palette.low, counts[1])
            own += roof
            other += ground
            at = lower[p, r, c]
            low[count] = _distance(at[0], at[green], at[blue], palette.low, counts[1])
            high = _distance(at[0], at[green], at[blue], palette.high, counts[0])
            # A wall or a car is like neither; where both surfaces look the same, the photograph is like either.
            alike[Side.UPPER - 1, p, r, c] = roof < OTHER and roof <= ground + _ALIKE
            alike[Side.LOWER - 1, p, r, c] = low[count] < OTHER and low[count] <= high + _ALIKE
            foreign[p] = min(high, low[count]) >= OTHER
            known += alike[Side.LOWER - 1, p, r, c]
            neither += foreign[p]
            count += 1
    if neither > known:
        # Shadow beside a wall may be like no ground around, and single photographs mix it with the roof to the colour of ground.
        for p in range(photos):
            alike[Side.LOWER - 1, p, r, c] = shown[p, r, c] and foreign[p]
    return (2.0 * own - other) / count - _mean_of_better_half(low, count) if count else np.nan


@njit()
def _score(upper, lower, shown, lattice, corner, chosen, out, alike):
    """Fills scores `out` (rows, cols) and `alike` (2, photos, rows, cols) of the `chosen` pixels, whose first row and column are
    `corner`; other arguments as of `likeness`."""
    photos, rows, cols, _ = upper.shape
    palette = _Palette(np.empty((3, _MOST), np.float32), np.empty((3, _MOST), np.float32))
    low, foreign = np.empty(photos), np.empty(photos, np.bool_)
    # Pixels of one cell share their examples; cells are counted from the corner of the orthoimage, not of these rows.
    size = lattice.divisor
    for cell_row in range(corner[0] // size, (corner[0] + rows - 1) // size + 1):
        top, bottom = max(cell_row * size - corner[0], 0), min((cell_row + 1) * size - corner[0], rows)
        for cell_col in range(corner[1] // size, (corner[1] + cols - 1) // size + 1):
            left, right = max(cell_col * size - corner[1], 0), min((cell_col + 1) * size - corner[1], cols)
            if not chosen[top:bottom, left:right].any():
                continue
            counts = _gather(lattice, (cell_row, cell_col), palette)
            if not counts[0] or not counts[1]:
                continue
            for r in range(top, bottom):
                for c in range(left, right):
                    if chosen[r, c]:
                        out[r, c] = _score_pixel(upper, lower, shown, (r, c), palette, counts, low, foreign, alike)


class Likeness(NamedTuple):
    """`score` float32 (rows, cols) grey levels: negative where the photographs show the upper surface, positive for the lower one;
    NaN where they cannot tell. `alike` bool (2, photos, rows, cols): whether the photo's colour at the lower (0) and at the upper
    height (1) is that of the lower, and upper, surface rather than the other's; where more photos show at the
    lower height a colour of neither surface than one of the ground, whether it is of neither."""

    score: np.ndarray
    alike: np.ndarray


def likeness(
    upper: np.ndarray, lower: np.ndarray, shown: np.ndarray, examples: Examples, chosen: np.ndarray, window: Window, divisor: int
) -> Likeness:
    """The likeness of the `chosen` pixels (rows, cols) to the surfaces around; they lie at `window` of the orthoimage.

    upper, lower (photos, rows, cols, bands): colours at either height; shown (photos, rows, cols) bool: both lie in the photo;
    divisor: px per cell of the surface model.
    """
    found = Likeness(np.full(chosen.shape, np.nan, np.float32), np.zeros((2, *shown.shape), bool))
    lattice = _Lattice(examples.colours, examples.sides, *examples.first, examples.spacing, divisor)
    _score(upper, lower, shown, lattice, (window.row, window.col), chosen, *found)
    return found


@njit()
def _support(scores, upper, lower, reach, out):
    """Fills `out` (rows, cols) as `supported` tells."""
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
