"""Lens models, in image coordinates with y up and the radius normalised by c: ideal points to observed ones, back, and derivatives.

The models (schemas/camera.py) with OpenCV's coefficients. OpenCV's image y points down, ours up; putting -y for y changes the sign
of the terms of p1, s3 and s4 and leaves all others. Affinity and skew, those of the pixels, come last. An ideal point is that of a
central projection, the tangents of the angles to the optical axis: every model takes fields of view up to, not including, 180
degrees.

Source: Brown 1971; Kannala and Brandt 2006 (the fisheye, as in OpenCV); Claus and Fitzgibbon 2005 (rational); Fitzgibbon 2001
(division).
"""

from typing import NamedTuple

import numpy as np

from orthomill.kernels.kernel_compilation import njit
from orthomill.schemas.camera import INTERIOR, Camera

LENS = INTERIOR[3:]
"""The parameters of a lens and its pixels, without c and the principal point."""
BROWN, RATIONAL, FISHEYE, DIVISION = 0.0, 1.0, 2.0, 3.0
"""Codes of the models for kernels; a thin prism is the rational model with more terms."""
LENS_CODES = {"brown": BROWN, "rational": RATIONAL, "thin_prism": RATIONAL, "fisheye": FISHEYE, "division": DIVISION}


class LensNumbers(NamedTuple):
    """The lens of one camera for kernels, in the order of INTERIOR, and the code of its model."""

    k1: float
    k2: float
    k3: float
    p1: float
    p2: float
    affinity: float
    skew: float
    k4: float
    k5: float
    k6: float
    s1: float
    s2: float
    s3: float
    s4: float
    model: float


NO_LENS = LensNumbers._make([0.0] * len(LensNumbers._fields))
"""Brown's model without distortion, and square pixels: that of a rectified image."""


@njit(inline="always")
def radial_factor(r2, n):
    """(factor, its derivative by r^2): how much longer the radius of an observed point is than that of its ideal one."""
    if n.model == BROWN:
        return 1.0 + r2 * (n.k1 + r2 * (n.k2 + r2 * n.k3)), n.k1 + r2 * (2.0 * n.k2 + 3.0 * r2 * n.k3)
    if n.model == RATIONAL:
        over, slope_over = 1.0 + r2 * (n.k1 + r2 * (n.k2 + r2 * n.k3)), n.k1 + r2 * (2.0 * n.k2 + 3.0 * r2 * n.k3)
        under, slope_under = 1.0 + r2 * (n.k4 + r2 * (n.k5 + r2 * n.k6)), n.k4 + r2 * (2.0 * n.k5 + 3.0 * r2 * n.k6)
        return over / under, (slope_over - over / under * slope_under) / under
    if n.model == DIVISION:
        root = np.sqrt(1.0 - 4.0 * n.k1 * r2)
        return 2.0 / (1.0 + root), 4.0 * n.k1 / (root * (1.0 + root) ** 2)
    # Near the axis the quotients below lose all digits: r = tan t makes t / r = 1 - r^2 / 3.
    if r2 < 1e-12:
        return 1.0 + r2 * (n.k1 - 1.0 / 3.0), n.k1 - 1.0 / 3.0
    r = np.sqrt(r2)
    t = np.arctan(r)
    q = t * t
    bent = t * (1.0 + q * (n.k1 + q * (n.k2 + q * (n.k3 + q * n.k4))))
    slope = 1.0 + q * (3.0 * n.k1 + q * (5.0 * n.k2 + q * (7.0 * n.k3 + 9.0 * q * n.k4)))
    return bent / r, (slope / (1.0 + r2) - bent / r) / (2.0 * r2)


@njit(inline="always")
def distort_brown(x, y, n):
    """As `distort_point`, of a lens of the model BROWN: without a branch, for loops over many points."""
    r2 = x * x + y * y
    radial = 1.0 + r2 * (n.k1 + r2 * (n.k2 + r2 * n.k3))
    xd = x * radial - 2.0 * n.p1 * x * y + n.p2 * (r2 + 2.0 * x * x)
    yd = y * radial - n.p1 * (r2 + 2.0 * y * y) + 2.0 * n.p2 * x * y
    return (1.0 + n.affinity) * xd + n.skew * yd, yd


@njit(inline="always")
def distort_point(x, y, n):
    """Ideal to observed image coordinates, both in units of c (y up)."""
    r2 = x * x + y * y
    if n.model == BROWN:
        radial = 1.0 + r2 * (n.k1 + r2 * (n.k2 + r2 * n.k3))
    else:
        radial, _ = radial_factor(r2, n)
    xd = x * radial - 2.0 * n.p1 * x * y + n.p2 * (r2 + 2.0 * x * x)
    yd = y * radial - n.p1 * (r2 + 2.0 * y * y) + 2.0 * n.p2 * x * y
    if n.model == RATIONAL:
        xd += r2 * (n.s1 + r2 * n.s2)
        yd -= r2 * (n.s3 + r2 * n.s4)
    return (1.0 + n.affinity) * xd + n.skew * yd, yd


@njit(inline="always")
def distortion_slopes(x, y, n):
    """Derivatives of the observed coordinates by the ideal ones: x by x, x by y, y by x, y by y."""
    r2 = x * x + y * y
    radial, slope = radial_factor(r2, n)
    xx = radial + 2.0 * x * x * slope - 2.0 * n.p1 * y + 6.0 * n.p2 * x
    xy = 2.0 * x * y * slope - 2.0 * n.p1 * x + 2.0 * n.p2 * y
    yx = xy
    yy = radial + 2.0 * y * y * slope - 6.0 * n.p1 * y + 2.0 * n.p2 * x
    if n.model == RATIONAL:
        across, down = 2.0 * (n.s1 + 2.0 * r2 * n.s2), -2.0 * (n.s3 + 2.0 * r2 * n.s4)
        xx, xy, yx, yy = xx + x * across, xy + y * across, yx + x * down, yy + y * down
    wide = 1.0 + n.affinity
    return wide * xx + n.skew * yx, wide * xy + n.skew * yy, yx, yy


@njit()
def lens_partials(x, y, n, out):
    """Derivatives `out` (2, 14) of the observed coordinates by the parameters in the order of LENS; 0 for those that the model
    lacks."""
    r2 = x * x + y * y
    out[:] = 0.0
    if n.model == FISHEYE:
        r = np.sqrt(r2)
        t = np.arctan(r)
        # t^3 / r, t^5 / r ...: towards the axis r^2, r^4 ...
        power = t * t * (t / r if r > 1e-12 else 1.0)
        for column in (0, 1, 2, 7):
            out[0, column], out[1, column] = x * power, y * power
            power *= t * t
    elif n.model == DIVISION:
        root = np.sqrt(1.0 - 4.0 * n.k1 * r2)
        by = 4.0 * r2 / (root * (1.0 + root) ** 2)
        out[0, 0], out[1, 0] = x * by, y * by
    else:
        radial, under = 1.0, 1.0
        if n.model == RATIONAL:
            under = 1.0 + r2 * (n.k4 + r2 * (n.k5 + r2 * n.k6))
            radial = (1.0 + r2 * (n.k1 + r2 * (n.k2 + r2 * n.k3))) / under
        power = r2 / under
        for k in range(3):
            out[0, k], out[1, k] = x * power, y * power
            if n.model == RATIONAL:
                out[0, 7 + k], out[1, 7 + k] = -radial * x * power, -radial * y * power
            power *= r2
        out[0, 3], out[1, 3] = -2.0 * x * y, -(r2 + 2.0 * y * y)
        out[0, 4], out[1, 4] = r2 + 2.0 * x * x, 2.0 * x * y
        if n.model == RATIONAL:
            out[0, 10], out[0, 11], out[1, 12], out[1, 13] = r2, r2 * r2, -r2, -r2 * r2
    for column in range(14):
        out[0, column] = (1.0 + n.affinity) * out[0, column] + n.skew * out[1, column]
    xd, yd = distort_point(x, y, n)
    # Affinity and skew apply to x only: y defines the scale, otherwise c and affinity would be the same.
    out[0, 5], out[0, 6] = (xd - n.skew * yd) / (1.0 + n.affinity), yd


@njit(inline="always")
def undistort_point(xd, yd, n):
    """Observed to ideal image coordinates, in units of c (y up), by iteration until 1e-12 or 60 times.

    Where the lens folds back no ideal point exists: the result is then a large number or NaN.
    """
    if n.model == BROWN:
        # Newton needs fewer iterations, but next to the fold of a strong barrel distortion its derivative vanishes and it jumps to
        # a false root. The fixed point contracts where the correction changes by less than the radius does, as in any usable lens.
        yo = yd
        xo = (xd - n.skew * yd) / (1.0 + n.affinity)
        x, y = xo, yo
        for _ in range(60):
            r2 = x * x + y * y
            radial = 1.0 + r2 * (n.k1 + r2 * (n.k2 + r2 * n.k3))
            ex = xo - (x * radial - 2.0 * n.p1 * x * y + n.p2 * (r2 + 2.0 * x * x))
            ey = yo - (y * radial - n.p1 * (r2 + 2.0 * y * y) + 2.0 * n.p2 * x * y)
            x += ex
            y += ey
            if abs(ex) + abs(ey) < 1e-12:
                break
        return x, y
    return _undistort_wide(xd, yd, n)


@njit()
def _undistort_wide(xd, yd, n):
    """`undistort_point` of the models for wide lenses."""
    xo = (xd - n.skew * yd) / (1.0 + n.affinity)
    r = np.sqrt(xo * xo + yd * yd)
    if r == 0.0 and n.model != RATIONAL:
        return xo, yd
    if n.model == DIVISION:
        factor = 1.0 / (1.0 + n.k1 * r * r)
        return (xo * factor, yd * factor) if factor > 0.0 else (np.nan, np.nan)
    if n.model == FISHEYE:
        t = min(r, 1.5)
        for _ in range(60):
            q = t * t
            miss = r - t * (1.0 + q * (n.k1 + q * (n.k2 + q * (n.k3 + q * n.k4))))
            slope = 1.0 + q * (3.0 * n.k1 + q * (5.0 * n.k2 + q * (7.0 * n.k3 + 9.0 * q * n.k4)))
            if not slope > 0.0:
                return np.nan, np.nan
            t += miss / slope
            if abs(miss) < 1e-14:
                break
        if not 0.0 <= t < 0.5 * np.pi:
            return np.nan, np.nan
        factor = np.tan(t) / r
        return xo * factor, yd * factor
    # Newton: the observed radius of a barrel is concave in the ideal one, so that steps from inside do not overshoot; a step may
    # still not more than double the radius, and a fold (no positive determinant) has no ideal point.
    x, y = xo, yd
    for _ in range(60):
        dx, dy = distort_point(x, y, n)
        ex, ey = xd - dx, yd - dy
        xx, xy, yx, yy = distortion_slopes(x, y, n)
        det = xx * yy - xy * yx
        if not (det > 0.0 and xx + yy > 0.0):
            return np.nan, np.nan
        sx, sy = (yy * ex - xy * ey) / det, (xx * ey - yx * ex) / det
        most = np.sqrt(x * x + y * y) + 0.1
        length = np.sqrt(sx * sx + sy * sy)
        if length > most:
            sx, sy = sx * most / length, sy * most / length
        x += sx
        y += sy
        if abs(ex) + abs(ey) < 1e-13:
            break
    return x, y


@njit()
def _distort_all(xy, lens, out):
    """`distort_point` for every row of `xy` (n, 2), into `out`."""
    for i in range(xy.shape[0]):
        out[i, 0], out[i, 1] = distort_point(xy[i, 0], xy[i, 1], lens)


@njit()
def _undistort_all(xy, lens, out):
    """`undistort_point` for every row of `xy` (n, 2), into `out`."""
    for i in range(xy.shape[0]):
        out[i, 0], out[i, 1] = undistort_point(xy[i, 0], xy[i, 1], lens)


@njit()
def _slopes_all(xy, lens, slopes, partials):
    """`distortion_slopes` (n, 2, 2) and `lens_partials` (n, 2, k) for every row of `xy` (n, 2)."""
    for i in range(xy.shape[0]):
        slopes[i, 0, 0], slopes[i, 0, 1], slopes[i, 1, 0], slopes[i, 1, 1] = distortion_slopes(xy[i, 0], xy[i, 1], lens)
        lens_partials(xy[i, 0], xy[i, 1], lens, partials[i])


def lens_numbers(interior: np.ndarray, model: str) -> LensNumbers:
    """The lens of interior parameters (17,) in the order of INTERIOR."""
    return LensNumbers._make((*map(float, interior[3:]), LENS_CODES[model]))


def lens_of(camera: Camera) -> LensNumbers:
    """The lens of a camera."""
    return lens_numbers(np.array(camera.interior), camera.lens.kind)


def distorted(xy: np.ndarray, lens: LensNumbers) -> np.ndarray:
    """Ideal image coordinates (N, 2) to observed ones (N, 2), both in units of c."""
    out = np.empty((len(xy), 2))
    _distort_all(np.ascontiguousarray(xy, dtype=np.float64), lens, out)
    return out


def undistorted(xy: np.ndarray, lens: LensNumbers) -> np.ndarray:
    """Observed image coordinates (N, 2) to ideal ones (N, 2), both in units of c."""
    out = np.empty((len(xy), 2))
    _undistort_all(np.ascontiguousarray(xy, dtype=np.float64), lens, out)
    return out


def distortion_derivatives(xy: np.ndarray, lens: LensNumbers) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives of the observed coordinates of ideal ones (N, 2): (N, 2, 2) by these, (N, 2, 14) by the parameters LENS."""
    slopes, partials = np.empty((len(xy), 2, 2)), np.empty((len(xy), 2, len(LENS)))
    _slopes_all(np.ascontiguousarray(xy, dtype=np.float64), lens, slopes, partials)
    return slopes, partials


def principal_place(camera: Camera) -> tuple[float, float]:
    """Column and row of the principal point."""
    # Pixel centres are integers, so the image centre is at (width - 1) / 2 and not at width / 2.
    return camera.x0 + (camera.width - 1) / 2, (camera.height - 1) / 2 - camera.y0


def image_to_pixel(camera: Camera, xy: np.ndarray) -> np.ndarray:
    """Ideal image coordinates (N, 2) (px, y up, origin at the principal point) to observed pixels (N, 2) (col, row)."""
    observed = distorted(np.asarray(xy, dtype=np.float64) / camera.c, lens_of(camera)) * camera.c
    # Pixel centres are integers, so the image centre is at (width - 1) / 2 and not at width / 2.
    col = observed[:, 0] + camera.x0 + (camera.width - 1) / 2
    row = (camera.height - 1) / 2 - (observed[:, 1] + camera.y0)
    return np.column_stack([col, row])


def pixel_to_image(camera: Camera, pixels: np.ndarray) -> np.ndarray:
    """Observed pixels (N, 2) (col, row) to ideal image coordinates (N, 2) (px, y up, origin at the principal point)."""
    pixels = np.asarray(pixels, dtype=np.float64)
    x = pixels[:, 0] - (camera.width - 1) / 2 - camera.x0
    y = (camera.height - 1) / 2 - pixels[:, 1] - camera.y0
    return undistorted(np.column_stack([x, y]) / camera.c, lens_of(camera)) * camera.c
