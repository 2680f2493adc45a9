"""Collinearity equations of board corners, with Brown's distortion, affinity and skew: residuals and analytic derivatives.

Rotations, of photos and of boards alike, are corrected from the left, R <- exp([w]x) R, so that the derivative of R p by w is
w x (R p). All corners are computed at once as arrays: a calibration has some thousand of them, and no kernel is needed.
"""

import numpy as np

from orthomill.tasks.adjustment.boards.board_network import BoardCorners, BoardState

# Finite, so that squares and sums of it stay numbers.
BEHIND = 1.0e5
"""Residual (px) assigned to a corner behind its camera; no step that moves one there is accepted."""


def projected(state: BoardState, corners: BoardCorners) -> np.ndarray:
    """Computed image coordinates (M, 2) px from the image centre, y up; NaN behind the camera."""
    _, u = _camera_points(state, corners)
    with np.errstate(divide="ignore", invalid="ignore"):
        # The camera looks along -z; what is behind it would be projected, too, upside down.
        ideal = np.where(u[:, 2:] < 0, -u[:, :2] / u[:, 2:], np.nan)
    return _pixels(state.interior, _distorted(state.interior, ideal))


def residuals(state: BoardState, corners: BoardCorners) -> np.ndarray:
    """Observed minus computed (M, 2) px; BEHIND for corners behind their camera."""
    return np.nan_to_num(corners.xy - projected(state, corners), nan=BEHIND, posinf=BEHIND, neginf=BEHIND)


def derivatives(state: BoardState, corners: BoardCorners) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives of the computed coordinates: (M, 2, 22) by photo, board and interior in the order of
    `BoardNetwork.columns_of`, and (M, 2, 3) by the corner on its board."""
    on_board, u = _camera_points(state, corners)
    ideal = -u[:, :2] / u[:, 2:]
    by_u = _by_ideal(state.interior, ideal) @ _ideal_by_u(u, ideal)
    by_point = by_u @ state.rotation[corners.photo]
    # u x (du/du) is the row form of (du/du) [w x u]: the mixed product changes cyclically.
    by_photo = np.concatenate([-by_point, np.cross(u[:, None], by_u)], axis=2)
    by_board = np.concatenate([by_point, np.cross(on_board[:, None], by_point)], axis=2)
    parts = [by_photo, by_board, _by_interior(state.interior, ideal)]
    return np.concatenate(parts, axis=2), by_point @ state.turn[corners.board]


def _camera_points(state: BoardState, corners: BoardCorners) -> tuple[np.ndarray, np.ndarray]:
    """Corners (M, 3) rotated with their boards, and corners (M, 3) in the image systems of their photographs."""
    on_board = np.einsum("mij,mj->mi", state.turn[corners.board], state.local[corners.board, corners.corner])
    from_centre = on_board + state.shift[corners.board] - state.centre[corners.photo]
    return on_board, np.einsum("mij,mj->mi", state.rotation[corners.photo], from_centre)


def _distorted(interior: np.ndarray, ideal: np.ndarray) -> np.ndarray:
    """Brown's distortion of ideal coordinates (M, 2) in units of c."""
    k1, k2, k3, p1, p2 = interior[3:8]
    a, b = ideal.T
    r2 = a * a + b * b
    radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    x = a * radial - 2.0 * p1 * a * b + p2 * (r2 + 2.0 * a * a)
    y = b * radial - p1 * (r2 + 2.0 * b * b) + 2.0 * p2 * a * b
    return np.column_stack([x, y])


def _shear(interior: np.ndarray) -> np.ndarray:
    """(2, 2) from distorted coordinates in units of c to px."""
    c, affinity, skew = interior[[0, 8, 9]]
    return c * np.array([[1.0 + affinity, skew], [0.0, 1.0]])


def _pixels(interior: np.ndarray, distorted: np.ndarray) -> np.ndarray:
    """Image coordinates (M, 2) px from the image centre."""
    return interior[1:3] + distorted @ _shear(interior).T


def _by_ideal(interior: np.ndarray, ideal: np.ndarray) -> np.ndarray:
    """(M, 2, 2): pixels by ideal coordinates in units of c."""
    k1, k2, k3, p1, p2 = interior[3:8]
    a, b = ideal.T
    r2 = a * a + b * b
    radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    slope = k1 + r2 * (2.0 * k2 + 3.0 * r2 * k3)
    mixed = 2.0 * a * b * slope - 2.0 * p1 * a + 2.0 * p2 * b
    xx = radial + 2.0 * a * a * slope - 2.0 * p1 * b + 6.0 * p2 * a
    yy = radial + 2.0 * b * b * slope - 6.0 * p1 * b + 2.0 * p2 * a
    return _shear(interior) @ np.stack([xx, mixed, mixed, yy], axis=1).reshape(-1, 2, 2)


def _ideal_by_u(u: np.ndarray, ideal: np.ndarray) -> np.ndarray:
    """(M, 2, 3): ideal coordinates by the point in the photo's system."""
    by_u = np.zeros((len(u), 2, 3))
    by_u[:, 0, 0] = by_u[:, 1, 1] = -1.0 / u[:, 2]
    by_u[:, :, 2] = -ideal / u[:, 2:]
    return by_u


def _by_interior(interior: np.ndarray, ideal: np.ndarray) -> np.ndarray:
    """(M, 2, 10): pixels by the interior parameters in the order of PARAMETERS."""
    c, shear = interior[0], _shear(interior)
    a, b = ideal.T
    r2 = a * a + b * b
    by = np.zeros((len(a), 2, 10))
    distorted = _distorted(interior, ideal)
    by[:, :, 0] = distorted @ shear.T / c
    by[:, 0, 1] = by[:, 1, 2] = 1.0
    for power, column in enumerate((3, 4, 5), start=1):
        by[:, :, column] = (ideal * r2[:, None] ** power) @ shear.T
    by[:, :, 6] = np.column_stack([-2.0 * a * b, -(r2 + 2.0 * b * b)]) @ shear.T
    by[:, :, 7] = np.column_stack([r2 + 2.0 * a * a, 2.0 * a * b]) @ shear.T
    # Affinity and skew apply to x only: y defines the scale, otherwise c and affinity would be the same.
    by[:, 0, 8:10] = c * distorted
    return by
