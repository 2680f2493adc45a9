"""The colour that a photograph has for each ortho pixel, and how much that colour is worth.

Colour: bicubic (Keys 1981, a = -1/2, which reproduces a linear ramp exactly) at the projected place, lens distortion included.
Worth: the area, in photo pixels, of the ortho cell's piece of surface as projected into the photograph (Petsa et al. 2007, M12;
after Poulin et al. 1998), times a feather towards the photo's border.

For a piece of surface over the horizontal area A with normal n = (-dz/dx, -dz/dy, 1), seen along d = centre - point at depth w
along the optical axis, that area is c^2 A (n . d) / w^3: the solid angle A (n . d) / |d|^3 over the cube of the cosine to the axis.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit

from orthomill.schemas.raster import MapGrid, Window
from orthomill.tasks.geometry.distortion import pixel_to_image
from orthomill.tasks.geometry.view import View, project_point
from orthomill.tasks.visibility.height_model import WALL

STEEPEST = 3.0
"""Slope beyond which a surface counts as no steeper: a wall's ortho cell is then not worth nothing in every photo."""
LEAST_FACING = 0.05
"""Least n . d as a share of the height difference: a visible cell is worth something even where its noisy normal looks away."""


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


@njit(cache=True, inline="always")
def _keys(t, w):
    w[0] = ((-0.5 * t + 1.0) * t - 0.5) * t
    w[1] = (1.5 * t - 2.5) * t * t + 1.0
    w[2] = ((-1.5 * t + 2.0) * t + 0.5) * t
    w[3] = (0.5 * t - 0.5) * t * t


@njit(cache=True)
def _sample(pixels, place, n, widest, west, north, cell, corner, z, dx, dy, seen, feather, colour, worth, r2):
    # places are counted in the whole grid and photograph, so that rounding is the same whatever the windows
    rows, cols = z.shape
    first_row, first_col = corner
    bands = pixels.shape[2]
    scale, col0, row0 = 2.0 ** place[0], place[1], place[2]
    height, width = pixels.shape[0], pixels.shape[1]
    wx, wy = np.empty(4), np.empty(4)
    half_diagonal2 = 0.25 * ((n[20] - 1.0) ** 2 + (n[21] - 1.0) ** 2)
    for i in range(rows):
        y = north - (first_row + i + 0.5) * cell
        for j in range(cols):
            if seen[i, j] == 0 or np.isnan(z[i, j]):
                continue
            x = west + (first_col + j + 0.5) * cell
            full_col, full_row, depth = project_point(n, x, y, z[i, j])
            if depth <= 0.0:
                continue
            reach = (n[9] - x) ** 2 + (n[10] - y) ** 2 + (n[11] - z[i, j]) ** 2
            if reach > (1.0 + widest) * depth * depth:
                continue
            border = min(min(full_col, n[20] - 1.0 - full_col), min(full_row, n[21] - 1.0 - full_row))
            if not border >= 0.0:
                continue
            col, row = (full_col + 0.5) / scale - 0.5, (full_row + 0.5) / scale - 0.5
            c, r = int(np.floor(col)), int(np.floor(row))
            _keys(col - c, wx)
            _keys(row - r, wy)
            c, r = c - col0, r - row0
            if c < 1 or r < 1 or c + 2 >= width or r + 2 >= height:
                continue
            for band in range(bands):
                total = 0.0
                for k in range(4):
                    line = 0.0
                    for m in range(4):
                        line += wx[m] * pixels[r - 1 + k, c - 1 + m, band]
                    total += wy[k] * line
                colour[i, j, band] = total
            rise = n[11] - z[i, j]
            facing = rise - dx[i, j] * (n[9] - x) - dy[i, j] * (n[10] - y)
            facing = max(facing, LEAST_FACING * rise)
            area = n[12] * n[12] * cell * cell * facing / (depth * depth * depth)
            share = 1.0 if feather <= 0.0 else min(border / feather, 1.0)
            worth[i, j] = max(area * share * share * (3.0 - 2.0 * share), 1e-12)
            r2[i, j] = ((full_col - 0.5 * (n[20] - 1.0)) ** 2 + (full_row - 0.5 * (n[21] - 1.0)) ** 2) / half_diagonal2


def _widest(view: View) -> float:
    """Squared tangent of the angle to the photo's farthest corner, and a little more.

    Beyond it a distortion polynomial may bend back and show a far point inside the photograph.
    """
    right, bottom = view.camera.width - 1.0, view.camera.height - 1.0
    corners = pixel_to_image(view.camera, np.array([[0.0, 0.0], [right, 0.0], [0.0, bottom], [right, bottom]])) / view.camera.c
    return 1.05 * float((corners**2).sum(axis=1).max())


@dataclass(frozen=True)
class Sampled:
    """What one photograph says about the ground.

    `colour` (rows, cols, bands) float32 grey values as recorded; `worth` (rows, cols) float32, photo px^2 times the border feather,
    0 where the photograph does not see the pixel; `r2` (rows, cols) float32, squared distance from the photo's middle in half
    diagonals.
    """

    colour: np.ndarray
    worth: np.ndarray
    r2: np.ndarray


def sample_photo(view: View, photo: PhotoPixelsAt, ground: Ground, seen: np.ndarray, feather: float) -> Sampled:
    """Colour and worth of every ground pixel that `seen` (rows, cols) leaves to this photograph. `feather` is in full-size px."""
    shape = ground.z.shape
    bands = photo.pixels.shape[2]
    colour = np.zeros((*shape, bands), np.float32)
    worth, r2 = np.zeros(shape, np.float32), np.zeros(shape, np.float32)
    if photo.pixels.size:
        place, corner = (photo.level, photo.window.col, photo.window.row), (ground.window.row, ground.window.col)
        grid = ground.grid
        _sample(
            photo.pixels,
            place,
            view.numbers,
            _widest(view),
            grid.west,
            grid.north,
            grid.cell,
            corner,
            ground.z,
            ground.dx,
            ground.dy,
            np.ascontiguousarray(seen),
            feather,
            colour,
            worth,
            r2,
        )
    return Sampled(colour, worth, r2)


@njit(cache=True)
def _drape(heights, corner, first, divisor, limit, z):
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
    padded = np.pad(heights.astype(np.float64), 1, mode="edge")
    down = padded[:-2] + padded[1:-1] + padded[2:]
    across = padded[:, :-2] + padded[:, 1:-1] + padded[:, 2:]
    dx = (down[:, 2:] - down[:, :-2]) / (6.0 * cell)
    dy = (across[:-2] - across[2:]) / (6.0 * cell)
    steepness = np.maximum(np.hypot(dx, dy) / STEEPEST, 1.0)
    missing = np.isnan(steepness)
    return tuple(np.where(missing, 0.0, slope / steepness).astype(np.float32) for slope in (dx, dy))


def _slopes_at(heights: np.ndarray, cell: float, rows: np.ndarray, cols: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The slopes of the cells `rows` x `cols` (ascending), computed for these and their neighbours only."""
    top, left = max(int(rows[0]) - 1, 0), max(int(cols[0]) - 1, 0)
    slopes = _slopes(heights[top : rows[-1] + 2, left : cols[-1] + 2], cell)
    return tuple(slope[np.ix_(rows - top, cols - left)] for slope in slopes)


def ground_of(heights: np.ndarray, heights_window: Window, dsm: MapGrid, ortho: MapGrid, window: Window) -> Ground:
    """The ground of the ortho pixels `window` from DSM `heights` (at `heights_window`).

    Heights are bilinear between four DSM cells that belong together, and the nearest cell's where they differ by more than two
    cells in height (a wall) or one is missing: no ramp is drawn between a roof and the ground.
    """
    divisor = round(dsm.cell / ortho.cell)
    heights = np.ascontiguousarray(heights, np.float32)
    z = np.empty(window.shape, np.float32)
    corner, first = (heights_window.row, heights_window.col), (window.row, window.col)
    _drape(heights, corner, first, divisor, WALL * dsm.cell, z)
    rows = np.arange(window.row, window.row + window.height) // divisor - heights_window.row
    cols = np.arange(window.col, window.col + window.width) // divisor - heights_window.col
    return Ground(ortho, window, z, *_slopes_at(heights, dsm.cell, rows, cols))
