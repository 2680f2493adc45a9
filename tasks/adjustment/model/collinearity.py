"""Collinearity equations with Brown's distortion: residuals and analytic derivatives, ray by ray.

Rotations are corrected from the left, R <- exp([w]x) R, so that with u = R (P - C) the derivative of u by w is simply w x u.
"""

import numpy as np
from numba import njit

from orthomill.tasks.adjustment.model.network import Network, Rays, State
from orthomill.tasks.geometry.distortion import distort_point

# Finite, so that squares and sums of it stay numbers; far above any image coordinate, so that it cannot be mistaken for one.
BEHIND = 1.0e5
"""Residual (px) assigned to a point behind its camera; no step that moves a point there is accepted."""

# Columns of the derivatives by the unknowns of a ray: X, Y, Z of the projection centre first, then these.
ROTATION, C, X0, Y0, RADIAL, P1, P2, COLUMNS = 3, 6, 7, 8, 9, 12, 13, 14


@njit(cache=True)
def _residuals(photo, camera, point, xy, rotation, centre, points, interior):
    out = np.empty((len(photo), 2))
    for i in range(len(photo)):
        R, n = rotation[photo[i]], interior[camera[i]]
        c, x0, y0, k1, k2, k3, p1, p2 = n[0], n[1], n[2], n[3], n[4], n[5], n[6], n[7]
        dx = points[point[i], 0] - centre[photo[i], 0]
        dy = points[point[i], 1] - centre[photo[i], 1]
        dz = points[point[i], 2] - centre[photo[i], 2]
        u3 = R[2, 0] * dx + R[2, 1] * dy + R[2, 2] * dz
        if u3 >= 0.0:
            out[i] = BEHIND
            continue
        a = -(R[0, 0] * dx + R[0, 1] * dy + R[0, 2] * dz) / u3
        b = -(R[1, 0] * dx + R[1, 1] * dy + R[1, 2] * dz) / u3
        xd, yd = distort_point(a, b, k1, k2, k3, p1, p2)
        out[i, 0] = xy[i, 0] - x0 - c * xd
        out[i, 1] = xy[i, 1] - y0 - c * yd
    return out


@njit(cache=True)
def _derivatives(photo, camera, point, rotation, centre, points, interior):
    jg = np.zeros((len(photo), 2, COLUMNS))
    jp = np.zeros((len(photo), 2, 3))
    du = np.empty((2, 3))
    for i in range(len(photo)):
        R, n = rotation[photo[i]], interior[camera[i]]
        c, k1, k2, k3, p1, p2 = n[0], n[3], n[4], n[5], n[6], n[7]
        d = points[point[i]] - centre[photo[i]]
        u1 = R[0, 0] * d[0] + R[0, 1] * d[1] + R[0, 2] * d[2]
        u2 = R[1, 0] * d[0] + R[1, 1] * d[1] + R[1, 2] * d[2]
        u3 = R[2, 0] * d[0] + R[2, 1] * d[1] + R[2, 2] * d[2]
        if u3 >= 0.0:
            continue
        a, b = -u1 / u3, -u2 / u3
        r2 = a * a + b * b
        radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
        slope = k1 + r2 * (2.0 * k2 + 3.0 * r2 * k3)
        # Brown's distortion is a gradient: d xd / d b = d yd / d a, so that one mixed derivative serves both rows.
        xx = c * (radial + 2.0 * a * a * slope - 2.0 * p1 * b + 6.0 * p2 * a)
        xy = c * (2.0 * a * b * slope - 2.0 * p1 * a + 2.0 * p2 * b)
        yy = c * (radial + 2.0 * b * b * slope - 6.0 * p1 * b + 2.0 * p2 * a)
        for k in range(2):
            by_a, by_b = (xx, xy) if k == 0 else (xy, yy)
            du[k, 0], du[k, 1], du[k, 2] = -by_a / u3, -by_b / u3, -(by_a * a + by_b * b) / u3
            for j in range(3):
                jp[i, k, j] = du[k, 0] * R[0, j] + du[k, 1] * R[1, j] + du[k, 2] * R[2, j]
                jg[i, k, j] = -jp[i, k, j]
            # u x (du/du), because du/dw = w x u for a correction from the left.
            jg[i, k, ROTATION] = du[k, 2] * u2 - du[k, 1] * u3
            jg[i, k, ROTATION + 1] = du[k, 0] * u3 - du[k, 2] * u1
            jg[i, k, ROTATION + 2] = du[k, 1] * u1 - du[k, 0] * u2
        xd, yd = distort_point(a, b, k1, k2, k3, p1, p2)
        jg[i, 0, C], jg[i, 1, C] = xd, yd
        # The principal point is added after the distortion: its derivatives are 1 and 0.
        jg[i, 0, X0], jg[i, 1, Y0] = 1.0, 1.0
        power = c * r2
        for k in range(RADIAL, P1):
            jg[i, 0, k], jg[i, 1, k] = a * power, b * power
            power *= r2
        jg[i, 0, P1], jg[i, 1, P1] = -2.0 * c * a * b, -c * (r2 + 2.0 * b * b)
        jg[i, 0, P2], jg[i, 1, P2] = c * (r2 + 2.0 * a * a), 2.0 * c * a * b
    return jg, jp


def residuals(state: State, rays: Rays, camera_of: np.ndarray) -> np.ndarray:
    """Observed minus computed image coordinates (M, 2), px; BEHIND for points behind their camera."""
    return _residuals(
        rays.photo, camera_of[rays.photo], rays.point, rays.xy, state.rotation, state.centre, state.point, state.interior
    )


def derivatives(state: State, rays: Rays, camera_of: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives of the computed image coordinates: (M, 2, 14) by X, Y, Z, three rotations and INTERIOR; (M, 2, 3) by the
    point."""
    return _derivatives(rays.photo, camera_of[rays.photo], rays.point, state.rotation, state.centre, state.point, state.interior)


def residual_lengths(network: Network, state: State, rays: Rays) -> np.ndarray:
    """(M,) lengths of the residual vectors of the rays, in stated standard errors."""
    return np.linalg.norm(residuals(state, rays, network.camera_of), axis=1) / rays.sigma
