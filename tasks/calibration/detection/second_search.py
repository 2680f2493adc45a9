"""The second search in a photograph: the corners of boards that it shows cut or that were missed, near their predicted places.

Strategy. A first calibration predicts the places, and where it is wrong (a polynomial for a wide lens) they lie tens of pixels
off: on edges and inside squares, where something can always be refined. So a corner counts where its own neighbourhood has the
shape of one, whatever the prediction was: dark and bright quarters around it, in the expected order. From the corners that are
confirmed the predictions of their neighbours are corrected, and the search goes on until no corner is added.
"""

import numpy as np

from orthomill.tasks.calibration.board_tables import Arranged, Corners
from orthomill.tasks.calibration.detection.board_detection import grey_image
from orthomill.tasks.calibration.detection.board_turns import coloured
from orthomill.tasks.calibration.detection.saddles import crossings, refined, signs, spacings

_LEAST_SHARE = 0.5
"""Least contrast of a corner, as a share of the median of its board."""
_LEAST_GREY = 8.0
"""The same in grey values. Twice that of the first search: there a whole board has to fit, here each corner counts for itself."""
# 1566 corners of whole boards of a fisheye lens have 0.89 or more, 864 of a wide webcam 0.75; edges and squares have 0.3 or less.
_SHAPE = 0.6
"""Least share of the grey values around a corner that four quarters explain."""
_NEAR = 0.25
"""Largest distance of a corner from its prediction, in spacings: half of it would reach the next edge."""
_FEWEST = 0.1
"""Least share of a board's corners that the search has to find: fewer are chance."""
_REACH = 2
"""Lattice steps over which confirmed corners correct the predictions of others."""


def complete_corners(pixels: np.ndarray, arranged: Arranged, photo: str, corners: tuple[int, int]) -> Corners:
    """Corners of the boards that a photograph (rows, cols, bands) shows cut or that were missed in it, near their predictions from
    the other boards; `corners`: columns and rows of a board."""
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
    steps = spacings(grid)
    points, good = _confirmed(image, grid, steps)
    for _ in range(sum(grid.shape[:2])):
        if not good.any() or good.all():
            break
        better = np.where(good[..., None], np.nan, grid + _shifts(points - grid, good))
        again, found = _confirmed(image, better, steps)
        if not found.any():
            break
        points, good = np.where(found[..., None], again, points), good | found
    return points, good & (good.mean() > _FEWEST)


def _confirmed(image: np.ndarray, start: np.ndarray, steps: tuple[np.ndarray, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Corners (rows, cols, 2) refined from `start`, and which of them (rows, cols) are corners by their own shape; steps: px to the
    next column and row."""
    across, down = steps
    spacing = np.sqrt(np.abs(across[..., 0] * down[..., 1] - across[..., 1] * down[..., 0]))
    inside = ((start >= 0) & (start <= np.array(image.shape[::-1]) - 1)).all(axis=-1)
    points = np.full_like(start, np.nan)
    for row, column in np.argwhere(inside & np.isfinite(spacing)):
        half = spacing[row, column]
        # Each corner by itself with its own spacing: neighbours may be hidden, and refined() needs a grid only for the spacing.
        patch = start[row, column] + np.array([[[0.0, 0.0], [half, 0.0]], [[0.0, half], [half, half]]])
        points[row, column] = refined(image, patch)[0, 0]
    pattern, share = crossings(image, points, across, down)
    pattern = pattern * signs(*start.shape[:2])
    if not coloured((start.shape[1], start.shape[0])):
        pattern = pattern * np.sign(np.nansum(pattern))
    with np.errstate(invalid="ignore"):
        formed = (share > _SHAPE) & (pattern > _LEAST_GREY) & (np.linalg.norm(points - start, axis=2) < _NEAR * spacing)
    strength = np.median(pattern[formed]) if formed.any() else np.inf
    return points, formed & (np.nan_to_num(pattern) > _LEAST_SHARE * strength)


def _shifts(shift: np.ndarray, good: np.ndarray) -> np.ndarray:
    """(rows, cols, 2): by how much predictions are wrong, from the `good` corners at most _REACH steps away; NaN without any."""
    out = np.full_like(shift, np.nan)
    place = np.argwhere(good)
    for row, column in np.argwhere(~good):
        away = place - [row, column]
        near = np.abs(away).max(axis=1) <= _REACH
        if not near.any():
            continue
        known = shift[place[near, 0], place[near, 1]]
        # A plane through the shifts where they span one: errors of a lens grow from corner to corner.
        plane = np.column_stack([np.ones(near.sum()), away[near]])
        spans = near.sum() > 3 and np.linalg.matrix_rank(plane) == 3
        out[row, column] = np.linalg.lstsq(plane, known, rcond=None)[0][0] if spans else known.mean(axis=0)
    return out
