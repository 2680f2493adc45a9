"""Collinearity equations of board corners, with any lens model: residuals and analytic derivatives.

Rotations, of photos and of boards alike, are corrected from the left, R <- exp([w]x) R, so that the derivative of R p by w is
w x (R p). All corners are computed at once as arrays: a calibration has some thousand of them, and no kernel is needed.
"""

import numpy as np

from orthomill.tasks.adjustment.boards.board_network import PARAMETERS, BoardCorners, BoardState
from orthomill.tasks.geometry.distortion import distorted, distortion_derivatives

# Finite, so that squares and sums of it stay numbers.
BEHIND = 1.0e5
"""Residual (px) assigned to a corner behind its camera; no step that moves one there is accepted."""


def projected(state: BoardState, corners: BoardCorners) -> np.ndarray:
    """Computed image coordinates (M, 2) px from the image centre, y up; NaN behind the camera."""
    return _pixels(state, ideal_points(state, corners))


def ideal_points(state: BoardState, corners: BoardCorners) -> np.ndarray:
    """Image coordinates (M, 2) of a central projection, in units of c; NaN behind the camera."""
    _, u = _camera_points(state, corners)
    with np.errstate(divide="ignore", invalid="ignore"):
        # The camera looks along -z; what is behind it would be projected, too, upside down.
        return np.where(u[:, 2:] < 0, -u[:, :2] / u[:, 2:], np.nan)


def residuals(state: BoardState, corners: BoardCorners) -> np.ndarray:
    """Observed minus computed (M, 2) px; BEHIND for corners behind their camera."""
    return np.nan_to_num(corners.xy - projected(state, corners), nan=BEHIND, posinf=BEHIND, neginf=BEHIND)


def derivatives(state: BoardState, corners: BoardCorners) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives of the computed coordinates: (M, 2, 29 + S) by photo, board, interior and the S bends of the board, in the
    order of `BoardNetwork.columns_of`, and (M, 2, 3) by the corner on its board."""
    on_board, u = _camera_points(state, corners)
    ideal = -u[:, :2] / u[:, 2:]
    by_ideal, by_lens = distortion_derivatives(ideal, state.numbers)
    by_u = state.interior[0] * by_ideal @ _ideal_by_u(u, ideal)
    by_point = by_u @ state.rotation[corners.photo]
    # u x (du/du) is the row form of (du/du) [w x u]: the mixed product changes cyclically.
    by_photo = np.concatenate([-by_point, np.cross(u[:, None], by_u)], axis=2)
    by_board = np.concatenate([by_point, np.cross(on_board[:, None], by_point)], axis=2)
    by_corner = by_point @ state.turn[corners.board]
    parts = [by_photo, by_board, _by_interior(state, ideal, by_lens)]
    if state.bend is not None:
        parts.append(by_corner @ state.bend.derivatives(corners.board, corners.corner))
    return np.concatenate(parts, axis=2), by_corner


def _camera_points(state: BoardState, corners: BoardCorners) -> tuple[np.ndarray, np.ndarray]:
    """Corners (M, 3) rotated with their boards, and corners (M, 3) in the image systems of their photographs."""
    on_board = np.einsum("mij,mj->mi", state.turn[corners.board], state.on_boards[corners.board, corners.corner])
    from_centre = on_board + state.shift[corners.board] - state.centre[corners.photo]
    return on_board, np.einsum("mij,mj->mi", state.rotation[corners.photo], from_centre)


def _pixels(state: BoardState, ideal: np.ndarray) -> np.ndarray:
    """Image coordinates (M, 2) px from the image centre of ideal ones (M, 2) in units of c."""
    return state.interior[1:3] + state.interior[0] * distorted(ideal, state.numbers)


def _ideal_by_u(u: np.ndarray, ideal: np.ndarray) -> np.ndarray:
    """(M, 2, 3): ideal coordinates by the point in the photo's system."""
    by_u = np.zeros((len(u), 2, 3))
    by_u[:, 0, 0] = by_u[:, 1, 1] = -1.0 / u[:, 2]
    by_u[:, :, 2] = -ideal / u[:, 2:]
    return by_u


def _by_interior(state: BoardState, ideal: np.ndarray, by_lens: np.ndarray) -> np.ndarray:
    """(M, 2, 17): pixels by the interior parameters in the order of PARAMETERS; `by_lens` (M, 2, 14) those of observed coordinates
    in units of c by the lens."""
    by = np.zeros((len(ideal), 2, len(PARAMETERS)))
    by[:, :, 0] = distorted(ideal, state.numbers)
    by[:, 0, 1] = by[:, 1, 2] = 1.0
    by[:, :, 3:] = state.interior[0] * by_lens
    return by
