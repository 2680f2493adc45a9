"""Contours of the whole map from the pieces of its tiles: joined, cut where the ground was not measured, thinned and named.

Strategy. Pieces of one height that end in the same point are one line. A closed line begins at its smallest vertex, so that it is
the same whatever the tiles. Short closed lines, around places no larger than the grid tells, are left out.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from orthomill.schemas.bare_ground import ContourLines
from orthomill.tasks.terrain.contours.contour_interval import ContourInterval
from orthomill.tasks.terrain.contours.contour_pieces import ContourPieces

LEAST_RING = 12.0
"""cells along the shortest closed line that is kept"""
SHORTEST_RUN = 6.0
"""cells: shorter runs of measured or other ground do not change how the line is drawn"""
THINNING = 0.1
"""cells that a vertex must stand off the line between its neighbours to be kept"""
LAYERS = {
    (False, False): "CONTOUR",
    (True, False): "CONTOUR_INDEX",
    (False, True): "CONTOUR_DASHED",
    (True, True): "CONTOUR_INDEX_DASHED",
}
"""layer by whether a line is an index contour, and whether it is dashed"""


@dataclass(frozen=True)
class _Line:
    """A line: its vertices (N, 2) m, standard errors and whether the ground was measured (N,)."""

    xy: np.ndarray
    sigma: np.ndarray
    measured: np.ndarray

    @property
    def closed(self) -> bool:
        return len(self.xy) > 2 and np.array_equal(self.xy[0], self.xy[-1])

    @property
    def length(self) -> float:
        return float(np.hypot(*np.diff(self.xy, axis=0).T).sum())

    def part(self, first: int, last: int) -> "_Line":
        """The vertices from the first to the last, both included."""
        return _Line(self.xy[first : last + 1], self.sigma[first : last + 1], self.measured[first : last + 1])


def join_contours(parts: tuple[ContourPieces, ...], interval: ContourInterval, cell: float, every: int) -> ContourLines:
    """All contours; `cell` m; `every` so many-th contour is an index contour."""
    numbers, rows = [], []
    for level, pieces in sorted(_by_level(parts, interval.interval).items()):
        lines = sorted(_joined(pieces), key=lambda line: (tuple(line.xy[0]), tuple(line.xy[-1]), len(line.xy)))
        for line in lines:
            if line.closed and line.length < LEAST_RING * cell:
                continue
            for run in _runs(line, SHORTEST_RUN * cell):
                numbers.append(level)
                rows.append(_thinned(run, THINNING * cell))
    return _table(numbers, rows, interval.interval, every)


def _by_level(parts: tuple[ContourPieces, ...], interval: float) -> dict[int, list[_Line]]:
    found: dict[int, list[_Line]] = {}
    for part in parts:
        starts = np.flatnonzero(np.diff(part.piece, prepend=-1)) if len(part) else np.zeros(0, np.int64)
        for first, last in zip(starts, [*starts[1:], len(part)], strict=False):
            level = int(np.rint(part.height[first] / interval))
            xy = np.column_stack([part.x[first:last], part.y[first:last]])
            found.setdefault(level, []).append(_Line(xy, part.sigma[first:last], part.measured[first:last]))
    return found


def _joined(pieces: list[_Line]) -> Iterator[_Line]:
    """Pieces joined at their common ends."""
    # Contours run with the higher ground on one side, so that the end of a piece is the start of the next.
    starts: dict[tuple[float, float], list[int]] = {}
    open_pieces = [k for k, piece in enumerate(pieces) if not piece.closed]
    for k in open_pieces:
        starts.setdefault(tuple(pieces[k].xy[0]), []).append(k)
    ends = {tuple(pieces[k].xy[-1]) for k in open_pieces}
    used: set[int] = set()
    # First those that nothing precedes, then what is left: rings over several tiles.
    heads = [k for k in open_pieces if tuple(pieces[k].xy[0]) not in ends]
    for head in [*heads, *open_pieces]:
        if head in used:
            continue
        chain = [head]
        used.add(head)
        while following := [k for k in starts.get(tuple(pieces[chain[-1]].xy[-1]), []) if k not in used]:
            chain.append(following[0])
            used.add(following[0])
        yield _from_smallest(_chained([pieces[k] for k in chain]))
    yield from (_from_smallest(piece) for piece in pieces if piece.closed)


def _chained(pieces: list[_Line]) -> _Line:
    later = [piece.part(1, len(piece.xy)) for piece in pieces[1:]]
    parts = [pieces[0], *later]
    return _Line(*(np.concatenate([getattr(part, name) for part in parts]) for name in ("xy", "sigma", "measured")))


def _from_smallest(line: _Line) -> _Line:
    """A closed line from its smallest vertex on; any other as it is."""
    if not line.closed:
        return line
    first = int(np.lexsort((line.xy[:-1, 1], line.xy[:-1, 0]))[0])
    turned = (np.roll(values[:-1], -first, axis=0) for values in (line.xy, line.sigma, line.measured))
    return _Line(*(np.concatenate([values, values[:1]]) for values in turned))


def _runs(line: _Line, shortest: float) -> Iterator[_Line]:
    """The line in runs over measured ground and over other ground."""
    measured = _without_short_runs(line, shortest)
    changes = np.flatnonzero(np.diff(measured))
    bounds = [0, *(changes + 1).tolist(), len(line.xy) - 1]
    for first, last in pairwise(bounds):
        if last > first:
            part = line.part(first, last)
            yield _Line(part.xy, part.sigma, np.full(len(part.xy), measured[first]))


def _without_short_runs(line: _Line, shortest: float) -> np.ndarray:
    """`measured` with runs shorter than that, m, counted to what surrounds them; a run over other ground is never hidden whole."""
    away = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line.xy, axis=0).T))])
    measured = line.measured.copy()
    changes = np.flatnonzero(np.diff(measured)) + 1
    bounds = [0, *changes.tolist(), len(measured)]
    for first, last in pairwise(bounds):
        # Only measured ground between other ground may be swallowed: dashed is the cautious way to draw it.
        if measured[first] and away[last - 1] - away[first] < shortest and len(bounds) > 2:
            measured[first:last] = False
    return measured


def _thinned(line: _Line, tolerance: float) -> _Line:
    """The line without vertices that stand off it by less than `tolerance`, m (Douglas and Peucker 1973)."""
    keep = np.zeros(len(line.xy), bool)
    keep[[0, -1]] = True
    middle = len(line.xy) // 2
    waiting = [(0, middle), (middle, len(line.xy) - 1)] if line.closed else [(0, len(line.xy) - 1)]
    keep[middle] |= line.closed
    while waiting:
        first, last = waiting.pop()
        if last - first < 2:
            continue
        along = line.xy[last] - line.xy[first]
        length = np.hypot(*along)
        away = line.xy[first + 1 : last] - line.xy[first]
        off = np.abs(away[:, 0] * along[1] - away[:, 1] * along[0]) / length if length else np.hypot(*away.T)
        worst = int(np.argmax(off))
        if off[worst] > tolerance:
            keep[first + 1 + worst] = True
            waiting += [(first, first + 1 + worst), (first + 1 + worst, last)]
    return _Line(line.xy[keep], line.sigma[keep], line.measured[keep])


def _table(levels: list[int], lines: list[_Line], interval: float, every: int) -> ContourLines:
    count = np.array([len(line.xy) for line in lines], np.int64)
    xy = np.concatenate([line.xy for line in lines]) if lines else np.zeros((0, 2))
    level = np.repeat(np.array(levels, np.int64), count)
    measured = np.repeat(np.array([line.measured[0] for line in lines], bool), count)
    sigma = np.repeat(np.array([round(float(np.sqrt((line.sigma**2).mean())), 3) for line in lines], np.float64), count)
    height = np.round(level * interval, 6)
    index = level % every == 0
    layers = np.array([LAYERS[bool(i), bool(d)] for i, d in zip(index, ~measured, strict=True)], dtype=str)
    return ContourLines(
        line=np.repeat(np.arange(len(lines)), count),
        x=xy[:, 0],
        y=xy[:, 1],
        z=height,
        layer=layers,
        dashed=~measured,
        text=np.array([f"{h:g}" if i else "" for h, i in zip(height, index, strict=True)], dtype=str),
        height=height,
        index=index,
        measured=measured,
        sigma=sigma,
    )
