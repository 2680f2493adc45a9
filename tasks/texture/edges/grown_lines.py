"""Straight edges of roofs and walls: lines through the places that were measured along them.

Strategy. From the most precise place on, neighbours join a line as long as they lie on it, across and in height, and their own
direction is that of the line (region growing, as line segments are grown in a photograph). Where two lines end near the point in
which they cross, they are drawn to it: corners of roofs.

Standard errors. Photographs displace all places along an edge alike, so that a long line is known no better than its places are;
what they scatter about the line comes on top.
"""

from dataclasses import dataclass
from math import ceil, log10
from typing import NamedTuple

import numpy as np
from pydantic import BaseModel, ConfigDict
from scipy.spatial import cKDTree

from orthomill.schemas.maps.straight_edges import StraightEdges
from orthomill.tasks.texture.edges.edge_places import SPACING
from orthomill.tasks.texture.edges.edge_profiles import HALF_PIECE
from orthomill.tasks.texture.edges.measured_edges import MeasuredEdges, joined_edges

LEAST_LENGTH = 5.0
"""cells along a line"""
LEAST_PLACES = 4
CORNER = 3.0
"""cells from its end to which a line is drawn to the crossing with another"""
_REACH = 3 * SPACING  # cells between neighbours
_TURN = np.cos(np.radians(12.0))
_CROSSING = np.sin(np.radians(30.0))  # lines that differ less make no corner
_CLIMB = 0.2  # m per m: slopes along one edge differ by less; a gable rises and falls
_OFF = 0.5  # cells, or three standard errors, from a line across it, and twice as much in height
LAYER = "EDGE"
_DIGITS = 3  # of a cell: coordinates are written to its thousandth, or to a millimetre where this is finer


@dataclass(frozen=True)
class _GrownLine:
    """A line through `members`: `point` (3,) m, `along` (2,) unit vector, `climb` m per m, from `first` to `last` m along it."""

    members: np.ndarray
    point: np.ndarray
    along: np.ndarray
    climb: float
    first: float
    last: float

    def at(self, t: float) -> np.ndarray:
        """The point (3,) at t m along it."""
        return np.array([*(self.point[:2] + t * self.along), self.point[2] + t * self.climb])


class _Offsets(NamedTuple):
    """Places against a line, m: along it, across it, above it."""

    along: np.ndarray
    across: np.ndarray
    above: np.ndarray


class EdgeSums(BaseModel):
    """Sums over the lines of a sheet."""

    model_config = ConfigDict(frozen=True)

    lines: int
    length: float
    """m"""
    variance: float
    """m3: sum of the squared standard errors across the lines, each times its length"""


class EdgeSheet(NamedTuple):
    """The straight edges of a sheet."""

    lines: StraightEdges
    sums: EdgeSums


def edge_sheet(parts: tuple[MeasuredEdges, ...], cell: float) -> EdgeSheet:
    """The straight edges of the tiles of a sheet; `cell` as of `straight_edges`."""
    lines = straight_edges(parts, cell)
    each = lines.take(np.arange(0, len(lines), 2))
    variance = float((each.sigma_across**2 * each.length).sum())
    return EdgeSheet(lines, EdgeSums(lines=len(each), length=float(each.length.sum()), variance=variance))


def straight_edges(parts: tuple[MeasuredEdges, ...], cell: float) -> StraightEdges:
    """The lines through the places of all parts; `cell`: side of a cell of the surface model, m."""
    edges = _in_order(parts)
    lines = _lines(edges, cell)
    return _table(edges, lines, _ends(lines, cell), max(_DIGITS, ceil(_DIGITS - log10(cell))))


def _in_order(parts: tuple[MeasuredEdges, ...]) -> MeasuredEdges:
    """All places, the most precise ones first, in the same order whatever the tiles."""
    edges = joined_edges(parts)
    taken: MeasuredEdges = edges.take(np.lexsort((edges.y, edges.x, edges.sigma_across)))
    return taken


def _lines(edges: MeasuredEdges, cell: float) -> list[_GrownLine]:
    if not len(edges):
        return []
    tree = cKDTree(np.column_stack([edges.x, edges.y]))
    near = tree.query_ball_point(tree.data, _REACH * cell, return_sorted=True)
    free, found = np.ones(len(edges), bool), []
    for seed in range(len(edges)):
        if not free[seed]:
            continue
        line = _grown(edges, seed, near, free, cell)
        if line is not None:
            free[line.members] = False
            found.append(line)
    return found


def _grown(edges: MeasuredEdges, seed: int, near: np.ndarray, free: np.ndarray, cell: float) -> _GrownLine | None:
    """The line through a place and those that join it; None where it stays short."""
    members, waiting, asked = [seed], [seed], {seed}
    line = _seeded(edges, seed)
    while waiting:
        here = waiting.pop(0)
        beside = np.array([k for k in near[here] if free[k] and k not in asked], np.int64)
        if not len(beside):
            continue
        fits = beside[_fits(edges, beside, line, cell)]
        asked.update(fits.tolist())
        members += fits.tolist()
        waiting += fits.tolist()
        if len(fits) and len(members) >= LEAST_PLACES:
            line = _through(edges, np.array(members))
    chosen = np.array(members)
    for _ in range(2):
        if len(chosen) < LEAST_PLACES:
            return None
        line = _through(edges, chosen)
        chosen = chosen[_fits(edges, chosen, line, cell)]
    if len(chosen) < LEAST_PLACES or line.last - line.first < LEAST_LENGTH * cell:
        return None
    return _through(edges, chosen)


def _seeded(edges: MeasuredEdges, k: int) -> _GrownLine:
    along = np.array([-edges.away_y[k], edges.away_x[k]])
    return _GrownLine(np.array([k]), np.array([edges.x[k], edges.y[k], edges.z[k]]), along, float(edges.climb[k]), 0.0, 0.0)


def _offsets(edges: MeasuredEdges, chosen: np.ndarray, line: _GrownLine) -> _Offsets:
    dx, dy = edges.x[chosen] - line.point[0], edges.y[chosen] - line.point[1]
    along = dx * line.along[0] + dy * line.along[1]
    return _Offsets(along, dx * line.along[1] - dy * line.along[0], edges.z[chosen] - line.point[2] - line.climb * along)


def _fits(edges: MeasuredEdges, chosen: np.ndarray, line: _GrownLine, cell: float) -> np.ndarray:
    """bool: which of the chosen places lie on the line and run along it."""
    off = _offsets(edges, chosen, line)
    same = edges.away_x[chosen] * line.along[1] - edges.away_y[chosen] * line.along[0] >= _TURN
    same &= np.abs(edges.climb[chosen] - line.climb) <= _CLIMB
    across = np.abs(off.across) <= np.maximum(_OFF * cell, 3.0 * edges.sigma_across[chosen])
    return np.asarray(same & across & (np.abs(off.above) <= np.maximum(2.0 * _OFF * cell, 3.0 * edges.sigma_height[chosen])))


def _through(edges: MeasuredEdges, members: np.ndarray) -> _GrownLine:
    """The line of least squares through the members, each with the weight of its precision."""
    weight = 1.0 / edges.sigma_across[members] ** 2
    weight /= weight.sum()
    middle = np.array([weight @ edges.x[members], weight @ edges.y[members]])
    dx, dy = edges.x[members] - middle[0], edges.y[members] - middle[1]
    xx, xy, yy = weight @ (dx * dx), weight @ (dx * dy), weight @ (dy * dy)
    turn = 0.5 * np.arctan2(2.0 * xy, xx - yy)
    along = np.array([np.cos(turn), np.sin(turn)])
    # The upper surface lies to the left, as at every place.
    if (edges.away_x[members] * along[1] - edges.away_y[members] * along[0]).sum() < 0:
        along = -along
    t = dx * along[0] + dy * along[1]
    level = 1.0 / edges.sigma_height[members] ** 2
    level /= level.sum()
    mean_t, mean_z = level @ t, level @ edges.z[members]
    spread = level @ (t - mean_t) ** 2
    climb = float(level @ ((t - mean_t) * (edges.z[members] - mean_z)) / spread) if spread > 0 else 0.0
    return _GrownLine(members, np.array([*middle, mean_z - climb * mean_t]), along, climb, float(t.min()), float(t.max()))


def _ends(lines: list[_GrownLine], cell: float) -> np.ndarray:
    """Both ends (L, 2, 3) m of the lines, drawn to the corner where another one ends."""
    ends = np.array([[line.at(line.first), line.at(line.last)] for line in lines]).reshape(-1, 2, 3)
    if not len(lines):
        return ends
    tree = cKDTree(ends.reshape(-1, 3)[:, :2])
    drawn = ends.copy()
    taken: set[int] = set()
    pairs = tree.query_pairs(2.0 * CORNER * cell, output_type="ndarray")
    apart = np.hypot(*(tree.data[pairs[:, 0]] - tree.data[pairs[:, 1]]).T)
    for a, b in pairs[np.lexsort((pairs[:, 1], pairs[:, 0], apart))].tolist():
        one, other = lines[a // 2], lines[b // 2]
        cross = one.along[0] * other.along[1] - one.along[1] * other.along[0]
        if a in taken or b in taken or a // 2 == b // 2 or abs(cross) < _CROSSING:
            continue
        gap = other.point[:2] - one.point[:2]
        t = (gap[0] * other.along[1] - gap[1] * other.along[0]) / cross
        u = (gap[0] * one.along[1] - gap[1] * one.along[0]) / cross
        corner_a, corner_b = one.at(t), other.at(u)
        near = [np.hypot(*(corner_a - ends[k // 2, k % 2])[:2]) <= CORNER * cell for k in (a, b)]
        if all(near) and abs(corner_a[2] - corner_b[2]) <= CORNER * cell:
            drawn[a // 2, a % 2] = drawn[b // 2, b % 2] = 0.5 * (corner_a + corner_b)
            taken |= {a, b}
    return drawn


def _table(edges: MeasuredEdges, lines: list[_GrownLine], ends: np.ndarray, decimals: int) -> StraightEdges:
    """The table of the lines, sorted by place, with so many decimals of a metre."""
    order = np.lexsort((ends[:, 0, 1], ends[:, 0, 0]))
    found = np.array([_precision(edges, lines[k]) for k in order]).reshape(-1, len(_Precision._fields))
    each = _Precision(*np.repeat(found, 2, axis=0).T)
    vertices = ends[order].reshape(-1, 3)
    count = len(vertices)
    return StraightEdges(
        line=np.repeat(np.arange(len(order)), 2),
        x=np.round(vertices[:, 0], decimals),
        y=np.round(vertices[:, 1], decimals),
        z=np.round(vertices[:, 2], decimals),
        layer=np.full(count, LAYER),
        dashed=np.zeros(count, bool),
        text=np.full(count, ""),
        length=np.repeat(np.round(np.hypot(*(ends[order, 1] - ends[order, 0])[:, :2].T), decimals), 2),
        step=np.round(each.step, decimals),
        sigma_across=np.round(each.across, decimals + 1),
        sigma_height=np.round(each.height, decimals + 1),
        scatter=np.round(each.scatter, decimals + 1),
        photos=np.rint(each.photos).astype(np.int64),
    )


class _Precision(NamedTuple):
    """Of a line, m: standard errors across its less certain end and of the height there; scatter of its places about it; height
    above the lower surface; and photographs. Numbers, or (N,) of vertices."""

    across: np.ndarray | float
    height: np.ndarray | float
    scatter: np.ndarray | float
    step: np.ndarray | float
    photos: np.ndarray | float


def _precision(edges: MeasuredEdges, line: _GrownLine) -> _Precision:
    members, off = line.members, _offsets(edges, line.members, line)
    # Pieces that are measured at once overlap: so many of them count as one.
    independent = max(len(members) * SPACING / (2.0 * HALF_PIECE), 1.0)
    spread = max(float(off.along.std()), 1e-9)
    own = (1.0 + (max(abs(line.first), abs(line.last)) / spread) ** 2) / independent
    across, height = (
        float(np.sqrt(np.median(sigma[members]) ** 2 + own * (left**2).mean()))
        for sigma, left in ((edges.sigma_across, off.across), (edges.sigma_height, off.above))
    )
    scatter = float(np.sqrt((off.across**2).mean()))
    return _Precision(across, height, scatter, float(np.median(edges.step[members])), float(np.median(edges.photos[members])))
