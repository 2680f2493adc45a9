"""The window of a pair's left epipolar image that shows a window of the map, and the reverse: planning declares regions with
them, so they may be too large but never too small."""

import numpy as np

from orthomill.schemas.epipolar import EpipolarPair
from orthomill.schemas.raster import MapGrid, Window

BEYOND = 1.0
"""px of parallax beyond the range of a pair that matching may end at"""


def box_corners(grid: MapGrid, window: Window, low: float, high: float) -> np.ndarray:
    """The eight corners (8, 3), m, of the box over the cells `window` of `grid` between two heights."""
    x = grid.west + grid.cell * np.array([window.col, window.col + window.width])
    y = grid.north - grid.cell * np.array([window.row, window.row + window.height])
    return np.stack(np.meshgrid(x, y, [low, high]), axis=-1).reshape(-1, 3)


def left_pixels(pair: EpipolarPair, points: np.ndarray) -> np.ndarray:
    """Ground points (N, 3) m to pixels (N, 2) (col, row) of the left epipolar image; NaN behind the camera."""
    u = (points - np.array(pair.left_centre)) @ np.array(pair.rotation).T
    with np.errstate(divide="ignore", invalid="ignore"):
        pixels = np.column_stack([pair.left_col0 - pair.c * u[:, 0] / u[:, 2], pair.row0 + pair.c * u[:, 1] / u[:, 2]])
    pixels[u[:, 2] >= 0] = np.nan
    return pixels


def greatest_parallax(pair: EpipolarPair) -> float:
    """px: what nodes of a pair that are nearer to the cameras are not made from."""
    return pair.parallax_high + BEYOND


def _within_range(pair: EpipolarPair, corners: np.ndarray) -> np.ndarray:
    """The corners (8, 3) of a box with a top that is as low as the parallaxes of the pair allow: of a photograph from low over the
    ground the greatest heights of the surface may be as near as its lens."""
    depth = (np.array(pair.left_centre) - corners) @ np.array(pair.rotation)[2]
    nearest, bottom, top = pair.c * pair.base / greatest_parallax(pair), depth[::2], depth[1::2]
    low, high = corners[0, 2], corners[1, 2]
    # Depth is linear in height: over all of the box nothing above the highest of the four places is far enough.
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(top >= nearest, 1.0, np.clip((bottom - nearest) / (bottom - top), 0.0, 1.0))
    lowered = corners.copy()
    lowered[1::2, 2] = low + (high - low) * share.max()
    return lowered


def node_window(pair: EpipolarPair, step: int, corners: np.ndarray, margin: int = 3) -> Window:
    """The window of the grid of nodes (node (i, j) at left pixel (j step, i step)) that may show the box of `corners` (8, 3).

    `margin` nodes are added on each side, and the window is clipped to the grid; it is empty where the left image does not see the
    box. What is nearer than the parallaxes of the pair reach does not count.
    """
    corners = _within_range(pair, corners)
    # A central projection maps a convex box that lies wholly in front of the camera into the convex hull of its projected corners;
    # with a corner behind the camera this does not hold, and such a box is none of the pair's ground.
    pixels = left_pixels(pair, corners)
    if not np.isfinite(pixels).all():
        return Window(0, 0, 0, 0)
    col, row = np.floor(pixels.min(axis=0) / step).astype(int) - margin
    right, bottom = np.ceil(pixels.max(axis=0) / step).astype(int) + 1 + margin
    return Window(int(row), int(col), int(bottom - row), int(right - col)).clipped(nodes_shape(pair, step))


def map_window(pair: EpipolarPair, left: Window, grid: MapGrid, low: float, high: float, margin: int = 2) -> Window:
    """The cells of `grid` that the pixels `left` of the left epipolar image can show between two heights, m.

    `margin` cells are added on each side, and the window is clipped to the grid. A ray that meets the heights nowhere does
    not count.
    """
    cols, rows = np.array([left.col, left.col + left.width - 1.0]), np.array([left.row, left.row + left.height - 1.0])
    corners = np.stack(np.meshgrid(cols - pair.left_col0, pair.row0 - rows, [-pair.c]), axis=-1).reshape(-1, 3)
    rays = corners @ np.array(pair.rotation)
    # At or above the horizon a ray meets no height; the other corners then bound what is left of the ground.
    rays = rays[rays[:, 2] < 0]
    if not len(rays):
        return Window(0, 0, 0, 0)
    centre = np.array(pair.left_centre)
    ground = np.concatenate([centre[:2] + rays[:, :2] * ((z - centre[2]) / rays[:, 2])[:, None] for z in (low, high)])
    col, row = grid.pixel(ground[:, 0], ground[:, 1])
    first_row, first_col = int(np.floor(row.min())) - margin, int(np.floor(col.min())) - margin
    last_row, last_col = int(np.ceil(row.max())) + margin, int(np.ceil(col.max())) + margin
    return Window(first_row, first_col, last_row - first_row + 1, last_col - first_col + 1).clipped(grid.shape)


def nodes_shape(pair: EpipolarPair, step: int) -> tuple[int, int]:
    """Rows and columns of the grid of nodes of a pair: one node every `step` px, the last step may be incomplete."""
    return -(-pair.rows // step), -(-pair.left_cols // step)
