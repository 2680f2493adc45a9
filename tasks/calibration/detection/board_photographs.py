"""The jobs on one photograph of boards: the corners of a first search, and those of a second one with predicted places."""

from typing import NamedTuple

import numpy as np

from orthomill.tasks.calibration.board_tables import Arranged, Corners, PhotoSearch
from orthomill.tasks.calibration.detection.board_detection import COARSE_SIDE, FoundBoards, find_boards, grey_image, pyramid
from orthomill.tasks.calibration.detection.board_turns import coloured
from orthomill.tasks.calibration.detection.cut_boards import CutBoards, find_cut_boards
from orthomill.tasks.calibration.detection.saddles import contrast, edge_blur, refined, signs, spacings
from orthomill.tasks.imagery.pyramid import full_to_level, level_shape

OVERVIEW_SIDE = 1100
"""Longer side in px, at most, of the reduced photographs that the report shows."""
_LEAST_SHARE = 0.5
"""Least contrast of a corner of the second search, as a share of the median of its board."""
_LEAST_GREY = 8.0
"""The same in grey values. Twice that of the first search: there a whole board has to fit, here each corner counts for itself."""
_NEAR = 0.25
"""Largest distance of a corner of the second search from its prediction, in spacings: half of it would reach the next edge."""
_FEWEST = 0.1
"""Least share of a board's corners that the second search has to find: fewer are chance."""


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


def complete_corners(pixels: np.ndarray, arranged: Arranged, photo: str, corners: tuple[int, int]) -> Corners:
    """The second search in a photograph (rows, cols, bands): corners of boards that it shows cut or that were missed, near their
    predictions from the other boards. A corner counts where the squares around it alternate with the expected sign."""
    image = grey_image(pixels)
    own = next(known for known in arranged.photos if known.photo == photo)
    parts = []
    for prediction in own.predictions:
        points, good = near_predictions(image, np.array(prediction.pixels).reshape(corners[1], corners[0], 2))
        row, column = np.nonzero(good)
        parts.append((np.full(len(row), prediction.board), column, row, *points[good].T))
    merged = [np.concatenate(part) for part in zip(*parts, strict=True)]
    return Corners(*(part.astype(np.int32) for part in merged[:3]), *merged[3:])


def near_predictions(image: np.ndarray, grid: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Corners (rows, cols, 2) px of a board near their predictions `grid` (rows, cols, 2), NaN where the photo cannot show them,
    and which of them (rows, cols) were found."""
    across, down = spacings(grid)
    # Comparisons with NaN are False but warn; a place far outside is outside everywhere.
    start = np.where(np.isfinite(grid), grid, -1e6)
    expected = contrast(image, grid, across, down)
    spacing = np.sqrt(np.abs(across[..., 0] * down[..., 1] - across[..., 1] * down[..., 0]))
    points = np.full_like(grid, np.nan)
    for row, column in np.argwhere(np.isfinite(expected) & np.isfinite(spacing)):
        half = spacing[row, column]
        # Each corner by itself with its own spacing: neighbours may be hidden, and refined() needs a grid only for the spacing.
        patch = start[row, column] + np.array([[[0.0, 0.0], [half, 0.0]], [[0.0, half], [half, half]]])
        points[row, column] = refined(image, patch)[0, 0]
    pattern = contrast(image, points, across, down) * signs(*grid.shape[:2])
    if not coloured((grid.shape[1], grid.shape[0])):
        pattern = pattern * np.sign(np.nansum(pattern))
    strength = np.nanmedian(np.where(pattern > 0, pattern, np.nan)) if (pattern > 0).any() else np.inf
    with np.errstate(invalid="ignore"):
        near = np.linalg.norm(points - grid, axis=2) < _NEAR * spacing
        good = near & (pattern > _LEAST_SHARE * strength) & (pattern > _LEAST_GREY)
    return points, good & (good.mean() > _FEWEST)


def to_overview(pixels: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Pixels (..., 2) of the photograph as pixels of its reduced image."""
    return full_to_level(pixels, overview_level(size))
