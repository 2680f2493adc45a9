"""Dense matching of one block of an epipolar pair: a grid of parallaxes with precision, correlation and outcome.

Strategy
- The unit of matching is a *block*: a fixed square of the left epipolar image on an absolute grid, with a fixed halo, whatever the
  tile of the project. A block's result depends on nothing else, so tiling cannot change it.
- Start: the heights of a volume of all photographs, projected into the pair by the caller. A pair that has nothing but itself is
  matched in one piece by pair_surface.py.
- The residual y-parallax that the orientation left is measured in the block by least-squares matching of a sparse grid with free
  rows, and the right block is moved by its median.
- Refinement: least-squares matching of every node on its own surface (epipolar_least_squares.py).
- A node must agree with some of its neighbours, and its standard error must be within the limit.

Parallaxes here are column left - column right of the two rasters, px ("column parallax").

Source: Karfis 2009 (sources/epipolar.md#base-system to #levels); sources/measured.md#dense.
"""

from dataclasses import dataclass

import numpy as np

from orthomill.kernels.kernel_compilation import njit
from orthomill.schemas.memory import array_bytes
from orthomill.schemas.outcome import Outcome
from orthomill.schemas.raster import Window
from orthomill.tasks.matching.dense.dense_settings import DenseMatching
from orthomill.tasks.matching.dense.epipolar_least_squares import EpipolarLimits, NodeParallaxes, match_nodes
from orthomill.tasks.matching.dense.node_surfaces import StartSurface
from orthomill.tasks.matching.least_squares.grey_values import cubic_weights
from orthomill.tasks.matching.least_squares.least_squares_settings import LeastSquaresMatching
from orthomill.tasks.matching.least_squares.matching import PreparedImage, match_points
from orthomill.tasks.matching.smoothing import smoothed, with_gaps

BLOCK = 256
"""Side of a block in px of the left image."""
HALO = 64
"""Context on every side of a block, px: room for nodes around it and their windows."""
_UNIT = 16
"""px: parallax ranges are multiples of this"""
_FREE_ROWS = LeastSquaresMatching(
    window=17, interpolation="bilinear", stop=0.05, max_iterations=12, min_correlation=0.8, min_gradient=1.0
)


def limits_of(settings: DenseMatching) -> EpipolarLimits:
    """The limits by which the kernels match the nodes of a pair."""
    return EpipolarLimits(
        edge_half=settings.edge_window // 2,
        small_half=settings.small_window // 2,
        half=settings.window // 2,
        wide_half=settings.wide_window // 2,
        weak_sigma=settings.weak_sigma,
        max_shift=settings.max_shift,
        surface_tolerance=settings.surface_tolerance,
        min_support=settings.min_support,
        min_correlation=settings.min_correlation,
        min_gradient=settings.min_gradient,
        smoothing=settings.smoothing,
    )


@dataclass(frozen=True)
class ParallaxRange:
    """Column parallaxes that can occur, px; multiples of 16, so that few differ."""

    low: int
    high: int

    @classmethod
    def around(cls, low: float, high: float) -> "ParallaxRange":
        """The narrowest such range that holds `low` to `high`, px."""
        return cls(int(np.floor(low / _UNIT)) * _UNIT, int(np.ceil(high / _UNIT)) * _UNIT)


def left_window(core: Window) -> Window:
    """The window of the left raster that a block reads; may leave the raster."""
    return core.grown(HALO)


def right_window(core: Window, parallaxes: ParallaxRange) -> Window:
    """The window of the right raster that a block reads; may leave the raster."""
    return searched_window(left_window(core), parallaxes)


def searched_window(left: Window, parallaxes: ParallaxRange) -> Window:
    """The window of the right raster where the pixels of a window of the left one can be; may leave the raster."""
    return Window(left.row, left.col - parallaxes.high, left.height, left.width + parallaxes.high - parallaxes.low)


def scratch_bytes(parallaxes: ParallaxRange, settings: DenseMatching) -> int:
    """Working memory of `refined_block`, bytes."""
    # Both images in float32 with their scratch; beside the left one what it is compared with; planes, weights and results of nodes.
    left = (BLOCK + 2 * HALO) ** 2
    right = (BLOCK + 2 * HALO) * (BLOCK + 2 * HALO + parallaxes.high - parallaxes.low)
    return array_bytes(20, right) + array_bytes(40, left) + array_bytes(100, left // settings.step**2)


@dataclass(frozen=True)
class BlockMatch:
    """The nodes of a block (core / step, column parallaxes) and its residual y-parallax."""

    nodes: NodeParallaxes
    y_parallax: float
    """median residual y-parallax, row right - row left, px; NaN with too few points"""


def refined_block(
    left: np.ndarray, right: np.ndarray, start: StartSurface, parallaxes: ParallaxRange, settings: DenseMatching
) -> BlockMatch:
    """Match one block near a start that comes from elsewhere, such as heights of several photographs projected into the pair.

    left, right: grey uint8 of `left_window` and `right_window` in full (0 where they leave the raster, see `placed`). The core's
    nodes are at the left pixels HALO + i * step. start: column parallaxes of the left block (H / factor, W / factor) float32, good
    to a pixel or so, NaN where unknown: nodes around which nothing is known are not tried.
    """
    grey_left, grey_right = smoothed(with_gaps(left), settings.smoothing), smoothed(with_gaps(right), settings.smoothing)
    y_parallax, grey_right = _rows_met(grey_left, grey_right, start, parallaxes)
    return BlockMatch(_fine_nodes(grey_left, grey_right, start, parallaxes.high, settings), y_parallax)


def _rows_met(left: np.ndarray, right: np.ndarray, start: StartSurface, parallaxes: ParallaxRange) -> tuple[float, np.ndarray]:
    """The residual y-parallax of a block, and its right image without it."""
    y_parallax = residual_y_parallax(left, right, start, parallaxes.high)
    # Once per block instead of per node: all later steps then work along rows.
    return y_parallax, moved_rows(right, np.float32(y_parallax)) if np.isfinite(y_parallax) else right


def _fine_nodes(left: np.ndarray, right: np.ndarray, start: StartSurface, shift: int, settings: DenseMatching) -> NodeParallaxes:
    """The nodes of the core, matched with a ring of one node around them that only serves the neighbour test."""
    if not np.isfinite(start.parallax).any():
        return _nothing_found(left[HALO : -HALO : settings.step, HALO : -HALO : settings.step])
    counts = (-(-(side - 2 * HALO) // settings.step) for side in left.shape)
    rows, cols = (HALO - settings.step + settings.step * np.arange(count + 2) for count in counts)
    return consistent(match_nodes(left, right, start, rows, cols, shift, limits_of(settings)), settings)


def reduced(grey: np.ndarray, level: int) -> np.ndarray:
    """A pyramid level: means of 2 x 2 pixels, `level` times; NaN where any of them is NaN."""
    for _ in range(level):
        # The sum is bracketed: its order must not depend on what the compiler prefers, for tiles must agree bit for bit.
        even = grey[: grey.shape[0] // 2 * 2, : grey.shape[1] // 2 * 2]
        grey = (even[::2, ::2] + even[::2, 1::2] + (even[1::2, ::2] + even[1::2, 1::2])) * np.float32(0.25)
    return np.ascontiguousarray(grey)


def residual_y_parallax(left: np.ndarray, right: np.ndarray, start: StartSurface, shift: int) -> float:
    """Median of row right - row left of a sparse grid of points matched with free rows (px); NaN below 12 points."""
    # A margin of half the window of `_FREE_ROWS`, and more on reduced levels, whose borders are unreliable.
    centre = start.factor * 8
    cols, rows = np.meshgrid(np.arange(centre, left.shape[1] - centre, 20), np.arange(centre, left.shape[0] - centre, 20))
    parallax = start.parallax[rows // start.factor, cols // start.factor].ravel()
    points = np.column_stack([cols.ravel(), rows.ravel()])[np.isfinite(parallax)].astype(np.float64)
    starts = points + np.column_stack([shift - parallax, np.zeros_like(parallax)])[np.isfinite(parallax)]
    matches = match_points(PreparedImage(left), PreparedImage(right), points, starts, _FREE_ROWS)
    # 0.3 px keeps rows that the texture hardly determines (horizontal edges absent) out of the median.
    good = matches.converged & (matches.sigma_row < 0.3)
    return float(np.median((matches.row - points[:, 1])[good])) if good.sum() >= 12 else float("nan")


@njit()
def moved_rows(grey, shift):
    """The image moved up by `shift` rows, cubic; NaN where that leaves it."""
    rows, cols = grey.shape
    out = np.full((rows, cols), np.float32(np.nan))
    whole = int(np.floor(shift))
    w0, w1, w2, w3 = cubic_weights(np.float32(shift - whole))
    for r in range(rows):
        first = r + whole - 1
        if first >= 0 and first + 3 < rows:
            for c in range(cols):
                out[r, c] = (w0 * grey[first, c] + w1 * grey[first + 1, c]) + (w2 * grey[first + 2, c] + w3 * grey[first + 3, c])
    return out


def consistent(nodes: NodeParallaxes, settings: DenseMatching) -> NodeParallaxes:
    """The nodes without their outer ring; imprecise ones and those with too few agreeing neighbours are removed."""
    parallax, sigma, outcome = nodes.parallax.copy(), nodes.sigma.copy(), nodes.outcome.copy()
    # Imprecise nodes are removed first: they may not support their neighbours.
    vague = sigma > settings.max_sigma
    outcome[vague] = Outcome.IMPRECISE
    parallax[vague] = np.nan
    lonely = np.isfinite(parallax) & (_agreeing(parallax, np.float32(settings.neighbour_tolerance)) < settings.min_neighbours)
    outcome[lonely] = Outcome.INCONSISTENT
    parallax[lonely] = np.nan
    sigma[np.isnan(parallax)] = np.nan
    inner = slice(1, -1), slice(1, -1)
    return NodeParallaxes(parallax[inner], sigma[inner], nodes.correlation[inner], outcome[inner])


@njit()
def _agreeing(parallax, tolerance):
    """(r, c) uint8: how many of eight neighbours have a parallax within `tolerance` (px)."""
    rows, cols = parallax.shape
    count = np.zeros((rows, cols), np.uint8)
    for r in range(1, rows - 1):
        for c in range(1, cols - 1):
            for y in range(r - 1, r + 2):
                for x in range(c - 1, c + 2):
                    if (y != r or x != c) and abs(parallax[y, x] - parallax[r, c]) <= tolerance:
                        count[r, c] += 1
    return count


def placed(array: np.ndarray, window: Window, wanted: Window) -> np.ndarray:
    """The array of `window` (clipped to its raster, perhaps empty) placed in `wanted`, 0 around it."""
    out = np.zeros((wanted.height, wanted.width), dtype=array.dtype)
    if window.empty:
        return out
    out[window.within(wanted).slices] = array.reshape(window.height, window.width)
    return out


def _nothing_found(grey: np.ndarray) -> NodeParallaxes:
    """Nodes of a block without a start surface; grey: (rows, cols) left grey values at the nodes."""
    return NodeParallaxes.unmatched(np.where(np.isnan(grey), Outcome.OUTSIDE, Outcome.NOT_TRIED).astype(np.uint8))
