"""All chessboards in one photograph: their inner corners to a few hundredths of a pixel.

Strategy: boards are found on a reduced image, where OpenCV's sector-based detector (Duda & Frese 2018) is fast and sure. It gives
one board at a time, so each one found is painted over, up to the outer edge of its squares, and the search goes on until nothing
is found. The search ends one level after the first that found boards: small boards get a second chance. Each corner is then
refined in the full image as the saddle point of its neighbourhood (Foerstner's gradient condition, OpenCV's cornerSubPix), in a
window that follows the spacing of the corners; on rendered boards with known corners that is twice as precise as the detector's
own sub-pixel step, and free of its outliers.

NORMALIZE_IMAGE is left out on purpose: it loses boards (methods/measured.md). So is ACCURACY: it searches an enlarged image, which
takes three times as long, for places that are refined in the full image anyway.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from schemas.job import Columns
from schemas.raster import Window
from tasks.imagery.pyramid import full_to_level, halved_shape, halved_window, level_to_full, source_window
from tasks.imagery.radiometry import grey_bytes, grey_range

cv2.setNumThreads(1)

_SEARCH = cv2.CALIB_CB_EXHAUSTIVE
_STOP = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 60, 1e-4)
COARSE_SIDE = 700
"""Longer side in px of the image in which boards are searched first."""
MOST_BOARDS = 40
_STRIP = 256


@dataclass(frozen=True)
class Corners(Columns):
    """Chessboard corners of one photograph, board after board, row by row."""

    board: np.ndarray
    """int32: number of the board in the photograph"""
    column: np.ndarray
    row: np.ndarray
    """int32: place of the corner on its board"""
    x: np.ndarray
    y: np.ndarray
    """float64: pixel coordinates (col, row)"""


def photo_corners(pixels: np.ndarray, corners: tuple[int, int]) -> Corners:
    """The inner corners of all boards in a photograph (rows, cols, bands). corners: columns, rows of inner corners of a board."""
    boards = find_boards(_grey(pixels), corners)
    columns, rows = (index.ravel().astype(np.int32) for index in np.meshgrid(np.arange(corners[0]), np.arange(corners[1])))
    points = np.concatenate(boards) if boards else np.empty((0, 2))
    return Corners(
        board=np.repeat(np.arange(len(boards), dtype=np.int32), len(columns)),
        column=np.tile(columns, len(boards)),
        row=np.tile(rows, len(boards)),
        x=points[:, 0],
        y=points[:, 1],
    )


def _grey(pixels: np.ndarray) -> np.ndarray:
    """The photograph in grey, in strips: floating point copies of a whole photograph would be many times its size."""
    limits = grey_range(pixels[::8, ::8])
    image = np.empty(pixels.shape[:2], dtype=np.uint8)
    for row in range(0, len(image), _STRIP):
        image[row : row + _STRIP] = grey_bytes(pixels[row : row + _STRIP], limits)
    return image


def _halved(image: np.ndarray) -> np.ndarray:
    """The next pyramid level, in strips."""
    half = np.empty(halved_shape(image.shape), dtype=image.dtype)
    for row in range(0, len(half), _STRIP):
        window = Window(row, 0, min(_STRIP, len(half) - row), half.shape[1])
        half[window.slices] = halved_window(image[source_window(window, image.shape).slices], window)
    return half


def find_boards(image: np.ndarray, corners: tuple[int, int]) -> list[np.ndarray]:
    """Corners (columns * rows, 2) (col, row) of every board in a grey image (rows, cols) uint8, left to right by their centres."""
    levels = [image]
    while max(levels[-1].shape) > COARSE_SIDE:
        levels.append(_halved(levels[-1]))
    boards: list[np.ndarray] = []
    for level in reversed(range(len(levels))):
        known = list(boards)
        search = levels[level].copy()
        for board in known:
            _paint_over(search, full_to_level(board, level), corners)
        boards += [refined(image, level_to_full(board, level), corners) for board in _search(search, corners)]
        if known:
            break
    return sorted(boards, key=lambda board: tuple(board.mean(axis=0)))


def _search(image: np.ndarray, corners: tuple[int, int]) -> list[np.ndarray]:
    """Boards of one image, which is painted over on the way."""
    boards: list[np.ndarray] = []
    while len(boards) < MOST_BOARDS:
        found, points = cv2.findChessboardCornersSB(image, corners, flags=_SEARCH)
        if not found:
            break
        board = points.reshape(-1, 2).astype(np.float64)
        _paint_over(image, board, corners)
        boards.append(board)
    return boards


def _paint_over(image: np.ndarray, board: np.ndarray, corners: tuple[int, int]) -> None:
    cv2.fillConvexPoly(image, _outline(board, corners), float(np.median(image)))


def _outline(board: np.ndarray, corners: tuple[int, int]) -> np.ndarray:
    """The outer edge of a board's squares (4, 2) int32: the grid of its corners extended by a little more than one square."""
    columns, rows = corners
    homography, _ = cv2.findHomography(board_grid(corners), board)
    low, right, bottom = -1.2, columns + 0.2, rows + 0.2
    edge = np.array([[[low, low], [right, low], [right, bottom], [low, bottom]]])
    return np.rint(cv2.perspectiveTransform(edge, homography)[0]).astype(np.int32)


def refined(image: np.ndarray, board: np.ndarray, corners: tuple[int, int]) -> np.ndarray:
    """Corners (N, 2) as saddle points of `image`; a corner that runs away from its start by more than its window stays there."""
    grid = board.reshape(corners[1], corners[0], 2)
    spacing = min(np.linalg.norm(np.diff(grid, axis=axis), axis=2).min() for axis in (0, 1))
    half = int(np.clip(0.4 * spacing, 2, 11))
    points = cv2.cornerSubPix(image, board.astype(np.float32).reshape(-1, 1, 2), (half, half), (-1, -1), _STOP)
    points = points.reshape(-1, 2).astype(np.float64)
    ran_away = np.abs(points - board).max(axis=1) > half
    return np.where(ran_away[:, None], board, points)


def board_grid(corners: tuple[int, int]) -> np.ndarray:
    """(columns * rows, 2) float64: column and row number of every corner, row by row."""
    return np.stack(np.meshgrid(np.arange(corners[0]), np.arange(corners[1])), axis=-1).reshape(-1, 2).astype(np.float64)
