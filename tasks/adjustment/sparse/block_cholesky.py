"""Cholesky factors of block matrices, front by front, and the inverse in the blocks of the matrix.

Each front is a small dense matrix: the blocks of its own unknowns, and the contributions of the fronts below. Its own unknowns are
eliminated, the rest is passed to the front above. The inverse returns the same way: a front takes the inverse at its boundary from
the front above, where all of it is known, and computes that of its own unknowns. The whole inverse is never formed.

Source: Duff and Reid 1983 for fronts; Takahashi, Fagan and Chen 1973, Erisman and Tinney 1975 for the inverse on the pattern of
the factor.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from orthomill.kernels.kernel_compilation import njit
from orthomill.tasks.adjustment.sparse.block_matrix import BlockMatrix, Pattern
from orthomill.tasks.adjustment.sparse.dissection import dissected
from orthomill.tasks.adjustment.sparse.front_kernels import backward, eliminate, forward, take_product


class Step(NamedTuple):
    """A front by its unknowns, as kernels take it: `columns` (s + b,), its `own` (s,) before those of the boundary; the `groups`
    of both and their positions `at` in the front; the `blocks` of the matrix that enter it; its `parent` (-1: none) and the
    `place` (b,) of the boundary in the parent's front."""

    columns: np.ndarray
    own: np.ndarray
    groups: np.ndarray
    at: np.ndarray
    blocks: np.ndarray
    parent: int
    place: np.ndarray


@dataclass(frozen=True, eq=False)
class Structure:
    """A pattern and its order of elimination."""

    pattern: Pattern
    steps: tuple[Step, ...]

    @property
    def last(self) -> np.ndarray:
        """The unknowns of the last front."""
        return self.steps[-1].own


def structure_of(pattern: Pattern, photos: int, last: np.ndarray) -> Structure:
    """The order of elimination of a pattern whose first `photos` groups are photographs; `last` as in `dissected`."""
    fronts = dissected(pattern, photos, last)
    front_of = np.empty(len(pattern.start) - 1, np.int64)
    for number, front in enumerate(fronts):
        front_of[front.own] = number
    # A block enters where the first of its two groups is eliminated: from there on it is part of the contributions passed up.
    of_block = np.minimum(front_of[pattern.rows], front_of[pattern.partner])
    order = np.argsort(of_block, kind="stable")
    blocks = np.split(order, np.searchsorted(of_block[order], np.arange(1, len(fronts))))
    columns = [_columns(pattern, np.concatenate([front.own, front.boundary])) for front in fronts]
    steps = []
    for number, front in enumerate(fronts):
        size = int(np.diff(pattern.start)[front.own].sum())
        boundary = columns[number][size:]
        place = _positions(columns[front.parent], boundary) if front.parent >= 0 else boundary
        groups = np.concatenate([front.own, front.boundary])
        at = np.concatenate([[0], np.cumsum(np.diff(pattern.start)[groups])])[:-1]
        own = columns[number][:size]
        steps.append(Step(columns[number], own, groups, at.astype(np.int64), blocks[number], front.parent, place))
    return Structure(pattern, tuple(steps))


def _columns(pattern: Pattern, groups: np.ndarray) -> np.ndarray:
    """The unknowns of `groups`, group after group."""
    size = np.diff(pattern.start)[groups]
    before = np.repeat(pattern.start[groups] - np.concatenate([[0], np.cumsum(size)])[:-1], size)
    return before + np.arange(len(before))


def _positions(columns: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """The positions of the unknowns `wanted` in `columns`."""
    order = np.argsort(columns)
    return order[np.searchsorted(columns[order], wanted)]


@dataclass(frozen=True, eq=False)
class BlockCholesky:
    """Factors U'U of a positive definite matrix: of every front the rows (s, s + b) of U, columns in the order of the front."""

    structure: Structure
    upper: tuple[np.ndarray, ...]

    def solve(self, right: np.ndarray) -> np.ndarray:
        """A^-1 right (n, k)."""
        out, steps = np.array(right, float), self.structure.steps
        for step, U in zip(steps, self.upper, strict=True):
            X = out[step.columns]
            forward(U, X)
            out[step.columns] = X
        for step, U in zip(reversed(steps), reversed(self.upper), strict=True):
            X = out[step.columns]
            backward(U, X)
            out[step.own] = X[: len(U)]
        return out

    def selected_inverse(self) -> BlockMatrix:
        """A^-1 in the blocks of the pattern."""
        found, steps = BlockMatrix.zero(self.structure.pattern), self.structure.steps
        rows, known = found.pattern.rows, dict[int, np.ndarray]()
        # An inverse is dropped once the last front below has read it: all of them together would be as large as the factor.
        waiting = np.bincount([step.parent for step in steps if step.parent >= 0], minlength=len(steps))
        for number in reversed(range(len(steps))):
            step = steps[number]
            above = np.zeros((0, 0))
            if step.parent >= 0:
                # The boundary of a front is part of its parent, so that this part of the inverse is known.
                above = known[step.parent][np.ix_(step.place, step.place)]
                waiting[step.parent] -= 1
                if not waiting[step.parent]:
                    del known[step.parent]
            Z = _inverted(self.upper[number], above)
            _take(found.pattern, rows, step, Z, found.values)
            if waiting[number]:
                known[number] = Z
        return found


def factorised(structure: Structure, matrix: BlockMatrix, stiffness: np.ndarray | None = None) -> BlockCholesky:
    """The factors of a matrix; `stiffness` (s, s) is added at the unknowns of the last front.

    Raises LinAlgError where the matrix is not finite and positive definite.
    """
    # A NaN would pass through every front and come out as a wrong answer somewhere else.
    if not np.isfinite(matrix.values).all():
        raise np.linalg.LinAlgError("the matrix is not finite")
    rows, left = matrix.pattern.rows, dict[int, list[tuple[np.ndarray, np.ndarray]]]()
    upper = []
    for number, step in enumerate(structure.steps):
        F = np.zeros((len(step.columns),) * 2)
        _put(matrix.pattern, rows, step, matrix.values, F)
        for place, rest in left.pop(number, ()):
            _join(F, place, rest)
        if stiffness is not None and step.parent < 0:
            F += stiffness
        s = len(step.own)
        if not eliminate(F, s):
            raise np.linalg.LinAlgError("the matrix is not positive definite")
        # A copy: a view would keep the whole front in memory.
        upper.append(F[:s].copy())
        if step.parent >= 0:
            left.setdefault(step.parent, []).append((step.place, F[s:, s:].copy()))
    return BlockCholesky(structure, tuple(upper))


def _inverted(U: np.ndarray, above: np.ndarray) -> np.ndarray:
    """The inverse (s + b, s + b) at the unknowns of a front, from its rows of U and the inverse (b, b) at its boundary.

    With G = U_ss^-1 U_sb it is -G Z_bb between the own unknowns and the boundary, and U_ss^-1 U_ss'^-1 + G Z_bb G' for the own
    unknowns (Takahashi's equations).
    """
    s, m = U.shape
    corner, G, own = U[:, :s].copy(), U[:, s:].copy(), np.eye(s)
    backward(corner, own)
    backward(corner, G)
    Z = np.empty((m, m))
    across, inner = np.zeros((s, m - s)), np.zeros((s, s))
    take_product(across, G, above)
    take_product(inner, own, own.T.copy())
    take_product(inner, across, np.ascontiguousarray(-G.T))
    Z[s:, s:], Z[:s, s:], Z[s:, :s], Z[:s, :s] = above, across, across.T, -inner
    return Z


@njit()
def _join(F, place, rest):
    """Adds the contribution `rest` of a front below, upper half, at its places in F."""
    for a in range(len(place)):
        for b in range(a, len(place)):
            # The order of unknowns in the parent differs: what was above the diagonal may come below it.
            F[min(place[a], place[b]), max(place[a], place[b])] += rest[a, b]


@njit()
def _places(pattern, step):
    """Where the groups of a front begin in it; -1 for all others."""
    place = np.full(len(pattern.first) - 1, -1)
    for k in range(len(step.groups)):
        place[step.groups[k]] = step.at[k]
    return place


@njit()
def _put(pattern, rows, step, values, F):
    """Writes the blocks of a front to their places in its upper half."""
    place = _places(pattern, step)
    for s in step.blocks:
        g, h = rows[s], pattern.partner[s]
        width = pattern.start[h + 1] - pattern.start[h]
        for i in range(pattern.start[g + 1] - pattern.start[g]):
            for j in range(width):
                a, b = place[g] + i, place[h] + j
                if g != h or i <= j:
                    # The groups of a front are not in ascending order: a block of the upper half may belong below the diagonal.
                    F[min(a, b), max(a, b)] = values[pattern.offset[s] + i * width + j]


@njit()
def _take(pattern, rows, step, Z, values):
    """Reads the blocks of a front from their places in it."""
    place = _places(pattern, step)
    for s in step.blocks:
        g, h = rows[s], pattern.partner[s]
        width = pattern.start[h + 1] - pattern.start[h]
        for i in range(pattern.start[g + 1] - pattern.start[g]):
            for j in range(width):
                values[pattern.offset[s] + i * width + j] = Z[place[g] + i, place[h] + j]
