"""Symmetric matrices that store only the blocks which are not zero by structure.

Unknowns that always occur together (the six of a photograph, the interior orientation of a camera, a kept point) are a group; two
groups have a block where an observation, or a point that is eliminated, depends on both. The blocks of the upper half are stored,
row by row; those on the diagonal are whole.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array, eye_array, triu

from orthomill.kernels.kernel_compilation import njit


class Pattern(NamedTuple):
    """The blocks of a matrix, as kernels take it: group g has the unknowns start[g] to start[g + 1] and the blocks first[g] to
    first[g + 1], shared with the groups `partner` (ascending, from g itself); the values of block s begin at offset[s]. `owner`
    (n,) is the group of every unknown."""

    start: np.ndarray
    first: np.ndarray
    partner: np.ndarray
    offset: np.ndarray
    owner: np.ndarray

    @property
    def rows(self) -> np.ndarray:
        """(S,) the group of the rows of every block."""
        return np.repeat(np.arange(len(self.first) - 1), np.diff(self.first))


def pattern_of(start: np.ndarray, cliques: csr_array) -> Pattern:
    """The pattern in which all groups of a clique have blocks with each other; `cliques` (any number, groups), nonzero where a
    group belongs to it."""
    # The identity gives every group its diagonal block, also a photograph that no observation reaches: priors and damping need it.
    shared = triu(cliques.T @ cliques + eye_array(len(start) - 1, dtype=cliques.dtype), format="csr")
    shared.sort_indices()
    size = np.diff(start)
    first, partner = shared.indptr.astype(np.int64), shared.indices.astype(np.int64)
    # The numbers of a block: rows of its first group times columns of its second.
    cells = np.repeat(size, np.diff(first)) * size[partner]
    offset = np.concatenate([[0], np.cumsum(cells)]).astype(np.int64)
    return Pattern(start.astype(np.int64), first, partner, offset, np.repeat(np.arange(len(size)), size))


@dataclass(frozen=True, eq=False)
class BlockMatrix:
    """A symmetric matrix with the `values` of the blocks of its pattern."""

    pattern: Pattern
    values: np.ndarray

    @staticmethod
    def zero(pattern: Pattern) -> "BlockMatrix":
        """The matrix whose blocks are all 0."""
        return BlockMatrix(pattern, np.zeros(pattern.offset[-1]))

    @staticmethod
    def of(pattern: Pattern, dense: np.ndarray) -> "BlockMatrix":
        """The blocks of a symmetric matrix (n, n)."""
        out = BlockMatrix.zero(pattern)
        _read(pattern, out.values, dense)
        return out

    def __len__(self) -> int:
        return int(self.pattern.start[-1])

    def add(self, columns: np.ndarray, pieces: np.ndarray) -> None:
        """Adds symmetric `pieces` (T, k, k) at the unknowns `columns` (T, k); -1 omits a row and column.

        Raises ValueError where the pattern has no block for a piece.
        """
        _add(self.pattern, self.values, np.atleast_2d(columns), np.ascontiguousarray(pieces))

    def pieces(self, columns: np.ndarray) -> np.ndarray:
        """(T, k, k) the parts at the unknowns `columns` (T, k); 0 for -1, NaN where there is no block."""
        return _pieces(self.pattern, self.values, np.atleast_2d(columns))

    def add_product(self, left: np.ndarray, right: np.ndarray) -> None:
        """Adds left right' to the blocks of the pattern; `left`, `right` (n, k)."""
        _add_product(self.pattern, self.values, np.ascontiguousarray(left), np.ascontiguousarray(right))

    def scaled(self, scale: np.ndarray) -> "BlockMatrix":
        """Row and column i multiplied by scale[i]."""
        values = self.values.copy()
        _scale(self.pattern, values, scale)
        return BlockMatrix(self.pattern, values)

    def times(self, vectors: np.ndarray) -> np.ndarray:
        """The product (n, k) with `vectors` (n, k)."""
        return _times(self.pattern, self.values, np.ascontiguousarray(vectors))

    def diagonal(self) -> np.ndarray:
        """(n,) the diagonal."""
        return self.values[diagonal_places(self.pattern)]

    def row_sums(self) -> np.ndarray:
        """(n,) sums of the absolute values of every row."""
        return BlockMatrix(self.pattern, np.abs(self.values)).times(np.ones((len(self), 1)))[:, 0]

    def dense(self) -> np.ndarray:
        """(n, n) the whole matrix, for tests and small systems."""
        return self.times(np.eye(len(self)))


def diagonal_places(pattern: Pattern) -> np.ndarray:
    """(n,) the positions of the diagonal in the values."""
    size = np.diff(pattern.start)
    inside = np.arange(pattern.start[-1]) - pattern.start[pattern.owner]
    return pattern.offset[pattern.first[pattern.owner]] + inside * (size[pattern.owner] + 1)


def summed(columns: np.ndarray, parts: np.ndarray, unknowns: int) -> np.ndarray:
    """(n,) the sums of `parts` (any shape) by unknown; `columns` has the same shape, -1 for none."""
    there = columns >= 0
    return np.bincount(columns[there], parts[there], minlength=unknowns)


@njit()
def _block(pattern, g, h):
    """The number of the block of groups g <= h, -1 where there is none."""
    # Partners are in ascending order: bisection, because cameras have a block with every photograph.
    low, high = pattern.first[g], pattern.first[g + 1]
    while low < high:
        middle = (low + high) // 2
        if pattern.partner[middle] < h:
            low = middle + 1
        else:
            high = middle
    return low if low < pattern.first[g + 1] and pattern.partner[low] == h else -1


@njit()
def _position(pattern, s, row, column):
    """Where block s holds the value at the unknowns `row` and `column`."""
    width = pattern.start[pattern.partner[s] + 1] - pattern.start[pattern.partner[s]]
    return pattern.offset[s] + (row - pattern.start[pattern.owner[row]]) * width + column - pattern.start[pattern.partner[s]]


@njit()
def _add(pattern, values, columns, pieces):
    """Add symmetric `pieces` (n, k, k) at the `columns` (n, k), negative ones nowhere, to the `values` of a matrix with this
    pattern."""
    for t in range(len(columns)):
        for a in range(columns.shape[1]):
            ca = columns[t, a]
            if ca < 0:
                continue
            g = pattern.owner[ca]
            for b in range(columns.shape[1]):
                cb = columns[t, b]
                if cb < 0 or pattern.owner[cb] < g:
                    continue
                s = _block(pattern, g, pattern.owner[cb])
                # A silent loss would be a wrong covariance: the pattern has to be that of the observations.
                if s < 0:
                    raise ValueError("the pattern has no block for this piece")
                values[_position(pattern, s, ca, cb)] += pieces[t, a, b]


@njit()
def _pieces(pattern, values, columns):
    """(n, k, k): the matrix at `columns` (n, k); NaN where the pattern has no block."""
    k = columns.shape[1]
    out = np.zeros((len(columns), k, k))
    for t in range(len(columns)):
        for a in range(k):
            ca = columns[t, a]
            for b in range(k):
                cb = columns[t, b]
                if ca < 0 or cb < 0 or pattern.owner[cb] < pattern.owner[ca]:
                    continue
                s = _block(pattern, pattern.owner[ca], pattern.owner[cb])
                out[t, a, b] = values[_position(pattern, s, ca, cb)] if s >= 0 else np.nan
                out[t, b, a] = out[t, a, b]
    return out


@njit()
def _read(pattern, values, dense):
    """Take the `values` of the pattern's blocks from a `dense` matrix."""
    for g in range(len(pattern.first) - 1):
        for s in range(pattern.first[g], pattern.first[g + 1]):
            h, at = pattern.partner[s], pattern.offset[s]
            for i in range(pattern.start[g], pattern.start[g + 1]):
                for j in range(pattern.start[h], pattern.start[h + 1]):
                    values[at] = dense[i, j]
                    at += 1


@njit()
def _add_product(pattern, values, left, right):
    """Add `left` @ `right`.T (both (n, k)) to the `values`, within the pattern."""
    for g in range(len(pattern.first) - 1):
        for s in range(pattern.first[g], pattern.first[g + 1]):
            h, at = pattern.partner[s], pattern.offset[s]
            for i in range(pattern.start[g], pattern.start[g + 1]):
                for j in range(pattern.start[h], pattern.start[h + 1]):
                    total = 0.0
                    for k in range(left.shape[1]):
                        total += left[i, k] * right[j, k]
                    values[at] += total
                    at += 1


@njit()
def _scale(pattern, values, scale):
    """Multiply the `values` by `scale` (n,) of their row and of their column."""
    for g in range(len(pattern.first) - 1):
        for s in range(pattern.first[g], pattern.first[g + 1]):
            h, at = pattern.partner[s], pattern.offset[s]
            for i in range(pattern.start[g], pattern.start[g + 1]):
                for j in range(pattern.start[h], pattern.start[h + 1]):
                    values[at] *= scale[i] * scale[j]
                    at += 1


@njit()
def _times(pattern, values, vectors):
    """(n, k): the symmetric matrix times `vectors` (n, k)."""
    out = np.zeros(vectors.shape)
    for g in range(len(pattern.first) - 1):
        for s in range(pattern.first[g], pattern.first[g + 1]):
            h, at = pattern.partner[s], pattern.offset[s]
            for i in range(pattern.start[g], pattern.start[g + 1]):
                for j in range(pattern.start[h], pattern.start[h + 1]):
                    # Diagonal blocks are stored whole: their lower half would otherwise count twice.
                    if h != g or j >= i:
                        for k in range(vectors.shape[1]):
                            out[i, k] += values[at] * vectors[j, k]
                            if i != j:
                                out[j, k] += values[at] * vectors[i, k]
                    at += 1
    return out
