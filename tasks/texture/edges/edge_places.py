"""Places along the edges of roofs and walls: where pixels that chose the upper surface end.

Near a wall every pixel of the orthoimage chose the upper or the lower of two surfaces (`colouring.edges`). The border between them
is the edge to a pixel or two; the places along it are where it is then measured in the photographs.
"""

from typing import NamedTuple

import numpy as np
from scipy import ndimage

SPACING = 2
"""cells: about one place in so many along an edge"""
DIRECTION = 5 / 3
"""cells: standard deviation of the Gaussian over which the direction of an edge is averaged"""
HALO = 5
"""cells around a place whose choice takes part"""


class Places(NamedTuple):
    """Places (N,) on the upper side of an edge: `row`, `col` of their pixels; `normal` (N, 2) unit vectors (to the right, down),
    from the upper surface outwards."""

    row: np.ndarray
    col: np.ndarray
    normal: np.ndarray


def edge_places(raised: np.ndarray, parted: np.ndarray, corner: tuple[int, int], core: tuple[slice, slice], divisor: int) -> Places:
    """The places in the `core` of pixels (rows, cols) where the upper surface ends.

    raised: whether the upper surface is there; parted: whether there are two; bool. corner: row and column of the first pixel in
    the whole orthoimage, so that every tiling takes the same places; divisor: pixels along a cell.
    """
    beside = ndimage.binary_dilation(parted & ~raised, np.ones((3, 3), bool))
    border = parted & raised & beside
    down, right = np.indices(raised.shape, dtype=np.int64)
    # An odd step from row to row, so that edges along rows, columns and diagonals all have places.
    lattice = (3 * (down + corner[0]) + right + corner[1]) % (SPACING * divisor) == 0
    chosen = np.zeros(raised.shape, bool)
    chosen[core] = (border & lattice)[core]
    row, col = np.nonzero(chosen)
    normal = _outward(raised & parted, parted, row, col, DIRECTION * divisor)
    known = np.isfinite(normal).all(axis=1)
    return Places(row[known], col[known], normal[known])


def _outward(raised: np.ndarray, parted: np.ndarray, row: np.ndarray, col: np.ndarray, sigma: float) -> np.ndarray:
    """Unit vectors (N, 2) (right, down) down the share of the upper surface around the places; NaN where it has no slope."""
    if not len(row):
        return np.zeros((0, 2))
    share, weight = (
        ndimage.gaussian_filter(part.astype(np.float64), sigma, truncate=HALO / DIRECTION) for part in (raised, parted)
    )
    share = share / np.maximum(weight, 1e-6)
    rows, cols = raised.shape
    down = share[np.maximum(row - 1, 0), col] - share[np.minimum(row + 1, rows - 1), col]
    right = share[row, np.maximum(col - 1, 0)] - share[row, np.minimum(col + 1, cols - 1)]
    length = np.hypot(right, down)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.column_stack([right, down]) / np.where(length > 1e-6, length, np.nan)[:, None]
