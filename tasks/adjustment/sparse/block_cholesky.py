"""Cholesky factors of block matrices, front by front, and the inverse where the matrix has blocks.

Each front is a small dense matrix: what the matrix says of its own unknowns, and what the fronts below left over. Its own unknowns
are eliminated, the rest goes to the front above. The inverse comes back the same way: a front takes the inverse of its boundary
from the front above, where all of it is known, and finds that of its own unknowns. The whole inverse is never formed.

Source: Duff and Reid 1983 for fronts; Takahashi, Fagan and Chen 1973, Erisman and Tinney 1975 for the inverse on the pattern of
the factor.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit

from orthomill.tasks.adjustment.sparse.block_matrix import BlockMatrix, Pattern
from orthomill.tasks.adjustment.sparse.dissection import dissected
from orthomill.tasks.adjustment.sparse.front_kernels import backward, eliminate, forward, take_product


@dataclass(frozen=True, eq=False)
class Step:
    """A front by its unknowns: `columns` (s + b,), its `own` (s,) before those of the boundary; the `groups` of both with their
    places `at` in the front, the `blocks` of the matrix that belong to it, the `parent` and the `place` (b,) of the boundary in the
    parent's front."""

    columns: np.ndarray
    own: np.ndarray
    groups: np.ndarray
    at: np.ndarray
    blocks: np.ndarray
    parent: int
    place: np.ndarray


@dataclass(frozen=True, eq=False)
class Structure:
    """A pattern and the order in which it is eliminated. The pattern and the last front's unknowns are all that others need."""

    pattern: Pattern
    steps: tuple[Step, ...]

    @property
    def last(self) -> np.ndarray:
        """The unknowns of the last front."""
        return self.steps[-1].own


def structure_of(pattern: Pattern, photos: int, last: np.ndarray) -> Structure:
    """How a matrix of this pattern is eliminated; see `dissected`."""
    fronts = dissected(pattern, photos, last)
    front_of = np.empty(len(pattern.start) - 1, np.int64)
    for number, front in enumerate(fronts):
        front_of[front.own] = number
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
    size = np.diff(pattern.start)[groups]
    before = np.repeat(pattern.start[groups] - np.concatenate([[0], np.cumsum(size)])[:-1], size)
    return before + np.arange(len(before))


def _positions(columns: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    order = np.argsort(columns)
    return order[np.searchsorted(columns[order], wanted)]


@dataclass(frozen=True, eq=False)
class BlockCholesky:
    """Factors U'U of a positive matrix: the rows (s, s + b) of U of every front, by its own and its boundary's unknowns."""

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
        rows, known = found.pattern.rows, {}
        waiting = np.bincount([step.parent for step in steps if step.parent >= 0], minlength=len(steps))
        for number in reversed(range(len(steps))):
            step = steps[number]
            above = np.zeros((0, 0))
            if step.parent >= 0:
                above = known[step.parent][np.ix_(step.place, step.place)]
                waiting[step.parent] -= 1
                if not waiting[step.parent]:
                    del known[step.parent]
            Z = _inverted(self.upper[number], above)
            _take(*found.pattern.arrays, found.values, step.blocks, rows, step.groups, step.at, Z)
            if waiting[number]:
                known[number] = Z
        return found


def factorised(structure: Structure, matrix: BlockMatrix, stiffness: np.ndarray | None = None) -> BlockCholesky:
    """The factors of a matrix; `stiffness` (s, s) is added at the unknowns of the last front.

    Raises LinAlgError where the matrix is not finite and positive.
    """
    if not np.isfinite(matrix.values).all():
        raise np.linalg.LinAlgError("the matrix is not finite")
    rows, left = matrix.pattern.rows, {}
    upper = []
    for number, step in enumerate(structure.steps):
        F = np.zeros((len(step.columns),) * 2)
        _put(*matrix.pattern.arrays, matrix.values, step.blocks, rows, step.groups, step.at, F)
        for place, rest in left.pop(number, ()):
            _join(F, place, rest)
        if stiffness is not None and step.parent < 0:
            F += stiffness
        s = len(step.own)
        if not eliminate(F, s):
            raise np.linalg.LinAlgError("the matrix is not positive")
        upper.append(F[:s].copy())
        if step.parent >= 0:
            left.setdefault(step.parent, []).append((step.place, F[s:, s:].copy()))
    return BlockCholesky(structure, tuple(upper))


def _inverted(U: np.ndarray, above: np.ndarray) -> np.ndarray:
    """The inverse (s + b, s + b) at the unknowns of a front, from its rows of U and the inverse (b, b) at its boundary.

    With G = U_ss^-1 U_sb it is -G Z_bb beside the boundary, and U_ss^-1 U_ss'^-1 + G Z_bb G' for the own unknowns.
    """
    s, m = U.shape
    corner, G, own = U[:, :s].copy(), U[:, s:].copy(), np.eye(s)
    backward(corner, own)
    backward(corner, G)
    Z = np.empty((m, m))
    beside, inner = np.zeros((s, m - s)), np.zeros((s, s))
    take_product(beside, G, above)
    take_product(inner, own, own.T.copy())
    take_product(inner, beside, np.ascontiguousarray(-G.T))
    Z[s:, s:], Z[:s, s:], Z[s:, :s], Z[:s, :s] = above, beside, beside.T, -inner
    return Z


@njit(cache=True)
def _join(F, place, rest):
    """Adds what a front below leaves over, upper half, to its places in F."""
    for a in range(len(place)):
        for b in range(a, len(place)):
            F[min(place[a], place[b]), max(place[a], place[b])] += rest[a, b]


@njit(cache=True)
def _put(start, first, partner, offset, owner, values, blocks, rows, groups, at, F):
    """Writes the blocks of a front to their places in its upper half."""
    place = np.full(len(first) - 1, -1)
    for k in range(len(groups)):
        place[groups[k]] = at[k]
    for s in blocks:
        g, h = rows[s], partner[s]
        width = start[h + 1] - start[h]
        for i in range(start[g + 1] - start[g]):
            for j in range(width):
                a, b = place[g] + i, place[h] + j
                if g != h or i <= j:
                    F[min(a, b), max(a, b)] = values[offset[s] + i * width + j]


@njit(cache=True)
def _take(start, first, partner, offset, owner, values, blocks, rows, groups, at, Z):
    """Reads the blocks of a front from their places in it."""
    place = np.full(len(first) - 1, -1)
    for k in range(len(groups)):
        place[groups[k]] = at[k]
    for s in blocks:
        g, h = rows[s], partner[s]
        width = start[h + 1] - start[h]
        for i in range(start[g + 1] - start[g]):
            for j in range(width):
                values[offset[s] + i * width + j] = Z[place[g] + i, place[h] + j]
