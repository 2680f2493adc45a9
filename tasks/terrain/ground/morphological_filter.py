"""Which cells of a height model are ground: a progressive morphological filter.

Strategy. What stands on the ground is narrower than the ground is. Openings with discs of growing radius take off ever wider
objects; a cell that sinks by more than the ground can rise over that width is no ground. Cells without a measured height take no
part: an estimate below a crown or behind a wall is no evidence for ground.

Source: Pingel, Clarke and McBride (2013), An improved simple morphological filter for the terrain classification of airborne LIDAR
data, ISPRS Journal of Photogrammetry and Remote Sensing 77.
"""

import numpy as np

HIGHER = np.float32(1e9)
"""stands in for cells without a height: erosion passes over it, and nothing opened reaches it where one height is within reach"""

SMALL_DISC = 4
"""cells: radius of the discs of which larger ones are made"""


def disc_radii(widest: float) -> tuple[int, ...]:
    """Radii of the discs, cells: doubled until they are wider than the `widest` object, cells."""
    radii = [1]
    while 2 * radii[-1] < widest:
        radii.append(2 * radii[-1])
    return tuple(radii)


def filter_halo(radii: tuple[int, ...]) -> int:
    """Cells around a tile from which its answer can follow: an opening reaches two radii, and each starts from the one before."""
    return 2 * sum(radii)


def ground_cells(heights: np.ndarray, radii: tuple[int, ...], slope: float, step: float, cell: float) -> np.ndarray:
    """Which cells (rows, cols) bool are ground.

    heights (rows, cols) float32 m, NaN where none was measured; radii in cells; `slope` is the steepest ground as a ratio, `step`
    (m) the roughness that ground always has, `cell` in m.
    """
    known = np.isfinite(heights)
    surface = np.where(known, heights, HIGHER).astype(np.float32)
    ground = known.copy()
    for radius in radii:
        opened = np.asarray(_opened(surface, radius), np.float32)
        ground &= surface - opened <= slope * radius * cell + step
        surface = opened
    return ground


def _opened(surface: np.ndarray, radius: int) -> np.ndarray:
    """The surface (rows, cols) m opened with a disc of `radius` cells, a power of 2."""
    import cv2

    # Small discs one after the other are a large one, for a fraction of its cost.
    small = min(radius, SMALL_DISC)
    border = cv2.BORDER_REPLICATE
    return cv2.morphologyEx(surface, cv2.MORPH_OPEN, _disc(small), iterations=radius // small, borderType=border)


def rings(ground: np.ndarray, margin: int) -> np.ndarray:
    """(rows, cols) uint8: 0 where there is no `ground` (rows, cols) bool, else the distance to the nearest such cell, from 1 on;
    `margin` + 1 for all that lies farther than `margin` cells."""
    import cv2

    away = cv2.distanceTransform(ground.astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return np.where(ground, np.clip(np.rint(away), 1, margin + 1), 0).astype(np.uint8)


def _disc(radius: int) -> np.ndarray:
    """uint8 (2 radius + 1, 2 radius + 1)."""
    row, col = np.ogrid[-radius : radius + 1, -radius : radius + 1]
    return (row**2 + col**2 <= radius**2).astype(np.uint8)
