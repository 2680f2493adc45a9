"""The map grid of the surface model: the ground that the pairs see, in cells of a round size."""

from dataclasses import dataclass, replace

import numpy as np

from orthomill.schemas.epipolar import EpipolarPair, EpipolarPairs
from orthomill.schemas.errors import GeometryError
from orthomill.schemas.maps.wanted_area import WantedArea
from orthomill.schemas.observations import GroundPoints
from orthomill.schemas.orientation import Area, Block, in_area
from orthomill.schemas.raster import MapGrid
from orthomill.schemas.surface import Surface, round_cell_size
from orthomill.tasks.densification.well_seen_ground import well_seen_ground
from orthomill.tasks.geometry.normal_case import Side, corner_rays

Corners = tuple[np.ndarray, np.ndarray]
"""the lower left and the upper right one, (2,) m"""
_STRAY = 0.01
"""share of tie points that may lie anywhere, on each side"""
_WHOLE = 1e-6
"""cells: a corner as near to a whole number of them is one"""


@dataclass(frozen=True)
class GridWish:
    """What is asked of the map grid: its cell (m; None: a round size near 1.5 ground pixels), a corner of its cells (m), and its
    area (west, south, east, north) m; None: all that pairs see."""

    cell: float | None = None
    origin: tuple[float, float] = (0.0, 0.0)
    area: Area | None = None


def surface_of(
    block: Block, pairs: EpipolarPairs, points: GroundPoints, wish: GridWish, wanted: WantedArea | None = None
) -> Surface:
    """The grid over the union of what the pairs see, in the area of the block where it has one, or over the area that is asked for:
    that of the wish, or the bounds of polygons that are drawn; else no farther from tie points than a photograph is wide, and only
    where the ground is seen well.

    Raises GeometryError when there is no pair, when no pair sees common ground, or none in the area.
    """
    if wanted:
        wish = replace(wish, area=wanted.bounds)
    if not pairs.pairs:
        raise GeometryError(
            "No pair of photographs is suitable for matching, so there is no surface model; the epipolar report gives the reasons."
        )
    # The median: one oblique or high pair must not set the resolution of the whole surface.
    level = _level(block, points)
    pixel = float(np.median([_pixel_at(pair, level) for pair in pairs.pairs]))
    cell = wish.cell or round_cell_size(pixel)
    low, high = height_bounds(pairs)
    low_corner, high_corner = _seen_by_pairs(block, pairs)
    if area := wish.area or block.area:
        low_corner, high_corner = _in_area((low_corner, high_corner), area, wish.area is not None)
    elif len(points.x):
        low_corner, high_corner = _within((low_corner, high_corner), _tied_ground(pairs, points, level))
        wanted = well_seen_ground(block, (*low_corner, *high_corner), level, pixel)
        if wanted.polygons:
            bounds = np.array(wanted.bounds)
            low_corner, high_corner = _within((low_corner, high_corner), (bounds[:2], bounds[2:]))
    # Whole multiples of the cell: surfaces of repeated surveys then lie on one grid and can be subtracted cell by cell.
    origin = np.array(wish.origin)
    low_cells, high_cells = (low_corner - origin) / cell, (high_corner - origin) / cell
    # Corners that are multiples already stay so, whatever the division left of them.
    first, last = np.floor(low_cells + _WHOLE).astype(int), np.ceil(high_cells - _WHOLE).astype(int)
    if not (last > first).all():
        raise GeometryError("The pairs of photographs see no common ground; check the orientation and the heights of the block.")
    (west, _), (_, north) = origin + first * cell, origin + last * cell
    cols, rows = (last - first).tolist()
    grid = MapGrid(west=float(west), north=float(north), cell=cell, rows=rows, cols=cols)
    return Surface(grid=grid, height_low=low, height_high=high, wanted=wanted or WantedArea())


def _seen_by_pairs(block: Block, pairs: EpipolarPairs) -> Corners:
    bounds = np.array([pair_bounds(pair, block.ground_low, block.ground_high) for pair in pairs.pairs])
    return bounds[:, :2].min(axis=0), bounds[:, 2:].max(axis=0)


def _in_area(corners: Corners, area: Area, asked: bool) -> Corners:
    inner = np.maximum(corners[0], area[:2]), np.minimum(corners[1], area[2:])
    if not (inner[0] < inner[1]).all():
        where = "that is asked for" if asked else "of the plane"
        raise GeometryError(f"The pairs of photographs see no ground in the area {where}, {_corners(area)}; move it (grid).")
    # A client's sheet is as large as it is named, also where nothing is seen of it.
    return (np.array(area[:2]), np.array(area[2:])) if asked else inner


def _within(corners: Corners, bounds: Corners) -> Corners:
    """The lower and the upper corner (2,) m of what two rectangles share; the first of them where they share nothing."""
    low, high = np.maximum(corners[0], bounds[0]), np.minimum(corners[1], bounds[1])
    return (low, high) if (low < high).all() else corners


def _tied_ground(pairs: EpipolarPairs, points: GroundPoints, z: float) -> Corners:
    """The corners (2,), (2,) m of the ground on which tie points lie, but for stray ones, wider by an image on every side.

    Photographs that look along the ground see it for miles, in pixels of metres that no tie point holds: a walk about a tree had a
    surface of two hundred million cells.
    """
    wide = float(np.median([max(pair.rows, pair.left_cols) * _pixel_at(pair, z) for pair in pairs.pairs]))
    low, high = np.percentile(np.column_stack([points.x, points.y]), (100.0 * _STRAY, 100.0 * (1.0 - _STRAY)), axis=0)
    return low - wide, high + wide


def _corners(area: Area) -> str:
    west, south, east, north = (f"{value:.6g}" for value in area)
    return f"from x = {west}, y = {south} to x = {east}, y = {north} m"


def _level(block: Block, points: GroundPoints) -> float:
    """Height of most of the surface, m: the middle between the lowest and the highest may be far above or below it."""
    inside = in_area(block.area, points.x, points.y)
    return float(np.median(points.z[inside])) if inside.any() else block.ground_mean


def _pixel_at(pair: EpipolarPair, z: float) -> float:
    """Side of a pixel of the epipolar images at the height z (m) in their middle, m."""
    x, y = 0.5 * (pair.left_cols - 1) - pair.left_col0, pair.row0 - 0.5 * (pair.rows - 1)
    ray = np.array([x, y, -pair.c]) @ np.array(pair.rotation)
    return float((z - pair.left_centre[2]) / ray[2])


def ground_pixel(pair: EpipolarPair) -> float:
    """Side of a pixel of the epipolar images on the mean ground, m."""
    return pair.base / ((pair.parallax_low + pair.parallax_high) / 2)


def parallax_height(pair: EpipolarPair) -> float:
    """Height that one pixel of parallax stands for on the mean ground, m (Karfis 2009, 1.17: dZ/dp = B c / p^2)."""
    return pair.base * pair.c / ((pair.parallax_low + pair.parallax_high) / 2) ** 2


def window_cells(side: int, pairs: tuple[EpipolarPair, ...], surface: Surface) -> float:
    """Side of windows of so many pixels of the epipolar images, in cells of the surface: of the median pair.

    Raises GeometryError for windows that the images of no pair can hold.
    """
    if not pairs:
        return 0.0
    sizes = [min(pair.rows, pair.left_cols, pair.right_cols) for pair in pairs]
    if side >= max(sizes):
        raise GeometryError(
            f"Windows of {side} px do not fit into the epipolar images, whose shorter side is {max(sizes)} px; set a smaller "
            "window (matching)."
        )
    return side * float(np.median([ground_pixel(pair) for pair in pairs])) / surface.grid.cell


def height_bounds(pairs: EpipolarPairs) -> tuple[float, float]:
    """Lowest and highest height (m) that the parallax ranges of the pairs allow, of those that the pairs are to cover."""
    # The corners suffice: between them the height of a plane of constant parallax is linear.
    corners = [_frame_points(pair, p)[:, 2] for pair in pairs.pairs for p in (pair.parallax_low, pair.parallax_high)]
    # The range of a tilted pair, which covers near and far ground, allows heights at its corners that the block nowhere has.
    low, high = pairs.heights or (-np.inf, np.inf)
    return float(max(np.min(corners), low)), float(min(np.max(corners), high))


def pair_bounds(pair: EpipolarPair, low: float, high: float) -> tuple[float, float, float, float]:
    """(west, south, east, north) of the ground that both images of a pair can show between the heights low and high, m."""
    sides = []
    images: tuple[tuple[Side, tuple[float, float, float]], ...] = ("left", pair.left_centre), ("right", pair.right_centre)
    for side, centre in images:
        # the footprint of a tilted frame is widest at either the lower or the upper height, never between
        ground = np.concatenate([_frame_on_plane(pair, side, np.array(centre), z) for z in (low, high)])
        sides.append((*ground.min(axis=0), *ground.max(axis=0)))
    left, right = np.array(sides)
    west, south = map(float, np.maximum(left[:2], right[:2]))
    east, north = map(float, np.minimum(left[2:], right[2:]))
    return west, south, east, north


def _frame_points(pair: EpipolarPair, parallax: float) -> np.ndarray:
    """Ground points (4, 3) m of the corners of the left image at one parallax (px)."""
    return np.array(pair.left_centre) + corner_rays(pair, "left") * pair.base / parallax


def _frame_on_plane(pair: EpipolarPair, side: Side, centre: np.ndarray, z: float) -> np.ndarray:
    """Plan positions (4, 2) where the corners' rays meet the height z."""
    rays = corner_rays(pair, side)
    # A ray at or above the horizon meets no height, and the division below would put it behind the camera.
    if (rays[:, 2] >= 0).any():
        raise GeometryError(f"The pair {pair.name} shows the horizon, so its ground has no bounds on the map. Exclude the pair.")
    return centre[:2] + rays[:, :2] * ((z - centre[2]) / rays[:, 2])[:, None]
