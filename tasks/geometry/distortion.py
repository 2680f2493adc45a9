"""Brown's lens distortion with OpenCV's numbers, in image coordinates with y up and radius normalised by c.

OpenCV's image y points down, ours up; in our coordinates its p1 term therefore changes sign. The kernels below are written in
our coordinates with OpenCV's numbers.
"""

import numpy as np
from numba import njit

from orthomill.schemas.camera import Camera


@njit(cache=True, inline="always")
def distort_point(x, y, k1, k2, k3, p1, p2):
    """Ideal to observed, both in units of c (y up)."""
    r2 = x * x + y * y
    radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    xd = x * radial - 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x)
    yd = y * radial - p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y
    return xd, yd


@njit(cache=True, inline="always")
def undistort_point(xd, yd, k1, k2, k3, p1, p2):
    """Observed to ideal by fixed-point iteration, in units of c (y up); stops at 1e-12, at most 60 rounds."""
    x, y = xd, yd
    for _ in range(60):
        dx, dy = distort_point(x, y, k1, k2, k3, p1, p2)
        ex, ey = xd - dx, yd - dy
        x += ex
        y += ey
        if abs(ex) + abs(ey) < 1e-12:
            break
    return x, y


@njit(cache=True)
def _distort_all(xy, k, out):
    for i in range(xy.shape[0]):
        out[i, 0], out[i, 1] = distort_point(xy[i, 0], xy[i, 1], k[0], k[1], k[2], k[3], k[4])


@njit(cache=True)
def _undistort_all(xy, k, out):
    for i in range(xy.shape[0]):
        out[i, 0], out[i, 1] = undistort_point(xy[i, 0], xy[i, 1], k[0], k[1], k[2], k[3], k[4])


def distortion_numbers(camera: Camera) -> np.ndarray:
    """(k1, k2, k3, p1, p2) of a camera."""
    return np.array([camera.k1, camera.k2, camera.k3, camera.p1, camera.p2])


def image_to_pixel(camera: Camera, xy: np.ndarray) -> np.ndarray:
    """Ideal image coordinates (N, 2) (px, y up, origin at the principal point) to observed pixels (N, 2) (col, row)."""
    observed = np.empty((len(xy), 2))
    _distort_all(np.ascontiguousarray(xy, dtype=np.float64) / camera.c, distortion_numbers(camera), observed)
    observed *= camera.c
    col = observed[:, 0] + camera.x0 + (camera.width - 1) / 2
    row = (camera.height - 1) / 2 - (observed[:, 1] + camera.y0)
    return np.column_stack([col, row])


def pixel_to_image(camera: Camera, pixels: np.ndarray) -> np.ndarray:
    """Observed pixels (N, 2) (col, row) to ideal image coordinates (N, 2) (px, y up, origin at the principal point)."""
    pixels = np.asarray(pixels, dtype=np.float64)
    x = pixels[:, 0] - (camera.width - 1) / 2 - camera.x0
    y = (camera.height - 1) / 2 - pixels[:, 1] - camera.y0
    ideal = np.empty((len(pixels), 2))
    _undistort_all(np.column_stack([x, y]) / camera.c, distortion_numbers(camera), ideal)
    return ideal * camera.c
