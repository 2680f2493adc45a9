"""Heights that two pairs of photographs without a common one measured in the same cell: what one says of the other.

Strategy. Every so many-th cell in which two such pairs agree on the height gives one difference, for neighbours share their errors.
The points of a pair lie beside each other in the cell: each is taken relative to the surface there, so that a slope is no
difference. What all pairs share, the orientation and its datum, cancels as it does in the promised errors among neighbours.
"""

from dataclasses import dataclass

import numpy as np

from orthomill.schemas.accuracy.promised_errors import PairDifferences
from orthomill.schemas.epipolar import EpipolarPairs
from orthomill.schemas.raster import MapGrid, Window
from orthomill.schemas.surface import Provenance, SurfacePoints

STRIDE = 12
"""cells between samples: errors of matching are shared over about as many"""


@dataclass(frozen=True)
class CheckedPart:
    """The window of a grid whose heights are given."""

    grid: MapGrid
    window: Window

    def beside(self, x: np.ndarray, y: np.ndarray, heights: np.ndarray) -> np.ndarray:
        """Heights (N,) of the surface at places, bilinear; heights (rows, cols) m of the window."""
        col, row = self.grid.pixel(x, y)
        c, r = col - self.window.col, row - self.window.row
        left = np.clip(np.floor(c), 0, self.window.width - 2).astype(np.int64)
        top = np.clip(np.floor(r), 0, self.window.height - 2).astype(np.int64)
        u, v = c - left, r - top
        upper = heights[top, left] * (1 - u) + heights[top, left + 1] * u
        lower = heights[top + 1, left] * (1 - u) + heights[top + 1, left + 1] * u
        return upper * (1 - v) + lower * v


def pair_differences(points: SurfacePoints, heights: np.ndarray, pairs: EpipolarPairs, part: CheckedPart) -> PairDifferences:
    """The differences in a tile: its points, the heights (rows, cols) m of the surface around, and the pairs that they name."""
    if not len(points) or min(heights.shape) < 2:
        return PairDifferences(np.zeros(0), np.zeros(0))
    col, row = (np.rint(at).astype(np.int64) for at in part.grid.pixel(points.x, points.y))
    use = (col % STRIDE == 0) & (row % STRIDE == 0) & (points.code == Provenance.AGREED)
    chosen = points.take(use)
    rest = chosen.z - part.beside(chosen.x, chosen.y, heights)
    cell = (row * part.grid.cols + col)[use]
    order = np.lexsort((chosen.source, chosen.sigma, cell))
    first, second = _disjoint(cell[order], _photographs(pairs)[chosen.source[order].astype(np.int64) - 1])
    off, sigma = rest[order], chosen.sigma[order].astype(np.float64)
    difference, promised = off[first] - off[second], np.hypot(sigma[first], sigma[second])
    known = np.isfinite(difference) & np.isfinite(promised)
    return PairDifferences(difference[known], promised[known])


def _photographs(pairs: EpipolarPairs) -> np.ndarray:
    """(pairs, 2) int64: numbers of their photographs."""
    numbers = {name: k for k, name in enumerate(sorted({name for pair in pairs.pairs for name in (pair.left, pair.right)}))}
    return np.array([(numbers[pair.left], numbers[pair.right]) for pair in pairs.pairs], np.int64).reshape(-1, 2)


def _disjoint(cell: np.ndarray, photographs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rows of the surest point of every cell (N,), and of the surest one that shares none of its photographs (N, 2); only of cells
    that have both, whose rows follow each other."""
    starts = np.flatnonzero(np.diff(cell, prepend=-1))
    best = np.repeat(starts, np.diff(np.append(starts, len(cell))))
    apart = (photographs[:, :, None] != photographs[best][:, None, :]).all(axis=(1, 2))
    found = np.flatnonzero(apart)
    _, once = np.unique(cell[found], return_index=True)
    return best[found[once]], found[once]
