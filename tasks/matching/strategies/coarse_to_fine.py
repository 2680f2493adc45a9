"""Coarse-to-fine matching of a grid of nodes: no seeds, no orientation, no epipolar images; the affine is passed on as well.

Strategy
- Both parts are halved by means of 2 x 2 pixels on an absolute grid. On the coarsest level every node is tried from a small lattice
  of starts that covers the search range, and the solution with the highest correlation is kept.
- From level to level a node starts where the four surrounding nodes of the coarser level predict it: their positions transferred by
  their affines, weighted as in bilinear interpolation. Starts are then good to a fraction of a pixel, and one or two iterations
  suffice.
- On each level a node must be predicted by some of its neighbours. Nodes that fail get a second attempt from the prediction of
  their solved neighbours, poorly determined ones from their own solution, both with a wide window: it bridges ground of little
  texture. A node that stays unsolved passes on its own start, so that texture visible on finer levels only is not lost.
- Every step depends on a fixed number of nodes to either side: a part with its `halo` gives what the whole photograph gives.

For surfaces that are mostly smooth, and for photographs whose orientation is not known. Roofs and walls are matched by `dense`,
whose windows keep to one surface; growing from seeds (region_growing.py) is for ground of which only parts can be matched.

Source: Skarlatos (sources/matching.md#pyramids); sources/measured.md#dense.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from orthomill.kernels.kernel_compilation import njit
from orthomill.schemas.outcome import Outcome
from orthomill.tasks.matching.gaussian_reach import reach_of
from orthomill.tasks.matching.least_squares.matching import Matches
from orthomill.tasks.matching.smoothing import with_gaps
from orthomill.tasks.matching.strategies.match_tables import merged, taken
from orthomill.tasks.matching.strategies.node_grid import GridMatches, ImagePart, NodeGrid, PreparedPair, agreeing, from_neighbours
from orthomill.tasks.matching.strategies.pyramid_settings import PyramidMatching

_UNSOLVED = 1e-3
"""Weight of a node that only passes on its start, relative to solved ones."""
_RING = 3
"""Nodes to either side that one level depends on: agreement, second attempt, agreement again."""


@dataclass(frozen=True)
class SearchRange:
    """Right column - left column and right row - left row that can occur, px of the photographs."""

    col_low: float
    col_high: float
    row_low: float = 0.0
    row_high: float = 0.0

    def starts(self, points: np.ndarray, spacing: float) -> Iterator[np.ndarray]:
        """Offsets, px of the photographs, of left points (N, 2) to their starts, at most `spacing` px apart, that cover the range:
        (2,) for all points, or (N, 2), NaN where one has no more."""
        yield from self.offsets(spacing)

    def offsets(self, spacing: float) -> np.ndarray:
        """(K, 2) offsets at most `spacing` px apart that cover the range."""
        cols, rows = (
            low + (high - low) * (np.arange(n) + 0.5) / n
            for low, high in ((self.col_low, self.col_high), (self.row_low, self.row_high))
            for n in [max(1, int(np.ceil((high - low) / spacing)))]
        )
        return np.column_stack([part.ravel() for part in np.meshgrid(cols, rows)])


@dataclass(frozen=True, eq=False)
class Field:
    """Where the nodes of a level (rows * cols, row by row) lie in the right image, px of the level: solved, or passed on."""

    grid: NodeGrid
    right: np.ndarray
    """(N, 2), NaN where unknown"""
    affine: np.ndarray
    """(N, 4)"""
    solved: np.ndarray
    """(N,) bool"""

    def predicted(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Right positions (M, 2) and affines (M, 4) of points (M, 2) of the same level; NaN where unknown."""
        right, affine = np.empty((len(points), 2)), np.empty((len(points), 4))
        first = np.array([self.grid.col, self.grid.row], dtype=np.float64)
        nodes = GridMatches.of(self.grid, self.solved, self.right, self.affine)
        _predict(nodes, points / self.grid.step - first, float(self.grid.step), right, affine)
        return right, affine

    def below(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The same for points of the next finer level, in pixels of that level."""
        right, affine = self.predicted((points - 0.5) / 2.0)
        # Pixel p of a level lies at 2 p + 0.5 of the one below; an affine has no unit and stays as it is.
        return 2.0 * right + 0.5, affine


def halo(settings: PyramidMatching, step: int) -> int:
    """Pixels around its nodes that a part of the left photograph needs to give what the whole gives."""
    # Halos add up: every level needs its ring of nodes, and one more for the nodes that predict the finer level.
    reach = _RING * step
    for level in range(1, settings.levels + 1):
        reach += (_RING + 1) * settings.coarse_step * 2**level
    # 2 px: cubic interpolation and the gradient of the outermost pixel.
    widest = max(settings.wide_window // 2, settings.coarse.reach, settings.fine.reach)
    window = widest + 2 + reach_of(max(settings.coarse.smoothing, settings.fine.smoothing))
    return reach + window * 2**settings.levels


def match_pyramid(left: ImagePart, right: ImagePart, grid: NodeGrid, search: SearchRange, settings: PyramidMatching) -> Matches:
    """Match the nodes of a grid: one row per node, row by row; positions in pixels of the photographs.

    left: the nodes and `halo` px around them, as far as the photograph extends; right: all that can be homologous to it. Raises
    ValueError when the parts do not begin at multiples of 2**levels. Nodes without any start are NOT_TRIED.
    """
    _check_origins(left, right, settings)
    level = _matched_level(left, right, grid, search, settings, 0)
    return taken(level.matches, level.core)


def coarse_field(left: ImagePart, right: ImagePart, points: np.ndarray, search: SearchRange, settings: PyramidMatching) -> Field:
    """The field of the first coarser level under points (N, 2) of the photographs, to be used with `below`; as `match_pyramid`."""
    _check_origins(left, right, settings)
    return _field(halved_part(left), halved_part(right), _covering(points, settings), search, settings, 1)


@dataclass(frozen=True, eq=False)
class _Level:
    """One matched level, on a grid `_RING` wider than wanted. core: (N,) bool, the wanted nodes."""

    grid: NodeGrid
    starts: np.ndarray
    start_affine: np.ndarray
    matches: Matches
    core: np.ndarray


def _matched_level(
    left: ImagePart, right: ImagePart, grid: NodeGrid, search: SearchRange, settings: PyramidMatching, level: int
) -> _Level:
    pair = PreparedPair.of(left, right, settings.coarse if level else settings.fine)
    wide = grid.grown(_RING)
    points = wide.points()
    if level == settings.levels:
        scale = float(2**level)
        found = search.starts((points + 0.5) * scale - 0.5, settings.start_spacing * scale)
        starts, affine = _best_starts(pair, points, (offset / scale for offset in found))
    else:
        coarser = _field(halved_part(left), halved_part(right), _covering(points, settings), search, settings, level + 1)
        starts, affine = coarser.below(points)
    # The ring is matched only to test and to predict; its own nodes lack neighbours and are dropped.
    core = np.zeros(wide.shape, bool)
    core[_RING : wide.rows - _RING, _RING : wide.cols - _RING] = True
    return _Level(wide, starts, affine, _solved(pair, wide, starts, affine, settings), core.ravel())


def _field(left: ImagePart, right: ImagePart, grid: NodeGrid, search: SearchRange, settings: PyramidMatching, level: int) -> Field:
    """A level as passed on to the next finer one: unsolved nodes take the prediction of their neighbours, or their own start."""
    found = _matched_level(left, right, grid, search, settings, level)
    solved = found.matches.converged
    right_of = np.where(solved[:, None], found.matches.position, found.starts)
    affine = np.where(solved[:, None], found.matches.affine, found.start_affine)
    nodes = GridMatches.of(found.grid, solved, found.matches.position, found.matches.affine)
    from_neighbours(nodes, float(found.grid.step), GridMatches.of(found.grid, ~solved, right_of, affine))
    return Field(grid, right_of[found.core], affine[found.core], solved[found.core])


def _solved(pair: PreparedPair, grid: NodeGrid, starts: np.ndarray, affine: np.ndarray, settings: PyramidMatching) -> Matches:
    """Match nodes, reject those that their neighbours contradict, and try failed and poorly determined ones a second time."""
    points = grid.points()
    rule = settings.min_neighbours, settings.neighbour_tolerance
    first = agreeing(pair.match(points, starts, affine), grid, *rule)
    weak = first.converged & ~(first.sigma <= settings.weak_sigma)
    starts[weak], affine[weak] = first.position[weak], first.affine[weak]
    # A window that leaves the image would leave it again with the wide window.
    failed = ~first.converged & (first.outcome != Outcome.OUTSIDE)
    nodes = GridMatches.of(grid, first.converged, first.position, first.affine)
    from_neighbours(nodes, float(grid.step), GridMatches.of(grid, failed, starts, affine))
    again = weak | failed
    second = pair.match(points[again], starts[again], affine[again], settings.wide_window // 2)
    # A poorly determined node keeps its first solution where the second attempt fails.
    better = second.converged | failed[again]
    again[again] = better
    return agreeing(merged(first, taken(second, better), again), grid, *rule)


def _best_starts(pair: PreparedPair, points: np.ndarray, offsets: Iterator[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Of the starts about every point (`SearchRange.starts`) the solution of highest correlation: positions (N, 2),
    affines (N, 4), or NaN."""
    best, best_affine = np.full((len(points), 2), np.nan), np.tile([1.0, 0.0, 0.0, 1.0], (len(points), 1))
    # The correlation decides, not sigma: a wrong place with strong texture can have a small standard error.
    likeness = np.full(len(points), -np.inf)
    for offset in offsets:
        found = pair.match(points, points + offset)
        better = found.converged & (found.correlation > likeness)
        best[better], best_affine[better] = found.position[better], found.affine[better]
        likeness[better] = found.correlation[better]
    return best, best_affine


def halved_part(part: ImagePart) -> ImagePart:
    """The next level: means of 2 x 2 pixels, NaN where any of them has no data. An odd last row or column is dropped."""
    grey = with_gaps(part.pixels)
    even = grey[: grey.shape[0] // 2 * 2, : grey.shape[1] // 2 * 2]
    # NaN of one pixel makes its mean NaN: coarse levels must not invent grey values at the edge of the data.
    means = (even[::2, ::2] + even[::2, 1::2] + (even[1::2, ::2] + even[1::2, 1::2])) * np.float32(0.25)
    return ImagePart(np.ascontiguousarray(means), part.col // 2, part.row // 2)


def _covering(points: np.ndarray, settings: PyramidMatching) -> NodeGrid:
    """The nodes of the next coarser level around all points of a level."""
    step = settings.coarse_step
    # Floor and one more node: every point lies between nodes, as bilinear weights need it.
    first = np.floor((points.min(axis=0) - 0.5) / 2.0 / step).astype(int)
    last = np.floor((points.max(axis=0) - 0.5) / 2.0 / step).astype(int) + 1
    return NodeGrid(first[1], first[0], last[1] - first[1] + 1, last[0] - first[0] + 1, step)


def _check_origins(left: ImagePart, right: ImagePart, settings: PyramidMatching) -> None:
    unit = 2**settings.levels
    for part in (left, right):
        if part.col % unit or part.row % unit:
            raise ValueError(
                f"a part begins at column {part.col}, row {part.row}; with {settings.levels} coarser levels both must "
                f"be multiples of {unit}"
            )


@njit()
def _predict(nodes, places, step, out, out_affine):
    """Weighted mean of what the four nodes around each place (M, 2), in units of the grid, predict. nodes: `GridMatches`."""
    solved, right, affine = nodes
    rows, cols = solved.shape
    for i in range(places.shape[0]):
        first_col, first_row = int(np.floor(places[i, 0])), int(np.floor(places[i, 1]))
        total = 0.0
        out[i, :] = 0.0
        out_affine[i, :] = 0.0
        for r in range(max(first_row, 0), min(first_row + 2, rows)):
            for c in range(max(first_col, 0), min(first_col + 2, cols)):
                if np.isnan(right[r, c, 0]):
                    continue
                dx, dy = places[i, 0] - c, places[i, 1] - r
                # The small weight of unsolved nodes acts only where no solved node predicts the place.
                weight = (1.0 - abs(dx)) * (1.0 - abs(dy)) * (1.0 if solved[r, c] else _UNSOLVED)
                a = affine[r, c]
                out[i, 0] += weight * (right[r, c, 0] + step * (a[0] * dx + a[1] * dy))
                out[i, 1] += weight * (right[r, c, 1] + step * (a[2] * dx + a[3] * dy))
                for k in range(4):
                    out_affine[i, k] += weight * a[k]
                total += weight
        for k in range(4):
            out_affine[i, k] = out_affine[i, k] / total if total > 0.0 else (1.0 if k % 3 == 0 else 0.0)
        for k in range(2):
            out[i, k] = out[i, k] / total if total > 0.0 else np.nan
