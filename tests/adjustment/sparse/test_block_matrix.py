"""Block matrices against dense ones: every operation on random patterns."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse import csr_array

from orthomill.tasks.adjustment.sparse.block_matrix import BlockMatrix, diagonal_places, pattern_of, summed

SEEDS = st.integers(0, 10**6)


def random_pattern(rng, groups=6, links=5):
    """A pattern of groups of one to four unknowns, some of which share a clique."""
    pairs = rng.integers(0, groups, (links, 2))
    cliques = csr_array((np.ones(pairs.size), pairs.ravel(), 2 * np.arange(links + 1)), shape=(links, groups))
    return pattern_of(np.concatenate([[0], np.cumsum(rng.integers(1, 5, groups))]), cliques)


def mask(pattern):
    """(n, n) bool: where the pattern has blocks."""
    inside = np.zeros((len(pattern.start) - 1,) * 2, bool)
    inside[pattern.rows, pattern.partner] = inside[pattern.partner, pattern.rows] = True
    return inside[pattern.owner][:, pattern.owner]


def random_matrix(seed):
    rng = np.random.default_rng(seed)
    pattern = random_pattern(rng)
    whole = rng.standard_normal((pattern.start[-1],) * 2)
    dense = (whole + whole.T) * mask(pattern)
    return rng, BlockMatrix.of(pattern, dense), dense


@settings(max_examples=30, deadline=None)
@given(seed=SEEDS)
def test_a_dense_matrix_comes_back_from_its_blocks(seed):
    _, matrix, dense = random_matrix(seed)
    assert np.allclose(matrix.dense(), dense, atol=1e-15) and len(matrix) == len(dense)
    assert matrix.diagonal() == pytest.approx(np.diag(dense))
    assert (matrix.values[diagonal_places(matrix.pattern)] == np.diag(dense)).all()


@settings(max_examples=30, deadline=None)
@given(seed=SEEDS)
def test_products_sums_and_scaling_equal_the_dense_ones(seed):
    rng, matrix, dense = random_matrix(seed)
    vectors, scale = rng.standard_normal((len(dense), 3)), rng.uniform(0.1, 2.0, len(dense))
    assert np.allclose(matrix.times(vectors), dense @ vectors, atol=1e-12)
    assert matrix.row_sums() == pytest.approx(np.abs(dense).sum(axis=1))
    before = matrix.values.copy()
    assert np.allclose(matrix.scaled(scale).dense(), scale[:, None] * dense * scale, atol=1e-13)
    assert (matrix.values == before).all(), "scaling returns another matrix"


@settings(max_examples=30, deadline=None)
@given(seed=SEEDS)
def test_an_outer_product_is_added_inside_the_pattern_only(seed):
    rng, matrix, dense = random_matrix(seed)
    left, right = rng.standard_normal((2, len(dense), 2))
    matrix.add_product(left, left + right)
    matrix.add_product(left + right, left)
    expected = left @ (left + right).T + (left + right) @ left.T
    assert np.allclose(matrix.dense(), dense + expected * mask(matrix.pattern), atol=1e-12)


@settings(max_examples=30, deadline=None)
@given(seed=SEEDS)
def test_pieces_are_read_where_they_were_added(seed):
    rng, matrix, dense = random_matrix(seed)
    pattern = matrix.pattern
    block = rng.integers(0, len(pattern.partner))
    g, h = pattern.rows[block], pattern.partner[block]
    columns = np.unique(np.concatenate([np.arange(*pattern.start[g : g + 2]), np.arange(*pattern.start[h : h + 2])]))
    columns = rng.permutation(np.append(columns, -1))
    piece = rng.standard_normal((len(columns),) * 2)
    piece = piece + piece.T
    matrix.add(columns, piece[None])
    there = columns >= 0
    expected = dense.copy()
    expected[np.ix_(columns[there], columns[there])] += piece[np.ix_(there, there)]
    assert np.allclose(matrix.dense(), expected, atol=1e-13)
    read = matrix.pieces(columns)[0]
    assert np.allclose(read[np.ix_(there, there)], expected[np.ix_(columns[there], columns[there])], atol=1e-13)
    assert not read[~there].any() and not read[:, ~there].any()


def three_groups():
    """Groups 0 and 1 have a block, 2 has none with them."""
    return pattern_of(np.array([0, 2, 3, 5]), csr_array(np.array([[1.0, 1.0, 0.0]])))


def test_a_missing_block_is_nan_when_read_and_an_error_when_written():
    matrix = BlockMatrix.zero(three_groups())
    read = matrix.pieces(np.array([0, 2, 4]))[0]
    assert np.isnan(read[0, 2]) and np.isnan(read[1, 2]) and read[0, 1] == 0.0 and read[2, 2] == 0.0
    with pytest.raises(ValueError, match="no block for this piece"):
        matrix.add(np.array([0, 4]), np.ones((1, 2, 2)))


def test_groups_without_any_link_have_their_diagonal_block():
    pattern = three_groups()
    assert list(zip(pattern.rows, pattern.partner, strict=True)) == [(0, 0), (0, 1), (1, 1), (2, 2)]
    assert list(np.diff(pattern.offset)) == [4, 2, 1, 4] and list(pattern.owner) == [0, 0, 1, 2, 2]


def test_parts_are_summed_by_unknown():
    columns = np.array([[0, 2], [2, -1]])
    assert list(summed(columns, np.array([[1.0, 2.0], [4.0, 8.0]]), 4)) == [1.0, 0.0, 6.0, 0.0]
