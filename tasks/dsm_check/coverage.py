"""Selection of the pairs that check the surface, and of their parts of it.

Strategy. The common ground of a pair is a polygon. Pairs are selected greedily, first the one that adds most unchecked ground,
weighted by base over height, until all ground that can be checked is covered once. Each pair then gets the window of the surface
model that encloses its polygon, aligned with tiles.
"""

import numpy as np
from pydantic import BaseModel, ConfigDict

from orthomill.schemas.epipolar import EpipolarPair, EpipolarPairs
from orthomill.schemas.errors import GeometryError
from orthomill.schemas.job import Table
from orthomill.schemas.orientation import Block
from orthomill.schemas.raster import MapGrid, Window
from orthomill.schemas.surface import Surface
from orthomill.tasks.geometry.normal_case import border_pixels, common_polygon, convex
from orthomill.tasks.geometry.view import block_view

_CELLS = 96
"""cells along the longer side of the raster on which coverage is counted"""
_NEGLIGIBLE = 0.005
"""share of the ground that can be checked: a pair that adds less costs as much as any other and brings next to nothing"""
_STEEP = 0.6
"""base over height beyond which a pair is not preferred any more: precision still grows, but its photographs differ too much"""


class CheckedPair(BaseModel):
    """A pair that checks the surface, and its window of the surface model (row, col, height, width in cells)."""

    model_config = ConfigDict(frozen=True)

    name: str
    left: str
    right: str
    box: tuple[int, int, int, int]
    base_height: float
    share: float
    """of the surface model's area that this pair is the first to check"""
    direction: tuple[float, float] = (0.0, 0.0)
    """unit vector of the base from left to right, east and north; zeros where it is not known"""

    @property
    def window(self) -> Window:
        """`box` as a window of the surface's grid."""
        return Window(*self.box)


class CheckedPairs(BaseModel):
    """The pairs that check the surface, and the number of orthoimage pixels along a cell."""

    model_config = ConfigDict(frozen=True)

    pairs: tuple[CheckedPair, ...]
    pixels_per_cell: int
    pixel_height: float
    """m: height error that shifts the two orthoimages by one pixel, mean over the pairs"""


CHECKED_PAIRS = Table("dsm_check/pairs.json", CheckedPairs)


def choose_checked_pairs(
    pairs: EpipolarPairs,
    block: Block,
    surface: Surface,
    tile: int,
    count: int | None,
    pixels_per_cell: int | None,
    per_place: int = 1,
) -> CheckedPairs:
    """The pairs that cover every place `per_place` times, if there are as many (at most `count` pairs), with their windows on the
    grid in whole tiles.

    Raises GeometryError when no pair shows the surface.
    """
    grid = surface.grid
    polygons = [seen_ground(pair, block, surface) for pair in pairs.pairs]
    # Steeper pairs measure heights better: the greedy choice weighs ground gained by base over height.
    nothing = np.zeros_like(rasterised(np.empty((0, 2)), grid))
    covers = [covered(pair, block, surface) if len(p) else nothing for pair, p in zip(pairs.pairs, polygons, strict=True)]
    order = best_cover(covers, [p.base_height for p in pairs.pairs], count, per_place)
    if not order:
        raise GeometryError(
            "No pair of photographs shows the surface model: it is of another place or in another reference system. Check its CRS."
        )
    chosen = tuple(_checked_pair(pairs.pairs[k], share, _box(polygons[k], grid, tile), block) for k, share in order)
    # The orthoimages should resolve what the photographs show: coarser pixels lose the texture that matching needs.
    factor = pixels_per_cell or (2 if grid.cell > 1.5 * ground_pixel(block, surface) else 1)
    ratio = float(np.mean([1 / pair.base_height for pair in chosen]))
    return CheckedPairs(pairs=chosen, pixels_per_cell=factor, pixel_height=grid.cell / factor * ratio)


def _checked_pair(pair: EpipolarPair, share: float, box: tuple[int, int, int, int], block: Block) -> CheckedPair:
    base = np.subtract(block.of(pair.right).centre, block.of(pair.left).centre)[:2]
    east, north = base / max(float(np.hypot(*base)), 1e-9)
    return CheckedPair(
        name=pair.name,
        left=pair.left,
        right=pair.right,
        base_height=pair.base_height,
        share=share,
        box=box,
        direction=(float(east), float(north)),
    )


def covered(pair: EpipolarPair, block: Block, surface: Surface) -> np.ndarray:
    """Which places (bool) of the coarse raster both photographs show, whether the ground is as low as the lowest tie points or as
    high as the highest."""
    # What they may show between the bounds of a surface from a file is far more: at the border of the block it hides, as a ground
    # that is covered already, what another pair shows in truth.
    low, high = (rasterised(_common_ground(pair, block, z), surface.grid) for z in (block.ground_low, block.ground_high))
    both = low & high
    # On a mountain side the two may have nothing in common.
    return both if both.any() else rasterised(seen_ground(pair, block, surface), surface.grid)


def _common_ground(pair: EpipolarPair, block: Block, z: float) -> np.ndarray:
    """Convex polygon (N, 2) m of what both photographs show of a level ground at height z (m); (0, 2) without any."""
    views = block_view(block, pair.left), block_view(block, pair.right)
    return common_polygon(*(convex(view.at_height(border_pixels(view), z)[:, :2]) for view in views))


def seen_ground(pair: EpipolarPair, block: Block, surface: Surface) -> np.ndarray:
    """Convex polygon (N, 2) m of the ground that both photographs may show between the height bounds; (0, 2) without any."""
    parts = [_common_ground(pair, block, z) for z in (surface.height_low, surface.height_high)]
    # generously, at both heights: a place at the border that turns out invisible only costs nodes that are OUTSIDE
    corners = np.concatenate(parts)
    return convex(corners) if len(corners) > 2 else np.empty((0, 2))


def ground_pixel(block: Block, surface: Surface) -> float:
    """Mean ground pixel of the photographs, m."""
    # vertical photographs are assumed; a factor of 1.5 in the only use forgives the tilt
    mean = (surface.height_low + surface.height_high) / 2
    return float(np.mean([(photo.centre[2] - mean) / block.camera_of(photo.photo).c for photo in block.photos]))


def rasterised(polygon: np.ndarray, grid: MapGrid) -> np.ndarray:
    """Which places (bool) of a coarse raster of the grid (96 along the longer side) lie inside a convex polygon (N, 2) m."""
    # coverage decides on pairs, not on cells: a percent of the surface is fine enough
    size = max(grid.rows, grid.cols) * grid.cell / _CELLS
    x = grid.west + (np.arange(int(np.ceil(grid.cols * grid.cell / size))) + 0.5) * size
    y = grid.north - (np.arange(int(np.ceil(grid.rows * grid.cell / size))) + 0.5) * size
    inside = np.full((len(y), len(x)), len(polygon) > 2)
    # OpenCV returns convex polygons in either orientation: the sign of the area says which side is inside
    turn = np.sign(_turn(polygon)) if len(polygon) else 0.0
    for a, b in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        side = (b[0] - a[0]) * (y[:, None] - a[1]) - (b[1] - a[1]) * (x[None, :] - a[0])
        inside &= side * turn >= 0
    return inside


def _turn(polygon: np.ndarray) -> float:
    """Twice the signed area of a polygon (N, 2)."""
    x, y = (polygon - polygon.mean(axis=0)).T
    return float(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1)))


def best_cover(covers: list[np.ndarray], weights: list[float], count: int | None, per_place: int = 1) -> list[tuple[int, float]]:
    """Numbers of the pairs that cover the most ground `per_place` times, best first, with the share of all places that each is the
    first to cover.

    Stops at `count`, or when no pair adds more than half a percent of what can be covered.
    """
    wanted = np.any(covers, axis=0) * per_place
    enough = _NEGLIGIBLE * (wanted > 0).sum()
    chosen: list[tuple[int, float]] = []
    # Greedy: the exact smallest cover is NP-hard, and one pair more than necessary is no loss.
    while len(chosen) < (count or len(covers)):
        open_pairs = [k for k in range(len(covers)) if k not in {number for number, _ in chosen}]
        # What nobody covers yet counts more than all second looks: fewer pairs than asked for still cover everything once.
        gains = {k: ((covers[k] & (wanted > 0)) * np.where(wanted == per_place, per_place, 1)).sum() for k in open_pairs}
        best = max(open_pairs, key=lambda k: (gains[k] * min(weights[k], _STEEP), -k), default=-1)
        if best < 0 or gains[best] <= enough:
            break
        chosen.append((best, float((covers[best] & (wanted == per_place)).sum() / wanted.size)))
        wanted -= covers[best] & (wanted > 0)
    return chosen


def _box(polygon: np.ndarray, grid: MapGrid, tile: int) -> tuple[int, int, int, int]:
    """The window around a polygon, widened to whole tiles."""
    # whole tiles: chunks of the pair's rasters then coincide with tiles, and no chunk has two writers
    col, row = grid.pixel(polygon[:, 0], polygon[:, 1])
    top, left = (int(np.floor(max(v.min(), 0) / tile)) * tile for v in (row, col))
    bottom, right = (int(np.ceil((v.max() + 1) / tile)) * tile for v in (row, col))
    window = Window(top, left, bottom - top, right - left).clipped(grid.shape)
    return window.row, window.col, window.height, window.width
