"""The surface and the two photographs of the published matching experiment, exactly: heights, rays, projections, intersections.

Strategy. The surface is a sum of a plane and two sine waves along each axis, so that its height and slope are exact everywhere. A
ray of a photograph meets it at the root of one equation in Z, which Newton's method finds to 1e-10 m; the equation is monotone
because the surface is nowhere as steep as a ray. Both photographs are vertical and at the same height, so the least-squares
intersection of two rays has a closed form: x of the left and x of the right give X and Z, the mean of both y gives Y.

Pixels are (col, row) with the centre of the upper-left one at (0, 0); the published affine of the scan counts from its corner.

Source: Skarlatos (sources/matching.md#synthetic-pair), equation 4.1, table 4.3; sources/measured.md#geometry.
"""

from enum import IntEnum

import numpy as np
from numba import njit

SIDE = 10866
"""rows and columns of each photograph"""
PIXEL = 0.02116694275722
"""mm"""
CORNER = 115.0
"""mm: the upper-left corner of the scan lies at (-CORNER, CORNER)"""
C = 150.0
"""mm: principal distance; there is no distortion"""
FLYING_HEIGHT = 1900.0
BASE = 1104.0
STATION_X = (10000.0, 11104.0)
STATION_Y = 10000.0
"""m: projection centres; all angles are zero"""
# The surface of the source, 4.1: middle of the model, slope of the plane, and amplitudes and wavenumbers of the two waves.
_XS, _YS, _ZS = 10552.0, 10000.0, 100.0
_K, _A1, _A2 = 0.01, 15.0, 6.0
_P1, _P2 = np.pi / 400.0, np.pi / 90.0
_MOST_STEPS, _LAST_STEP = 30, 1e-6  # m: Newton's method converges quadratically, so the error after it is 1e-10 m and less


class PublishedPhoto(IntEnum):
    """The two photographs of the pair."""

    LEFT = 0
    RIGHT = 1


@njit(cache=True, inline="always")
def _height(x, y):
    """Height at a ground point; the same sum as in `_height_and_slopes`, for arrays of any shape."""
    u, v = x - _XS, y - _YS
    return _ZS + _K * (u - v) + _A1 * (np.sin(_P1 * u) + np.sin(_P1 * v)) + _A2 * (np.sin(_P2 * u) + np.sin(_P2 * v))


@njit(cache=True, inline="always")
def _height_and_slopes(x, y):
    """Height and its derivatives by x and y at a ground point."""
    u, v = x - _XS, y - _YS
    z = _ZS + _K * (u - v) + _A1 * (np.sin(_P1 * u) + np.sin(_P1 * v)) + _A2 * (np.sin(_P2 * u) + np.sin(_P2 * v))
    slope_x = _K + _A1 * _P1 * np.cos(_P1 * u) + _A2 * _P2 * np.cos(_P2 * u)
    slope_y = -_K + _A1 * _P1 * np.cos(_P1 * v) + _A2 * _P2 * np.cos(_P2 * v)
    return z, slope_x, slope_y


@njit(cache=True, inline="always")
def ray_height(station_x, along_x, along_y, z):
    """Height where the ray from (station_x, STATION_Y, FLYING_HEIGHT) meets the surface.

    The ray moves by (along_x, along_y) in plan for one metre down. z: where to start.
    """
    for _ in range(_MOST_STEPS):
        down = FLYING_HEIGHT - z
        surface, slope_x, slope_y = _height_and_slopes(station_x + along_x * down, STATION_Y + along_y * down)
        change = (z - surface) / (1.0 + slope_x * along_x + slope_y * along_y)
        z -= change
        if abs(change) < _LAST_STEP:
            break
    return z


@njit(cache=True)
def _surface_points(pixels, station_x, out):
    for i in range(pixels.shape[0]):
        x, y = (pixels[i, 0] + 0.5) * PIXEL - CORNER, CORNER - (pixels[i, 1] + 0.5) * PIXEL
        z = ray_height(station_x, x / C, y / C, _ZS)
        out[i, 0], out[i, 1], out[i, 2] = station_x + x / C * (FLYING_HEIGHT - z), STATION_Y + y / C * (FLYING_HEIGHT - z), z


def heights(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Heights (m) of the surface at ground coordinates (m) of any one shape."""
    return _height(np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64))


def surface_points(pixels: np.ndarray, photo: PublishedPhoto) -> np.ndarray:
    """Intersections of the rays of pixels (N, 2) (col, row) with the surface: (N, 3) X, Y, Z in m."""
    out = np.empty((len(pixels), 3))
    _surface_points(np.ascontiguousarray(pixels, dtype=np.float64), STATION_X[photo], out)
    return out


def projected(ground: np.ndarray, photo: PublishedPhoto) -> np.ndarray:
    """Pixels (N, 2) (col, row) of ground points (N, 3) in m."""
    scale = C / (FLYING_HEIGHT - ground[:, 2])
    x, y = (ground[:, 0] - STATION_X[photo]) * scale, (ground[:, 1] - STATION_Y) * scale
    return np.column_stack([(x + CORNER) / PIXEL - 0.5, (CORNER - y) / PIXEL - 0.5])


def true_matches(left: np.ndarray) -> np.ndarray:
    """Pixels (N, 2) of the right photograph that show what pixels (N, 2) of the left one show."""
    return projected(surface_points(left, PublishedPhoto.LEFT), PublishedPhoto.RIGHT)


def intersected(left: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Ground points (N, 3) in m of pixels (N, 2) of the left and the right photograph, by least squares."""
    x = (left[:, 0] + 0.5) * PIXEL - CORNER
    y = CORNER - (0.5 * (left[:, 1] + right[:, 1]) + 0.5) * PIXEL
    down = C * BASE / ((left[:, 0] - right[:, 0]) * PIXEL)
    return np.column_stack([STATION_X[0] + x / C * down, STATION_Y + y / C * down, FLYING_HEIGHT - down])


def grid_points(half_frame: float, spacing: float = 10.0) -> np.ndarray:
    """Points (N, 3) of the surface on round coordinates that both photographs show within `half_frame` mm of their centres."""
    reach = half_frame / C * FLYING_HEIGHT
    x = np.arange(np.ceil((STATION_X[1] - reach) / spacing), np.floor((STATION_X[0] + reach) / spacing) + 1) * spacing
    y = np.arange(np.ceil((STATION_Y - reach) / spacing), np.floor((STATION_Y + reach) / spacing) + 1) * spacing
    x, y = (part.ravel() for part in np.meshgrid(x, y))
    ground = np.column_stack([x, y, heights(x, y)])
    scale = C / (FLYING_HEIGHT - ground[:, 2])
    offsets = (ground[:, 0] - STATION_X[0]) * scale, (ground[:, 0] - STATION_X[1]) * scale, (ground[:, 1] - STATION_Y) * scale
    return ground[np.max(np.abs(offsets), axis=0) <= half_frame]
