"""Collinearity equations with any lens model: residuals and analytic derivatives, ray by ray.

Rotations are corrected from the left, R <- exp([w]x) R, so that with u = R (P - C) the derivative of u by w is simply w x u.
"""

import numpy as np

from orthomill.kernels.kernel_compilation import njit
from orthomill.schemas.camera import INTERIOR
from orthomill.tasks.adjustment.model.network import Network, Rays, State
from orthomill.tasks.geometry.distortion import LensNumbers, distort_point, distortion_slopes, lens_partials

# Finite, so that squares and sums of it stay numbers; far above any image coordinate, so that it cannot be mistaken for one.
BEHIND = 1.0e5
"""Residual (px) assigned to a point behind its camera; no step that moves a point there is accepted."""

# Columns of the derivatives by the unknowns of a ray: X, Y, Z of the projection centre first, then the rotations, then INTERIOR.
ROTATION, EXTERIOR = 3, 6


@njit(inline="always")
def _lens(n, model):
    """The lens of the interior parameters `n` (INTERIOR order) with the `model` number."""
    return LensNumbers(n[3], n[4], n[5], n[6], n[7], n[8], n[9], n[10], n[11], n[12], n[13], n[14], n[15], n[16], model)


@njit()
def _residuals(photo, point, xy, rotation, centre, points, interior, models):
    """(m, 2) px: image coordinates `xy` (m, 2) less those computed, BEHIND for points that no camera can see. photo, point (m,):
    rows of `rotation` (P, 3, 3), `centre` (P, 3), `interior` (P, INTERIOR), `models` (P,), and of `points` (N, 3)."""
    out = np.empty((len(photo), 2))
    for i in range(len(photo)):
        R, n = rotation[photo[i]], interior[photo[i]]
        dx = points[point[i], 0] - centre[photo[i], 0]
        dy = points[point[i], 1] - centre[photo[i], 1]
        dz = points[point[i], 2] - centre[photo[i], 2]
        u3 = R[2, 0] * dx + R[2, 1] * dy + R[2, 2] * dz
        if u3 >= 0.0:
            out[i] = BEHIND
            continue
        a = -(R[0, 0] * dx + R[0, 1] * dy + R[0, 2] * dz) / u3
        b = -(R[1, 0] * dx + R[1, 1] * dy + R[1, 2] * dz) / u3
        xd, yd = distort_point(a, b, _lens(n, models[photo[i]]))
        out[i, 0] = xy[i, 0] - n[1] - n[0] * xd
        out[i, 1] = xy[i, 1] - n[2] - n[0] * yd
    return out


@njit()
def _derivatives(photo, point, rotation, centre, points, interior, models, wanted):
    """Derivatives of the computed image coordinates of `_residuals` by exterior and `wanted` interior parameters (m, 2, EXTERIOR
    + k), and by the points (m, 2, 3); zeros for points behind the camera."""
    jg = np.zeros((len(photo), 2, EXTERIOR + len(wanted)))
    jp = np.zeros((len(photo), 2, 3))
    du = np.empty((2, 3))
    by_lens = np.empty((2, 14))
    # With c and the principal point alone nothing of the lens is differentiated.
    lens_wanted = len(wanted) > 0 and wanted[-1] > 2
    for i in range(len(photo)):
        R, n = rotation[photo[i]], interior[photo[i]]
        c, lens = n[0], _lens(n, models[photo[i]])
        d = points[point[i]] - centre[photo[i]]
        u1 = R[0, 0] * d[0] + R[0, 1] * d[1] + R[0, 2] * d[2]
        u2 = R[1, 0] * d[0] + R[1, 1] * d[1] + R[1, 2] * d[2]
        u3 = R[2, 0] * d[0] + R[2, 1] * d[1] + R[2, 2] * d[2]
        if u3 >= 0.0:
            continue
        a, b = -u1 / u3, -u2 / u3
        xx, xy, yx, yy = distortion_slopes(a, b, lens)
        for k in range(2):
            by_a, by_b = (c * xx, c * xy) if k == 0 else (c * yx, c * yy)
            du[k, 0], du[k, 1], du[k, 2] = -by_a / u3, -by_b / u3, -(by_a * a + by_b * b) / u3
            for j in range(3):
                jp[i, k, j] = du[k, 0] * R[0, j] + du[k, 1] * R[1, j] + du[k, 2] * R[2, j]
                jg[i, k, j] = -jp[i, k, j]
            # u x (du/du), because du/dw = w x u for a correction from the left.
            jg[i, k, ROTATION] = du[k, 2] * u2 - du[k, 1] * u3
            jg[i, k, ROTATION + 1] = du[k, 0] * u3 - du[k, 2] * u1
            jg[i, k, ROTATION + 2] = du[k, 1] * u1 - du[k, 0] * u2
        if lens_wanted:
            lens_partials(a, b, lens, by_lens)
        for j in range(len(wanted)):
            parameter = wanted[j]
            if parameter == 0:
                jg[i, 0, EXTERIOR + j], jg[i, 1, EXTERIOR + j] = distort_point(a, b, lens)
            elif parameter < 3:
                # The principal point is added after the distortion: its derivatives are 1 and 0.
                jg[i, parameter - 1, EXTERIOR + j] = 1.0
            else:
                for k in range(2):
                    jg[i, k, EXTERIOR + j] = c * by_lens[k, parameter - 3]
    return jg, jp


def residuals(state: State, rays: Rays, camera_of: np.ndarray) -> np.ndarray:
    """Observed minus computed image coordinates (M, 2), px; BEHIND for points behind their camera."""
    interior, models = photo_interiors(state, camera_of)
    return _residuals(rays.photo, rays.point, rays.xy, state.rotation, state.centre, state.point, interior, models)


def derivatives(
    state: State, rays: Rays, camera_of: np.ndarray, parameters: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives of the computed image coordinates: (M, 2, 6 + k) by X, Y, Z, three rotations and the k interior `parameters`
    (ascending numbers in INTERIOR; by default all of the state); (M, 2, 3) by the point."""
    interior, models = photo_interiors(state, camera_of)
    wanted = np.arange(state.interior.shape[1]) if parameters is None else parameters
    return _derivatives(rays.photo, rays.point, state.rotation, state.centre, state.point, interior, models, wanted)


def photo_interiors(state: State, camera_of: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Interior parameters (P, 17) and codes of the lens models (P,) of the photographs."""
    missing = len(INTERIOR) - state.interior.shape[1]
    interior = np.pad(state.interior, ((0, 0), (0, missing))) if missing else state.interior
    models = np.zeros(len(interior)) if state.lens is None else state.lens
    own = interior[camera_of]
    return own if state.variation is None else own + state.variation, models[camera_of]


def residual_lengths(network: Network, state: State, rays: Rays) -> np.ndarray:
    """(M,) lengths of the residual vectors of the rays, in stated standard errors."""
    return np.linalg.norm(residuals(state, rays, network.camera_of), axis=1) / rays.sigma
