"""Boards that the frame cuts, and boards of another size than stated: as much of a grid as a photo shows, and which part it is.

Strategy. Lattices of any outline are found (lattices.py) and refined. On each of its four sides a lattice ends in the photo (the
next row would be inside the frame, and is not there) or may continue outside. A side that ends is a side of the board; together
with the colour of the first square this determines which corners of the board they are, mostly uniquely. A lattice that ends on all
sides and does not have the stated number of corners is a board of another kind.

Where a cut grid can be several parts of the board (a close-up whose border is outside on three sides), it can still be used alone:
a single board has a pose of its own, and any part of an exact grid equals any other.
"""

from dataclasses import dataclass

import numpy as np

from orthomill.tasks.calibration.detection.board_detection import paint_over, regular, through_levels
from orthomill.tasks.calibration.detection.board_turns import coloured, corner_orders
from orthomill.tasks.calibration.detection.lattices import lattices
from orthomill.tasks.calibration.detection.saddles import contrast, refined, signs, spacings
from orthomill.tasks.imagery.pyramid import full_to_level

_FEWEST, _LEAST_CONTRAST = 12, 8.0
"""Least number of corners and least median contrast (grey values) of a grid that is accepted."""
_FINEST_SIDE, _MOST = 1000, 12
"""Longer side in px of the finest image that is searched, and how many grids are examined in one."""
_KEPT, _ABSENT = 0.4, 0.5
"""Contrast of a corner as a share of its grid's median: from here on it is a corner, and below this the next row is not there."""


@dataclass(frozen=True, eq=False)
class CutBoards:
    """`corners` (B, rows, cols, 2) px, NaN for corners that are not shown; `unnumbered`: number of grids that can be more than one
    part of a board; `other`: sizes (columns, rows) of boards of another kind, whose four sides are in the photo."""

    corners: np.ndarray
    unnumbered: int
    other: tuple[tuple[int, int], ...]


def find_cut_boards(levels: list[np.ndarray], whole: np.ndarray, corners: tuple[int, int], alone: bool) -> CutBoards:
    """Boards with `corners` (columns, rows) of which a photo, given as its pyramid, shows a part, in addition to the `whole` ones
    (B, rows, cols, 2). `alone`: accept a grid that can be several parts of the board if there is nothing else."""
    numbered: list[np.ndarray] = []
    unnumbered: list[np.ndarray] = []
    other: list[tuple[int, int]] = []
    for level in reversed(range(len(levels))):
        # Coarse first, as in the search for whole boards: large squares are lost among the texture of fine levels.
        if numbered or unnumbered or (max(levels[level].shape) > _FINEST_SIDE and level < len(levels) - 1):
            break
        search, others = levels[level].copy(), []
        for board in whole:
            paint_over(search, full_to_level(board, level))
        for coarse in lattices(search, _FEWEST)[:_MOST]:
            grid = _accepted(levels[0], through_levels(refined(levels[level], coarse), levels, level))
            if grid is None:
                continue
            ends = [_ending(levels[0], np.rot90(grid, turn)) for turn in range(4)]
            parts = _parts(levels[0], grid, ends, corners)
            if parts:
                (numbered if len(parts) == 1 else unnumbered).append(parts[0])
            elif all(ends):
                others.append((max(grid.shape[:2]), min(grid.shape[:2])))
        # The longer list, not both: what two levels show is counted once.
        other = max(other, others, key=len)
    if other:
        # A board that the frame cuts is then more likely one of these than of the stated kind.
        numbered, unnumbered = [part for part in numbered if np.isfinite(part).all()], []
    if alone and not len(whole) and not numbered and unnumbered:
        numbered.append(unnumbered.pop(0))
    shape = (0, corners[1], corners[0], 2)
    return CutBoards(np.array(numbered) if numbered else np.empty(shape), len(unnumbered), tuple(other))


def _accepted(image: np.ndarray, grid: np.ndarray) -> np.ndarray | None:
    """The grid (rows, cols, 2) without the corners around which squares do not alternate; None where that leaves no board."""
    # A lattice may have grown into texture next to the board: such rows have no contrast, and are cut off.
    pattern = contrast(image, grid, *spacings(grid)) * signs(*grid.shape[:2])
    pattern *= np.sign(np.nansum(pattern))
    strength = float(np.nanmedian(pattern)) if np.isfinite(pattern).any() else 0.0
    with np.errstate(invalid="ignore"):
        good = pattern > _KEPT * strength
    rows, columns = (np.flatnonzero(good.sum(axis=axis) >= 2) for axis in (1, 0))
    if strength < _LEAST_CONTRAST or min(len(rows), len(columns)) < 3:
        return None
    part = np.s_[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    grid, good = np.where(good[..., None], grid, np.nan)[part], good[part]
    # A small grid has to be nearly complete to be more than chance; a large one may be half hidden.
    full = good.sum() >= max(_FEWEST, 0.6 * good.size) if good.size < 40 else good.mean() > 0.4
    return grid if full and regular(grid) else None


def _ending(image: np.ndarray, grid: np.ndarray) -> bool:
    """Whether the board ends in the photo before the first row of its grid: another row would be inside the frame, and is not
    there."""
    across, down = 0.5 * (np.roll(grid[0], -1, axis=0) - np.roll(grid[0], 1, axis=0)), grid[1] - grid[0]
    before = grid[0] - down
    room = np.abs(down).max(axis=1, keepdims=True)
    inside = ((before > room) & (before < np.array(image.shape[::-1]) - 1 - room)).all(axis=1)
    # np.roll wraps around at both ends of the row, where the steps are therefore meaningless.
    inside[[0, -1]] = False
    if inside.sum() < 2:
        return False
    usual = np.nanmedian(np.abs(contrast(image, grid, *spacings(grid))))
    return bool((np.abs(contrast(image, before, across, down))[inside] < _ABSENT * usual).mean() > 0.7)


def _parts(image: np.ndarray, grid: np.ndarray, ends: list[bool], corners: tuple[int, int]) -> list[np.ndarray]:
    """All ways (rows, cols, 2) in which the grid can be a part of the board; none when it is a board of another kind. ends: whether
    the board ends at the grid's first row, last column, last row, first column (as rot90 brings them to the front)."""
    columns, rows = corners
    out = []
    steps = (np.nanmean(step, axis=(0, 1)) for step in (np.diff(grid, axis=1), np.diff(grid, axis=0)))
    across, down = steps
    # Mirrored grids are flipped first: a printed board has one handedness, and four turns are then all there is to try.
    if across[0] * down[1] - across[1] * down[0] > 0:
        grid, ends = grid[::-1], [ends[2], ends[1], ends[0], ends[3]]
    # Turns that change nothing would only repeat the same part.
    for turn in range(4 // len(corner_orders(corners))):
        own = np.rot90(grid, turn)
        before, right, behind, left = ends[turn:] + ends[:turn]
        pattern = contrast(image, own, *spacings(own))
        for row in _offsets(own.shape[0], rows, before, behind):
            for column in _offsets(own.shape[1], columns, left, right):
                colour = signs(rows, columns)[row : row + own.shape[0], column : column + own.shape[1]]
                if np.nansum(pattern * colour) > 0 or not coloured(corners):
                    part = np.full((rows, columns, 2), np.nan)
                    part[row : row + own.shape[0], column : column + own.shape[1]] = own
                    out.append(part)
    return out


def _offsets(count: int, of: int, before: bool, behind: bool) -> list[int]:
    """At which of the board's `of` rows a grid of `count` rows can begin, given at which of its sides the board ends."""
    return [first for first in range(of - count + 1) if (first == 0 or not before) and (first + count == of or not behind)]
