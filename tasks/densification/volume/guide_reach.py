"""How far from an existing height model the surface may lie, place by place, as the tie points say.

Strategy. A coarse model lacks roofs and gullies, and its posts have errors of their own; tie points show both where they lie. Near
them the model is corrected by their departures, carried on into the gaps between them. What that leaves is learned from tie points
that were left out: squares of places, black and white as on a chessboard, are predicted from those of the other colour, and the
larger the squares, the farther the prediction reached. So every place gets the reach of its distance from the nearest tie point,
and twice what its surroundings were predicted wrong by on top: at a cliff or among roofs heights are looked for farther away than
on a meadow. Where a correction is no better than the model, the model stays as it is.
"""

from typing import NamedTuple

import numpy as np
from scipy.ndimage import distance_transform_cdt, map_coordinates, maximum_filter

from orthomill.schemas.observations import GroundPoints
from orthomill.schemas.raster import MapGrid
from orthomill.tasks.densification.volume.terrain import median_heights
from orthomill.tasks.imagery.pull_push import filled

_FEW, _SPARE = 0.005, 2.0
"""Share of the tie points on either side that may be wrong; the highest roof or mast carries none, so that the reach is twice as
far as the others depart."""
_SQUARES = 2, 4, 8, 16
"""places along the side of a square that is predicted; half of it is how far the prediction reaches"""
_ANYWHERE = 1e6
"""m: a reach that bounds nothing"""


class Reach(NamedTuple):
    """How far the surface may lie below and above, m."""

    below: float
    above: float


class _Departures(NamedTuple):
    """Tie points (N,) over places: map coordinates, columns and rows of the places, and heights above the model, m."""

    x: np.ndarray
    y: np.ndarray
    col: np.ndarray
    row: np.ndarray
    away: np.ndarray

    def take(self, which: np.ndarray) -> "_Departures":
        return _Departures(*(values[which] for values in self))


def near_tie_points(points: GroundPoints, model: np.ndarray, grid: MapGrid) -> tuple[np.ndarray, np.ndarray]:
    """The model (rows, cols), m, corrected near tie points, and the reach (rows, cols, 2) below and above it, both float32."""
    tie = _departures(points, model, grid)
    if not len(tie.away):
        return model, np.full((*grid.shape, 2), _ANYWHERE, np.float32)
    plain = reach_of(tie.away)
    # A wrong tie point corrects nothing.
    tie = tie.take((tie.away >= -plain.below) & (tie.away <= plain.above))
    heights, reach = model.copy(), np.empty((*grid.shape, 2), np.float32)
    reach[:] = plain
    corrected = np.zeros(grid.shape, bool)
    if len(tie.away):
        known = _departure(tie, grid)
        distance = distance_transform_cdt(np.isnan(known), "chessboard")
        for side, found in _learned(tie, grid, plain):
            here = (distance <= side // 2) & ~corrected
            reach[here] = found
            corrected |= here
        heights[corrected] += filled(known)[corrected]
        reach[corrected] += _SPARE * _disagreement(tie, grid)[corrected, None]
    return heights, reach


def reach_of(away: np.ndarray) -> Reach:
    """Twice as far as all but a few of the departures (N,), m."""
    low, high = np.quantile(away, [_FEW, 1.0 - _FEW])
    return Reach(max(-_SPARE * float(low), 0.0), max(_SPARE * float(high), 0.0))


def _departures(points: GroundPoints, model: np.ndarray, grid: MapGrid) -> _Departures:
    col, row = grid.pixel(points.x, points.y)
    inside = (col >= 0) & (row >= 0) & (col <= grid.cols - 1) & (row <= grid.rows - 1) & np.isfinite(points.z)
    away = points.z[inside] - map_coordinates(model.astype(np.float64), [row[inside], col[inside]], order=1)
    found = _Departures(points.x[inside], points.y[inside], col[inside], row[inside], away)
    return found.take(np.isfinite(away))


def _learned(tie: _Departures, grid: MapGrid, plain: Reach) -> list[tuple[int, Reach]]:
    """Squares and the reach that predictions across them need, as long as it is less than the plain one."""
    found: list[tuple[int, Reach]] = []
    last = Reach(0.0, 0.0)
    for side in _SQUARES:
        this = reach_of(_predicted_wrong(tie, grid, side))
        last = Reach(max(last.below, this.below), max(last.above, this.above))
        if sum(last) >= sum(plain):
            break
        found.append((side, last))
    return found


def _predicted_wrong(tie: _Departures, grid: MapGrid, side: int) -> np.ndarray:
    """What the departure of every tie point (N,) is beyond what the tie points of the other colour say, m."""
    col, row = (np.rint(values).astype(np.int64) // side for values in (tie.col, tie.row))
    black = (col + row) % 2 == 0
    wrong = tie.away.copy()
    for own in (black, ~black):
        if own.any() and not own.all():
            said = filled(_departure(tie.take(~own), grid)).astype(np.float64)
            wrong[own] -= map_coordinates(said, [tie.row[own], tie.col[own]], order=1)
    return wrong


def _disagreement(tie: _Departures, grid: MapGrid) -> np.ndarray:
    """The most (rows, cols) by which a place around was predicted wrong from its neighbours, m."""
    wrong = tie._replace(away=_predicted_wrong(tie, grid, 1))
    return maximum_filter(np.abs(np.nan_to_num(_departure(wrong, grid))), 3)


def _departure(tie: _Departures, grid: MapGrid) -> np.ndarray:
    """Median departures (rows, cols) float32 of the places, m; NaN without a tie point."""
    return median_heights(tie.x, tie.y, tie.away, grid)
