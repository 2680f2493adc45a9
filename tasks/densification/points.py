"""The matched nodes of all pairs as points: true places in space instead of one height per cell.

Strategy: pairs come one at a time. Every node falls into one cell of the surface model; of all nodes of a cell those of the
smallest standard error are kept, so that memory does not depend on the number of pairs, and steep places (walls, crowns) keep nodes
at several heights. A set of bits per cell remembers which photographs measured there. Nodes with equal standard errors keep the
order of the pairs, and a cell belongs to one tile: the points are the same for any tiling.
"""

from typing import NamedTuple

import numpy as np

from orthomill.kernels.kernel_compilation import njit
from orthomill.schemas.epipolar import EpipolarPair
from orthomill.schemas.memory import array_bytes
from orthomill.schemas.raster import MapGrid, Window
from orthomill.schemas.surface import MEASURED, Provenance, SurfacePoints
from orthomill.tasks.densification.ground_intersection import NodesOnGround
from orthomill.tasks.densification.settings.surface_settings import PointThinning

_WORD = 64
"""photographs per word of a set of bits"""


class _KeptNodes(NamedTuple):
    """What is kept of the cells of a window: standard errors (rows, cols, most) m, ascending, inf in free places; places (..., 3)
    m; numbers of pairs; photographs as bits (rows, cols, words)."""

    sigma: np.ndarray
    xyz: np.ndarray
    source: np.ndarray
    photos: np.ndarray


class _TileCorner(NamedTuple):
    """Origin of the grid and side of a cell, m; first row and column of the window."""

    west: float
    north: float
    cell: float
    row: int
    col: int


class _PairBits(NamedTuple):
    """A pair: its number from 1, and the word and bit of its two photographs."""

    number: int
    left_word: int
    left_bit: np.uint64
    right_word: int
    right_bit: np.uint64


@njit()
def _keep(nodes, accepted, corner, source, cells):
    """Keep the `accepted` nodes of one pair in `cells`: in each the most precise points, the best one first, and who sees it."""
    rows, cols, most = cells.sigma.shape
    for i in range(accepted.shape[0]):
        for j in range(accepted.shape[1]):
            if not accepted[i, j] or np.isnan(nodes.z[i, j]):
                continue
            c = int(np.floor((nodes.x[i, j] - corner.west) / corner.cell)) - corner.col
            r = int(np.floor((corner.north - nodes.y[i, j]) / corner.cell)) - corner.row
            if r < 0 or c < 0 or r >= rows or c >= cols:
                continue
            cells.photos[r, c, source.left_word] |= source.left_bit
            cells.photos[r, c, source.right_word] |= source.right_bit
            sigma, place = nodes.sigma[i, j], most
            while place > 0 and sigma < cells.sigma[r, c, place - 1]:
                place -= 1
            for k in range(most - 1, place, -1):
                cells.sigma[r, c, k] = cells.sigma[r, c, k - 1]
                cells.xyz[r, c, k] = cells.xyz[r, c, k - 1]
                cells.source[r, c, k] = cells.source[r, c, k - 1]
            if place < most:
                cells.sigma[r, c, place], cells.source[r, c, place] = sigma, source.number
                xyz = cells.xyz[r, c, place]
                xyz[0], xyz[1], xyz[2] = nodes.x[i, j], nodes.y[i, j], nodes.z[i, j]


class _NodePlaces(NamedTuple):
    """(rows, cols) of the nodes of a pair: place float64 and standard error float32, m."""

    x: np.ndarray
    y: np.ndarray
    z: np.ndarray
    sigma: np.ndarray


class PointCollector:
    """The points of a tile, gathered from one pair after another."""

    def __init__(self, grid: MapGrid, window: Window, photos: tuple[str, ...], thinning: PointThinning) -> None:
        """`window`: the tile's own cells; `photos`: the photographs of all pairs that will be added."""
        shape, words = (*window.shape, thinning.most_per_cell), -(-max(len(photos), 1) // _WORD)
        self._photos = {name: number for number, name in enumerate(photos)}
        self._corner = _TileCorner(float(grid.west), float(grid.north), float(grid.cell), window.row, window.col)
        self._cells = _KeptNodes(
            np.full(shape, np.inf, np.float32),
            np.zeros((*shape, 3)),
            np.zeros(shape, np.uint16),
            np.zeros((*window.shape, words), np.uint64),
        )

    def add(self, number: int, pair: EpipolarPair, nodes: NodesOnGround, accepted: np.ndarray) -> None:
        """Adds the `accepted` (rows, cols) bool nodes of a pair; number: its place in the list of pairs, from 0.

        Pairs are added in the order of their numbers. Nodes outside the tile are ignored.
        """
        left, right = self._photos[pair.left], self._photos[pair.right]
        bits = [(photo // _WORD, np.uint64(1 << photo % _WORD)) for photo in (left, right)]
        source = _PairBits(number + 1, *bits[0], *bits[1])
        _keep(_NodePlaces(nodes.x, nodes.y, nodes.z, nodes.sigma), accepted, self._corner, source, self._cells)

    def points(self, provenance: np.ndarray) -> SurfacePoints:
        """The points; provenance (rows, cols): codes of the tile's own cells."""
        kept = np.isfinite(self._cells.sigma)
        rays = np.minimum(np.bitwise_count(self._cells.photos).sum(axis=2), 255)
        # A node is matched in one pair at least, also where the cell as a whole got no measured height.
        codes = np.where(np.isin(provenance, MEASURED), provenance, Provenance.ONE_PAIR)
        rays, codes = (np.broadcast_to(cells[..., None], kept.shape)[kept].astype(np.uint8) for cells in (rays, codes))
        x, y, z = (np.ascontiguousarray(values) for values in self._cells.xyz[kept].T)
        return SurfacePoints(x=x, y=y, z=z, sigma=self._cells.sigma[kept], rays=rays, code=codes, source=self._cells.source[kept])


def points_bytes(window: Window, photos: int, thinning: PointThinning) -> int:
    """Memory of a collector and of its table, bytes."""
    # Standard error, place and pair of every kept node, twice while the table is made; bits of photographs, codes and counts.
    per_cell = 2 * thinning.most_per_cell * (4 + 24 + 2 + 2) + 8 * -(-max(photos, 1) // _WORD) + 4
    return array_bytes(per_cell, window)
