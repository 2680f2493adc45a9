"""Homographies from the plane of the boards to the photo, and the joint refinement of one photo's homography and its boards.

Image coordinates are px from the image centre, y up. A homography is normalised to h33 = 1.

Source: Kawka 2021, S3, S5 and S6 (sources/calibration.md); Hartley 1997 for the normalisation.
"""

import numpy as np

from orthomill.schemas.errors import GeometryError

_ROUNDS = 12
_TURN, _SHIFT = np.radians(1e-3), 1e-3
"""The published convergence limits of the joint refinement: 0.001 degrees (here in radians) and 0.001 m."""


def homography(plane: np.ndarray, xy: np.ndarray) -> np.ndarray:
    """(3, 3) from points (N, 2) of a plane to image coordinates (N, 2), by least squares (direct linear transformation).

    Raises GeometryError for fewer than four points, or points on one line.
    """
    # Without the normalisation metres and pixels meet in one matrix, and its condition number grows with their ratio (Hartley).
    T, U = _normalising(plane), _normalising(xy)
    p, q = applied(T, plane), applied(U, xy)
    one, zero = np.ones((len(p), 1)), np.zeros((len(p), 3))
    rows = np.vstack([np.hstack([p, one, zero, -q[:, :1] * p, -q[:, :1]]), np.hstack([zero, p, one, -q[:, 1:] * p, -q[:, 1:]])])
    # The 9 x 9 normal matrix instead of the singular value decomposition of 2 N rows: identification computes a homography for
    # every trial, and normalised coordinates can afford the squared condition number.
    values, vectors = np.linalg.eigh(rows.T @ rows)
    # A second zero eigenvalue means a family of solutions: all points on one line.
    if len(p) < 4 or values[1] < 1e-14 * values[-1]:
        raise GeometryError("Four corners or more that do not lie on one line are needed for a homography.")
    H = np.linalg.solve(U, vectors[:, 0].reshape(3, 3)) @ T
    return H / H[2, 2]


def applied(H: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Points (..., 2) transformed by a homography; infinite or NaN on its horizon."""
    w = points @ H[:, :2].T + H[:, 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        return w[..., :2] / w[..., 2:]


def _normalising(points: np.ndarray) -> np.ndarray:
    """(3, 3) that takes points (N, 2) to mean 0 and mean distance sqrt(2)."""
    centre = points.mean(axis=0)
    scale = np.sqrt(2.0) / max(float(np.linalg.norm(points - centre, axis=1).mean()), 1e-300)
    return np.array([[scale, 0.0, -scale * centre[0]], [0.0, scale, -scale * centre[1]], [0.0, 0.0, 1.0]])


def rigid_motion(points: np.ndarray, onto: np.ndarray) -> np.ndarray:
    """(3,) angle, x, y of the motion in the plane that takes points (N, 2) onto others (N, 2), by least squares (S5)."""
    p, q = points - points.mean(axis=0), onto - onto.mean(axis=0)
    angle = np.arctan2((p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]).sum(), (p * q).sum())
    return np.append(angle, onto.mean(axis=0) - points.mean(axis=0) @ _rotation(angle).T)


def moved(motion: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Points (N, 2) after a motion (angle, x, y) in the plane."""
    return points @ _rotation(motion[0]).T + motion[1:]


def _rotation(angle: float) -> np.ndarray:
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def refined_together(H: np.ndarray, motions: np.ndarray, local: np.ndarray, xy: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """One photo's homography and the motions (B, 3) of its boards, adjusted together; the first board is fixed (S6).

    local: (N, 2) m corners of a board; xy: (B, N, 2) their image coordinates, NaN where not known. The best iterate is returned,
    which may be the start.
    """
    best = (_misfit(H, motions, local, xy), H, motions)
    for _ in range(_ROUNDS):
        A, residual = _linearised(H, motions, local, xy)
        # A step may throw corners onto the horizon; the best iterate so far is then the answer.
        if not np.isfinite(A).all():
            break
        # The columns have different units and sizes: lstsq decides on the rank by the largest, and must not cut off the small ones.
        scale = 1.0 / np.maximum(np.linalg.norm(A, axis=0), 1e-300)
        step = scale * np.linalg.lstsq(A * scale, residual, rcond=None)[0]
        H = (H.ravel() + np.append(step[:8], 0.0)).reshape(3, 3)
        motions = motions + np.vstack([np.zeros(3), step[8:].reshape(-1, 3)])
        misfit = _misfit(H, motions, local, xy)
        if misfit < best[0]:
            best = (misfit, H, motions)
        if np.abs(step[8::3]).max(initial=0.0) < _TURN and np.abs(np.delete(step[8:], np.s_[::3])).max(initial=0.0) < _SHIFT:
            break
    return best[1], best[2]


def _misfit(H: np.ndarray, motions: np.ndarray, local: np.ndarray, xy: np.ndarray) -> float:
    computed = np.array([applied(H, moved(motion, local)) for motion in motions])
    value = float(((xy - computed)[np.isfinite(xy)] ** 2).sum())
    return value if np.isfinite(value) else np.inf


def _linearised(H: np.ndarray, motions: np.ndarray, local: np.ndarray, xy: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives (m, 8 + 3 (B - 1)) by h11 ... h32 and the motions (angle, x, y) of all boards but the first, and residuals (m,)
    of the m known coordinates."""
    boards, count = xy.shape[:2]
    A, residual = np.zeros((boards, count, 2, 8 + 3 * (boards - 1))), np.empty((boards, count, 2))
    for b, motion in enumerate(motions):
        P = moved(motion, local)
        w = P @ H[2, :2] + 1.0
        xy_now = applied(H, P)
        residual[b] = xy[b] - xy_now
        plain = np.column_stack([P, np.ones(count)]) / w[:, None]
        A[b, :, 0, :3] = A[b, :, 1, 3:6] = plain
        A[b, :, :, 6:8] = -xy_now[:, :, None] * plain[:, None, :2]
        if b:
            by_plane = (H[:2, :2] - xy_now[:, :, None] * H[2, :2]) / w[:, None, None]
            # The derivative of a rotation by its angle is the rotated vector turned by 90 degrees.
            turned = (P - motion[1:]) @ np.array([[0.0, 1.0], [-1.0, 0.0]])
            own = 8 + 3 * (b - 1)
            A[b, :, :, own] = np.einsum("nij,nj->ni", by_plane, turned)
            A[b, :, :, own + 1 : own + 3] = by_plane
    known = np.isfinite(residual)
    return A[known], residual[known]
