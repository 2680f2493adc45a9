"""The surfaces that matching windows lie on: a plane at every node, fitted to a start surface or to the nodes around it.

Strategy
- A start surface (heights of a volume projected into the pair, or parallaxes of semi-global matching) is good to a pixel or less
  and jumps where the surface jumps.
- The plane of a node is fitted to the parallaxes of its surroundings that agree with it within a tolerance: at a roof edge those of
  the roof, so that parallaxes are not smeared across the wall. Where the start is unknown, or a speck that hardly any of its
  surroundings shares, the level that most of them have takes its place.
- Between two adjustments the planes are fitted anew, each node weighted by its own precision: nodes of little texture follow their
  neighbours.

The support is our own; see sources/epipolar.md#levels.
"""

from typing import NamedTuple

import numpy as np

from orthomill.kernels.kernel_compilation import njit
from orthomill.tasks.matching.least_squares.grey_values import EXACT

_FEWEST = 4
"""parallaxes that a plane needs: its three unknowns and one more"""
_STEEPEST = 0.8
"""largest slope of a plane, px of parallax per px; steeper surfaces are hidden in one of the images"""
_RIDGE = 0.06
"""squared spacings added to the variances of the coordinates, so that the slope across a strip of nodes stays near zero"""
_ROOM = 0.1
"""px per px: slope that a level first guess of a plane leaves room for"""
_SPECK, _MOST = 0.25, 0.6
"""shares of a window that share a level: below the first it is a speck, above the second it is what the window shows"""


class StartSurface(NamedTuple):
    """Start parallaxes of a left image (H, W), on a grid reduced by `factor`."""

    parallax: np.ndarray
    """(H / factor, W / factor) float32, px of the left image, NaN where unknown"""
    factor: int


class NodeLattice(NamedTuple):
    """Nodes of the left image at equal distances."""

    row: int
    col: int
    """pixel of the first node; may lie outside the image"""
    rows: int
    cols: int
    step: int

    @classmethod
    def around(cls, rows: np.ndarray, cols: np.ndarray, reach: int) -> "NodeLattice":
        """The lattice of pixel rows (n,) and columns (m,), equally spaced by the same step, grown by `reach` px."""
        step = int((rows if len(rows) > 1 else cols)[1] - (rows if len(rows) > 1 else cols)[0])
        more = -(-reach // step)
        return cls(int(rows[0]) - more * step, int(cols[0]) - more * step, len(rows) + 2 * more, len(cols) + 2 * more, step)

    @property
    def pixels(self) -> tuple[np.ndarray, np.ndarray]:
        """Rows (rows,) and columns (cols,) of the nodes."""
        return self.row + self.step * np.arange(self.rows), self.col + self.step * np.arange(self.cols)

    def thinned(self, factor: int) -> "NodeLattice":
        """Every `factor`-th node, from the first on."""
        return NodeLattice(self.row, self.col, -(-self.rows // factor), -(-self.cols // factor), factor * self.step)

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, columns) of nodes."""
        return self.rows, self.cols


@njit(error_model="numpy", forceinline=True, fastmath=EXACT)
def _fit_plane(values, weights, at, reach, step, guess, tolerance, plane):
    """Plane through the values within `reach` nodes that lie within `tolerance` of the plane `guess`; returns their number.

    values, weights (rows, cols): parallaxes of nodes `step` px apart. at: (row, col) of the node. guess, plane (3,): the parallax
    at the node, px, and its slopes along x and y.
    """
    rows, cols = values.shape
    flat, share = values.ravel(), weights.ravel()
    level, limit = np.float32(guess[0]), np.float32(tolerance)
    slope_x, slope_y = np.float32(guess[1] * step), np.float32(guess[2] * step)
    one, zero = np.float32(1.0), np.float32(0.0)
    n = total = sum_x = sum_y = sum_v = sum_xx = sum_xy = sum_yy = sum_vx = sum_vy = zero
    left, right = max(at[1] - reach, 0), min(at[1] + reach, cols - 1)
    first = np.float32(left - at[1])
    for row in range(max(at[0] - reach, 0), min(at[0] + reach, rows - 1) + 1):
        y = np.float32(row - at[0])
        # Unsigned places need no test for negative ones, so that the loop is vectorised.
        k, expected = np.uint64(row * cols + left), level + slope_y * y
        for j in range(np.uint64(right - left + 1)):
            x = first + np.float32(j)
            # Selected instead of branched, for the same reason; NaN compares as not near.
            near = abs(flat[k + j] - (expected + slope_x * x)) <= limit
            weight, value = share[k + j] if near else zero, flat[k + j] - level if near else zero
            n += one if near else zero
            total += weight
            sum_x += weight * x
            sum_y += weight * y
            sum_v += weight * value
            sum_xx += weight * x * x
            sum_xy += weight * x * y
            sum_yy += weight * y * y
            sum_vx += weight * value * x
            sum_vy += weight * value * y
    if n < _FEWEST or not total > 0.0:
        return 0
    part = 1.0 / np.float64(total)
    mx, my, mv = sum_x * part, sum_y * part, sum_v * part
    cxx, cxy, cyy = sum_xx * part - mx * mx + _RIDGE, sum_xy * part - mx * my, sum_yy * part - my * my + _RIDGE
    cvx, cvy = sum_vx * part - mv * mx, sum_vy * part - mv * my
    determinant = cxx * cyy - cxy * cxy
    sx, sy = (cvx * cyy - cvy * cxy) / determinant, (cvy * cxx - cvx * cxy) / determinant
    plane[1], plane[2] = min(max(sx / step, -_STEEPEST), _STEEPEST), min(max(sy / step, -_STEEPEST), _STEEPEST)
    plane[0] = level + mv - (plane[1] * mx + plane[2] * my) * step
    return int(n)


@njit(error_model="numpy", forceinline=True)
def _median_around(values, at, reach, found):
    """Median of the known values within `reach` nodes, NaN where there is none; `found` is scratch."""
    count = 0
    for r in range(max(at[0] - reach, 0), min(at[0] + reach, values.shape[0] - 1) + 1):
        for c in range(max(at[1] - reach, 0), min(at[1] + reach, values.shape[1] - 1) + 1):
            if values[r, c] == values[r, c]:
                found[count] = values[r, c]
                count += 1
    return np.sort(found[:count])[count // 2] if count else np.float32(np.nan)


@njit(error_model="numpy")
def _first_planes(values, wanted, reach, step, tolerance, planes):
    """Planes (parallax and its slopes) through the `values` (r, c) px within `reach` nodes of every `wanted` one, into `planes`
    (r, c, 3). tolerance (px): what belongs to a plane; step: pixels between nodes."""
    whole = (2 * reach + 1) ** 2
    weights, found = np.ones_like(values), np.empty(whole, np.float32)
    guess, plane = np.zeros(3), np.empty(3)
    wide = tolerance + _ROOM * reach * step
    for i in range(values.shape[0]):
        for j in range(values.shape[1]):
            if not wanted[i, j]:
                continue
            guess[0], guess[1], guess[2] = values[i, j], 0.0, 0.0
            count = _fit_plane(values, weights, (i, j), reach, step, guess, wide, plane)
            if count < _SPECK * whole:
                # A speck, which hardly anything around goes along with, or unknown: what most of the window shows takes its place.
                other = _median_around(values, (i, j), reach, found)
                if count == 0 or _near(values, (i, j), reach, other, wide) > _MOST * whole:
                    guess[0] = other
                    count = _fit_plane(values, weights, (i, j), reach, step, guess, wide, plane)
            if count == 0:
                continue
            guess[0], guess[1], guess[2] = plane[0], plane[1], plane[2]
            if _fit_plane(values, weights, (i, j), reach, step, guess, tolerance, plane) > 0:
                planes[i, j, 0], planes[i, j, 1], planes[i, j, 2] = plane[0], plane[1], plane[2]


@njit(error_model="numpy", forceinline=True)
def _near(values, at, reach, level, tolerance):
    """Values within `reach` nodes that are within `tolerance` of a level."""
    count = 0
    for r in range(max(at[0] - reach, 0), min(at[0] + reach, values.shape[0] - 1) + 1):
        for c in range(max(at[1] - reach, 0), min(at[1] + reach, values.shape[1] - 1) + 1):
            count += abs(values[r, c] - level) <= tolerance
    return count


def start_values(start: StartSurface, lattice: NodeLattice) -> np.ndarray:
    """Start parallaxes (rows, cols) float32 of the cells under the nodes, NaN where unknown."""
    factor, shape = start.factor, start.parallax.shape
    rows, cols = lattice.pixels
    values = start.parallax[np.ix_(np.clip(rows // factor, 0, shape[0] - 1), np.clip(cols // factor, 0, shape[1] - 1))]
    values[(rows < 0) | (rows >= shape[0] * factor)] = np.nan
    values[:, (cols < 0) | (cols >= shape[1] * factor)] = np.nan
    return values


def start_planes(
    start: StartSurface, lattice: NodeLattice, half: int, tolerance: float, wanted: np.ndarray | None = None
) -> np.ndarray:
    """Planes (rows, cols, 3) float32 of the nodes: parallax px, slopes along x and y; NaN where nothing is known around it.

    half: half side of the window that a plane is fitted in, px. tolerance: what agrees with a plane, px. wanted: (rows, cols) bool,
    nodes without it get no plane; None for all.
    """
    wanted = np.ones(lattice.shape, np.bool_) if wanted is None else wanted
    planes = np.full((*lattice.shape, 3), np.nan, np.float32)
    _first_planes(start_values(start, lattice), wanted, _reach(half, lattice.step), lattice.step, tolerance, planes)
    # The value of a cell belongs to its centre, the plane to the node.
    y, x = (places - (places // start.factor * start.factor + 0.5 * (start.factor - 1)) for places in lattice.pixels)
    planes[..., 0] += planes[..., 1] * x.astype(np.float32) + planes[..., 2] * y.astype(np.float32)[:, None]
    return planes


def _reach(half: int, step: int) -> int:
    """Nodes to either side that a window of half side `half` px covers, one at least."""
    return max(1, (half + step // 2) // step)


@njit(error_model="numpy")
def _smoothed_planes(planes, weights, reach, step, tolerance, out):
    """Planes through the heights of `planes` (r, c, 3) around every node, by `weights`, into `out`; the old one where none is
    found."""
    values = planes[:, :, 0].copy()
    guess, plane = np.empty(3), np.empty(3)
    for i in range(values.shape[0]):
        for j in range(values.shape[1]):
            guess[0], guess[1], guess[2] = planes[i, j, 0], planes[i, j, 1], planes[i, j, 2]
            if guess[0] == guess[0] and _fit_plane(values, weights, (i, j), reach, step, guess, tolerance, plane) > 0:
                out[i, j, 0], out[i, j, 1], out[i, j, 2] = plane[0], plane[1], plane[2]
            else:
                out[i, j] = planes[i, j]


def smoothed_planes(planes: np.ndarray, weights: np.ndarray, lattice: NodeLattice, half: int, tolerance: float) -> np.ndarray:
    """Planes fitted anew to the parallaxes of the nodes within `half` px that agree with them; weights (rows, cols) float32."""
    out = np.empty_like(planes)
    _smoothed_planes(planes, weights, _reach(half, lattice.step), lattice.step, tolerance, out)
    return out


def finer_planes(planes: np.ndarray, lattice: NodeLattice, finer: NodeLattice) -> np.ndarray:
    """The planes of a finer lattice: each that of the nearest node, carried to its own place."""
    rows, cols = finer.pixels
    i = np.clip((rows - lattice.row + lattice.step // 2) // lattice.step, 0, lattice.rows - 1)
    j = np.clip((cols - lattice.col + lattice.step // 2) // lattice.step, 0, lattice.cols - 1)
    out = planes[np.ix_(i, j)]
    x, y = cols - (lattice.col + j * lattice.step), rows - (lattice.row + i * lattice.step)
    out[..., 0] += out[..., 1] * x.astype(np.float32) + out[..., 2] * y.astype(np.float32)[:, None]
    return out
