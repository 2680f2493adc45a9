"""Where the homologue of a left pixel can lie on its row, by a height model: the published interval of columns.

Strategy. The left ray meets the model at A (monoplotting). The lowest and the highest height of the model in a square about A are
put on the *same left ray*: its points at those heights have other X and Y than A, and their parallaxes are the ends of the
interval. With X and Y kept, both images of the point would move, and the interval would be that of another pixel.

A model is a grid of posts that know how many points they stand for. Where the square holds too few points it is doubled, twice at
most; then what the posts were closed with has to do.

Source: Karfis 2009, sections 6.3 and 6.4 (sources/epipolar.md#monoplotting, #column-interval), check 17.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from orthomill.kernels.kernel_compilation import njit
from orthomill.schemas.epipolar import EpipolarPair
from orthomill.schemas.raster import MapGrid, Window
from orthomill.tasks.matching.guided.guided_settings import _DOUBLINGS, ColumnInterval
from orthomill.tasks.visibility.monoplotting import follow_rays


@dataclass(frozen=True, eq=False)
class GuidePosts:
    """A height model as a grid of posts, each (rows, cols) float32: `middle`, `low` and `high` of the points of a post, m, and the
    `count` of them, 0 where the post was closed from elsewhere."""

    grid: MapGrid
    middle: np.ndarray
    low: np.ndarray
    high: np.ndarray
    count: np.ndarray

    @classmethod
    def of(cls, grid: MapGrid, window: Window, bands: np.ndarray) -> "GuidePosts":
        """The posts `window` of `grid`; bands (rows, cols, 4): middle, low, high, count."""
        part = MapGrid(
            west=grid.west + window.col * grid.cell,
            north=grid.north - window.row * grid.cell,
            cell=grid.cell,
            rows=window.height,
            cols=window.width,
        )
        return cls(part, *(np.ascontiguousarray(bands[..., k]) for k in range(4)))


class _Posts(NamedTuple):
    """The same for kernels; corner: west, north, side of a post, m."""

    low: np.ndarray
    high: np.ndarray
    number: np.ndarray
    corner: np.ndarray


@njit(error_model="numpy")
def _nearby(posts, x, y, half, least):
    """Lowest and highest height of the posts within `half` (m) of a place along both axes."""
    rows, cols = posts.number.shape
    west, north, post = posts.corner
    col, row = (x - west) / post - 0.5, (north - y) / post - 0.5
    low, high = np.inf, -np.inf
    for _ in range(_DOUBLINGS + 1):
        points, reach = 0.0, half / post
        low, high = np.inf, -np.inf
        # The nearest post always counts: a square may be smaller than the distance of the posts.
        for r in range(
            max(min(int(np.ceil(row - reach)), int(row + 0.5)), 0), min(max(int(row + reach), int(row + 0.5)) + 1, rows)
        ):
            for c in range(
                max(min(int(np.ceil(col - reach)), int(col + 0.5)), 0), min(max(int(col + reach), int(col + 0.5)) + 1, cols)
            ):
                low, high = min(low, posts.low[r, c]), max(high, posts.high[r, c])
                points += posts.number[r, c]
        if points >= least:
            break
        half *= 2.0
    return low, high


@njit(error_model="numpy")
def _heights(posts, points, half, least, symmetric, out):
    """Fill out (N, 2): the two heights of the interval of every point (N, 3)."""
    for n in range(len(points)):
        x, y, z = points[n]
        if np.isnan(z):
            continue
        low, high = _nearby(posts, x, y, half, least)
        if symmetric:
            low, high = z - (high - low), z + (high - low)
        # Monoplotting between posts may end above or below all of them.
        out[n, 0], out[n, 1] = min(low, z), max(high, z)


def parallax_intervals(
    pair: EpipolarPair, pixels: np.ndarray, posts: GuidePosts, interval: ColumnInterval, side: float
) -> np.ndarray:
    """(N, 3) px: least parallax x_left - x_right, that of the guide itself, and the greatest, of left epipolar pixels (N, 2).

    side: of the square, m. NaN where the ray of a pixel misses the guide.
    """
    at = np.column_stack([pixels[:, 0] - pair.left_col0, pair.row0 - pixels[:, 1], np.full(len(pixels), -pair.c)])
    rays = at @ np.array(pair.rotation)
    centre, grid = np.array(pair.left_centre), posts.grid
    known = np.isfinite(posts.middle)
    out = np.full((len(pixels), 3), np.nan)
    if not known.any():
        return out
    corner = np.array([grid.west, grid.north, grid.cell])
    points = np.full((len(pixels), 3), np.nan)
    bounds = float(posts.middle[known].min()), float(posts.middle[known].max())
    follow_rays(centre, rays / np.linalg.norm(rays, axis=1, keepdims=True), posts.middle, corner, *bounds, points)
    ends = np.full((len(pixels), 2), np.nan)
    symmetric = interval.extremes == "symmetric"
    kernel_posts = _Posts(posts.low, posts.high, posts.count, corner)
    _heights(kernel_posts, points, side / 2, float(interval.min_points), symmetric, ends)
    # A point of the ray at height z is base / parallax times as far as the pixel itself: p = B dz / (z - Z0).
    for column, z in enumerate((ends[:, 0], points[:, 2], ends[:, 1])):
        with np.errstate(divide="ignore", invalid="ignore"):
            out[:, column] = pair.base * rays[:, 2] / (z - centre[2])
    # Heights at or above the camera have no parallax there; the interval then ends at infinity, and the image cuts it.
    out[:, 2] = np.where(ends[:, 1] >= centre[2], np.inf, out[:, 2])
    return out
