"""On which side of a wall a cell lies: the photographs are asked again, with windows that hardly reach beyond the cell.

Strategy. The windows of the search are several cells wide, and beside a wall they show both surfaces in all photographs alike, so
that edges come out displaced by a cell or two: no number of photographs mends that. What is left to decide there is only which of
two surfaces a cell belongs to. Both are known from the heights around; each is compared in small windows, among the photographs
that see it past what stands around, and the difference of the costs, smoothed over the cells around, decides. A window that reaches
over the edge fits the upper surface better than it should, for the wall itself is nowhere seen twice alike; this is made up for.
"""

from typing import NamedTuple

import numpy as np
from scipy import ndimage

from orthomill.kernels.kernel_compilation import njit
from orthomill.tasks.matching.volume.candidates import CellRanges
from orthomill.tasks.matching.volume.costs import Choice, PhotographStack, choose, looked_up
from orthomill.tasks.matching.volume.signatures import BITS, bits_set

HALF, SPACING = 2, 1
"""half side of the small windows and distance of their pixels, as of signatures"""
LEAST = 3.0
"""heights of the volume by which two surfaces must differ"""
_REACH = 3
"""cells on every side from which the two surfaces are known"""
_QUARTER = 0.25
"""heights farther than this share of the step from its middle belong to one of the surfaces: those between are a blurred wall"""
_FEWEST, _BETWEEN = 3, 0.2
"""cells without which there is no surface, and share of the heights around that lie between at most: those of leaves all do"""
_SHADOW = 12
"""cells that may stand before a cell"""
_SMOOTH = 1.0
"""cells, sigma of the Gaussian over which costs are smoothed"""
_MOST = 8
"""photographs that are compared"""
_FAVOUR = 0.02
"""share of the bits by which the upper surface fits better where it is not"""


class WallSides(NamedTuple):
    """The two surfaces (rows, cols) float32 m of cells near a wall; NaN where there is none."""

    upper: np.ndarray
    lower: np.ndarray

    @property
    def near(self) -> np.ndarray:
        """(rows, cols) bool: cells near a wall."""
        return np.isfinite(self.upper)

    def contradicted(self, height: np.ndarray, upper: np.ndarray) -> np.ndarray:
        """Cells (rows, cols) bool whose heights (rows, cols) m do not belong to the surface on which they lie; upper (rows, cols)
        bool."""
        with np.errstate(invalid="ignore"):
            above = (height - self.lower) / (self.upper - self.lower)
            return self.near & np.where(upper, above < 0.5 + _QUARTER, above > 0.5 - _QUARTER)


class Lookouts(NamedTuple):
    """Where the photographs stand: columns and rows (p,) of the cells, and heights m; `tolerance` m: what stands higher than a ray
    by less hides nothing."""

    col: np.ndarray
    row: np.ndarray
    height: np.ndarray
    tolerance: float


def wall_sides(height: np.ndarray, least: float) -> WallSides:
    """The surfaces on both sides of walls of at least `least` m from heights (rows, cols) float32 m, NaN where unknown."""
    sides = WallSides(np.full(height.shape, np.nan, np.float32), np.full(height.shape, np.nan, np.float32))
    _sides(height.astype(np.float32), np.float32(least), *sides)
    return sides


def decided(
    height: np.ndarray,
    sides: WallSides,
    stack: PhotographStack,
    choice: Choice,
    candidates: CellRanges,
    heights: np.ndarray,
    lookouts: Lookouts,
) -> np.ndarray:
    """Whether the cells (rows, cols) near walls belong to the upper surface; bool.

    height (rows, cols) m; stack: signatures of HALF and SPACING; heights (K,) m of its planes.
    """
    planes = np.stack([np.rint(np.nan_to_num((side - heights[0]) / (heights[1] - heights[0]))) for side in sides])
    cost = np.full((2, *height.shape), np.nan, np.float32)
    images = stack.flat, stack.starts, stack.sizes, stack.planes
    where = choice.spacing, choice.preferred.astype(np.int16), np.zeros_like(choice.hidden)
    surface = np.nan_to_num(height, nan=-np.inf).astype(np.float32)
    places = np.column_stack([lookouts.col, lookouts.row, lookouts.height])
    ranges, two = (candidates.low, candidates.offset), (planes.astype(np.int64), np.stack(sides))
    _side_costs(*images, *where, *ranges, stack.none, *two, surface, places, np.float32(lookouts.tolerance), cost)
    dearer = (cost[1] - cost[0]) / BITS[HALF] - _FAVOUR
    known = np.isfinite(dearer)
    total = ndimage.gaussian_filter(np.where(known, dearer, 0).astype(np.float64), _SMOOTH, mode="constant", truncate=3.0)
    # Where no photographs say anything the height stays on its side.
    silent = ndimage.gaussian_filter(known.astype(np.float64), _SMOOTH, mode="constant", truncate=3.0) <= 0
    with np.errstate(invalid="ignore"):
        own = np.abs(height - sides.upper) < np.abs(height - sides.lower)
    return np.where(silent, own, total > 0) & sides.near


@njit()
def _sides(height, least, upper, lower):
    """Fills `upper` and `lower` (r, c), NaN before, near steps of `least` m; nearer heights count more."""
    rows, cols = height.shape
    for r in range(rows):
        for c in range(cols):
            if height[r, c] != height[r, c]:
                continue
            top, bottom = max(0, r - _REACH), min(rows, r + _REACH + 1)
            left, right = max(0, c - _REACH), min(cols, c + _REACH + 1)
            low, high, known = np.float32(np.inf), np.float32(-np.inf), 0
            for y in range(top, bottom):
                for x in range(left, right):
                    if height[y, x] == height[y, x]:
                        low, high, known = min(low, height[y, x]), max(high, height[y, x]), known + 1
            if high - low < least:
                continue
            middle, margin = (low + high) / 2, np.float32(_QUARTER) * (high - low)
            above, below, heavy, light, many, few = 0.0, 0.0, 0.0, 0.0, 0, 0
            for y in range(top, bottom):
                for x in range(left, right):
                    # Comparisons with NaN are false.
                    weight = 1.0 / (1 + (y - r) * (y - r) + (x - c) * (x - c)) ** 2
                    if height[y, x] > middle + margin:
                        above, heavy, many = above + weight * height[y, x], heavy + weight, many + 1
                    elif height[y, x] < middle - margin:
                        below, light, few = below + weight * height[y, x], light + weight, few + 1
            if many >= _FEWEST and few >= _FEWEST and known - many - few <= _BETWEEN * known:
                upper[r, c], lower[r, c] = above / heavy, below / light


@njit(inline="always")
def _stands_before(surface, r, c, z, place, tolerance):
    """Whether something of the `surface` (r, c) m hides the height z of a cell from a photograph at `place` (column, row, m)."""
    away = np.sqrt((place[0] - c) * (place[0] - c) + (place[1] - r) * (place[1] - r))
    if away < 1e-6:
        return False
    across, down, rise = (place[0] - c) / away, (place[1] - r) / away, (place[2] - z) / away
    for step in range(1, _SHADOW + 1):
        y, x = int(np.rint(r + down * step)), int(np.rint(c + across * step))
        if y < 0 or x < 0 or y >= surface.shape[0] or x >= surface.shape[1]:
            return False
        if surface[y, x] > z + rise * step + tolerance:
            return True
    return False


@njit()
def _side_costs(
    flat, starts, sizes, planes, spacing, preferred, hidden, low, offset, none, at, side, surface, places, tolerance, cost
):
    """Costs of both sides (2, r, c) into `cost`, bits, NaN where fewer than two photographs show them: mean over the pairs of
    photographs that see it, or of all if fewer than two do. at, side (2, r, c): plane and height m of both, NaN off walls; places
    (p, 3): of the photographs, column, row and height m; others as in `costs.volume_costs` and `_stands_before`."""
    rows, cols = surface.shape
    chosen, sees = np.empty(starts.size, np.int64), np.empty(starts.size, np.bool_)
    found, some = np.empty(starts.size, flat.dtype), np.empty(starts.size, np.bool_)
    for r in range(rows):
        for c in range(cols):
            n = offset[r * cols + c + 1] - offset[r * cols + c]
            if n == 0 or side[0, r, c] != side[0, r, c]:
                continue
            photos = choose(
                flat, starts, sizes, planes, preferred[r // spacing, c // spacing], hidden, r, c, low[r, c], n, none, _MOST, chosen
            )
            for k in range(2):
                plane, count = at[k, r, c], 0
                if plane < 0 or plane >= planes.shape[1]:
                    continue
                for a in range(photos):
                    p = chosen[a]
                    found[a] = looked_up(
                        flat, starts[p], sizes[p, 0], sizes[p, 1], planes[p, plane], np.float32(r), np.float32(c), none
                    )
                    some[a] = found[a] < none
                    sees[a] = some[a] and not _stands_before(surface, r, c, side[k, r, c], places[p], tolerance)
                    count += sees[a]
                use = sees if count >= 2 else some
                total, pairs = np.int64(0), 0
                for a in range(photos):
                    for b in range(a + 1, photos):
                        if use[a] and use[b]:
                            total += np.int64(bits_set(found[a] ^ found[b]))
                            pairs += 1
                if pairs > 0:
                    cost[k, r, c] = np.float32(total) / np.float32(pairs)
