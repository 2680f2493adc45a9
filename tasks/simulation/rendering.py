"""A window of an aerial photograph: rays through four points of every pixel, colours where they meet the scene, optics, film.

1. Rays (traversal.py) start from the true camera, distortion included. A ray that meets the top of a column takes the colours of
   the scene, interpolated among cells of the same object only; one that meets a wall takes wall colour with windows, so that
   roofs do not smear down walls.
2. The lens blurs with a Gaussian of PSF_SIGMA on top of the pixel's own area.
3. Gain, offset and vignetting of the exposure, then noise hashed from photo, pixel and band.
Every step is a function of the pixel's own numbers, so tiles fit together bit for bit.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit

from orthomill.schemas.raster import MapGrid, Window
from orthomill.schemas.truth import Material
from orthomill.tasks.geometry.distortion import undistort_point
from orthomill.tasks.geometry.view import View
from orthomill.tasks.simulation.flight import FlightExposure
from orthomill.tasks.simulation.scene.ground_texture import AMBIENT, SUN, PaintedWindow
from orthomill.tasks.simulation.scene.hash_noise import normal_of, uniform_of, value_noise
from orthomill.tasks.simulation.scene.layout import Scene
from orthomill.tasks.simulation.scene.traversal import NOTHING, TOP, columns_of, first_hit, safe_start, widened
from orthomill.tasks.simulation.scene.vehicles import FIRST_NUMBER, vehicles_of, with_vehicles

PSF_SIGMA = 0.45
"""px, of the lens"""
HALO = 2
"""px around a window that the lens blurs into it"""
_TREE = int(Material.TREE)
_WATER = int(Material.WATER)
_TREE_KEY = 1 << 20


@dataclass(frozen=True)
class Film:
    """What the photo's grey levels hang on besides the light."""

    exposure: FlightExposure
    noise_sigma: float
    """grey levels"""
    seed: int


def render(scene: Scene, view: View, film: Film, pixels: Window, ground: tuple[MapGrid, Window, PaintedWindow]) -> np.ndarray:
    """The photo window `pixels`, uint8 (rows, cols, 3).

    `ground` is the grid of the scene's rasters, the window of it that the photo window can show (`flight.seen_window`) and what is
    there, without vehicles: this photo's own are added here.
    """
    grid, window, painted = ground
    painted = with_vehicles(painted, grid, window, vehicles_of(scene, film.exposure.number))
    light = cast(scene, view, pixels.grown(HALO), (grid, window, painted))
    blurred = blur(light, PSF_SIGMA)
    return expose(blurred, film, view, pixels)


def cast(scene: Scene, view: View, pixels: Window, ground: tuple[MapGrid, Window, PaintedWindow]) -> np.ndarray:
    """Light on the pixels of a window that may leave the photo: float32 (rows, cols, 3), the mean of four rays per pixel."""
    grid, window, painted = ground
    columns = columns_of(painted.surface.height, window, grid.cell)
    keys, mixed_cells = _object_keys(painted.surface.material, painted.surface.building)
    out = np.zeros((*pixels.shape, 3), np.float32)
    top = float(columns.highest.max())
    octaves = _detail_octaves(view, grid)
    numbers = np.array([grid.west, grid.north, grid.cell, top, pixels.row, pixels.col, octaves, scene.settings.seed])
    _cast(
        out,
        view.numbers,
        numbers,
        columns.numbers,
        (painted.colours, painted.surface.material, keys, mixed_cells),
        scene.buildings.table,
    )
    return out


def _detail_octaves(view: View, grid: MapGrid) -> int:
    """How many halvings of the cell the photo resolves: finer noise is added where the rasters of the scene end."""
    ground_pixel = (view.centre[2] - 40.0) / view.camera.c
    return int(np.clip(np.floor(np.log2(grid.cell / ground_pixel)), 0, 3))


@njit(cache=True)
def _object_keys(material, building):
    """(int32 key of the object that each cell belongs to, whether a cell has a neighbour that belongs to another one)."""
    rows, cols = material.shape
    keys = np.empty((rows, cols), np.int32)
    for row in range(rows):
        for col in range(cols):
            keys[row, col] = building[row, col] + (_TREE_KEY if material[row, col] == _TREE and building[row, col] == 0 else 0)
    mixed_cells = np.zeros((rows, cols), np.uint8)
    for row in range(1, rows - 1):
        for col in range(1, cols - 1):
            key = keys[row, col]
            for j in range(row - 1, row + 2):
                for i in range(col - 1, col + 2):
                    if keys[j, i] != key:
                        mixed_cells[row, col] = 1
    return keys, mixed_cells


@njit(cache=True, inline="always")
def _top_colour(paint, row, col, fu, fv, out):
    """Adds the colours at (fu, fv) of the window (cell corners) to `out`, interpolated among cells of the object of (row, col)."""
    colours, _, keys, mixed_cells = paint
    i, j = int(np.floor(fu - 0.5)), int(np.floor(fv - 0.5))
    if i < 0 or j < 0 or i + 1 >= keys.shape[1] or j + 1 >= keys.shape[0]:
        return
    wu, wv = np.float32(fu - 0.5 - i), np.float32(fv - 0.5 - j)
    one = np.float32(1.0)
    w00, w10, w01, w11 = (one - wu) * (one - wv), wu * (one - wv), (one - wu) * wv, wu * wv
    if mixed_cells[row, col]:
        key = keys[row, col]
        if keys[j, i] != key:
            w00 = np.float32(0.0)
        if keys[j, i + 1] != key:
            w10 = np.float32(0.0)
        if keys[j + 1, i] != key:
            w01 = np.float32(0.0)
        if keys[j + 1, i + 1] != key:
            w11 = np.float32(0.0)
        total = w00 + w10 + w01 + w11
        if total <= np.float32(1e-6):
            for band in range(3):
                out[band] = np.float32(colours[row, col, band])
            return
        w00, w10, w01, w11 = w00 / total, w10 / total, w01 / total, w11 / total
    for band in range(3):
        out[band] = (
            w00 * colours[j, i, band]
            + w10 * colours[j, i + 1, band]
            + w01 * colours[j + 1, i, band]
            + w11 * colours[j + 1, i + 1, band]
        )


@njit(cache=True)
def _wall_colour(house, number, seed, x, y, below_top, out):
    """Plaster of the house with rows of windows; lit by the sun as its side is turned."""
    p = (x - house[0]) * house[2] + (y - house[1]) * house[3]
    q = (y - house[1]) * house[2] - (x - house[0]) * house[3]
    end = house[4] - abs(p) < house[5] - abs(q)
    along = q if end else p
    if end:
        nx, ny = np.sign(p) * house[2], np.sign(p) * house[3]
    else:
        nx, ny = -np.sign(q) * house[3], np.sign(q) * house[2]
    light = AMBIENT + (1.0 - AMBIENT) * max(nx * SUN[0] + ny * SUN[1], 0.0) / SUN[2]
    plaster = 150.0 + 80.0 * uniform_of(seed + 51, number, 0)
    warm = 20.0 * uniform_of(seed + 52, number, 0)
    floor, bay = below_top / 3.1, along / 2.9 + 0.5
    if 0.25 < floor - np.floor(floor) < 0.72 and 0.28 < bay - np.floor(bay) < 0.72:
        plaster, warm = 62.0, -6.0
    out[0] = np.float32(min(plaster * light, 250.0))
    out[1] = np.float32(min((plaster - 0.4 * warm) * light, 250.0))
    out[2] = np.float32(min((plaster - warm) * light, 250.0))


@njit(cache=True)
def _cast(out, view, numbers, columns, paint, houses):
    """Fills `out`. `view` is View.numbers; `numbers` are west, north, cell, highest point, first row and column of the pixels,
    octaves of detail, seed; `paint` is colours, material, object keys, mixed cells."""
    west, north, cell, top = numbers[0], numbers[1], numbers[2], numbers[3]
    seed = int(numbers[7])
    octaves = int(numbers[6])
    u0, v0, z0 = (view[9] - west) / cell, (north - view[10]) / cell, view[11]
    tops, row0, col0 = columns[0], columns[2], columns[3]
    start = max(z0 - top, 0.0)
    ray = np.zeros(3, np.float32)
    high = widened(columns[1])
    for row in range(out.shape[0]):
        for col in range(out.shape[1]):
            x = (numbers[5] + col - view[13]) / view[12]
            y = (view[14] - (numbers[4] + row)) / view[12]
            x, y = undistort_point(x, y, view[15], view[16], view[17], view[18], view[19])
            down = -(view[2] * x + view[5] * y - view[8])
            du = (view[0] * x + view[3] * y - view[6]) / down / cell
            dv = -(view[1] * x + view[4] * y - view[7]) / down / cell
            begin = safe_start(high, row0, col0, u0, v0, z0, du, dv, start)
            for part in range(4):
                xs = x + (0.25 if part & 1 else -0.25) / view[12]
                ys = y + (0.25 if part & 2 else -0.25) / view[12]
                dx = view[0] * xs + view[3] * ys - view[6]
                dy = view[1] * xs + view[4] * ys - view[7]
                dz = view[2] * xs + view[5] * ys - view[8]
                du, dv = dx / -dz / cell, -dy / -dz / cell
                kind, s, r, c = first_hit(columns, u0, v0, z0, du, dv, begin, z0 + 1000.0)
                if kind == NOTHING:
                    continue
                u, v = u0 + s * du, v0 + s * dv
                key = paint[2][r, c]
                if kind == TOP or key == 0:
                    _top_colour(paint, r, c, u - col0, v - row0, ray)
                    if octaves > 0 and paint[1][r, c] != _WATER:
                        factor = np.float32(1.0)
                        size = cell
                        for octave in range(octaves):
                            noise = value_noise(seed + 61 + octave, u * cell / size, v * cell / size)
                            factor += np.float32(0.15) * np.float32(noise)
                            size *= 0.5
                        for band in range(3):
                            ray[band] *= factor
                elif key < FIRST_NUMBER:
                    _wall_colour(houses[key - 1], key, seed, west + u * cell, north - v * cell, tops[r, c, 0] - (z0 - s), ray)
                else:
                    for band in range(3):
                        ray[band] = np.float32(0.55) * paint[0][r, c, band]
                for band in range(3):
                    out[row, col, band] += np.float32(0.25) * ray[band]


def blur(light: np.ndarray, sigma: float) -> np.ndarray:
    """`light` (rows, cols, bands) float32 under a Gaussian of `sigma` px cut at HALO: smaller by HALO on every side."""
    weights = np.exp(-0.5 * (np.arange(-HALO, HALO + 1) / sigma) ** 2)
    weights = (weights / weights.sum()).astype(np.float32)
    out = np.zeros((light.shape[0] - 2 * HALO, light.shape[1] - 2 * HALO, light.shape[2]), np.float32)
    _blur(light, weights, out)
    return out


@njit(cache=True)
def _blur(light, weights, out):
    """Separable, in a fixed order of additions."""
    rows, cols, bands = out.shape
    count = len(weights)
    line = np.zeros((light.shape[1], bands), np.float32)
    for row in range(rows):
        line[:] = 0.0
        for k in range(count):
            for col in range(light.shape[1]):
                for band in range(bands):
                    line[col, band] += weights[k] * light[row + k, col, band]
        for k in range(count):
            for col in range(cols):
                for band in range(bands):
                    out[row, col, band] += weights[k] * line[col + k, band]


def expose(light: np.ndarray, film: Film, view: View, pixels: Window) -> np.ndarray:
    """Grey levels uint8 of the window `pixels` from the light on it: gain, vignetting, offset, noise."""
    exposure = film.exposure
    out = np.empty(light.shape, np.uint8)
    number = (film.seed * 1009 + exposure.number) * 8
    half = (view.camera.height - 1) / 2, (view.camera.width - 1) / 2
    optics = np.array([half[0], half[1], exposure.vignetting / (half[0] ** 2 + half[1] ** 2), exposure.offset, film.noise_sigma])
    _expose(light, out, np.array(exposure.gain), optics, (pixels.row, pixels.col, number))
    return out


@njit(cache=True)
def _expose(light, out, gain, optics, place):
    """`optics`: centre row, column, vignetting over squared corner radius, offset, noise; `place`: first row, column, seed."""
    for row in range(out.shape[0]):
        for col in range(out.shape[1]):
            down, right = place[0] + row, place[1] + col
            fall = 1.0 - optics[2] * ((down - optics[0]) ** 2 + (right - optics[1]) ** 2)
            for band in range(out.shape[2]):
                grey = optics[3] + gain[band] * fall * light[row, col, band] + optics[4] * normal_of(place[2] + band, down, right)
                out[row, col, band] = np.uint8(min(max(grey, 0.0), 255.0) + 0.5)
