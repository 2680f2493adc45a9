"""Standard errors and correlations as the field reports them: for angles instead of rotation vectors, by groups of unknowns."""

from dataclasses import dataclass

import numpy as np

from orthomill.tasks.adjustment.boards.board_bundle import BoardAdjustment
from orthomill.tasks.adjustment.boards.board_network import PARAMETERS
from orthomill.tasks.geometry.rotation import angles
from orthomill.tasks.geometry.rotation_vector import angles_from_vector, vector_of_rotation

EXTERIOR = ("X0", "Y0", "Z0", "omega", "phi", "kappa")
IN_PLANE = ("tX", "tY", "theta")


@dataclass(frozen=True, eq=False)
class Correlations:
    """|correlation| of the interior parameters `rows` with the exterior orientations and the boards: `typical` (root mean square)
    and `largest` over photos or boards, (rows, columns)."""

    rows: tuple[str, ...]
    columns: tuple[str, ...]
    typical: np.ndarray
    largest: np.ndarray


def photo_precision(result: BoardAdjustment, photo: int) -> tuple[np.ndarray, np.ndarray]:
    """Projection centre (m) and angles (radians) of a photo, (6,), and their standard errors (6,)."""
    R = result.state.rotation[photo]
    J = _to_angles(R)
    columns = result.network.photo_columns[photo]
    covariance = J @ result.covariance[np.ix_(columns, columns)] @ J.T
    return np.append(result.state.centre[photo], angles(R)), np.sqrt(np.clip(np.diag(covariance), 0.0, None))


def constant(result: BoardAdjustment) -> tuple[float, float]:
    """The camera constant and its standard error, px."""
    return float(result.state.interior[0]), float(np.sqrt(max(result.interior_covariance[0, 0], 0.0)))


def board_precision(result: BoardAdjustment, board: int) -> tuple[np.ndarray, np.ndarray]:
    """Shift (m) and rotation vector (radians) of a board, (6,), and their standard errors (6,); 0 for fixed ones."""
    columns = result.network.board_columns[board]
    # One variance more than unknowns: column -1 of a fixed value then finds a zero.
    variance = np.append(np.diag(result.covariance), 0.0)[columns]
    value = np.append(result.state.shift[board], vector_of_rotation(result.state.turn[board]))
    return value, np.sqrt(np.where(columns >= 0, variance, 0.0))


def bend_precision(result: BoardAdjustment, board: int) -> tuple[np.ndarray, np.ndarray]:
    """The bends (S,) m of a board and their standard errors (S,); none for boards that are flat."""
    columns = result.network.bend_columns[board]
    value = result.state.bend.value[board] if result.network.bends and result.state.bend else np.empty(0)
    return value, np.sqrt(np.diag(result.covariance)[columns])


def largest_bend(result: BoardAdjustment) -> tuple[int, float, float] | None:
    """The board that bends most, by how much, and the standard error of that, m; None for boards that are flat."""
    if not result.network.bends:
        return None
    found = [(board, *bend_precision(result, board)) for board in range(result.network.boards)]
    board, value, sigma = max(found, key=lambda one: float(np.abs(one[1]).max()))
    most = int(np.abs(value).argmax())
    return board, float(value[most]), float(sigma[most])


def _to_angles(R: np.ndarray) -> np.ndarray:
    """(6, 6): derivatives of centre, omega, phi and kappa by centre and rotation vector."""
    J = np.eye(6)
    J[3:, 3:] = angles_from_vector(R)
    return J


def correlations(result: BoardAdjustment) -> Correlations:
    """Interior against exterior orientation, boards and the other interior parameters (S12 of sources/calibration.md)."""
    # The root mean square over photos, not the mean: correlations of opposite sign would cancel, and a camera turned by 180 degrees
    # changes the sign of most of them.
    own = result.network.interior_columns
    rows = tuple(name for name, column in zip(PARAMETERS, own, strict=True) if column >= 0)
    own = own[own >= 0]
    exterior = np.array([_with_photo(result, own, photo) for photo in range(result.network.photos)])
    boards = [_with_board(result, own, board) for board in range(1, result.network.boards)]
    parts = [exterior] + ([np.array(boards)] if boards else [])
    interior = np.abs(result.correlation[np.ix_(own, own)])
    columns = (*EXTERIOR, *(IN_PLANE if boards else ()), *rows)
    typical = np.hstack([*(np.sqrt((part**2).mean(axis=0)) for part in parts), interior])
    return Correlations(rows, columns, typical, np.hstack([*(np.abs(part).max(axis=0) for part in parts), interior]))


def _with_photo(result: BoardAdjustment, own: np.ndarray, photo: int) -> np.ndarray:
    """(interior, 6): correlations with centre and angles of a photo."""
    J, columns = _to_angles(result.state.rotation[photo]), result.network.photo_columns[photo]
    cross = result.covariance[np.ix_(own, columns)] @ J.T
    variance = np.diag(J @ result.covariance[np.ix_(columns, columns)] @ J.T)
    return cross / np.sqrt(np.outer(np.diag(result.covariance)[own], variance))


def _with_board(result: BoardAdjustment, own: np.ndarray, board: int) -> np.ndarray:
    """(interior, 3): correlations with shifts and rotation of a board in its plane."""
    return result.correlation[np.ix_(own, result.network.board_columns[board][[0, 1, 5]])]
