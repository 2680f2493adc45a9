"""All chessboards in one photograph, each with its origin: inner corners to a few hundredths of a pixel.

Strategy. Boards are searched from a coarse pyramid level down, where OpenCV's sector-based detector (Duda & Frese 2018) is fast and
reliable; it returns one board at a time, so that each one found is painted over, up to the outer edge of its squares, and the
search is repeated. As long as none is found, a smoothed copy of a level is searched as well: noise and sharp texture hide boards.
The search ends when all boards are found, or with a level that adds none. Corners are refined from level to level down to the full
image.

A candidate is then tested: the squares around every corner must alternate (else it is no board), and must not go on alternating
beyond the outer corners (else the board is larger than stated). Numbering is made unique: seen from the front, x along the columns,
y along the rows, counter-clockwise, and the first square black.

NORMALIZE_IMAGE is not used, as it loses boards (sources/measured.md#chessboards). Nor is ACCURACY: it searches an enlarged image,
which takes three times as long, for corners that are refined in the full image anyway.
"""

from dataclasses import dataclass
from enum import IntEnum

import cv2
import numpy as np

from orthomill.schemas.raster import Window
from orthomill.tasks.calibration.detection.homographies import applied, homography
from orthomill.tasks.calibration.detection.saddles import contrast, refined, signs, spacings
from orthomill.tasks.imagery.pyramid import full_to_level, halved_shape, halved_window, level_to_full, source_window
from orthomill.tasks.imagery.radiometry import grey_bytes, grey_range

_SEARCH = cv2.CALIB_CB_EXHAUSTIVE
COARSE_SIDE = 450
"""Longer side in px of the image in which boards are searched first."""
_FINE_SIDE = 2000
"""And of the one in which they are searched last: the detector's time grows with the pixels, and boards that are smaller than it
needs at this size have too few pixels per square for a calibration."""
MOST_BOARDS = 40
_STRIP = 256
"""Rows that are converted at a time."""
_SMOOTH = 1.3
"""px: standard deviation of the Gaussian of the smoothed copies"""
# A few corners may be hidden by a reflection or a finger; a whole row that does not alternate belongs to a smaller board.
_WRONG_CORNERS, _WRONG_IN_ROW = 0.1, 0.7
"""Largest share of corners whose squares do not alternate, of all and of one row or column."""
_ALTERNATING = 0.35
"""Least contrast of a corner, as a share of the median of its board."""
_LEAST_CONTRAST = 4.0
"""Grey values: least median contrast of a board, above the noise of a photograph."""
_CHANGE_OF_SPACING = 0.35
"""Largest change of spacing from one square to the next, relative to it."""
# A close-up with a wide lens changes more (0.40 was measured, with 0.20 for the next figure), but steadily; false finds do not.
_BEND, _UNSTEADY = 0.6, 0.3
"""The same where spacings change steadily: by this much from square to square, and the change itself by this much."""


class Refusal(IntEnum):
    """Why a candidate is not a board with the stated number of corners."""

    NO_BOARD = 0
    LARGER = 1


@dataclass(frozen=True, eq=False)
class FoundBoards:
    """Corners (B, rows, cols, 2) (col, row) px of all boards, left to right, and the numbers of refused candidates: `false` ones,
    and boards with more corners than stated."""

    corners: np.ndarray
    false: int
    larger: int


def grey_image(pixels: np.ndarray) -> np.ndarray:
    """The photograph (rows, cols, bands) in grey uint8, in strips: floating-point copies of a whole one would be many times its
    size."""
    # Every eighth pixel is enough for the percentiles that stretch the grey values.
    limits = grey_range(pixels[::8, ::8])
    image = np.empty(pixels.shape[:2], dtype=np.uint8)
    for row in range(0, len(image), _STRIP):
        image[row : row + _STRIP] = grey_bytes(pixels[row : row + _STRIP], limits)
    return image


def pyramid(image: np.ndarray, below: int) -> list[np.ndarray]:
    """The image and its halves until the longer side is at most `below`, made in strips."""
    levels = [image]
    while max(levels[-1].shape) > below:
        half = np.empty(halved_shape(levels[-1].shape), dtype=image.dtype)
        for row in range(0, len(half), _STRIP):
            window = Window(row, 0, min(_STRIP, len(half) - row), half.shape[1])
            half[window.slices] = halved_window(levels[-1][source_window(window, levels[-1].shape).slices], window)
        levels.append(half)
    return levels


def find_boards(levels: list[np.ndarray], corners: tuple[int, int], boards: int = 0) -> FoundBoards:
    """Every board with `corners` (columns, rows) in a photograph, given as its pyramid; at most `boards` unless that is 0."""
    found: list[np.ndarray] = []
    refused = {Refusal.NO_BOARD: 0, Refusal.LARGER: 0}
    most = boards or MOST_BOARDS
    for level in reversed(range(len(levels))):
        known = len(found)
        if max(levels[level].shape) > _FINE_SIDE and level < len(levels) - 1:
            break
        for smooth in (False, True):
            if len(found) >= most or (smooth and found):
                break
            for board in _searched(_search_image(levels[level], level, smooth, found), corners, most - len(found)):
                fine = through_levels(board, levels, level)
                reason = _refusal(levels[0], fine)
                if reason is None:
                    found.append(numbered(levels[0], fine))
                else:
                    refused[reason] += 1
        if len(found) >= most or (known and len(found) == known):
            break
    found.sort(key=lambda board: tuple(board.reshape(-1, 2).mean(axis=0)))
    shape = (0, corners[1], corners[0], 2)
    return FoundBoards(np.array(found) if found else np.empty(shape), refused[Refusal.NO_BOARD], refused[Refusal.LARGER])


def _search_image(image: np.ndarray, level: int, smooth: bool, found: list[np.ndarray]) -> np.ndarray:
    """A copy of a pyramid level without the boards that are `found`, smoothed or not."""
    search = cv2.GaussianBlur(image, (0, 0), _SMOOTH) if smooth else image.copy()
    for board in found:
        paint_over(search, full_to_level(board, level))
    return search


def _searched(image: np.ndarray, corners: tuple[int, int], most: int) -> list[np.ndarray]:
    """Boards (rows, cols, 2) of one image, which is painted over in the process."""
    boards: list[np.ndarray] = []
    while len(boards) < most:
        found, points = cv2.findChessboardCornersSB(image, corners, flags=_SEARCH)
        if not found:
            break
        boards.append(points.reshape(corners[1], corners[0], 2).astype(np.float64))
        paint_over(image, boards[-1])
    return boards


def paint_over(image: np.ndarray, board: np.ndarray) -> None:
    """Covers a board (rows, cols, 2) in an image (rows, cols), up to the outer edge of its squares."""
    rows, cols = board.shape[:2]
    known = np.isfinite(board).all(axis=-1).ravel()
    H = homography(board_grid((cols, rows))[known], board.reshape(-1, 2)[known])
    low, right, bottom = -1.2, cols + 0.2, rows + 0.2
    # Beyond the range of OpenCV's fixed-point polygons a strongly tilted board would wrap around.
    edge = applied(H, np.array([[low, low], [right, low], [right, bottom], [low, bottom]]))
    cv2.fillConvexPoly(image, np.rint(np.clip(edge, -20000, 20000)).astype(np.int32), float(np.median(image)))


def through_levels(board: np.ndarray, levels: list[np.ndarray], level: int) -> np.ndarray:
    """Corners of a level in the full image, refined in each level in between."""
    full = level_to_full(board, level)
    for finer in reversed(range(level)):
        full = level_to_full(refined(levels[finer], full_to_level(full, finer)), finer)
    return refined(levels[0], full) if level == 0 else full


def _refusal(image: np.ndarray, board: np.ndarray) -> Refusal | None:
    """None for a board (rows, cols, 2) with the stated number of corners."""
    rows, cols = board.shape[:2]
    across, down = spacings(board)
    pattern = contrast(image, board, across, down) * signs(rows, cols)
    # The numbering is not unique yet: either diagonal pair of squares may be the black one.
    pattern = pattern if np.nansum(pattern) >= 0 else -pattern
    strength = np.nanmedian(pattern)
    if not strength > _LEAST_CONTRAST or not regular(board):
        return Refusal.NO_BOARD
    wrong = np.nan_to_num(pattern, nan=strength) < _ALTERNATING * strength
    if wrong.mean() > _WRONG_CORNERS or max(wrong.mean(axis=0).max(), wrong.mean(axis=1).max()) >= _WRONG_IN_ROW:
        return Refusal.NO_BOARD
    return Refusal.LARGER if _continues(image, board, strength) else None


def regular(board: np.ndarray) -> bool:
    """Whether spacings change as slowly along rows and columns as perspective and distortion allow: little, or steadily."""
    for grid in (board, board.swapaxes(0, 1)):
        step = np.diff(grid, axis=0)
        length = np.linalg.norm(step, axis=2)
        bend = np.diff(step, axis=0)
        usual = np.minimum(length[1:], length[:-1])
        change = np.linalg.norm(bend, axis=2)
        # Steadiness needs four lines; fewer can only change little.
        unsteady = np.linalg.norm(np.diff(bend, axis=0), axis=2) > _UNSTEADY * np.minimum(usual[1:], usual[:-1])
        steady = len(unsteady) > 0 and not unsteady.any()
        if (change > (_BEND if steady else _CHANGE_OF_SPACING) * usual).any():
            return False
    return True


def _continues(image: np.ndarray, board: np.ndarray, strength: float) -> bool:
    """Whether the squares go on alternating beyond one of the four sides."""
    for turned in (board, board[::-1], board.swapaxes(0, 1), board.swapaxes(0, 1)[::-1]):
        if len(turned) < 3:
            continue
        # Quadratic extrapolation: linear misses the next row by the change of spacing under perspective.
        outside = 3.0 * turned[0] - 3.0 * turned[1] + turned[2]
        across, down = np.gradient(outside, axis=0), turned[0] - outside
        ring = np.abs(contrast(image, outside, across, down))[1:-1]
        inside = np.isfinite(ring)
        if inside.sum() >= 2 and np.mean(ring[inside] > 0.6 * strength) > 0.7:
            return True
    return False


def numbered(image: np.ndarray, board: np.ndarray) -> np.ndarray:
    """The board (rows, cols, 2) with its numbering: y counter-clockwise from x in an upright photo, the first square black where a
    turn can make it so. It is unique unless the board looks the same after a turn (board_turns.py)."""
    rows, cols = board.shape[:2]
    across, down = board[:, -1].mean(axis=0) - board[:, 0].mean(axis=0), board[-1].mean(axis=0) - board[0].mean(axis=0)
    # Rows of pixels count downwards, so that a positive cross product is clockwise.
    if across[0] * down[1] - across[1] * down[0] > 0:
        board = board[::-1]
    pattern = contrast(image, board, *spacings(board)) * signs(rows, cols)
    if np.nansum(pattern) >= 0:
        return board
    # Of a board with as many columns as rows, the squares at the ends of a side differ in colour, not those of a diagonal.
    return np.rot90(board) if rows == cols else board[::-1, ::-1]


def board_grid(corners: tuple[int, int]) -> np.ndarray:
    """(columns * rows, 2) float64: column and row number of every corner, row by row."""
    return np.stack(np.meshgrid(np.arange(corners[0]), np.arange(corners[1])), axis=-1).reshape(-1, 2).astype(np.float64)
