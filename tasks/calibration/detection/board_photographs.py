"""The jobs on one photograph of boards: all corners of it, corners that were missed, and the drawing of the result."""

from typing import Any

import numpy as np

from orthomill.tasks.calibration.board_tables import Arranged, Corners, PhotoSearch
from orthomill.tasks.calibration.detection.board_detection import COARSE_SIDE, FoundBoards, find_boards, grey_image, pyramid
from orthomill.tasks.calibration.detection.cut_boards import CutBoards, find_cut_boards
from orthomill.tasks.calibration.detection.saddles import contrast, edge_blur, refined, signs, spacings
from orthomill.tasks.imagery.pyramid import full_to_level, level_shape

OVERVIEW_SIDE = 1100
"""Longer side in px, at most, of the reduced photographs that the report shows."""
_LEAST_SHARE = 0.5
"""Contrast of a corner that was looked for, as a share of what the photograph's whole boards have."""


def overview_level(size: tuple[int, int]) -> int:
    """The pyramid level that the report shows."""
    level = 0
    while max(level_shape((size[1], size[0]), level)) > OVERVIEW_SIDE:
        level += 1
    return level


def photo_corners(pixels: np.ndarray, photo: str, corners: tuple[int, int], boards: int, exact: bool = True) -> dict[str, Any]:
    """All boards of a photograph (rows, cols, bands): corners, what became of the search, and the reduced photograph.

    corners: columns, rows of inner corners of a board; boards: how many there are at most, 0 for unknown; exact: the corners of a
    board are free of error, so that any part of it is like any other.

    A quick look at lattices of any size comes first: where all boards are of another kind, the thorough search would only take
    long. Cut boards count where fewer than two whole ones are seen; with two, it is known where the others have to be.
    """
    levels = pyramid(grey_image(pixels), min(COARSE_SIDE, OVERVIEW_SIDE))
    none = np.empty((0, corners[1], corners[0], 2))
    parts, found = find_cut_boards(levels, none, corners, exact), FoundBoards(none, 0, 0)
    if len(parts.corners) or not parts.other:
        found = find_boards(levels, corners, boards)
    whole = found.corners
    if len(whole) >= min(boards or 2, 2):
        parts = CutBoards(whole[:0], 0, parts.other)
    elif len(whole):
        parts = find_cut_boards(levels, whole, corners, exact)
    shown = np.concatenate([whole, parts.corners])
    blurs = [edge_blur(levels[0], board) for board in shown]
    search = PhotoSearch(
        photo=photo, boards=len(whole), cut=len(parts.corners), unnumbered=parts.unnumbered, false=found.false,
        larger=found.larger, other=parts.other, blur=float(np.median(blurs)) if blurs else None,
        overexposed=_overexposed(pixels, shown),
    )  # fmt: skip
    overview = levels[overview_level((pixels.shape[1], pixels.shape[0]))]
    return {"corners": corners_of_boards(shown), "search": search, "overview": overview}


def corners_of_boards(boards: np.ndarray) -> Corners:
    """Boards (B, rows, cols, 2) as a table, without the corners that are NaN."""
    board, row, column = np.nonzero(np.isfinite(boards).all(axis=-1))
    x, y = boards[board, row, column].T
    return Corners(board.astype(np.int32), column.astype(np.int32), row.astype(np.int32), x.copy(), y.copy())


def _overexposed(pixels: np.ndarray, boards: np.ndarray) -> float:
    """Share of the pixels of the boards that are as bright as can be; half of a board is white."""
    top = np.iinfo(pixels.dtype).max
    shares = []
    for board in boards:
        low = np.floor(np.nanmin(board, axis=(0, 1))).astype(int).clip(0)
        high = np.ceil(np.nanmax(board, axis=(0, 1))).astype(int)
        part = pixels[low[1] : high[1] : 3, low[0] : high[0] : 3]
        shares.append(float((part == top).all(axis=-1).mean()))
    return float(np.mean(shares)) if shares else 0.0


def complete_corners(pixels: np.ndarray, arranged: Arranged, photo: str, corners: tuple[int, int]) -> Corners:
    """Corners of the boards that a photograph (rows, cols, bands) shows cut or did not give away, at the places where the others
    say
    that they are. A corner counts where the squares around it alternate as they should."""
    image = grey_image(pixels)
    own = next(known for known in arranged.photos if known.photo == photo)
    parts = []
    for prediction in own.predictions:
        points, good = looked_for(image, np.array(prediction.pixels).reshape(corners[1], corners[0], 2))
        row, column = np.nonzero(good)
        parts.append((np.full(len(row), prediction.board), column, row, *points[good].T))
    merged = [np.concatenate(part) for part in zip(*parts, strict=True)]
    return Corners(*(part.astype(np.int32) for part in merged[:3]), *merged[3:])


def looked_for(image: np.ndarray, grid: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Places (rows, cols, 2) of the corners of a board and which of them (rows, cols) are there, from where they should be; NaN for
    corners that the photo cannot show."""
    across, down = spacings(grid)
    start = np.where(np.isfinite(grid), grid, -1e6)
    expected = contrast(image, grid, across, down) * signs(*grid.shape[:2])
    spacing = np.sqrt(np.abs(across[..., 0] * down[..., 1] - across[..., 1] * down[..., 0]))
    points = np.full_like(grid, np.nan)
    for row, column in np.argwhere(np.isfinite(expected) & np.isfinite(spacing)):
        half = spacing[row, column]
        patch = start[row, column] + np.array([[[0.0, 0.0], [half, 0.0]], [[0.0, half], [half, half]]])
        points[row, column] = refined(image, patch)[0, 0]
    settled = contrast(image, points, across, down) * signs(*grid.shape[:2])
    strength = np.nanmedian(np.where(settled > 0, settled, np.nan)) if (settled > 0).any() else np.inf
    with np.errstate(invalid="ignore"):
        near = np.linalg.norm(points - grid, axis=2) < 0.25 * spacing
        good = near & (settled > _LEAST_SHARE * strength) & (settled > 8.0)
    return points, good & (good.mean() > 0.1)


def to_overview(pixels: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Pixels (..., 2) of the photograph in its reduced image."""
    return full_to_level(pixels, overview_level(size))
