"""One height of several depth maps: the highest that more of them confirm than look through, smoothed as far as a pixel
of theirs sees.

Strategy: a map votes in every cell that its pixel covers, with the highest of its heights there. Heights that differ by no more
than leaves are deep speak of the same crown, and the mean of such a group is a candidate. Then every map is asked again, along its
own line of sight to the candidate: it ends there, or before, behind another leaf, and says nothing; or it goes on to something
farther away, so that the candidate stands in space that was seen to be free. The uppermost candidate at which more lines end than
go on is the surface. Every vote is for another leaf, so that a median over the pixel's surroundings follows.

Source: free-space violations as in Merrell et al. 2007 (visibility-based fusion of depth maps).
"""

from typing import NamedTuple

import numpy as np

from orthomill.kernels.kernel_compilation import njit

MOST = 16
"""depth maps that vote in a cell; the first that show it"""
_FEWEST = 3
"""maps that must agree: two may follow the same leaf that moved"""
_COMPANY = 0.3
"""share of the cells around that must have a height"""


class SightToCells(NamedTuple):
    """Where a depth map looks at cells: `rotation` (3, 3) and `centre` (3,) m of its camera, `scale` px, column and row of its
    principal point in the part that is read, and `base`, by which a parallax is the depth, px m; corner and side of cells, m."""

    rotation: np.ndarray
    centre: np.ndarray
    scale: float
    col0: float
    row0: float
    base: float
    west: float
    north: float
    cell: float


@njit()
def cast(votes, count, places, reach, highest):
    """Add the heights of one map to `votes` (MOST, rows, cols) float32, whose first `count` (rows, cols) are taken.

    places (3, N): column and row in the window, and height m, of the pixels of the map, NaN without one; reach: cells on every side
    of a place that its pixel covers; highest (rows, cols) float32: scratch.
    """
    rows, cols = count.shape
    highest[:] = -np.inf
    for i in range(places.shape[1]):
        col, row, height = places[0, i], places[1, i], np.float32(places[2, i])
        # Comparisons with NaN are false.
        if not (col > -reach - 1 and row > -reach - 1 and col < cols + reach and row < rows + reach):
            continue
        for r in range(max(0, int(np.ceil(row - reach))), min(rows, int(np.floor(row + reach)) + 1)):
            for c in range(max(0, int(np.ceil(col - reach))), min(cols, int(np.floor(col + reach)) + 1)):
                highest[r, c] = max(highest[r, c], height)
    for r in range(rows):
        for c in range(cols):
            if highest[r, c] > -np.inf and count[r, c] < MOST:
                votes[count[r, c], r, c] = highest[r, c]
                count[r, c] += 1


@njit()
def group(votes, count, apart):
    """Replace the votes (MOST, rows, cols) of every cell by the means of their groups that differ by no more than `apart` (m), the
    highest first, and `count` by the number of groups; groups of fewer maps than must agree are left out."""
    rows, cols = count.shape
    own = np.empty(MOST, np.float32)
    for r in range(rows):
        for c in range(cols):
            number, kept = count[r, c], 0
            for i in range(number):
                own[i] = votes[i, r, c]
            own[:number].sort()
            for i in range(number - 1, -1, -1):
                total, agree = 0.0, 0
                for j in range(number):
                    if abs(own[j] - own[i]) <= apart:
                        total, agree = total + own[j], agree + 1
                mean = np.float32(total / agree)
                if agree >= _FEWEST and (kept == 0 or mean < votes[kept - 1, r, c]):
                    votes[kept, r, c] = mean
                    kept += 1
            count[r, c] = kept


@njit()
def look(groups, count, lines, parallax, sight, apart):
    """Add to `lines` (2, MOST, rows, cols) how many lines of sight of a map end at the groups of the cells, and how many go on.

    parallax (H, W): of the map, px; sight: see `SightToCells`; ends within `apart` (m) of a group are at it.
    """
    rows, cols = count.shape
    turn, centre = sight.rotation, sight.centre
    for r in range(rows):
        dy = sight.north - (r + 0.5) * sight.cell - centre[1]
        for c in range(cols):
            dx = sight.west + (c + 0.5) * sight.cell - centre[0]
            for k in range(count[r, c]):
                dz = groups[k, r, c] - centre[2]
                depth = -(turn[2, 0] * dx + turn[2, 1] * dy + turn[2, 2] * dz)
                if depth <= 0.0:
                    continue
                col = sight.col0 + sight.scale * (turn[0, 0] * dx + turn[0, 1] * dy + turn[0, 2] * dz) / depth
                row = sight.row0 - sight.scale * (turn[1, 0] * dx + turn[1, 1] * dy + turn[1, 2] * dz) / depth
                i, j = int(np.rint(row)), int(np.rint(col))
                if i < 0 or j < 0 or i >= parallax.shape[0] or j >= parallax.shape[1]:
                    continue
                # Comparisons with NaN are false.
                beyond = sight.base / parallax[i, j] - depth
                if abs(beyond) <= apart:
                    lines[0, k, r, c] += 1
                elif beyond > apart:
                    lines[1, k, r, c] += 1


@njit()
def elected(groups, count, lines):
    """Heights (rows, cols) float32 of the highest groups at which more `lines` end than go on; NaN where there is none."""
    rows, cols = count.shape
    out = np.full((rows, cols), np.float32(np.nan))
    for r in range(rows):
        for c in range(cols):
            for k in range(count[r, c]):
                if lines[0, k, r, c] > lines[1, k, r, c]:
                    out[r, c] = groups[k, r, c]
                    break
    return out


@njit()
def smoothed(heights, reach):
    """Medians (rows, cols) float32 over (2 reach + 1)^2 cells; NaN where too few of them have a height."""
    rows, cols = heights.shape
    out = np.full((rows, cols), np.float32(np.nan))
    around = np.empty((2 * reach + 1) ** 2, np.float32)
    for r in range(rows):
        for c in range(cols):
            n = 0
            for y in range(max(0, r - reach), min(rows, r + reach + 1)):
                for x in range(max(0, c - reach), min(cols, c + reach + 1)):
                    if heights[y, x] == heights[y, x]:
                        around[n] = heights[y, x]
                        n += 1
            if n >= _COMPANY * around.size:
                out[r, c] = np.median(around[:n])
    return out
