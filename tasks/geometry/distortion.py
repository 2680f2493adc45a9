"""Brown's lens distortion with OpenCV's coefficients, in image coordinates with y up and the radius normalised by c.

OpenCV's image y points down, ours up; putting -y for y changes the sign of the p1 terms and leaves all others. The kernels below
are written in our coordinates with OpenCV's coefficients.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from orthomill.schemas.camera import Camera


class BrownLens(NamedTuple):
    """Distortion coefficients of one camera for the kernels, in OpenCV's convention."""

    k1: float
    k2: float
    k3: float
    p1: float
    p2: float


@njit(cache=True, inline="always")
def distort_point(x, y, k1, k2, k3, p1, p2):
    """Ideal to observed image coordinates, both in units of c (y up)."""
    r2 = x * x + y * y
    radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    xd = x * radial - 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x)
    yd = y * radial - p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y
    return xd, yd


@njit(cache=True, inline="always")
def undistort_point(xd, yd, k1, k2, k3, p1, p2):
    """Observed to ideal image coordinates by fixed-point iteration, in units of c (y up), until 1e-12 or 60 times.

    Where the radial polynomial folds back no ideal point exists: the iteration then diverges, to large numbers or NaN.
    """
    x, y = xd, yd
    # Newton needs fewer iterations, but next to the fold of a strong barrel distortion its derivative vanishes and it jumps to a
    # false root. The fixed point contracts where the correction changes by less than the radius does, as in any usable lens.
    for _ in range(60):
        dx, dy = distort_point(x, y, k1, k2, k3, p1, p2)
        ex, ey = xd - dx, yd - dy
        x += ex
        y += ey
        if abs(ex) + abs(ey) < 1e-12:
            break
    return x, y


@njit(cache=True)
def _distort_all(xy, lens, out):
    for i in range(xy.shape[0]):
        out[i, 0], out[i, 1] = distort_point(xy[i, 0], xy[i, 1], lens.k1, lens.k2, lens.k3, lens.p1, lens.p2)


@njit(cache=True)
def _undistort_all(xy, lens, out):
    for i in range(xy.shape[0]):
        out[i, 0], out[i, 1] = undistort_point(xy[i, 0], xy[i, 1], lens.k1, lens.k2, lens.k3, lens.p1, lens.p2)


def lens_of(camera: Camera) -> BrownLens:
    """The distortion coefficients of a camera."""
    return BrownLens(camera.k1, camera.k2, camera.k3, camera.p1, camera.p2)


def image_to_pixel(camera: Camera, xy: np.ndarray) -> np.ndarray:
    """Ideal image coordinates (N, 2) (px, y up, origin at the principal point) to observed pixels (N, 2) (col, row)."""
    observed = np.empty((len(xy), 2))
    _distort_all(np.ascontiguousarray(xy, dtype=np.float64) / camera.c, lens_of(camera), observed)
    observed *= camera.c
    # Pixel centres are integers, so the image centre is at (width - 1) / 2 and not at width / 2.
    col = observed[:, 0] + camera.x0 + (camera.width - 1) / 2
    row = (camera.height - 1) / 2 - (observed[:, 1] + camera.y0)
    return np.column_stack([col, row])


def pixel_to_image(camera: Camera, pixels: np.ndarray) -> np.ndarray:
    """Observed pixels (N, 2) (col, row) to ideal image coordinates (N, 2) (px, y up, origin at the principal point)."""
    pixels = np.asarray(pixels, dtype=np.float64)
    x = pixels[:, 0] - (camera.width - 1) / 2 - camera.x0
    y = (camera.height - 1) / 2 - pixels[:, 1] - camera.y0
    ideal = np.empty((len(pixels), 2))
    _undistort_all(np.column_stack([x, y]) / camera.c, lens_of(camera), ideal)
    return ideal * camera.c
