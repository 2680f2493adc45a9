"""Photographs of chessboards on a floor: any camera, blur, noise, vignetting, 8 or 16 bits, window by window.

A pixel near an edge is the mean of 16 rays, any other takes one. The lens blurs with a Gaussian on top of the pixel's own area;
vignetting, noise and the range of grey values follow, as on a sensor.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit

from orthomill.schemas.raster import Window
from orthomill.tasks.geometry.distortion import undistort_point
from orthomill.tasks.geometry.view import View
from orthomill.tasks.simulation.boards.board_scene import BoardType
from orthomill.tasks.simulation.scene.hash_noise import normal_of, value_noise

_BLACK, _WHITE, _FLOOR = 34.0, 214.0, 128.0


@dataclass(frozen=True)
class BoardFilm:
    """`blur` px and `noise` (8-bit grey levels) are standard deviations; `vignetting`: light lost in the corners of the frame;
    `light`: factor of all light (saturated above about 1.15); `bits` 8 or 16."""

    blur: float = 0.45
    noise: float = 2.0
    vignetting: float = 0.0
    light: float = 1.0
    bits: int = 8
    seed: int = 0


def photograph_floor(view: View, places: np.ndarray, board: BoardType, film: BoardFilm, pixels: Window) -> np.ndarray:
    """The window `pixels` of a photo of boards at `places` (K, 3) x, y, angle on the floor; (rows, cols) uint8 or uint16."""
    halo = max(2, int(np.ceil(4.0 * film.blur)))
    light = np.zeros((pixels.height + 2 * halo, pixels.width + 2 * halo), np.float32)
    kind = np.array([(board.corners[0] + 1) / 2.0, (board.corners[1] + 1) / 2.0, board.square, board.quiet])
    turned = np.column_stack([places[:, :2], np.cos(places[:, 2]), np.sin(places[:, 2])])
    _cast_floor(light, view.numbers, (pixels.row - halo, pixels.col - halo), turned, kind, film.seed)
    blurred = _blurred(light, film.blur, halo) * np.float32(film.light)
    out = np.empty(pixels.shape, np.uint16)
    fade = film.vignetting / (0.25 * (view.camera.width**2 + view.camera.height**2))
    centre = ((view.camera.height - 1) / 2.0, (view.camera.width - 1) / 2.0)
    _digitise(blurred, out, (film.noise, fade, 257.0 if film.bits == 16 else 1.0), (pixels.row, pixels.col, film.seed), centre)
    return out if film.bits == 16 else out.astype(np.uint8)


def _blurred(light: np.ndarray, sigma: float, halo: int) -> np.ndarray:
    """`light` (rows, cols) under a Gaussian of `sigma` px: smaller by `halo` on every side."""
    weights = np.exp(-0.5 * (np.arange(-halo, halo + 1) / max(sigma, 1e-3)) ** 2)
    weights = (weights / weights.sum()).astype(np.float32)
    rows, cols = light.shape[0] - 2 * halo, light.shape[1] - 2 * halo
    along = sum(w * light[i : i + rows] for i, w in enumerate(weights))
    return sum(w * along[:, i : i + cols] for i, w in enumerate(weights))


@njit(cache=True, inline="always")
def _floor_at(x, y, places, kind, seed):
    """(brightness, distance to the nearest edge of a square or board, m) of a point of the floor."""
    square, quiet = kind[2], kind[3]
    half_x, half_y = square * kind[0], square * kind[1]
    nearest = np.inf
    for k in range(places.shape[0]):
        dx, dy = x - places[k, 0], y - places[k, 1]
        cos, sin = places[k, 2], places[k, 3]
        p, q = dx * cos + dy * sin, dy * cos - dx * sin
        over = max(abs(p) - half_x, abs(q) - half_y)
        nearest = min(nearest, abs(over - quiet))
        if over < 0.0:
            i, j = (p + half_x) / square, (q + half_y) / square
            edge = square * min(abs(i - np.rint(i)), abs(j - np.rint(j)))
            black = (int(np.floor(i)) + int(np.floor(j))) % 2 == 0
            return (_BLACK if black else _WHITE), min(edge, nearest)
        if over < quiet:
            return _WHITE, min(over, nearest)
    return _FLOOR + 14.0 * value_noise(seed + 71, x / 0.03, y / 0.03), nearest


@njit(cache=True)
def _cast_floor(light, view, corner, places, kind, seed):
    """Fills `light` (rows, cols); `view` is View.numbers, `corner` the row and column of the first pixel."""
    for row in range(light.shape[0]):
        for col in range(light.shape[1]):
            x = (corner[1] + col - view[13]) / view[12]
            y = (view[14] - (corner[0] + row)) / view[12]
            x, y = undistort_point(x, y, view[15], view[16], view[17], view[18], view[19])
            down = -(view[2] * x + view[5] * y - view[8])
            if down <= 0.02:
                light[row, col] = 90.0
                continue
            depth = view[11] / down
            grey, edge = _floor_at(
                view[9] + depth * (view[0] * x + view[3] * y - view[6]),
                view[10] + depth * (view[1] * x + view[4] * y - view[7]),
                places,
                kind,
                seed,
            )
            if edge < 1.5 * depth / view[12] / down:
                grey = 0.0
                for part in range(16):
                    # Sixteen different columns and rows, so that an edge along either covers by sixteenths and not by quarters.
                    dx, dy = (part % 4 + (part // 4 + 0.5) / 4.0) / 4.0 - 0.5, (part // 4 + (part % 4 + 0.5) / 4.0) / 4.0 - 0.5
                    xs, ys = (corner[1] + col + dx - view[13]) / view[12], (view[14] - corner[0] - row - dy) / view[12]
                    xs, ys = undistort_point(xs, ys, view[15], view[16], view[17], view[18], view[19])
                    depth = view[11] / -(view[2] * xs + view[5] * ys - view[8])
                    sample, _ = _floor_at(
                        view[9] + depth * (view[0] * xs + view[3] * ys - view[6]),
                        view[10] + depth * (view[1] * xs + view[4] * ys - view[7]),
                        places,
                        kind,
                        seed,
                    )
                    grey += sample / 16.0
            light[row, col] = grey


@njit(cache=True)
def _digitise(light, out, film, place, centre):
    for row in range(out.shape[0]):
        for col in range(out.shape[1]):
            y, x = place[0] + row - centre[0], place[1] + col - centre[1]
            grey = light[row, col] * (1.0 - film[1] * (x * x + y * y))
            grey += film[0] * normal_of(place[2], place[0] + row, place[1] + col)
            out[row, col] = np.uint16(min(max(grey, 0.0), 255.0) * film[2] + 0.5)
