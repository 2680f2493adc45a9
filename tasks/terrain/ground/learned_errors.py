"""How wrong invented ground is, learned from ground of the same block that is hidden and invented again.

Strategy. The pattern of gaps and objects is laid over the ground beside them, moved by a fixed number of cells; what it covers is
hidden and filled from what it leaves. The differences from what was measured there, sorted by the distance to the ground that was
left, are the errors of filling on this very terrain: on a plain they stay small, on broken ground they grow fast.
"""

import numpy as np
from pydantic import BaseModel, ConfigDict

from orthomill.tasks.terrain.ground.mean_value_fill import GapFill, fill_gaps

CLASSES = 10
"""of distance: up to 1, 2, 4, ... cells"""
LEAST_CELLS = 200
"""hidden cells that a class of distance needs: neighbours share their errors, so that fewer tell nothing"""
UNKNOWN_GROWTH = 0.1
"""m per m: error of invented ground where too little ground could be hidden, about that of hilly land"""


class HiddenGround(BaseModel):
    """Sums over hidden cells, by class of distance: enclosed ones, then those open to one side."""

    model_config = ConfigDict(frozen=True)

    cells: tuple[tuple[int, ...], tuple[int, ...]]
    squares: tuple[tuple[float, ...], tuple[float, ...]]
    """of the differences, m2"""


class ErrorCurve(BaseModel):
    """Standard error (m) of ground that was filled from so far away: at the `distance` (cells), enclosed and open to one side."""

    model_config = ConfigDict(frozen=True)

    distance: tuple[float, ...]
    enclosed: tuple[float, ...]
    one_sided: tuple[float, ...]
    cells: tuple[tuple[int, ...], tuple[int, ...]]
    """hidden cells that each rests on"""

    def at(self, fill: GapFill) -> np.ndarray:
        """Standard errors (rows, cols) float32, m, of filled cells; NaN where nothing was filled."""
        known = np.isfinite(fill.distance)
        place = np.log2(np.maximum(np.where(known, fill.distance, 1.0), 1e-3))
        # In the logarithm of the distance, and on in proportion to it beyond the last class.
        inside, outside = (_on_curve(place, self.distance, errors) for errors in (self.enclosed, self.one_sided))
        return np.where(known, np.where(fill.enclosed, inside, outside), np.nan).astype(np.float32)


def _on_curve(place: np.ndarray, distance: tuple[float, ...], errors: tuple[float, ...]) -> np.ndarray:
    log = np.log2(distance)
    beyond = np.exp2(np.clip(place - log[-1], 0.0, None))
    return np.interp(place, log, errors) * beyond


def hidden_ground(
    heights: np.ndarray, anchors: np.ndarray, moved: np.ndarray, core: tuple[slice, slice], reach: int
) -> HiddenGround:
    """The differences of the cells `core`.

    heights (rows, cols) m; anchors (rows, cols) bool: ground that counts; moved (rows, cols) bool: the anchors as they are a fixed
    number of cells away.
    """
    hidden = np.zeros(anchors.shape, bool)
    hidden[core] = (anchors & ~moved)[core]
    fill = fill_gaps(heights[..., None], anchors & moved, hidden, reach)
    found = hidden & np.isfinite(fill.distance)
    number = np.clip(np.ceil(np.log2(np.maximum(fill.distance[found], 1.0))), 0, CLASSES - 1).astype(np.int64)
    off = (fill.values[found, 0].astype(np.float64) - heights[found]) ** 2
    enclosed = fill.enclosed[found]
    count, squares = zip(*(_by_class(number[side], off[side]) for side in (enclosed, ~enclosed)), strict=True)
    return HiddenGround(cells=count, squares=squares)


def _by_class(number: np.ndarray, off: np.ndarray) -> tuple[tuple[int, ...], tuple[float, ...]]:
    count = np.bincount(number, minlength=CLASSES)
    return tuple(count.tolist()), tuple(np.bincount(number, off, CLASSES).tolist())


def learned_errors(parts: tuple[HiddenGround, ...], cell: float) -> ErrorCurve:
    """The errors of all tiles together; `cell` m."""
    cells, squares = np.zeros((2, CLASSES), np.int64), np.zeros((2, CLASSES))
    for part in parts:
        cells, squares = cells + part.cells, squares + part.squares
    distance = 2.0 ** (np.arange(CLASSES) - 0.5)
    inside = _completed(cells[0], squares[0], UNKNOWN_GROWTH * cell * distance)
    # What is open to one side is never better than what is enclosed: it is extrapolated.
    outside = np.maximum(_completed(cells[1], squares[1], 2.0 * inside), inside)
    return ErrorCurve(
        distance=tuple(distance.tolist()),
        enclosed=tuple(inside.tolist()),
        one_sided=tuple(outside.tolist()),
        cells=(tuple(cells[0].tolist()), tuple(cells[1].tolist())),
    )


def _completed(cells: np.ndarray, squares: np.ndarray, otherwise: np.ndarray) -> np.ndarray:
    """Errors by class, growing with the distance; between classes that are known in proportion to it, `otherwise` without any."""
    known = cells >= LEAST_CELLS
    if not known.any():
        return otherwise
    distance = 2.0 ** np.arange(len(cells))
    errors = np.sqrt(squares / np.maximum(cells, 1))
    first, last = np.flatnonzero(known)[[0, -1]]
    filled = np.interp(np.arange(len(cells)), np.flatnonzero(known), errors[known])
    filled[:first] = errors[first] * distance[:first] / distance[first]
    filled[last + 1 :] = errors[last] * distance[last + 1 :] / distance[last]
    return np.maximum.accumulate(filled)
