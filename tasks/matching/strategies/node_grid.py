"""What the matching strategies share: parts of photographs, a regular grid of nodes, and predictions from solved nodes.

All coordinates are pixels of the whole photograph, and nodes lie on integer pixels that are multiples of the step, so that a part
with its halo has the nodes, the starts and the windows of the whole.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from orthomill.kernels.kernel_compilation import njit
from orthomill.schemas.outcome import Outcome
from orthomill.tasks.matching.least_squares.least_squares_settings import LeastSquaresMatching
from orthomill.tasks.matching.least_squares.matching import Matches, PreparedImage, chosen_windows, match_points, prepare
from orthomill.tasks.matching.strategies.match_tables import moved, rejected


@dataclass(frozen=True, eq=False)
class ImagePart:
    """Grey pixels (H, W) of any dtype, 0 or NaN is no data, and where their upper-left one lies in the photograph."""

    pixels: np.ndarray
    col: int = 0
    row: int = 0

    @property
    def origin(self) -> np.ndarray:
        """(2,) (col, row) in the photograph"""
        return np.array([self.col, self.row], dtype=np.float64)


@dataclass(frozen=True)
class NodeGrid:
    """Nodes at the left pixels step * (row + i), step * (col + j), i < rows, j < cols."""

    row: int
    col: int
    rows: int
    cols: int
    step: int

    @classmethod
    def within(cls, part: ImagePart, step: int, margin: int = 0) -> "NodeGrid":
        """The nodes at least `margin` px inside a part."""
        (row, rows), (col, cols) = (
            (-(-(first + margin) // step), (first + size - 1 - margin) // step - -(-(first + margin) // step) + 1)
            for first, size in zip((part.row, part.col), part.pixels.shape, strict=True)
        )
        # A part smaller than its margins has no node.
        return cls(row, col, max(rows, 0), max(cols, 0), step)

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, columns) of nodes."""
        return self.rows, self.cols

    def grown(self, nodes: int) -> "NodeGrid":
        """The grid with so many nodes more on every side."""
        return NodeGrid(self.row - nodes, self.col - nodes, self.rows + 2 * nodes, self.cols + 2 * nodes, self.step)

    def points(self) -> np.ndarray:
        """(rows * cols, 2) float64 (col, row), row by row, px"""
        cols, rows = np.meshgrid(self.col + np.arange(self.cols), self.row + np.arange(self.rows))
        return np.column_stack([cols.ravel(), rows.ravel()]) * float(self.step)


@dataclass(frozen=True, eq=False)
class PreparedPair:
    """Two parts prepared for one recipe, to be reused by many calls."""

    left: PreparedImage
    right: PreparedImage
    left_origin: np.ndarray
    right_origin: np.ndarray
    settings: LeastSquaresMatching

    @classmethod
    def of(cls, left: ImagePart, right: ImagePart, settings: LeastSquaresMatching) -> "PreparedPair":
        """Both parts smoothed as the settings say."""
        return cls(prepare(left.pixels, settings), prepare(right.pixels, settings), left.origin, right.origin, settings)

    def match(
        self, points: np.ndarray, starts: np.ndarray, affine: np.ndarray | None = None, half: int | np.ndarray | None = None
    ) -> Matches:
        """`match_points` with all positions in pixels of the photographs; points without a start (NaN) are NOT_TRIED.

        half: half side of the windows, of all or of every one (N,), 0 where there is none; None for that of the settings.
        """
        # A half size of 0 is how `match_points` is told not to try a point.
        if half is None:
            half = chosen_windows(self.left.grey, points - self.left_origin, self.settings).half
        halves = np.where(np.isfinite(starts).all(axis=1), half, 0)
        found = match_points(
            self.left, self.right, points - self.left_origin, starts - self.right_origin, self.settings, affine, halves
        )
        return moved(found, self.left_origin, self.right_origin)


class GridMatches(NamedTuple):
    """Matched nodes as kernels read them."""

    solved: np.ndarray
    """(rows, cols) bool"""
    right: np.ndarray
    """(rows, cols, 2) float64 (col, row), px"""
    affine: np.ndarray
    """(rows, cols, 4)"""

    @classmethod
    def of(cls, grid: NodeGrid, solved: np.ndarray, right: np.ndarray, affine: np.ndarray) -> "GridMatches":
        """Tables (rows * cols, ...) of a grid, without a copy."""
        return cls(solved.reshape(grid.shape), right.reshape(*grid.shape, 2), affine.reshape(*grid.shape, 4))


def agreeing(found: Matches, grid: NodeGrid, min_neighbours: int, tolerance: float) -> Matches:
    """Reject the nodes whose position fewer than `min_neighbours` of their neighbours predict within `tolerance` px."""
    nodes = GridMatches.of(grid, found.converged, found.position, found.affine)
    count = agreement(nodes, float(grid.step), tolerance).ravel()
    return rejected(found, found.converged & (count < min_neighbours), Outcome.INCONSISTENT)


@njit()
def agreement(nodes, step, tolerance):
    """How many of the eight neighbours of a node predict its position within `tolerance` px: (rows, cols) uint8.

    nodes: `GridMatches`; step: distance of the nodes, px.
    """
    solved, right, affine = nodes
    rows, cols = solved.shape
    count = np.zeros((rows, cols), np.uint8)
    for r in range(rows):
        for c in range(cols):
            if not solved[r, c]:
                continue
            for y in range(max(r - 1, 0), min(r + 2, rows)):
                for x in range(max(c - 1, 0), min(c + 2, cols)):
                    if (y == r and x == c) or not solved[y, x]:
                        continue
                    dx, dy = (c - x) * step, (r - y) * step
                    a = affine[y, x]
                    # A neighbour predicts by its affine: slopes of the ground are no disagreement.
                    off_x = right[y, x, 0] + (a[0] * dx + a[1] * dy) - right[r, c, 0]
                    off_y = right[y, x, 1] + (a[2] * dx + a[3] * dy) - right[r, c, 1]
                    if abs(off_x) <= tolerance and abs(off_y) <= tolerance:
                        count[r, c] += 1
    return count


@njit()
def from_neighbours(nodes, step, wanted):
    """Give wanted nodes that have solved neighbours the mean of their predictions; returns which got one, (rows, cols) bool.

    nodes, wanted: `GridMatches`; `wanted.solved` marks the wanted ones, whose position and affine are overwritten.
    """
    solved, right, affine = nodes
    rows, cols = solved.shape
    given = np.zeros((rows, cols), np.bool_)
    for r in range(rows):
        for c in range(cols):
            if not wanted.solved[r, c]:
                continue
            # Sums in a fixed order of neighbours: a part of the grid gives bit for bit what the whole gives.
            n, px, py, a0, a1, a2, a3 = 0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
            for y in range(max(r - 1, 0), min(r + 2, rows)):
                for x in range(max(c - 1, 0), min(c + 2, cols)):
                    if (y == r and x == c) or not solved[y, x]:
                        continue
                    dx, dy = (c - x) * step, (r - y) * step
                    a = affine[y, x]
                    px += right[y, x, 0] + (a[0] * dx + a[1] * dy)
                    py += right[y, x, 1] + (a[2] * dx + a[3] * dy)
                    a0, a1, a2, a3 = a0 + a[0], a1 + a[1], a2 + a[2], a3 + a[3]
                    n += 1
            if n > 0:
                given[r, c] = True
                wanted.right[r, c, 0], wanted.right[r, c, 1] = px / n, py / n
                wanted.affine[r, c, 0], wanted.affine[r, c, 1] = a0 / n, a1 / n
                wanted.affine[r, c, 2], wanted.affine[r, c, 3] = a2 / n, a3 / n
    return given
