"""The colour that a photograph has for each ortho pixel, and the weight ("worth") of that colour.

Colour: bicubic (Keys 1981, a = -1/2, which reproduces a linear ramp exactly) at the projected place, lens distortion included.
Worth: the area, in photo pixels, of the ortho cell's piece of surface as projected into the photograph (Petsa et al. 2007, M12;
after Poulin et al. 1998), times a feather towards the photo's border.

For a piece of surface over the horizontal area A with normal n = (-dz/dx, -dz/dy, 1), seen along d = centre - point at depth w
along the optical axis, that area is c^2 A (n . d) / w^3: the solid angle A (n . d) / |d|^3 over the cube of the cosine to the axis.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit

from orthomill.schemas.raster import MapGrid, Window
from orthomill.tasks.geometry.distortion import pixel_to_image
from orthomill.tasks.geometry.view import View, project_point
from orthomill.tasks.imagery.pyramid import level_shape
from orthomill.tasks.visibility.height_model import WALL

STEEPEST = 3.0
"""Slopes are limited to this value, so that the ortho cell of a wall keeps some weight in every photo."""
LEAST_FACING = 0.05
"""Least n . d as a share of the height difference: a visible cell keeps some weight even where its noisy normal faces away."""
_LEAST_WORTH = 1e-12  # a visible pixel differs from an invisible one, even on the very border of the photo
_FIELD_MARGIN = 1.05  # on the squared tangent of the field angle


@dataclass(frozen=True)
class Ground:
    """Ortho pixels with heights: `z` (rows, cols) m, NaN where there is none, and the surface's slopes `dx`, `dy` (m per m),
    float32."""

    grid: MapGrid
    window: Window
    z: np.ndarray
    dx: np.ndarray
    dy: np.ndarray

    def part(self, window: Window) -> "Ground":
        """The pixels of a window (in the ortho grid) that lies within this one."""
        inner = Window(window.row - self.window.row, window.col - self.window.col, window.height, window.width).slices
        return Ground(self.grid, window, *(np.ascontiguousarray(values[inner]) for values in (self.z, self.dx, self.dy)))


@dataclass(frozen=True)
class PhotoPixelsAt:
    """Pixels of a photograph, (rows, cols, bands), at `window` of its pyramid level `level`."""

    pixels: np.ndarray
    window: Window
    level: int


class _Cells(NamedTuple):
    """Ortho pixels for the kernels: the grid, the first row and column of the window, and which pixels are sampled."""

    west: float
    north: float
    cell: float
    first_row: int
    first_col: int
    z: np.ndarray
    dx: np.ndarray
    dy: np.ndarray
    seen: np.ndarray


class _Part(NamedTuple):
    """Pixels of a photograph for the kernels: `scale` full-size pixels per pixel, first row and column in the level, and the
    level's last ones."""

    pixels: np.ndarray
    scale: float
    first_row: int
    first_col: int
    last_row: int
    last_col: int


class _Limits(NamedTuple):
    """`widest`: squared tangent of the largest field angle; `feather`: width of the border, px."""

    widest: float
    feather: float


class _Samples(NamedTuple):
    """The arrays of `Sampled` for the kernel, which fills them."""

    colour: np.ndarray
    worth: np.ndarray
    r2: np.ndarray


@njit(cache=True, inline="always")
def _keys(t, w):
    """Weights of four neighbours at the distance `t` behind the second one (Keys 1981, a = -1/2)."""
    w[0] = ((-0.5 * t + 1.0) * t - 0.5) * t
    w[1] = (1.5 * t - 2.5) * t * t + 1.0
    w[2] = ((-1.5 * t + 2.0) * t + 0.5) * t
    w[3] = (0.5 * t - 0.5) * t * t


@njit(cache=True, inline="always")
def _bicubic(part, col, row, wx, wy, colour):
    """Fills `colour` (bands) at a place of the level; False where the part does not hold the 4 x 4 neighbours.

    Beyond the border of the photograph its outermost pixels are repeated.
    """
    pixels = part.pixels
    c, r = int(np.floor(col)), int(np.floor(row))
    _keys(col - c, wx)
    _keys(row - r, wy)
    left, right = max(c - 1, 0) - part.first_col, min(c + 2, part.last_col) - part.first_col
    top, bottom = max(r - 1, 0) - part.first_row, min(r + 2, part.last_row) - part.first_row
    if left < 0 or top < 0 or right >= pixels.shape[1] or bottom >= pixels.shape[0]:
        return False
    c, r = c - 1 - part.first_col, r - 1 - part.first_row
    for band in range(pixels.shape[2]):
        total = 0.0
        for k in range(4):
            line, y = 0.0, min(max(r + k, top), bottom)
            for m in range(4):
                line += wx[m] * pixels[y, min(max(c + m, left), right), band]
            total += wy[k] * line
        colour[band] = total
    return True


@njit(cache=True, inline="always")
def _framed(n, x, y, z, widest):
    """(col, row, depth, border) of a ground point in a photo; `border`: px to its nearest border, negative outside, or NaN."""
    col, row, depth = project_point(n, x, y, z)
    border = min(min(col, n.width - 1.0 - col), min(row, n.height - 1.0 - row))
    # Outside the field of view the distortion polynomial may fold back into the photograph.
    reach = (n.xc - x) ** 2 + (n.yc - y) ** 2 + (n.zc - z) ** 2
    if depth <= 0.0 or reach > (1.0 + widest) * depth * depth:
        border = -1.0
    return col, row, depth, border


@njit(cache=True)
def _show(n, cells, widest, out):
    for i in range(cells.z.shape[0]):
        y = cells.north - (cells.first_row + i + 0.5) * cells.cell
        for j in range(cells.z.shape[1]):
            if cells.seen[i, j]:
                x = cells.west + (cells.first_col + j + 0.5) * cells.cell
                out[i, j] = _framed(n, x, y, cells.z[i, j], widest)[3] >= 0.0


@njit(cache=True)
def _sample(part, n, cells, limits, out):
    # Positions are counted in the whole grid and photograph, so that rounding is the same whatever the windows.
    z, cell = cells.z, cells.cell
    wx, wy = np.empty(4), np.empty(4)
    half_diagonal2 = 0.25 * ((n.width - 1.0) ** 2 + (n.height - 1.0) ** 2)
    for i in range(z.shape[0]):
        y = cells.north - (cells.first_row + i + 0.5) * cell
        for j in range(z.shape[1]):
            if cells.seen[i, j] == 0 or np.isnan(z[i, j]):
                continue
            x = cells.west + (cells.first_col + j + 0.5) * cell
            full_col, full_row, depth, border = _framed(n, x, y, z[i, j], limits.widest)
            if not border >= 0.0:  # also NaN
                continue
            col, row = (full_col + 0.5) / part.scale - 0.5, (full_row + 0.5) / part.scale - 0.5
            if not _bicubic(part, col, row, wx, wy, out.colour[i, j]):
                continue
            rise = n.zc - z[i, j]
            facing = rise - cells.dx[i, j] * (n.xc - x) - cells.dy[i, j] * (n.yc - y)
            facing = max(facing, LEAST_FACING * rise)
            area = n.c * n.c * cell * cell * facing / (depth * depth * depth)
            share = 1.0 if limits.feather <= 0.0 else min(border / limits.feather, 1.0)
            # A smooth step: neither end of the feather leaves a visible edge.
            out.worth[i, j] = max(area * share * share * (3.0 - 2.0 * share), _LEAST_WORTH)
            off_col, off_row = full_col - 0.5 * (n.width - 1.0), full_row - 0.5 * (n.height - 1.0)
            out.r2[i, j] = (off_col**2 + off_row**2) / half_diagonal2


def _widest(view: View) -> float:
    """Squared tangent of the angle to the photo's farthest corner, with a margin."""
    right, bottom = view.camera.width - 1.0, view.camera.height - 1.0
    corners = pixel_to_image(view.camera, np.array([[0.0, 0.0], [right, 0.0], [0.0, bottom], [right, bottom]])) / view.camera.c
    return _FIELD_MARGIN * float((corners**2).sum(axis=1).max())


@dataclass(frozen=True)
class Sampled:
    """The samples of one photograph on the ground.

    `colour` (rows, cols, bands) float32 grey values as recorded; `worth` (rows, cols) float32, photo px^2 times the border feather,
    0 where the photograph does not see the pixel; `r2` (rows, cols) float32, squared distance from the photo's middle in half
    diagonals.
    """

    colour: np.ndarray
    worth: np.ndarray
    r2: np.ndarray


def _cells(ground: Ground, chosen: np.ndarray) -> _Cells:
    grid, window = ground.grid, ground.window
    corner = float(grid.west), float(grid.north), float(grid.cell), window.row, window.col
    return _Cells(*corner, ground.z, ground.dx, ground.dy, np.ascontiguousarray(chosen))


def shown(view: View, ground: Ground, chosen: np.ndarray) -> np.ndarray:
    """bool (rows, cols): the `chosen` (uint8) pixels whose ground lies in the frame of the photograph, hidden or not."""
    out = np.zeros(ground.z.shape, np.bool_)
    _show(view.numbers, _cells(ground, chosen), _widest(view), out)
    return out


def sample_photo(view: View, photo: PhotoPixelsAt, ground: Ground, seen: np.ndarray, feather: float) -> Sampled:
    """Colour and worth of every ground pixel that `seen` (rows, cols) allows to this photograph. `feather` is in full-size px."""
    shape = ground.z.shape
    colour = np.zeros((*shape, photo.pixels.shape[2]), np.float32)
    worth, r2 = np.zeros(shape, np.float32), np.zeros(shape, np.float32)
    if photo.pixels.size:
        rows, cols = level_shape((view.camera.height, view.camera.width), photo.level)
        part = _Part(photo.pixels, 2.0**photo.level, photo.window.row, photo.window.col, rows - 1, cols - 1)
        _sample(part, view.numbers, _cells(ground, seen), _Limits(_widest(view), float(feather)), _Samples(colour, worth, r2))
    return Sampled(colour, worth, r2)


@njit(cache=True)
def _drape(heights, corner, first, divisor, limit, z):
    """Fills `z` with the heights of ortho pixels; `corner`, `first`: first row and column of the DSM window and of `z`."""
    rows, cols = z.shape
    row0, col0 = corner
    last_row, last_col = heights.shape[0] - 1, heights.shape[1] - 1
    for i in range(rows):
        y = (first[0] + i + 0.5) / divisor - 0.5
        near_r = min(max(int(np.floor(y + 0.5)) - row0, 0), last_row)
        r = min(max(int(np.floor(y)) - row0, 0), max(last_row - 1, 0))
        for j in range(cols):
            x = (first[1] + j + 0.5) / divisor - 0.5
            near_c = min(max(int(np.floor(x + 0.5)) - col0, 0), last_col)
            c = min(max(int(np.floor(x)) - col0, 0), max(last_col - 1, 0))
            z[i, j] = heights[near_r, near_c]
            # The last row and column of the model have no neighbour to interpolate with.
            if last_row < 1 or last_col < 1 or np.isnan(z[i, j]):
                continue
            a, b = heights[r, c], heights[r, c + 1]
            d, e = heights[r + 1, c], heights[r + 1, c + 1]
            lowest, highest = min(min(a, b), min(d, e)), max(max(a, b), max(d, e))
            if np.isnan(a + b + d + e) or highest - lowest > limit:
                continue
            s, t = min(max(x - (c + col0), 0.0), 1.0), min(max(y - (r + row0), 0.0), 1.0)
            z[i, j] = (1.0 - t) * ((1.0 - s) * a + s * b) + t * ((1.0 - s) * d + s * e)


def _slopes(heights: np.ndarray, cell: float) -> tuple[np.ndarray, np.ndarray]:
    """Slopes (dz/dx, dz/dy) in m per m from differences over two cells, averaged over three; 0 where a neighbour is missing."""
    # float64: differences of heights of hundreds of metres; the mean over three cells halves the effect of their noise.
    padded = np.pad(heights.astype(np.float64), 1, mode="edge")
    down = padded[:-2] + padded[1:-1] + padded[2:]
    across = padded[:, :-2] + padded[:, 1:-1] + padded[:, 2:]
    dx = (down[:, 2:] - down[:, :-2]) / (6.0 * cell)
    dy = (across[:-2] - across[2:]) / (6.0 * cell)
    steepness = np.maximum(np.hypot(dx, dy) / STEEPEST, 1.0)
    missing = np.isnan(steepness)
    limited = [np.where(missing, 0.0, slope / steepness).astype(np.float32) for slope in (dx, dy)]
    return limited[0], limited[1]


def _slopes_at(heights: np.ndarray, cell: float, rows: np.ndarray, cols: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The slopes of the cells `rows` x `cols` (ascending), computed for these and their neighbours only."""
    top, left = max(int(rows[0]) - 1, 0), max(int(cols[0]) - 1, 0)
    dx, dy = _slopes(heights[top : rows[-1] + 2, left : cols[-1] + 2], cell)
    at = np.ix_(rows - top, cols - left)
    return dx[at], dy[at]


def ground_of(heights: np.ndarray, heights_window: Window, dsm: MapGrid, ortho: MapGrid, window: Window) -> Ground:
    """The ground of the ortho pixels `window` from DSM `heights` (at `heights_window`).

    Heights are interpolated bilinearly between four DSM cells; where these differ by more than two cells in height (a wall) or one
    is missing, the nearest cell is taken: there is no ramp between a roof and the ground.
    """
    divisor = round(dsm.cell / ortho.cell)
    heights = np.ascontiguousarray(heights, np.float32)
    z = np.empty(window.shape, np.float32)
    corner, first = (heights_window.row, heights_window.col), (window.row, window.col)
    _drape(heights, corner, first, divisor, WALL * dsm.cell, z)
    rows = np.arange(window.row, window.row + window.height) // divisor - heights_window.row
    cols = np.arange(window.col, window.col + window.width) // divisor - heights_window.col
    return Ground(ortho, window, z, *_slopes_at(heights, dsm.cell, rows, cols))
