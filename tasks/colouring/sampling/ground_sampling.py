"""The colour that a photograph has for each ortho pixel, and the weight of that colour.

Colour: bicubic (Keys 1981, a = -1/2, which reproduces a linear ramp exactly) at the projected place, lens distortion included.
Worth: the area, in photo pixels, of the ortho cell's piece of surface as projected into the photograph (Petsa et al. 2007,
sources/blending.md, M12; after Poulin et al. 1998), times a feather towards the photo's border.

For a piece of surface over the horizontal area A with normal n = (-dz/dx, -dz/dy, 1), seen along d = centre - point at depth w
along the optical axis, that area is c^2 A (n . d) / w^3: the solid angle A (n . d) / |d|^3 over the cube of the cosine to the axis.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from orthomill.kernels.kernel_compilation import njit
from orthomill.schemas.raster import MapGrid, Window
from orthomill.tasks.colouring.balance.photo_radiometry import correct
from orthomill.tasks.colouring.sampling.photograph_colours import (
    LEAST_WEIGHT,
    PhotoPixelsAt,
    border_colours,
    drop_gaps,
    inner_colours,
    part_pixels,
)
from orthomill.tasks.geometry.view import FIELD_MARGIN, View, empty_row, frame_row, in_frame
from orthomill.tasks.visibility.height_model import WALL

STEEPEST = 3.0
"""Slopes are limited to this value, so that the ortho cell of a wall keeps some weight in every photo."""
LEAST_FACING = 0.05
"""Least n . d as a share of the height difference: a visible cell keeps some weight even where its noisy normal faces away."""
_SLOPE = 1.8
"""times that the cells around rise as much as a step that is one of a slope: three on an even slope, one at a wall"""
_RUN = 64  # pixels of a row that are placed, coloured and corrected while they are in the processor's nearest cache


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
        inner = window.within(self.window).slices
        return Ground(self.grid, window, *(np.ascontiguousarray(values[inner]) for values in (self.z, self.dx, self.dy)))


class _Cells(NamedTuple):
    """Ortho pixels for the kernels: the grid, the first row and column of the window, and the factor on the weight of
    each pixel, 0 for those that are not sampled."""

    west: float
    north: float
    cell: float
    first_row: int
    first_col: int
    z: np.ndarray
    dx: np.ndarray
    dy: np.ndarray
    factor: np.ndarray


class _Limits(NamedTuple):
    """`widest`: squared tangent of the largest field angle; `feather`: width of the border, px."""

    widest: float
    feather: float


class _Samples(NamedTuple):
    """The arrays of `Sampled` for the kernel, which fills them."""

    colour: np.ndarray
    weight: np.ndarray
    r2: np.ndarray


@njit(error_model="numpy", fastmath={"contract"})
def _weigh_row(n, cells, limits, i, first, x, y, line, weight, r2):
    """Fills weight, 0 outside of the photograph, and r2 (cols) of the pixels of row i from column `first` on, at x (cols) and y;
    line: their `FramedRow`."""
    # No branch, and float32: weights need no more digits, and twice as many pixels are computed at a time.
    zero, one, two, three = np.float32(0.0), np.float32(1.0), np.float32(2.0), np.float32(3.0)
    last = first + weight.size
    z, slope_x, slope_y = cells.z[i, first:last], cells.dx[i, first:last], cells.dy[i, first:last]
    factor = cells.factor[i, first:last]
    half_width, half_height = 0.5 * (n.width - 1.0), 0.5 * (n.height - 1.0)
    diagonal = np.float32(1.0 / (half_width**2 + half_height**2))
    scale, softness = np.float32((n.c * cells.cell) ** 2), np.float32(1.0 / max(limits.feather, 1e-30))
    facing_least, least, dy = np.float32(LEAST_FACING), np.float32(LEAST_WEIGHT), np.float32(y - n.yc)
    for j in range(weight.size):
        dx, above = np.float32(x[j] - n.xc), np.float32(n.zc - z[j])
        off_col, off_row = np.float32(line.col[j] - half_width), np.float32(line.row[j] - half_height)
        border, inverse = np.float32(line.border[j]), np.float32(line.inverse[j])
        facing = max(slope_x[j] * dx + slope_y[j] * dy + above, facing_least * above)
        share = min(border * softness, one)
        # A smooth step: neither end of the feather leaves a visible edge.
        area = max(scale * facing * (inverse * inverse * inverse) * (share * share * (three - two * share)), least)
        inside = border >= zero
        weight[j] = area * factor[j] if inside else zero
        r2[j] = (off_col * off_col + off_row * off_row) * diagonal if inside else zero


@njit()
def _sample(part, n, cells, limits, correction, out):
    """Fills `out` with what the view n, of which `part` is at hand, shows of the cells; correction: terms, or none (0, 0)."""
    # Positions are counted in the whole grid and photograph, so that rounding is the same whatever the windows.
    rows, cols = cells.z.shape
    x = np.empty(cols)
    for j in range(cols):
        x[j] = cells.west + (cells.first_col + j + 0.5) * cells.cell
    places, flat = empty_row(_RUN), part.pixels.reshape(-1)
    for i in range(rows):
        y = cells.north - (cells.first_row + i + 0.5) * cells.cell
        for first in range(0, cols, _RUN):
            last = min(first + _RUN, cols)
            # A photograph often shows a corner of the tile only, and of a strip with a wall a few pixels are asked for.
            if not cells.factor[i, first:last].any():
                continue
            weight, r2, colour = out.weight[i, first:last], out.r2[i, first:last], out.colour[i, first:last]
            frame_row(n, x[first:last], y, cells.z[i, first:last], limits.widest, places)
            _weigh_row(n, cells, limits, i, first, x[first:last], y, places, weight, r2)
            if inner_colours(flat, part.pixels.shape, part.origin, places, weight, colour):
                border_colours(part.pixels, part.last, part.origin, places, weight, colour)
            if correction.size:
                correct(colour, r2, correction)


@dataclass(frozen=True)
class Sampled:
    """The samples of one photograph on the ground.

    `colour` (rows, cols, bands) float32 grey values as recorded; `weight` (rows, cols) float32, photo px^2 times the border
    feather, 0 where the photograph does not see the pixel; `r2` (rows, cols) float32, squared distance from the photo's middle in
    half diagonals.
    """

    colour: np.ndarray
    weight: np.ndarray
    r2: np.ndarray

    @classmethod
    def nothing(cls, shape: tuple[int, int], bands: int) -> "Sampled":
        """Samples of a photograph that sees none of the pixels (rows, cols)."""
        return cls(np.zeros((*shape, bands), np.float32), np.zeros(shape, np.float32), np.zeros(shape, np.float32))


def _cells(ground: Ground, factor: np.ndarray) -> _Cells:
    grid, window = ground.grid, ground.window
    corner = float(grid.west), float(grid.north), float(grid.cell), window.row, window.col
    return _Cells(*corner, ground.z, ground.dx, ground.dy, np.ascontiguousarray(factor, np.float32))


def shown(view: View, ground: Ground, chosen: np.ndarray) -> np.ndarray:
    """bool (rows, cols): the `chosen` (0 or 1) pixels whose ground lies in the frame of the photograph, hidden or not."""
    x, y = ground.grid.centres(ground.window)
    return in_frame(view, x, y, np.where(chosen > 0, ground.z, np.float32(np.nan)))


def sample_photo(view: View, photo: PhotoPixelsAt, ground: Ground, factor: np.ndarray, feather: float) -> Sampled:
    """Colour and weight of every ground pixel whose `factor` (rows, cols) on the weight is not 0. `feather` is in full-size px."""
    found = Sampled.nothing(ground.z.shape, photo.pixels.shape[2])
    sample_into(found, view, photo, ground, factor, feather, np.zeros((0, 0), np.float32))
    return found


def sample_into(
    found: Sampled, view: View, photo: PhotoPixelsAt, ground: Ground, factor: np.ndarray, feather: float, correction: np.ndarray
) -> None:
    """As `sample_photo`, into arrays of zeros. Colours are corrected as by `radiometric_balance.correct`, if there are terms."""
    if photo.pixels.size:
        part = part_pixels(photo, (view.camera.height, view.camera.width))
        limits = _Limits(FIELD_MARGIN * view.field, float(feather))
        out = _Samples(found.colour, found.weight, found.r2)
        _sample(part, view.numbers, _cells(ground, factor), limits, correction, out)
        if part.pixels.dtype == np.float32:
            drop_gaps(found.colour, found.weight)


@njit(inline="always")
def _between(place, first, last):
    """The nearest cell to a place, the first of the two around it, and the share of the second one; cells are counted in a window
    from `first` on, whose last one is `last`."""
    low = int(np.floor(place)) - first
    cell = min(max(low, 0), max(last - 1, 0))
    return min(max(int(np.floor(place + 0.5)) - first, 0), last), cell, min(max(place - (cell + first), 0.0), 1.0)


@njit()
def _goes_on(heights, row, col, step):
    """Whether the `step` (m) between four cells, the first at row and col, is one of a slope: the cells around them rise and fall
    as steeply."""
    lowest, highest = np.inf, -np.inf
    for r in range(max(row - 1, 0), min(row + 3, heights.shape[0])):
        for c in range(max(col - 1, 0), min(col + 3, heights.shape[1])):
            # A hole compares as neither.
            lowest, highest = min(lowest, heights[r, c]), max(highest, heights[r, c])
    return highest - lowest > _SLOPE * step


@njit()
def _drape(heights, corner, first, step, divisor, limit, z):
    """Fills `z` with the heights of every `step`-th ortho pixel; `corner`, `first`: first row and column of the DSM window and of
    the pixels."""
    rows, cols = z.shape
    last_row, last_col = heights.shape[0] - 1, heights.shape[1] - 1
    near_c, left, share = np.empty(cols, np.int64), np.empty(cols, np.int64), np.empty(cols)
    for j in range(cols):
        near_c[j], left[j], share[j] = _between((first[1] + j * step + 0.5) / divisor - 0.5, corner[1], last_col)
    for i in range(rows):
        near_r, r, t = _between((first[0] + i * step + 0.5) / divisor - 0.5, corner[0], last_row)
        for j in range(cols):
            c, s = left[j], share[j]
            z[i, j] = heights[near_r, near_c[j]]
            # The last row and column of the model have no neighbour to interpolate with.
            if last_row < 1 or last_col < 1 or np.isnan(z[i, j]):
                continue
            a, b = heights[r, c], heights[r, c + 1]
            d, e = heights[r + 1, c], heights[r + 1, c + 1]
            lowest, highest = min(min(a, b), min(d, e)), max(max(a, b), max(d, e))
            if np.isnan(a + b + d + e) or (highest - lowest > limit and not _goes_on(heights, r, c, highest - lowest)):
                continue
            z[i, j] = (1.0 - t) * ((1.0 - s) * a + s * b) + t * ((1.0 - s) * d + s * e)


@njit()
def _slopes(heights, cell, rows, cols, dx, dy):
    """Slopes (dz/dx, dz/dy) in m per m of the cells `rows` x `cols`, from differences over two cells, averaged over three; 0 where
    a neighbour is missing. The cells at the edge of the model are their own neighbours beyond it."""
    last_row, last_col = heights.shape[0] - 1, heights.shape[1] - 1
    for i in range(rows.size):
        r = rows[i]
        # Several ortho pixels follow each other in a cell, both ways.
        if i > 0 and r == rows[i - 1]:
            dx[i], dy[i] = dx[i - 1], dy[i - 1]
            continue
        north, south = max(r - 1, 0), min(r + 1, last_row)
        for j in range(cols.size):
            if j > 0 and cols[j] == cols[j - 1]:
                dx[i, j], dy[i, j] = dx[i, j - 1], dy[i, j - 1]
                continue
            west, c, east = max(cols[j] - 1, 0), cols[j], min(cols[j] + 1, last_col)
            # float64 differences of heights of hundreds of metres; the mean over three cells halves the effect of their noise.
            here = np.float64(heights[r, c])
            a, b, d = heights[north, west] - here, heights[north, c] - here, heights[north, east] - here
            e, f = heights[r, west] - here, heights[r, east] - here
            g, h, k = heights[south, west] - here, heights[south, c] - here, heights[south, east] - here
            x, y = ((d + f + k) - (a + e + g)) / (6.0 * cell), ((a + b + d) - (g + h + k)) / (6.0 * cell)
            steepness = np.hypot(x, y) / STEEPEST
            if np.isnan(steepness):
                dx[i, j], dy[i, j] = 0.0, 0.0
            else:
                dx[i, j], dy[i, j] = x / max(steepness, 1.0), y / max(steepness, 1.0)


def every(grid: MapGrid, window: Window, spacing: int) -> tuple[MapGrid, Window]:
    """The grid whose cells are every `spacing`-th pixel of `grid`, and those of its cells that lie in `window`."""
    row, col = -(-window.row // spacing), -(-window.col // spacing)
    bottom, right = -(-(window.row + window.height) // spacing), -(-(window.col + window.width) // spacing)
    cell = grid.cell * spacing
    # Cells about the centres of the pixels.
    west, north = grid.west + 0.5 * (grid.cell - cell), grid.north - 0.5 * (grid.cell - cell)
    coarse = MapGrid(west=west, north=north, cell=cell, rows=-(-grid.rows // spacing), cols=-(-grid.cols // spacing))
    return coarse, Window(row, col, bottom - row, right - col)


def ground_of(
    heights: np.ndarray, heights_window: Window, dsm: MapGrid, ortho: MapGrid, window: Window, spacing: int = 1
) -> Ground:
    """The ground of every `spacing`-th of the ortho pixels `window` from DSM `heights` (at `heights_window`).

    Pixels whose row and column in the whole orthoimage are multiples of `spacing` are taken. Heights are interpolated bilinearly
    between four DSM cells; where these differ by more than two cells in height (a wall) or one is missing, the nearest cell is
    taken: there is no ramp between a roof and the ground. Where the cells around rise on as steeply there is one already, and steps
    in it would show every place of it twice.
    """
    divisor = round(dsm.cell / ortho.cell)
    heights = np.ascontiguousarray(heights, np.float32)
    grid, taken = every(ortho, window, spacing)
    z, dx, dy = (np.empty(taken.shape, np.float32) for _ in range(3))
    corner, first = (heights_window.row, heights_window.col), (taken.row * spacing, taken.col * spacing)
    _drape(heights, corner, first, spacing, divisor, WALL * dsm.cell, z)
    rows = (first[0] + np.arange(taken.height) * spacing) // divisor - corner[0]
    cols = (first[1] + np.arange(taken.width) * spacing) // divisor - corner[1]
    _slopes(heights, dsm.cell, rows, cols, dx, dy)
    return Ground(grid, taken, z, dx, dy)
