"""The numbers of the tables of a calibration: precision of places and angles, residuals of boards and photographs."""

from typing import NamedTuple

import numpy as np

from orthomill.tasks.adjustment.boards.board_bundle import BoardAdjustment
from orthomill.tasks.calibration.solving.calibration_precision import board_precision, photo_precision


class PlacedRow(NamedTuple):
    """A place (m) and its angles (degrees), with the largest standard error of each three."""

    place: tuple[float, ...]
    angles: tuple[float, ...]
    place_sigma: float
    angle_sigma: float


def photo_row(result: BoardAdjustment, photo: int) -> PlacedRow:
    """Of a photograph by its number."""
    return _placed(*photo_precision(result, photo))


def board_row(result: BoardAdjustment, board: int) -> PlacedRow:
    """Of a board by its number."""
    return _placed(*board_precision(result, board))


def _placed(value: np.ndarray, sigma: np.ndarray) -> PlacedRow:
    angles = tuple(np.degrees(value[3:]).tolist())
    return PlacedRow(tuple(value[:3].tolist()), angles, float(sigma[:3].max()), float(np.degrees(sigma[3:]).max()))


def parameter_sigma(result: BoardAdjustment, number: int) -> float:
    """Standard error of an interior parameter by its number."""
    return float(np.sqrt(result.interior_covariance[number, number]))


def median_residual(result: BoardAdjustment, board: int) -> float:
    """Median length (px) of the residual vectors on a board."""
    # Rejected corners count: they are what shows a warped board.
    return float(np.median(np.linalg.norm(result.residual[result.corners.board == board], axis=1)))


class PhotoResiduals(NamedTuple):
    """Of a photograph: boards, corners, rejected ones; root mean square and largest residual (px) of those used."""

    boards: int
    corners: int
    rejected: int
    rms: float | None
    largest: float


def photo_residuals(result: BoardAdjustment, photo: int) -> PhotoResiduals:
    """Of a photograph by its number."""
    own = result.corners.photo == photo
    # Corners used only, as in sigma0; the rejected ones are counted by themselves.
    size = np.linalg.norm(result.residual[own & result.used], axis=1)
    rms = float(np.sqrt((size**2).mean())) if len(size) else None
    boards, rejected = len(np.unique(result.corners.board[own])), int((own & ~result.used).sum())
    return PhotoResiduals(boards, int(own.sum()), rejected, rms, float(size.max(initial=0.0)))
