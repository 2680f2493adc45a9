"""How the errors that orientations give to heights go together over a block: level, tilt and bend, over kilometres.

Two places far apart do not share all of that error: a block that leans is too high here and too low there, which no correlation
of neighbours tells. The adjustment does: from the covariances of its photographs and cameras follow those of the heights of any
two places. They are taken on a lattice over the surface, and between its places bilinearly.
"""

from dataclasses import dataclass

import numpy as np

from orthomill.schemas.orientation import Block
from orthomill.schemas.raster import MapGrid
from orthomill.tasks.accuracy.adjustment.joint_covariance import StoredCovariance, WeighedRays

NODES = 7
"""places along a side: level and tilt are straight over the whole block, and a bend is nearly so over a sixth of it"""


@dataclass(frozen=True, eq=False)
class DatumLattice:
    """Covariance (n, n) m2 of the errors of the datum at the places of `rows` and `cols` (cells of the surface, rising), row by
    row; NaN where the adjustment did not store it."""

    rows: np.ndarray
    cols: np.ndarray
    covariance: np.ndarray

    def sigma(self, weights: np.ndarray, datum: np.ndarray, corner: tuple[int, int]) -> float:
        """Standard error of the sum of `weights` (rows, cols) times errors of the datum, of the cells from `corner` (row, column)
        on; datum (rows, cols): their standard errors, m. Where a covariance is not known the error counts as common to all cells.
        """
        nodes = self.shared(weights, datum, corner)
        if nodes is None:
            return abs(float((weights * datum).sum()))
        return float(np.sqrt(max(nodes @ np.nan_to_num(self.covariance) @ nodes, 0.0)))

    def shared(self, weights: np.ndarray, datum: np.ndarray, corner: tuple[int, int]) -> np.ndarray | None:
        """What of the weights falls to each of the places (n,); None where a covariance of theirs is not known.

        Level and lean of a block are straight between places, so that they cancel where weights do. What is stated for the cells
        (by pairs, not by all photographs together) differs by some per cent: all weights are changed by the one factor that makes
        up for it.
        """
        # A height in a large window has a part in four cells: the others cost and say nothing.
        rows, cols = (np.flatnonzero(weights.any(axis=axis)) for axis in (1, 0))
        weights, datum = weights[np.ix_(rows, cols)], datum[np.ix_(rows, cols)]
        down, across = _shares(self.rows, corner[0] + rows), _shares(self.cols, corner[1] + cols)
        used = np.outer(down.any(axis=0), across.any(axis=0)).ravel()
        if np.isnan(self.covariance[np.ix_(used, used)]).any():
            return None
        n, m = len(self.rows), len(self.cols)
        pairs = np.nan_to_num(self.covariance).reshape(n, m, n, m).transpose(0, 2, 1, 3).reshape(n * n, m * m)
        own = _products(down) @ pairs @ _products(across).T
        stated, found = (float((np.abs(weights) * variance).sum()) for variance in (datum.astype(np.float64) ** 2, own))
        factor = np.sqrt(stated / found) if found > 0 else 1.0
        return np.asarray(factor * (down.T @ weights @ across).ravel())


def _products(shares: np.ndarray) -> np.ndarray:
    """(cells, places^2): of the shares of every two places."""
    return np.asarray((shares[:, :, None] * shares[:, None, :]).reshape(len(shares), -1))


def _shares(places: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """(cells, places): bilinear weights of the places along one side for some cells; the nearest one beyond."""
    at = np.interp(cells, places, np.arange(len(places)))
    return np.maximum(1.0 - np.abs(at[:, None] - np.arange(len(places))[None, :]), 0.0)


def datum_lattice(block: Block, grid: MapGrid) -> DatumLattice | None:
    """The lattice of a surface (its `grid`) that a block made; None where the block states no covariances."""
    rows, cols = (np.linspace(0.0, count - 1.0, NODES) for count in grid.shape)
    stored = StoredCovariance(block, 0.0)
    x, y = np.meshgrid(grid.west + (cols + 0.5) * grid.cell, grid.north - (rows + 0.5) * grid.cell)
    places = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, block.ground_mean)])
    found = [stored.rays(place) for place in places]
    seen = [k for k, rays in enumerate(found) if rays is not None]
    if not seen:
        return None
    heights = [rays.seen(np.array([[0.0, 0.0, 1.0]])) for rays in found if rays is not None]
    covariance = _covariance(stored, heights)
    # Where fewer than two photographs see the ground, the nearest place that they see stands for it.
    nearest = np.array([np.argmin(np.hypot(*(places[seen] - place)[:, :2].T)) for place in places])
    return DatumLattice(rows, cols, covariance[np.ix_(nearest, nearest)])


def _covariance(stored: StoredCovariance, heights: list[WeighedRays]) -> np.ndarray:
    """(n, n) m2 of heights as their rays determine them; NaN where it is not stored."""
    covariance = np.full((len(heights), len(heights)), np.nan)
    for i, one in enumerate(heights):
        for j in range(i + 1):
            found = stored.of_points(one, heights[j])
            if found is not None:
                covariance[i, j] = covariance[j, i] = found[0, 0]
    return covariance
