"""A window of an aerial photograph: rays through four points of every pixel, colours where they meet the scene, optics, film.

1. Rays (traversal.py) start from the true camera, distortion included. A ray that meets the top of a column takes the colours of
   the scene, interpolated among cells of the same object only; one that meets a wall takes wall colour with windows, so that
   roofs are not smeared down walls; leaves of crowns and wires have their own. Vehicles, wind in the crowns and glints on water
   are those of this photograph.
2. The lens blurs with a Gaussian of PSF_SIGMA in addition to the pixel's own area.
3. Gain, offset and vignetting of the exposure, then noise hashed from photo, pixel and band.
Every step depends on the pixel's own position only, so tiles fit together bit for bit.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from orthomill.kernels.kernel_compilation import njit
from orthomill.schemas.raster import MapGrid, Window
from orthomill.schemas.truth import Material
from orthomill.tasks.geometry.distortion import undistort_point
from orthomill.tasks.geometry.view import View
from orthomill.tasks.simulation.flight import FlightExposure
from orthomill.tasks.simulation.scene.aloft import CABLE, LEAF, Aloft, first_seen, lifted, nothing_aloft
from orthomill.tasks.simulation.scene.crowns import leaf_colour, leaves_at
from orthomill.tasks.simulation.scene.glints import with_glints
from orthomill.tasks.simulation.scene.ground_texture import PaintedWindow
from orthomill.tasks.simulation.scene.hash_noise import normal_of, uniform_of, value_noise
from orthomill.tasks.simulation.scene.layout import HouseColumn, Scene
from orthomill.tasks.simulation.scene.sunlight import AMBIENT, SUN
from orthomill.tasks.simulation.scene.traversal import NOTHING, TOP, Ray, columns_of, first_hit, safe_start, widened
from orthomill.tasks.simulation.scene.vehicles import FIRST_NUMBER, vehicles_of, with_vehicles
from orthomill.tasks.simulation.scene.wires import WIRE_COLOUR

PSF_SIGMA = 0.45
"""px, of the lens"""
HALO = 2
"""px around a window that the lens blurs into it"""
_TREE = int(Material.TREE)
_WATER = int(Material.WATER)
_TREE_KEY = 1 << 20  # above all numbers of buildings (16 bits): crowns are one object
_PLASTER, _WARMTH, _DETAIL = 51, 52, 61  # layers of hashed noise, added to the seed
_DETAIL_STRENGTH = np.float32(0.15)
_SUBPIXEL = 0.25  # px: the four rays of a pixel pass through the middles of its quarters
_BEYOND = 1000.0  # m below the camera's height that a ray is followed: beyond any ground


@dataclass(frozen=True)
class Film:
    """What determines the photo's grey levels apart from the light."""

    exposure: FlightExposure
    noise_sigma: float
    """grey levels"""
    seed: int


class _Frame(NamedTuple):
    """The scene's grid and the photo window for the kernel: `row`, `col` of its first pixel, `octaves` of detail, the seed."""

    west: float
    north: float
    cell: float
    row: int
    col: int
    octaves: int
    seed: int


class _Paint(NamedTuple):
    """Colours, materials, keys of the objects and mixed cells of a window of the scene, (rows, cols); houses as in the layout."""

    colours: np.ndarray
    material: np.ndarray
    keys: np.ndarray
    mixed: np.ndarray
    houses: np.ndarray


class _Optics(NamedTuple):
    """Exposure for the kernel: the middle of the photo, the falloff per squared pixel from it, offset and noise in grey levels."""

    middle_row: float
    middle_col: float
    falloff: float
    offset: float
    noise: float


def render(scene: Scene, view: View, film: Film, pixels: Window, ground: tuple[MapGrid, Window, PaintedWindow]) -> np.ndarray:
    """The photo window `pixels`, uint8 (rows, cols, 3).

    `ground` is the grid of the scene's rasters, the window of it that the photo window can show (`flight.seen_window`) and its
    content at rest: what moves is as it is in this photo.
    """
    grid, window, painted = ground
    photo = film.exposure.number
    painted = with_vehicles(painted, grid, window, vehicles_of(scene, photo))
    painted = with_glints(painted, grid, window, scene.settings.seed, photo)
    painted, aloft = lifted(scene, painted, grid, window, photo)
    light = cast(scene, view, pixels.grown(HALO), (grid, window, painted), aloft)
    blurred = blur(light, PSF_SIGMA)
    return expose(blurred, film, view, pixels)


def cast(
    scene: Scene, view: View, pixels: Window, ground: tuple[MapGrid, Window, PaintedWindow], aloft: Aloft | None = None
) -> np.ndarray:
    """Light on the pixels of a window that may leave the photo: float32 (rows, cols, 3), the mean of four rays per pixel.

    Without `aloft` crowns are solid.
    """
    grid, window, painted = ground
    columns = columns_of(painted.surface.height, window, grid.cell)
    keys, mixed_cells = _object_keys(painted.surface.material, painted.surface.building)
    out = np.zeros((*pixels.shape, 3), np.float32)
    place = float(grid.west), float(grid.north), float(grid.cell)
    frame = _Frame(*place, pixels.row, pixels.col, _detail_octaves(view, grid), scene.settings.seed)
    paint = _Paint(painted.colours, painted.surface.material, keys, mixed_cells, scene.buildings.table)
    aloft, left = aloft or nothing_aloft(), np.zeros(pixels.shape, np.uint8)
    _cast(out, view.numbers, frame, columns, paint, aloft.number, left)
    _cast_aloft(out, view.numbers, frame, columns, paint, aloft, left)
    return out


def _detail_octaves(view: View, grid: MapGrid) -> int:
    """How many halvings of the cell the photo resolves: finer noise is added below the resolution of the scene's rasters."""
    # About the height of the plain: the octave must be the same in the whole photo, or its change would show as an edge.
    ground_pixel = (view.centre[2] - 40.0) / view.camera.c
    return int(np.clip(np.floor(np.log2(grid.cell / ground_pixel)), 0, 3))


@njit()
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


@njit(inline="always")
def _top_colour(paint, row, col, fu, fv, out):
    """Sets `out` to the colour at (fu, fv) of the window (cell corners), interpolated among cells of the object of (row, col)."""
    colours, keys = paint.colours, paint.keys
    i, j = int(np.floor(fu - 0.5)), int(np.floor(fv - 0.5))
    if i < 0 or j < 0 or i + 1 >= keys.shape[1] or j + 1 >= keys.shape[0]:
        return
    wu, wv = np.float32(fu - 0.5 - i), np.float32(fv - 0.5 - j)
    one = np.float32(1.0)
    w00, w10, w01, w11 = (one - wu) * (one - wv), wu * (one - wv), (one - wu) * wv, wu * wv
    # Most cells have neighbours of their own object only, and skip the comparison of keys.
    if paint.mixed[row, col]:
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


@njit()
def _wall_colour(house, number, seed, x, y, below_top, out):
    """Plaster of the house with rows of windows; lit by the sun according to the direction of the wall."""
    cos, sin = house[HouseColumn.COS], house[HouseColumn.SIN]
    east, north = x - house[HouseColumn.X], y - house[HouseColumn.Y]
    p, q = east * cos + north * sin, north * cos - east * sin
    # The point is on the side that it is nearer to.
    end = house[HouseColumn.HALF_LENGTH] - abs(p) < house[HouseColumn.HALF_WIDTH] - abs(q)
    along = q if end else p
    if end:
        nx, ny = np.sign(p) * cos, np.sign(p) * sin
    else:
        nx, ny = -np.sign(q) * sin, np.sign(q) * cos
    light = AMBIENT + (1.0 - AMBIENT) * max(nx * SUN[0] + ny * SUN[1], 0.0) / SUN[2]
    plaster = 150.0 + 80.0 * uniform_of(seed + _PLASTER, number, 0)
    warm = 20.0 * uniform_of(seed + _WARMTH, number, 0)
    # Floors of 3.1 m, windows every 2.9 m: patterns that repeat, as they do on real walls.
    floor, bay = below_top / 3.1, along / 2.9 + 0.5
    if 0.25 < floor - np.floor(floor) < 0.72 and 0.28 < bay - np.floor(bay) < 0.72:
        plaster, warm = 62.0, -6.0
    out[0] = np.float32(min(plaster * light, 250.0))
    out[1] = np.float32(min((plaster - 0.4 * warm) * light, 250.0))
    out[2] = np.float32(min((plaster - warm) * light, 250.0))


@njit()
def _leaf(aloft, u, v, z, row, col, top, out):
    """Sets `out` to the colour of the leaves that a ray met at (u, v) of the grid and height z, in the cell (row, col)."""
    k, x, y = aloft.number[row, col] - 1, aloft.west + u * aloft.cell, aloft.north - v * aloft.cell
    brightness = leaves_at(aloft.stand, k, aloft.seed, x, y, z, top)
    leaf_colour(aloft.stand, k, aloft.seed, (x, y, z), top, brightness, out)


@njit(inline="always")
def _add_detail(frame, u, v, colour):
    """Multiplies a colour by noise finer than the cells of the scene."""
    factor = np.float32(1.0)
    size = frame.cell
    for octave in range(frame.octaves):
        noise = value_noise(frame.seed + _DETAIL + octave, u * frame.cell / size, v * frame.cell / size)
        factor += _DETAIL_STRENGTH * np.float32(noise)
        size *= 0.5
    for band in range(3):
        colour[band] *= factor


@njit(inline="always")
def _sight(n, frame, row, col):
    """Image coordinates (over c) of a pixel, without distortion."""
    x = (frame.col + col - n.col0) / n.c
    y = (n.row0 - (frame.row + row)) / n.c
    # Undistorted once per pixel: the distortion hardly differs between its four rays.
    return undistort_point(x, y, n.lens)


@njit(inline="always")
def _slope(n, frame, x, y, part):
    """Columns and rows that ray number `part` of a pixel goes per metre of depth."""
    xs = x + (_SUBPIXEL if part & 1 else -_SUBPIXEL) / n.c
    ys = y + (_SUBPIXEL if part & 2 else -_SUBPIXEL) / n.c
    dx = n.r11 * xs + n.r21 * ys - n.r31
    dy = n.r12 * xs + n.r22 * ys - n.r32
    dz = n.r13 * xs + n.r23 * ys - n.r33
    return dx / -dz / frame.cell, -dy / -dz / frame.cell


@njit()
def _side_colour(frame, columns, paint, r, c, u, v, z, out):
    """Sets `out` to the colour of the side of the column (r, c) of the window, at (u, v, z)."""
    key = paint.keys[r, c]
    if key < FIRST_NUMBER:
        east, north, below = frame.west + u * frame.cell, frame.north - v * frame.cell, columns.tops[r, c, 0] - z
        _wall_colour(paint.houses[key - 1], key, frame.seed, east, north, below, out)
        return
    # Sides of vehicles and poles, darker than their tops; solid crowns (whose key is larger still) look alike.
    for band in range(3):
        out[band] = np.float32(0.55) * paint.colours[r, c, band]


@njit()
def _cast(out, n, frame, columns, paint, number, left):
    """Fills `out`; `n` is `View.numbers`. Rays that meet a cell with a `number` (as in `Aloft`) are left: bits in `left`."""
    cell, hollow = frame.cell, number.shape[0] > 0
    u0, v0, z0 = (n.xc - frame.west) / cell, (frame.north - n.yc) / cell, n.zc
    start = max(z0 - float(columns.highest.max()), 0.0)
    colour = np.zeros(3, np.float32)
    high = widened(columns.highest)
    for row in range(out.shape[0]):
        for col in range(out.shape[1]):
            x, y = _sight(n, frame, row, col)
            down = -(n.r13 * x + n.r23 * y - n.r33)
            du = (n.r11 * x + n.r21 * y - n.r31) / down / cell
            dv = -(n.r12 * x + n.r22 * y - n.r32) / down / cell
            begin = safe_start(columns, high, Ray(u0, v0, z0, du, dv), start)
            for part in range(4):
                du, dv = _slope(n, frame, x, y, part)
                kind, s, r, c = first_hit(columns, Ray(u0, v0, z0, du, dv), begin, z0 + _BEYOND)
                if kind == NOTHING:
                    continue
                if hollow and number[r, c] != 0:
                    left[row, col] |= 1 << part
                    continue
                u, v = u0 + s * du, v0 + s * dv
                if kind == TOP or paint.keys[r, c] == 0:
                    _top_colour(paint, r, c, u - columns.col, v - columns.row, colour)
                    if frame.octaves > 0 and paint.material[r, c] != _WATER:
                        _add_detail(frame, u, v, colour)
                else:
                    _side_colour(frame, columns, paint, r, c, u, v, z0 - s, colour)
                for band in range(3):
                    out[row, col, band] += np.float32(0.25) * colour[band]


@njit()
def _cast_aloft(out, n, frame, columns, paint, aloft, left):
    """Adds the rays that `_cast` has left: through crowns and below wires."""
    # A kernel of its own: few rays come here, and what they need would slow down all others.
    u0, v0, z0 = (n.xc - frame.west) / frame.cell, (frame.north - n.yc) / frame.cell, n.zc
    start = max(z0 - float(columns.highest.max()), 0.0)
    colour = np.zeros(3, np.float32)
    for row in range(out.shape[0]):
        for col in range(out.shape[1]):
            if left[row, col] == 0:
                continue
            x, y = _sight(n, frame, row, col)
            for part in range(4):
                if not left[row, col] & 1 << part:
                    continue
                du, dv = _slope(n, frame, x, y, part)
                kind, s, r, c = first_seen(columns, aloft, Ray(u0, v0, z0, du, dv), start, z0 + _BEYOND)
                if kind == NOTHING:
                    continue
                u, v = u0 + s * du, v0 + s * dv
                if kind == LEAF:
                    _leaf(aloft, u, v, z0 - s, r, c, float(columns.tops[r, c, 0]), colour)
                elif kind == CABLE:
                    for band in range(3):
                        colour[band] = np.float32(WIRE_COLOUR[band])
                elif kind == TOP or paint.keys[r, c] == 0:
                    _top_colour(paint, r, c, u - columns.col, v - columns.row, colour)
                    if frame.octaves > 0:
                        _add_detail(frame, u, v, colour)
                else:
                    _side_colour(frame, columns, paint, r, c, u, v, z0 - s, colour)
                for band in range(3):
                    out[row, col, band] += np.float32(0.25) * colour[band]


def blur(light: np.ndarray, sigma: float) -> np.ndarray:
    """`light` (rows, cols, bands) float32 under a Gaussian of `sigma` px cut at HALO: smaller by HALO on every side."""
    weights = np.exp(-0.5 * (np.arange(-HALO, HALO + 1) / sigma) ** 2)
    weights = (weights / weights.sum()).astype(np.float32)
    out = np.zeros((light.shape[0] - 2 * HALO, light.shape[1] - 2 * HALO, light.shape[2]), np.float32)
    _blur(light, weights, out)
    return out


@njit()
def _blur(light, weights, out):
    """Separable, in a fixed order of additions."""
    # OpenCV's filters add in an order that depends on the width of the image: tiles would differ in the last bit.
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
    # A seed per photo and band: 1009 photos of one scene, and up to eight bands, draw different noise.
    seed = (film.seed * 1009 + exposure.number) * 8
    half = (view.camera.height - 1) / 2, (view.camera.width - 1) / 2
    falloff = exposure.vignetting / (half[0] ** 2 + half[1] ** 2)
    optics = _Optics(half[0], half[1], float(falloff), float(exposure.offset), float(film.noise_sigma))
    _expose(light, out, np.array(exposure.gain), optics, (pixels.row, pixels.col), seed)
    return out


@njit()
def _expose(light, out, gain, optics, corner, seed):
    """Fills `out`; `corner`: row and column of its first pixel in the photo."""
    for row in range(out.shape[0]):
        for col in range(out.shape[1]):
            down, right = corner[0] + row, corner[1] + col
            fall = 1.0 - optics.falloff * ((down - optics.middle_row) ** 2 + (right - optics.middle_col) ** 2)
            for band in range(out.shape[2]):
                noise = optics.noise * normal_of(seed + band, down, right)
                grey = optics.offset + gain[band] * fall * light[row, col, band] + noise
                # Rounded by truncation of + 0.5, which is the same in compiled and in plain code.
                out[row, col, band] = np.uint8(min(max(grey, 0.0), 255.0) + 0.5)
