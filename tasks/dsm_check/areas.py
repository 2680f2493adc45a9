"""Where the surface is wrong: connected areas of significant corrections, found on a coarse raster of blocks of cells.

Strategy. Each tile leaves two numbers per block: the share of its checked cells whose correction is significant, and their mean
correction. One job then sees the whole as a small raster, joins neighbouring blocks of the same sign, and ranks the areas by
volume.
"""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import find_objects, label

from schemas.raster import MapGrid

SHARE, MEAN = range(2)


@dataclass(frozen=True)
class SuspiciousArea:
    """A connected area whose surface is too high or too low."""

    x: float
    y: float
    """m, centroid"""
    area: float
    """m2"""
    dh: float
    """m, mean correction: negative where the surface is too high"""
    extreme: float
    """m, of the block that is worst"""


def block_size(shape: tuple[int, int], cells: int = 8, most: int = 1024) -> int:
    """Side of a block in cells, 8 to 64, so that the coarse raster has at most `most` rows and columns if that is possible."""
    while cells < 64 and max(shape) > cells * most:
        cells *= 2
    return cells


def blocks(dh: np.ndarray, sigma: np.ndarray, size: int, significance: float) -> np.ndarray:
    """(rows, cols, 2) float32 of a tile (rows, cols) m: share of significant cells among the checked, and their mean dh."""
    rows, cols = -(-dh.shape[0] // size), -(-dh.shape[1] // size)
    padding = (0, rows * size - dh.shape[0]), (0, cols * size - dh.shape[1])
    folded = np.pad(dh, padding, constant_values=np.nan).reshape(rows, size, cols, size)
    limit = np.pad(sigma * significance, padding, constant_values=np.nan).reshape(rows, size, cols, size)
    with np.errstate(invalid="ignore"):
        significant = np.abs(folded) > limit
    number, checked = significant.sum(axis=(1, 3)), np.isfinite(folded).sum(axis=(1, 3))
    total = np.where(significant, np.nan_to_num(folded), 0).astype(np.float64).sum(axis=(1, 3))
    return np.stack([number / np.maximum(checked, 1), total / np.maximum(number, 1)], axis=-1).astype(np.float32)


def suspicious_areas(coarse: np.ndarray, grid: MapGrid, size: int, least_share: float = 0.5) -> list[SuspiciousArea]:
    """Areas of a coarse raster (rows, cols, 2), greatest volume first; single blocks are left out as noise."""
    found = []
    for sign in (-1, 1):
        marked = (coarse[..., SHARE] >= least_share) & (np.sign(coarse[..., MEAN]) == sign)
        numbers, _ = label(marked, structure=np.ones((3, 3)))
        for k, place in enumerate(find_objects(numbers), start=1):
            rows, cols = np.nonzero(numbers[place] == k)
            rows, cols = rows + place[0].start, cols + place[1].start
            if len(rows) > 1:
                found.append(_area(coarse[rows, cols], rows, cols, grid, size))
    return sorted(found, key=lambda a: -a.area * abs(a.dh))


def _area(values: np.ndarray, rows: np.ndarray, cols: np.ndarray, grid: MapGrid, size: int) -> SuspiciousArea:
    side = size * grid.cell
    weights = values[:, SHARE].astype(np.float64)
    dh = float(np.average(values[:, MEAN], weights=weights))
    return SuspiciousArea(
        x=float(grid.west + (np.average(cols, weights=weights) + 0.5) * side),
        y=float(grid.north - (np.average(rows, weights=weights) + 0.5) * side),
        area=float(weights.sum() * side**2), dh=dh, extreme=float(values[np.argmax(np.abs(values[:, MEAN])), MEAN]),
    )
