"""The job on one photograph of boards: the corners of a first search."""

from typing import NamedTuple

import numpy as np

from orthomill.tasks.calibration.board_tables import Corners, PhotoSearch
from orthomill.tasks.calibration.detection.board_detection import COARSE_SIDE, FoundBoards, find_boards, grey_image, pyramid
from orthomill.tasks.calibration.detection.cut_boards import CutBoards, find_cut_boards
from orthomill.tasks.calibration.detection.saddles import edge_blur
from orthomill.tasks.imagery.pyramid import full_to_level, level_shape

OVERVIEW_SIDE = 1100
"""Longer side in px, at most, of the reduced photographs that the report shows."""


class PhotoCorners(NamedTuple):
    """Corners of all boards of a photograph, the result of the search, and the reduced photograph (rows, cols) uint8."""

    corners: Corners
    search: PhotoSearch
    overview: np.ndarray


def overview_level(size: tuple[int, int]) -> int:
    """The pyramid level that the report shows."""
    level = 0
    while max(level_shape((size[1], size[0]), level)) > OVERVIEW_SIDE:
        level += 1
    return level


def photo_corners(pixels: np.ndarray, photo: str, corners: tuple[int, int], boards: int, exact: bool = True) -> PhotoCorners:
    """All boards of a photograph (rows, cols, bands) uint8 or uint16.

    corners: columns, rows of inner corners of a board; boards: how many there are at most, 0 for unknown; exact: the corners of a
    board are free of error, so that any part of it equals any other.
    """
    levels = pyramid(grey_image(pixels), min(COARSE_SIDE, OVERVIEW_SIDE))
    found, parts = _searched(levels, corners, boards, exact)
    measured = np.concatenate([found.corners, parts.corners])
    blurs = [edge_blur(levels[0], board) for board in measured]
    search = PhotoSearch(
        photo=photo,
        boards=len(found.corners),
        cut=len(parts.corners),
        unnumbered=parts.unnumbered,
        false=found.false,
        larger=found.larger,
        other=parts.other,
        blur=float(np.median(blurs)) if blurs else None,
        overexposed=_overexposed(pixels, measured),
    )
    overview = levels[overview_level((pixels.shape[1], pixels.shape[0]))]
    return PhotoCorners(corners_of_boards(measured), search, overview)


def _searched(levels: list[np.ndarray], corners: tuple[int, int], boards: int, exact: bool) -> tuple[FoundBoards, CutBoards]:
    """Whole boards and cut ones of a photograph, given as its pyramid."""
    none = np.empty((0, corners[1], corners[0], 2))
    # Lattices of any size come first: where all boards are of another kind, the thorough search would take long and find nothing.
    parts, found = find_cut_boards(levels, none, corners, exact), FoundBoards(none, 0, 0)
    if len(parts.corners) or not parts.other:
        found = find_boards(levels, corners, boards)
    whole = found.corners
    # With two whole boards the photo is identified, and the second search knows where the others are; cut boards are only needed,
    # and only risked, where there are fewer.
    if len(whole) >= min(boards or 2, 2):
        parts = CutBoards(whole[:0], 0, parts.other)
    elif len(whole):
        parts = find_cut_boards(levels, whole, corners, exact)
    return found, parts


def corners_of_boards(boards: np.ndarray) -> Corners:
    """Boards (B, rows, cols, 2) as a table, without the corners that are NaN."""
    board, row, column = np.nonzero(np.isfinite(boards).all(axis=-1))
    x, y = boards[board, row, column].T
    return Corners(board.astype(np.int32), column.astype(np.int32), row.astype(np.int32), x.copy(), y.copy())


def _overexposed(pixels: np.ndarray, boards: np.ndarray) -> float:
    """Share of saturated pixels of the boards, 0 to about 0.5, as half of a board is white."""
    top = np.iinfo(pixels.dtype).max
    shares = []
    for board in boards:
        low = np.floor(np.nanmin(board, axis=(0, 1))).astype(int).clip(0)
        high = np.ceil(np.nanmax(board, axis=(0, 1))).astype(int)
        part = pixels[low[1] : high[1] : 3, low[0] : high[0] : 3]
        shares.append(float((part == top).all(axis=-1).mean()))
    return float(np.mean(shares)) if shares else 0.0


def to_overview(pixels: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Pixels (..., 2) of the photograph as pixels of its reduced image."""
    return full_to_level(pixels, overview_level(size))
