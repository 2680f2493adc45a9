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
from itertools import pairwise
from typing import Literal

import numpy as np
from pydantic import model_validator

from orthomill.kernels.kernel_compilation import njit
from orthomill.schemas.outcome import Outcome
from orthomill.schemas.raster import Window
from orthomill.schemas.settings import Settings, setting
from orthomill.tasks.matching.dense.epipolar_least_squares import EpipolarLimits, NodeParallaxes, match_nodes
from orthomill.tasks.matching.dense.node_surfaces import StartSurface
from orthomill.tasks.matching.least_squares.grey_values import cubic_weights
from orthomill.tasks.matching.least_squares.matching import PreparedImage, match_points
from orthomill.tasks.matching.least_squares.model import LeastSquaresMatching
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


class DenseMatching(Settings):
    """How a pair of epipolar images is matched densely."""

    step: Literal[1, 2, 4] = setting(2, "Distance of the nodes.", "px")
    window: int = setting(
        15, "Side of the least-squares window on smooth surfaces; an even number is taken as the next odd one.", "px", ge=7, le=41
    )
    small_window: int = setting(9, "Side of the window where the surface bends.", "px", ge=5, le=41)
    edge_window: int = setting(5, "Side of the window where the surface breaks within the other.", "px", ge=5, le=41)
    wide_window: int = setting(31, "Side of the window where texture is weak.", "px", ge=7, le=101)
    weak_sigma: float = setting(0.1, "Standard error of a parallax above which wider windows are tried.", "px", gt=0.0)
    smoothing: float = setting(0.5, "Sigma of the Gaussian that both images are smoothed with.", "px", ge=0.0, le=3.0)
    max_shift: float = setting(1.5, "A node that ends farther than this from its start is rejected.", "px", gt=0.0)
    surface_tolerance: float = setting(1.0, "Pixels of the window farther from the surface of the node are excluded.", "px", gt=0.0)
    min_support: float = setting(0.3, "Share of the window that must lie on the node's surface.", gt=0.0, le=1.0)
    min_correlation: float = setting(0.6, "Normalised correlation that the matched windows must reach.", ge=0.0, le=1.0)
    min_gradient: float = setting(0.5, "Root mean square grey value gradient along the row.", "grey values per px", ge=0.0)
    max_sigma: float = setting(0.5, "Largest standard error of a parallax.", "px", gt=0.0)
    min_neighbours: int = setting(3, "Of the eight neighbours of a node, how many must agree with it.", ge=0, le=8)
    neighbour_tolerance: float = setting(1.5, "Largest parallax difference of neighbours that agree.", "px", gt=0.0)

    @model_validator(mode="after")
    def _windows_ascend(self) -> "DenseMatching":
        names = ("edge_window", "small_window", "window", "wide_window")
        for smaller, larger in pairwise(names):
            if getattr(self, smaller) // 2 > getattr(self, larger) // 2:
                raise ValueError(
                    f"{smaller} is {getattr(self, smaller)} and {larger} is {getattr(self, larger)}; {smaller} must not be larger"
                )
        return self

    @property
    def limits(self) -> EpipolarLimits:
        return EpipolarLimits(
            edge_half=self.edge_window // 2,
            small_half=self.small_window // 2,
            half=self.window // 2,
            wide_half=self.wide_window // 2,
            weak_sigma=self.weak_sigma,
            max_shift=self.max_shift,
            surface_tolerance=self.surface_tolerance,
            min_support=self.min_support,
            min_correlation=self.min_correlation,
            min_gradient=self.min_gradient,
            smoothing=self.smoothing,
        )


@dataclass(frozen=True)
class ParallaxRange:
    """Column parallaxes that can occur, px; multiples of 16, so that few differ."""

    low: int
    high: int

    @classmethod
    def around(cls, low: float, high: float) -> "ParallaxRange":
        return cls(int(np.floor(low / _UNIT)) * _UNIT, int(np.ceil(high / _UNIT)) * _UNIT)


def left_window(core: Window) -> Window:
    """The window of the left raster that a block reads; may leave the raster."""
    return core.grown(HALO)


def right_window(core: Window, parallaxes: ParallaxRange) -> Window:
    """The window of the right raster that a block reads; may leave the raster."""
    left = left_window(core)
    return Window(left.row, left.col - parallaxes.high, left.height, left.width + parallaxes.high - parallaxes.low)


def scratch_bytes(parallaxes: ParallaxRange, settings: DenseMatching) -> int:
    """Working memory of `refined_block`, bytes."""
    # Both images in float32 with their scratch; beside the left one what it is compared with; planes, weights and results of nodes.
    left = (BLOCK + 2 * HALO) ** 2
    right = (BLOCK + 2 * HALO) * (BLOCK + 2 * HALO + parallaxes.high - parallaxes.low)
    return 20 * right + 40 * left + 100 * (left // settings.step**2)


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
    return consistent(match_nodes(left, right, start, rows, cols, shift, settings.limits), settings)


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
