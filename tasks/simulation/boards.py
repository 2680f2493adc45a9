"""Photographs of chessboards that lie on a floor, taken by the camera of the flight as a sharp central projection.

Equal boards lie flat on one plane at different angles; the photos look down at them from different sides, tilted up to 32 degrees
and turned through the four quadrants, so that principal point and distortion separate from the exterior orientation. Every other
photo is a close one, which the first board fills; the rest show all boards or most of them. A pixel near an edge is the mean of 16
rays, any other takes one.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit

from schemas.camera import Camera
from schemas.raster import Window
from tasks.geometry.distortion import undistort_point
from tasks.geometry.rotation import rotation_matrix
from tasks.geometry.view import View
from tasks.simulation.hash_noise import normal_of, value_noise
from tasks.simulation.rendering import HALO, PSF_SIGMA, blur

CORNERS = (9, 6)
"""Inner corners: columns, rows."""
SQUARE = 0.05
"""m"""
QUIET = 0.045
"""m of white paper around the squares"""
_PLACES = np.array([[0.0, 0.0, 8.0], [-0.67, 0.51, -14.0], [0.68, 0.49, 97.0], [0.65, -0.53, 24.0], [-0.65, -0.51, 170.0]])
"""x, y (m), angle (degrees) of the first five boards."""


@dataclass(frozen=True)
class BoardPhoto:
    """A photo of the boards: its number from 0, how many boards lie there, the seed of the series and its noise (grey levels)."""

    number: int
    boards: int
    seed: int
    noise_sigma: float


def board_view(camera: Camera, photo: BoardPhoto) -> View:
    """Where the photo was taken from, in the system of the floor (m, Z up, floor at 0)."""
    generator = np.random.default_rng([photo.seed, 6, photo.number])
    close = photo.number % 2 == 1
    height = generator.uniform(0.53, 0.67) if close else generator.uniform(1.18, 1.37)
    aim = generator.uniform(-0.11, 0.11, 2) if close else generator.uniform(-0.15, 0.15, 2)
    tilt = np.radians(generator.uniform(16.0, 32.0) if photo.number % 4 else generator.uniform(0.0, 4.0))
    side = 2.0 * np.pi * photo.number / 12.0 * 5.0 + generator.uniform(-0.3, 0.3)
    omega, phi = tilt * np.sin(side), tilt * np.cos(side)
    kappa = np.radians(90.0 * (photo.number % 4) + generator.uniform(-12.0, 12.0))
    # Size of the field of view against that of the large camera, so that a small frame sees the boards as well.
    field = 0.5 * (camera.width + camera.height) / camera.c / 1.5
    rotation = rotation_matrix(float(omega), float(phi), float(kappa))
    axis = -rotation[2]
    centre = np.array([*aim, 0.0]) - axis * (height / field / -axis[2])
    return View(f"board_{photo.number + 1:02d}", camera, rotation, centre)


def board_places(count: int) -> np.ndarray:
    """(count, 4) x, y (m) of the middles of the boards, cosine and sine of their angles."""
    angle = np.radians(_PLACES[:count, 2])
    return np.column_stack([_PLACES[:count, :2], np.cos(angle), np.sin(angle)])


def board_corners(count: int) -> np.ndarray:
    """(count, rows * cols, 3) inner corners of the boards on the floor, m, row by row."""
    col, row = np.meshgrid(np.arange(CORNERS[0]), np.arange(CORNERS[1]))
    local = (np.column_stack([col.ravel(), row.ravel()]) - (np.array(CORNERS) - 1) / 2.0) * SQUARE
    places = board_places(count)
    cos, sin = places[:, 2, None], places[:, 3, None]
    x = places[:, 0, None] + local[:, 0] * cos - local[:, 1] * sin
    y = places[:, 1, None] + local[:, 0] * sin + local[:, 1] * cos
    return np.stack([x, y, np.zeros_like(x)], axis=-1)


def render_boards(camera: Camera, photo: BoardPhoto, pixels: Window) -> np.ndarray:
    """The window `pixels` of the photo, uint8 (rows, cols)."""
    view = board_view(camera, photo)
    grown = pixels.grown(HALO)
    light = np.zeros((*grown.shape, 1), np.float32)
    _cast_floor(light, view.numbers, (grown.row, grown.col), board_places(photo.boards), photo.seed)
    out = np.empty(pixels.shape, np.uint8)
    number = photo.seed * 1013 + photo.number
    _digitise(blur(light, PSF_SIGMA)[..., 0], out, photo.noise_sigma, (pixels.row, pixels.col, number))
    return out


@njit(cache=True, inline="always")
def _floor_at(x, y, places, seed):
    """(brightness, distance to the nearest edge of a square or board, m) of a point of the floor."""
    half_x, half_y = SQUARE * (CORNERS[0] + 1) / 2.0, SQUARE * (CORNERS[1] + 1) / 2.0
    nearest = np.inf
    for k in range(places.shape[0]):
        dx, dy = x - places[k, 0], y - places[k, 1]
        cos, sin = places[k, 2], places[k, 3]
        p, q = dx * cos + dy * sin, dy * cos - dx * sin
        over = max(abs(p) - half_x, abs(q) - half_y)
        nearest = min(nearest, abs(over - QUIET))
        if over < 0.0:
            i, j = (p + half_x) / SQUARE, (q + half_y) / SQUARE
            edge = SQUARE * min(abs(i - np.rint(i)), abs(j - np.rint(j)))
            black = (int(np.floor(i)) + int(np.floor(j))) % 2 == 0
            return (34.0 if black else 214.0), min(edge, nearest)
        if over < QUIET:
            return 214.0, min(over, nearest)
    return 128.0 + 14.0 * value_noise(seed + 71, x / 0.03, y / 0.03), nearest


@njit(cache=True)
def _cast_floor(light, view, corner, places, seed):
    """Fills `light` (rows, cols, 1); `view` is View.numbers, `corner` the row and column of the first pixel."""
    for row in range(light.shape[0]):
        for col in range(light.shape[1]):
            x = (corner[1] + col - view[13]) / view[12]
            y = (view[14] - (corner[0] + row)) / view[12]
            x, y = undistort_point(x, y, view[15], view[16], view[17], view[18], view[19])
            down = -(view[2] * x + view[5] * y - view[8])
            if down <= 0.02:
                light[row, col, 0] = 90.0
                continue
            depth = view[11] / down
            grey, edge = _floor_at(view[9] + depth * (view[0] * x + view[3] * y - view[6]),
                                   view[10] + depth * (view[1] * x + view[4] * y - view[7]), places, seed)
            if edge < 1.5 * depth / view[12] / down:
                grey = 0.0
                for part in range(16):
                    xs = x + (part % 4 - 1.5) * 0.25 / view[12]
                    ys = y + (part // 4 - 1.5) * 0.25 / view[12]
                    depth = view[11] / -(view[2] * xs + view[5] * ys - view[8])
                    sample, _ = _floor_at(view[9] + depth * (view[0] * xs + view[3] * ys - view[6]),
                                          view[10] + depth * (view[1] * xs + view[4] * ys - view[7]), places, seed)
                    grey += sample / 16.0
            light[row, col, 0] = grey


@njit(cache=True)
def _digitise(light, out, sigma, place):
    for row in range(out.shape[0]):
        for col in range(out.shape[1]):
            grey = light[row, col] + sigma * normal_of(place[2], place[0] + row, place[1] + col)
            out[row, col] = np.uint8(min(max(grey, 0.0), 255.0) + 0.5)
