"""Still water: one level inside every outline of it, that of its shore.

Strategy. Photographs see waves, glare and what is mirrored, each its own, so that matching finds speckle. What the outline says is
water has one level. Along the shore, a few cells outside of the outline, the volume measured the land; the water lies where the
lowest of it begins: at the lower quartile of these heights, which a bank on one side does not lift and single wrong heights do not
lower. How far the lower half of them scatters is the standard error of the level.
"""

from collections.abc import Iterator

import numpy as np
from pydantic import BaseModel, ConfigDict
from scipy import ndimage

from orthomill.schemas.maps.wanted_area import WantedArea
from orthomill.schemas.raster import MapGrid, Window
from orthomill.schemas.surface import Provenance
from orthomill.tasks.densification.fusion import FusedCells
from orthomill.tasks.densification.volume.confidence import Confidence

SHORE = 3
"""cells outside an outline that are its shore"""
_FEWEST = 20
"""measured cells of a shore without which nothing is said of the level"""
_LOW, _LOWEST, _MIDDLE = 25, 10, 50
"""% of the shore below the level, and between which its standard error is taken"""


class WaterLevels(BaseModel):
    """Outlines of water with their levels."""

    model_config = ConfigDict(frozen=True)

    outlines: WantedArea = WantedArea()
    levels: tuple[float | None, ...] = ()
    """m, of every polygon; None: its shore was not measured"""
    sigmas: tuple[float, ...] = ()
    """m, their standard errors"""

    @property
    def unknown(self) -> int:
        """Outlines without a level."""
        return sum(level is None for level in self.levels)


NO_WATER = WaterLevels()
"""nothing is outlined"""


def taken_outlines(outlines: WantedArea) -> WantedArea:
    """The outlines of a file, for those who plan."""
    return outlines


def shore_windows(outlines: WantedArea, grid: MapGrid, windows: Iterator[Window]) -> tuple[Window, ...]:
    """Those of the windows that the shore of an outline may lie in."""
    boxes = [_box(WantedArea(polygons=(polygon,)), grid) for polygon in outlines.polygons]
    return tuple(window for window in windows if any(not window.overlap(box).empty for box in boxes))


def _box(outline: WantedArea, grid: MapGrid) -> Window:
    west, south, east, north = outline.bounds
    cols, rows = grid.pixel(np.array([west, east]), np.array([north, south]))
    row, col = int(np.floor(rows[0])), int(np.floor(cols[0]))
    return Window(row, col, int(np.ceil(rows[1])) - row + 1, int(np.ceil(cols[1])) - col + 1).grown(SHORE + 1)


def water_levels(
    outlines: WantedArea, grid: MapGrid, windows: tuple[Window, ...], height: Iterator[np.ndarray], confidence: Iterator[np.ndarray]
) -> WaterLevels:
    """The level of every outline. height (rows, cols) m and confidence (rows, cols), see `Confidence`: of the windows, in order."""
    polygons = [WantedArea(polygons=(polygon,)) for polygon in outlines.polygons]
    shores: list[list[np.ndarray]] = [[] for _ in polygons]
    for window, heights, codes in zip(windows, height, confidence, strict=True):
        around = window.grown(SHORE)
        inner = window.within(around).slices
        measured, water = (codes == Confidence.HIGH) & np.isfinite(heights), outlines.cells(grid, window)
        for outline, shore in zip(polygons, shores, strict=True):
            near = ndimage.binary_dilation(outline.cells(grid, around), np.ones((2 * SHORE + 1,) * 2))[inner]
            shore.append(heights[near & measured & ~water])
    found = [_level(np.concatenate(shore) if shore else np.empty(0)) for shore in shores]
    return WaterLevels(outlines=outlines, levels=tuple(level for level, _ in found), sigmas=tuple(sigma for _, sigma in found))


def _level(shore: np.ndarray) -> tuple[float | None, float]:
    if len(shore) < _FEWEST:
        return None, 0.0
    lowest, low, middle = np.percentile(shore.astype(np.float64), (_LOWEST, _LOW, _MIDDLE))
    return float(low), float(middle - lowest) / 2


def levelled(cells: FusedCells, water: WaterLevels, grid: MapGrid, window: Window) -> FusedCells:
    """The cells `window` with one height inside every outline that has a level."""
    for polygon, level, sigma in zip(water.outlines.polygons, water.levels, water.sigmas, strict=True):
        inside = WantedArea(polygons=(polygon,)).cells(grid, window)
        if level is not None and inside.any():
            cells = FusedCells(
                np.where(inside, np.float32(level), cells.height),
                np.where(inside, np.float32(sigma), cells.precision),
                np.where(inside, np.uint8(0), cells.count),
                np.where(inside, np.uint8(Provenance.WATER), cells.provenance),
            )
    return cells
