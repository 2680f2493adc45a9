"""Where the surface is wrong: its trend, and connected areas that deviate from it, found on a coarse raster of blocks of cells.

Strategy. Each tile leaves three numbers per block of cells: the share that was checked, the mean correction and its mean standard
error. One job then sees the whole as a small raster. A plane through the blocks, robust against the areas, is the trend
(a surface that is shifted or tilted as a whole is a matter of orientation or datum, not of places); neighbouring blocks that
deviate from it significantly and with the same sign are one area. Areas are ranked by volume.
"""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import find_objects, label

from orthomill.schemas.raster import MapGrid

CHECKED, MEAN, SIGMA = range(3)


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


@dataclass(frozen=True)
class Trend:
    """A plane through the corrections: dh at the middle of the surface (m), and how it grows to the east and to the north."""

    middle: float
    east: float
    north: float
    """m per km"""
    range: float
    """m between its lowest and its highest corner"""


def block_size(shape: tuple[int, int], cells: int = 8, most: int = 1024) -> int:
    """Side of a block in cells, 8 to 64, so that the coarse raster has at most `most` rows and columns if that is possible."""
    while cells < 64 and max(shape) > cells * most:
        cells *= 2
    return cells


def blocks(dh: np.ndarray, sigma: np.ndarray, size: int) -> np.ndarray:
    """(rows, cols, 3) float32 of a tile (rows, cols) m: share of checked cells, their mean dh and mean sigma (0 without any)."""
    rows, cols = -(-dh.shape[0] // size), -(-dh.shape[1] // size)
    padding = (0, rows * size - dh.shape[0]), (0, cols * size - dh.shape[1])
    folded, spread = (np.pad(a, padding, constant_values=np.nan).reshape(rows, size, cols, size) for a in (dh, sigma))
    number = np.isfinite(folded).sum(axis=(1, 3))
    sums = [np.nan_to_num(a).astype(np.float64).sum(axis=(1, 3)) for a in (folded, spread)]
    return np.stack([number / size**2, *(total / np.maximum(number, 1) for total in sums)], axis=-1).astype(np.float32)


def fitted_trend(coarse: np.ndarray, grid: MapGrid, size: int) -> tuple[Trend, np.ndarray]:
    """The plane through the blocks (rows, cols, 3), and its value (rows, cols) m in every block.

    Iterated least squares with Huber weights; a constant where fewer than 30 blocks were checked.
    """
    rows, cols = np.indices(coarse.shape[:2])
    km = size * grid.cell / 1000
    design = np.stack([np.ones(rows.shape), (cols - cols.mean()) * km, (rows.mean() - rows) * km], axis=-1)
    known = coarse[..., CHECKED] > 0.3
    plane = np.zeros(3)
    if known.sum() >= 30:
        plane = _robust_plane(design[known], coarse[known][:, MEAN].astype(np.float64))
    elif known.any():
        plane[0] = np.median(coarse[known][:, MEAN])
    values = design @ plane
    return Trend(*map(float, plane), float(np.ptp(values))), values


def _robust_plane(design: np.ndarray, dh: np.ndarray) -> np.ndarray:
    plane = np.array([np.median(dh), 0.0, 0.0])
    for _ in range(20):
        residual = np.abs(dh - design @ plane)
        limit = 1.5 * max(1.4826 * np.median(residual), 1e-6)
        weight = np.minimum(1.0, limit / np.maximum(residual, 1e-12))[:, None]
        plane = np.linalg.lstsq(design * np.sqrt(weight), dh * np.sqrt(weight[:, 0]), rcond=None)[0]
    return plane


def suspicious_areas(coarse: np.ndarray, trend: np.ndarray, grid: MapGrid, size: int, significance: float) -> list[SuspiciousArea]:
    """Areas of a coarse raster (rows, cols, 3) that leave the trend (rows, cols), greatest volume first.

    Single blocks are left out as noise.
    """
    found = []
    deviation = coarse[..., MEAN] - trend
    marked = (coarse[..., CHECKED] > 0.3) & (np.abs(deviation) > significance * coarse[..., SIGMA])
    for sign in (-1, 1):
        numbers, _ = label(marked & (np.sign(deviation) == sign), structure=np.ones((3, 3)))
        for k, place in enumerate(find_objects(numbers), start=1):
            rows, cols = np.nonzero(numbers[place] == k)
            rows, cols = rows + place[0].start, cols + place[1].start
            if len(rows) > 1:
                found.append(_area(deviation[rows, cols], coarse[rows, cols, CHECKED], (rows, cols), grid, size))
    return sorted(found, key=lambda a: -a.area * abs(a.dh))


def _area(dh: np.ndarray, weights: np.ndarray, place: tuple[np.ndarray, np.ndarray], grid: MapGrid, size: int) -> SuspiciousArea:
    side = size * grid.cell
    volume = np.abs(dh) * weights
    return SuspiciousArea(
        x=float(grid.west + (np.average(place[1], weights=volume) + 0.5) * side),
        y=float(grid.north - (np.average(place[0], weights=volume) + 0.5) * side),
        area=float(weights.sum() * side**2),
        dh=float(np.average(dh, weights=weights)),
        extreme=float(dh[np.argmax(np.abs(dh))]),
    )
