"""Photographs of chessboards on a floor: any camera, blur, noise, vignetting, 8 or 16 bits, window by window.

A pixel near an edge is the mean of 16 rays, any other takes one. The lens blurs with a Gaussian in addition to the pixel's own
area; vignetting, noise and the limited range of grey values follow, as on a sensor.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from orthomill.kernels.kernel_compilation import njit
from orthomill.schemas.raster import Window
from orthomill.tasks.geometry.distortion import undistort_point
from orthomill.tasks.geometry.view import View
from orthomill.tasks.simulation.boards.board_scene import BoardType
from orthomill.tasks.simulation.scene.hash_noise import normal_of, value_noise

# Printed black and paper white do not reach the ends of the range: noise is then cut off neither below nor above.
_BLACK, _WHITE, _FLOOR, _WALL = 34.0, 214.0, 128.0, 90.0
"""8-bit grey values"""
_LEAST_DIP = 0.02
"""Rays with a smaller downward component do not meet the floor within any room."""
_SIDE = 4
"""Columns and rows of the rays of one pixel near an edge."""


@dataclass(frozen=True)
class BoardFilm:
    """`blur` px and `noise` (8-bit grey values) are standard deviations; `vignetting`: share of the light lost in the corners of
    the frame; `light`: factor of all light (saturated above about 1.15); `bits` 8 or 16."""

    blur: float = 0.45
    noise: float = 2.0
    vignetting: float = 0.0
    light: float = 1.0
    bits: int = 8
    seed: int = 0


class BoardFloor(NamedTuple):
    """The floor for kernels: boards at `places` (K, 4) x, y (m), cosine and sine of their angles; half their columns and rows of
    squares; side of a square and width of the white margin, m; seed of the floor's texture."""

    places: np.ndarray
    half_columns: float
    half_rows: float
    square: float
    quiet: float
    seed: int


class BoardSensor(NamedTuple):
    """The sensor for kernels: noise (grey values), vignetting per px^2 of the distance from the centre (row, col) of the frame,
    factor from 8-bit grey values; row and column of the window's first pixel, and the seed of the noise."""

    noise: float
    fade: float
    centre_row: float
    centre_col: float
    scale: float
    row: int
    col: int
    seed: int


def photograph_floor(view: View, places: np.ndarray, board: BoardType, film: BoardFilm, pixels: Window) -> np.ndarray:
    """The window `pixels` of a photo of boards at `places` (K, 3) x, y (m), angle (radians) on the floor; (rows, cols) uint8 or
    uint16."""
    # Four standard deviations hold all but 6e-5 of the Gaussian: windows then join without a seam of half a grey value.
    halo = max(2, int(np.ceil(4.0 * film.blur)))
    light = np.zeros((pixels.height + 2 * halo, pixels.width + 2 * halo), np.float32)
    _cast_floor(light, view.numbers, (pixels.row - halo, pixels.col - halo), _floor_of(places, board, film.seed))
    blurred = _blurred(light, film.blur, halo) * np.float32(film.light)
    out = np.empty(pixels.shape, np.uint16)
    _digitise(blurred, out, _sensor_of(view, film, pixels))
    return out if film.bits == 16 else out.astype(np.uint8)


def _floor_of(places: np.ndarray, board: BoardType, seed: int) -> BoardFloor:
    turned = np.column_stack([places[:, :2], np.cos(places[:, 2]), np.sin(places[:, 2])])
    columns, rows = board.corners
    return BoardFloor(turned, (columns + 1) / 2.0, (rows + 1) / 2.0, float(board.square), float(board.quiet), seed)


def _sensor_of(view: View, film: BoardFilm, pixels: Window) -> BoardSensor:
    camera = view.camera
    return BoardSensor(
        noise=float(film.noise),
        fade=film.vignetting / (0.25 * (camera.width**2 + camera.height**2)),
        centre_row=(camera.height - 1) / 2.0,
        centre_col=(camera.width - 1) / 2.0,
        # 255 becomes 65535.
        scale=257.0 if film.bits == 16 else 1.0,
        row=pixels.row,
        col=pixels.col,
        seed=film.seed,
    )


def _blurred(light: np.ndarray, sigma: float, halo: int) -> np.ndarray:
    """`light` (rows, cols) convolved with a Gaussian of `sigma` px: smaller by `halo` on every side."""
    weights = np.exp(-0.5 * (np.arange(-halo, halo + 1) / max(sigma, 1e-3)) ** 2)
    weights = (weights / weights.sum()).astype(np.float32)
    rows, cols = light.shape[0] - 2 * halo, light.shape[1] - 2 * halo
    # Rows, then columns: a Gaussian is separable.
    along = np.zeros((rows, light.shape[1]), np.float32)
    for i, w in enumerate(weights):
        along += w * light[i : i + rows]
    out = np.zeros((rows, cols), np.float32)
    for i, w in enumerate(weights):
        out += w * along[:, i : i + cols]
    return out


@njit(inline="always")
def _floor_at(x, y, floor):
    """(grey value, distance to the nearest edge of a square or board, m) of a point of the floor."""
    half_x, half_y = floor.square * floor.half_columns, floor.square * floor.half_rows
    nearest = np.inf
    for k in range(floor.places.shape[0]):
        dx, dy = x - floor.places[k, 0], y - floor.places[k, 1]
        cos, sin = floor.places[k, 2], floor.places[k, 3]
        p, q = dx * cos + dy * sin, dy * cos - dx * sin
        over = max(abs(p) - half_x, abs(q) - half_y)
        nearest = min(nearest, abs(over - floor.quiet))
        if over < 0.0:
            i, j = (p + half_x) / floor.square, (q + half_y) / floor.square
            edge = floor.square * min(abs(i - np.rint(i)), abs(j - np.rint(j)))
            black = (int(np.floor(i)) + int(np.floor(j))) % 2 == 0
            return (_BLACK if black else _WHITE), min(edge, nearest)
        if over < floor.quiet:
            return _WHITE, min(over, nearest)
    # A textured floor, as a detector is never offered a plain background outside.
    return _FLOOR + 14.0 * value_noise(floor.seed + 71, x / 0.03, y / 0.03), nearest


@njit(inline="always")
def _ray_at(view, x, y):
    """Undistorted image coordinates in units of c, and the downward component of their ray (with 1 along the optical axis)."""
    x, y = undistort_point(x, y, view.lens)
    return x, y, -(view.r13 * x + view.r23 * y - view.r33)


@njit(inline="always")
def _seen_floor(view, x, y, down, floor):
    """(grey value, distance to the nearest edge, m) where the ray of undistorted image coordinates meets the floor."""
    depth = view.zc / down
    return _floor_at(
        view.xc + depth * (view.r11 * x + view.r21 * y - view.r31),
        view.yc + depth * (view.r12 * x + view.r22 * y - view.r32),
        floor,
    )


@njit()
def _cast_floor(light, view, corner, floor):
    """Fills `light` (rows, cols); `view` is View.numbers, `corner` the row and column of the first pixel."""
    for row in range(light.shape[0]):
        for col in range(light.shape[1]):
            x, y, down = _ray_at(view, (corner[1] + col - view.col0) / view.c, (view.row0 - (corner[0] + row)) / view.c)
            if down <= _LEAST_DIP:
                light[row, col] = _WALL
                continue
            grey, edge = _seen_floor(view, x, y, down, floor)
            # 1.5 pixels on the floor, along the dip: farther away, all of the pixel has one colour.
            if edge < 1.5 * (view.zc / down) / view.c / down:
                grey = 0.0
                for part in range(_SIDE * _SIDE):
                    i, j = part % _SIDE, part // _SIDE
                    # Sixteen different columns and rows, so that an edge along either covers by sixteenths and not by quarters.
                    dx, dy = (i + (j + 0.5) / 4.0) / 4.0 - 0.5, (j + (i + 0.5) / 4.0) / 4.0 - 0.5
                    xs, ys, below = _ray_at(
                        view, (corner[1] + col + dx - view.col0) / view.c, (view.row0 - corner[0] - row - dy) / view.c
                    )
                    sample, _ = _seen_floor(view, xs, ys, below, floor)
                    grey += sample / 16.0
            light[row, col] = grey


@njit()
def _digitise(light, out, sensor):
    """Fills `out` (rows, cols) uint16 from `light` (rows, cols): vignetting, noise, range and rounding."""
    for row in range(out.shape[0]):
        for col in range(out.shape[1]):
            y, x = sensor.row + row - sensor.centre_row, sensor.col + col - sensor.centre_col
            grey = light[row, col] * (1.0 - sensor.fade * (x * x + y * y))
            # The noise belongs to the pixel of the photograph, not of the window: windows agree with the whole.
            grey += sensor.noise * normal_of(sensor.seed, sensor.row + row, sensor.col + col)
            out[row, col] = np.uint16(min(max(grey, 0.0), 255.0) * sensor.scale + 0.5)
