"""Boards drawn on a reduced photograph: corners by board, its number, origin and axes, residual vectors, rejected corners."""

import cv2
import numpy as np

from orthomill.tasks.calibration.board_tables import CornerResiduals
from orthomill.tasks.calibration.detection.board_photographs import to_overview

_COLOURS = (
    (230, 80, 60),
    (60, 140, 230),
    (70, 180, 80),
    (220, 160, 40),
    (160, 90, 200),
    (40, 180, 180),
    (200, 100, 140),
    (130, 130, 60),
)
RESIDUAL_LENGTH = 16.0
"""px of the drawing for a residual of median length."""
_LONGEST = 60.0
"""px of the drawing: longer residuals are shortened, or one blunder would cross the picture."""


def draw_boards(overview: np.ndarray, residuals: CornerResiduals, photo: str, size: tuple[int, int]) -> np.ndarray:
    """The drawing (rows, cols, 3) uint8 of a photo reduced to `overview` (rows, cols) uint8; size: its own width and height, px."""
    # Half the contrast on a light ground, so that colours stand out on black squares as well.
    picture = cv2.cvtColor((128 + overview // 2).astype(np.uint8), cv2.COLOR_GRAY2RGB)
    own = residuals.take(residuals.photo == photo)
    # The median of all photographs, so that residuals can be compared between drawings.
    usual = usual_length(np.column_stack([residuals.dx, residuals.dy])[residuals.used])
    for board in np.unique(own.board):
        _draw_board(picture, own.take(own.board == board), size, RESIDUAL_LENGTH / max(usual, 1e-6))
    return picture


def spread(count: int, most: int) -> list[int]:
    """At most so many of `count` numbers, evenly over them."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).round().astype(int)).tolist()


def usual_length(residual: np.ndarray) -> float:
    """Median length (px) of residuals (M, 2)."""
    return float(np.median(np.linalg.norm(residual, axis=1))) if len(residual) else 1.0


def _draw_board(picture: np.ndarray, board: CornerResiduals, size: tuple[int, int], enlarged: float) -> None:
    colour = _COLOURS[int(board.board[0]) % len(_COLOURS)]
    places = to_overview(np.column_stack([board.x, board.y]), size)
    for place, dx, dy, used in zip(places, board.dx, board.dy, board.used, strict=True):
        if used:
            cv2.circle(picture, _at(place), 2, colour, -1, cv2.LINE_AA)
            step = enlarged * np.array([dx, dy])
            step *= min(1.0, _LONGEST / max(float(np.linalg.norm(step)), 1e-9))
            cv2.line(picture, _at(place), _at(place + step), (20, 20, 20), 1, cv2.LINE_AA)
        else:
            cv2.drawMarker(picture, _at(place), (220, 0, 0), cv2.MARKER_TILTED_CROSS, 9, 1, cv2.LINE_AA)
    _draw_axes(picture, board, places, colour)
    cv2.putText(
        picture, str(int(board.board[0]) + 1), _at(places.mean(axis=0)), cv2.FONT_HERSHEY_SIMPLEX, 0.9, colour, 2, cv2.LINE_AA
    )


def _draw_axes(picture: np.ndarray, board: CornerResiduals, places: np.ndarray, colour: tuple[int, int, int]) -> None:
    """Origin with arrows to the ends of the first row and the first column, where these corners are known."""
    # A cut board may lack its origin; its axes cannot be drawn then.
    known = {(int(c), int(r)): place for c, r, place in zip(board.column, board.row, places, strict=True)}
    if (0, 0) not in known:
        return
    for name, end in (("x", (int(board.column.max()), 0)), ("y", (0, int(board.row.max())))):
        if end in known:
            cv2.arrowedLine(picture, _at(known[0, 0]), _at(known[end]), colour, 2, cv2.LINE_AA, tipLength=0.06)
            cv2.putText(picture, name, _at(known[end] + 6), cv2.FONT_HERSHEY_SIMPLEX, 0.5, colour, 1, cv2.LINE_AA)


def _at(place: np.ndarray) -> tuple[int, int]:
    return round(float(place[0])), round(float(place[1]))
