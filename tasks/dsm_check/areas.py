"""Where the surface is wrong: its trend, and connected areas that deviate from it, found on a coarse raster of blocks of cells.

Strategy. Each tile yields three numbers per block of cells: the share that was checked, the mean correction and its mean standard
error. One job then sees the whole surface as a small raster. A plane through the blocks, robust against the areas, is the trend (a
shift or tilt of the whole surface is an error of orientation or datum, not a local one). Neighbouring blocks that deviate from it
significantly and with the same sign form an area. Areas are ranked by volume.
"""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import find_objects, label

from orthomill.schemas.raster import MapGrid

CoarseBlocks = np.ndarray
"""float32 (rows, cols, 5): `blocks` and `slopes` of the check in blocks of cells"""
CHECKED, MEAN, SIGMA, EAST, NORTH = range(5)
"""bands of the coarse raster"""
_JUDGED = 0.3
"""share of a block that must have been checked: the mean of fewer cells is that of their edges and trees"""
_FINEST = 1e-3
"""m: standard errors below it weigh no more"""
_LEAST_BLOCKS = 30
"""blocks that a plane needs; below, a few buildings would tilt it"""


@dataclass(frozen=True, eq=False)
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
    """m, of the worst block"""
    blocks: np.ndarray
    """(N, 2) row and column of its blocks"""


@dataclass(frozen=True)
class Trend:
    """A plane through the corrections: dh at the middle of the surface (m), and its gradients to the east and to the north."""

    middle: float
    east: float
    north: float
    """m per km"""
    range: float
    """m, between its lowest and its highest corner"""


def block_size(shape: tuple[int, int], cells: int = 8, most: int = 1024) -> int:
    """Side of a block in cells, 8 to 64: the smallest that keeps the coarse raster within `most` rows and columns, if possible."""
    # powers of two up to 64, of which every tile size is a multiple: tiles write whole blocks
    while cells < 64 and max(shape) > cells * most:
        cells *= 2
    return cells


def blocks(dh: np.ndarray, sigma: np.ndarray, size: int) -> np.ndarray:
    """(rows, cols, 3) float32 of a tile (rows, cols) m: share of checked cells, their dh and their sigma, both means weighted by
    precision (0 without any)."""
    rows, cols = -(-dh.shape[0] // size), -(-dh.shape[1] // size)
    # sums of float64, not means of means: blocks at the border of the surface hold fewer cells
    padding = (0, rows * size - dh.shape[0]), (0, cols * size - dh.shape[1])
    folded, spread = (np.pad(a, padding, constant_values=np.nan).reshape(rows, size, cols, size) for a in (dh, sigma))
    known = np.isfinite(folded)
    # At the walls of a wrong house a correction is known to metres only, and would hide how certain the others are.
    weight = np.where(known, np.maximum(np.nan_to_num(spread, nan=1.0).astype(np.float64), _FINEST) ** -2, 0.0)
    whole = np.maximum(weight.sum(axis=(1, 3)), 1e-12)
    means = [(weight * np.nan_to_num(a)).sum(axis=(1, 3)) / whole for a in (folded, spread)]
    return np.stack([known.sum(axis=(1, 3)) / size**2, *means], axis=-1).astype(np.float32)


def slopes(heights: np.ndarray, dh: np.ndarray, size: int, cell: float) -> np.ndarray:
    """(rows, cols, 2) float32: slopes to the east and to the north of heights (m) in blocks, from their cells with a correction."""
    # Half against half, within the block: a gradient at its border would read cells of the next tile.
    known = np.where(np.isfinite(dh), heights, np.nan).astype(np.float64)
    rows, cols = -(-dh.shape[0] // size), -(-dh.shape[1] // size)
    padding = (0, rows * size - dh.shape[0]), (0, cols * size - dh.shape[1])
    folded = np.pad(known, padding, constant_values=np.nan).reshape(rows, size, cols, size)
    half, length = size // 2, size / 2 * cell
    east = _mean(folded[..., half:]) - _mean(folded[..., :half])
    north = _mean(folded[:, :half]) - _mean(folded[:, half:])
    return np.nan_to_num(np.stack([east, north], axis=-1) / length).astype(np.float32)


def _mean(folded: np.ndarray) -> np.ndarray:
    """Means (rows, cols) over the second and the fourth axis of known values; NaN without any."""
    number = np.isfinite(folded).sum(axis=(1, 3))
    return np.where(number > 0, np.nan_to_num(folded).sum(axis=(1, 3)) / np.maximum(number, 1), np.nan)


def is_judged(coarse: np.ndarray) -> np.ndarray:
    """Which blocks (rows, cols) bool of a coarse raster (rows, cols, 3) have enough checked cells to speak for themselves."""
    return np.asarray(coarse[..., CHECKED] > _JUDGED)


def fitted_trend(coarse: np.ndarray, grid: MapGrid, size: int) -> tuple[Trend, np.ndarray]:
    """The plane through the blocks (rows, cols, 3), and its value (rows, cols) m in every block.

    Iterated least squares with robust weights; a constant where fewer than 30 blocks were checked.
    """
    rows, cols = np.indices(coarse.shape[:2])
    km = size * grid.cell / 1000
    design = np.stack([np.ones(rows.shape), (cols - cols.mean()) * km, (rows.mean() - rows) * km], axis=-1)
    known = is_judged(coarse)
    plane = np.zeros(3)
    if known.sum() >= _LEAST_BLOCKS:
        plane = _robust_plane(design[known], coarse[known][:, MEAN].astype(np.float64))
    elif known.any():
        plane[0] = np.median(coarse[known][:, MEAN])
    values = design @ plane
    middle, east, north = map(float, plane)
    return Trend(middle, east, north, float(np.ptp(values))), values


def _robust_plane(design: np.ndarray, dh: np.ndarray) -> np.ndarray:
    """Coefficients (3,) of dh (N,) over design (N, 3), by iterated least squares with Huber's weights and then Tukey's.

    Source: Tukey's biweight, Beaton & Tukey 1974, with the usual constant 4.685.
    """
    # Starts from the median: a start by plain least squares follows a large area and may not leave it again.
    plane = np.array([np.median(dh), 0.0, 0.0])
    for turn in range(30):
        residual = np.abs(dh - design @ plane)
        scale = max(1.4826 * float(np.median(residual)), 1e-6)
        # Huber's weights never vanish: a bump of 25 m would still tilt the plane. Tukey's do, but need a good start.
        huber = np.minimum(1.0, 1.5 * scale / np.maximum(residual, 1e-12))
        weight = huber if turn < 10 else np.maximum(1.0 - (residual / (4.685 * scale)) ** 2, 0.0) ** 2
        plane = np.linalg.lstsq(design * np.sqrt(weight)[:, None], dh * np.sqrt(weight), rcond=None)[0]
    return plane


def suspicious_areas(coarse: np.ndarray, trend: np.ndarray, grid: MapGrid, size: int, significance: float) -> list[SuspiciousArea]:
    """Areas of a coarse raster (rows, cols, 3) that deviate from the trend (rows, cols), largest volume first.

    Single blocks are left out as noise.
    """
    # Significance by the mean sigma, not divided by the root of the cells in a block: the corrections of neighbouring cells come
    # from overlapping windows and are correlated.
    found = []
    deviation = coarse[..., MEAN] - trend
    marked = is_judged(coarse) & (np.abs(deviation) > significance * coarse[..., SIGMA])
    # signs apart: a hollow next to a bump is two errors, and their volumes must not cancel
    for sign in (-1, 1):
        numbers, _ = label(marked & (np.sign(deviation) == sign), structure=np.ones((3, 3)))
        for k, place in enumerate(find_objects(numbers), start=1):
            rows, cols = np.nonzero(numbers[place] == k)
            rows, cols = rows + place[0].start, cols + place[1].start
            if len(rows) > 1:
                found.append(_area(deviation[rows, cols], coarse[rows, cols, CHECKED], (rows, cols), grid, size))
    return sorted(found, key=lambda a: -a.area * abs(a.dh))


def _area(dh: np.ndarray, weights: np.ndarray, place: tuple[np.ndarray, np.ndarray], grid: MapGrid, size: int) -> SuspiciousArea:
    # the centroid of the volume, not of the outline: it leads to the place where the error is largest
    side = size * grid.cell
    volume = np.abs(dh) * weights
    return SuspiciousArea(
        x=float(grid.west + (np.average(place[1], weights=volume) + 0.5) * side),
        y=float(grid.north - (np.average(place[0], weights=volume) + 0.5) * side),
        area=float(weights.sum() * side**2),
        dh=float(np.average(dh, weights=weights)),
        extreme=float(dh[np.argmax(np.abs(dh))]),
        blocks=np.column_stack(place),
    )
