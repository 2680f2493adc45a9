"""Dense operations on a front against LAPACK, at sizes around the sweep of eight rows."""

import numpy as np
import pytest
from scipy.linalg import cholesky, solve_triangular

from orthomill.tasks.adjustment.sparse.front_kernels import SWEEP, backward, eliminate, forward, take_product

SIZES = [(1, 1), (3, 7), (7, 8), (8, 8), (9, 20), (16, 17), (23, 40)]


def positive(m, seed=0):
    half = np.random.default_rng(seed).standard_normal((m, m))
    return half @ half.T + m * np.eye(m)


@pytest.mark.parametrize(("own", "m"), SIZES)
def test_elimination_leaves_factor_and_schur_complement(own, m):
    A = positive(m)
    F = np.triu(A)
    assert eliminate(F, own)
    U = cholesky(A)[:own]
    assert np.allclose(np.triu(F)[:own], U, atol=1e-12 * m)
    rest = A[own:, own:] - A[own:, :own] @ np.linalg.solve(A[:own, :own], A[:own, own:])
    assert np.allclose(np.triu(F[own:, own:]), np.triu(rest), atol=1e-11 * m)


@pytest.mark.parametrize("wrong", [0.0, -1.0, np.nan])
def test_a_matrix_that_is_not_positive_definite_is_refused(wrong):
    F = np.triu(positive(12))
    F[9, 9] = wrong
    assert not eliminate(F.copy(), 12)
    assert eliminate(F.copy(), 9), "the eliminated part is"


@pytest.mark.parametrize(("own", "m"), SIZES)
def test_substitutions_invert_the_factor(own, m):
    rng = np.random.default_rng(1)
    U = cholesky(positive(m))[:own].copy()
    X = rng.standard_normal((m, 3))
    there = X.copy()
    forward(U, there)
    first = solve_triangular(U[:, :own], X[:own], trans="T")
    assert np.allclose(there[:own], first) and np.allclose(there[own:], X[own:] - U[:, own:].T @ first)
    back = X.copy()
    backward(U, back)
    assert np.allclose(back[:own], solve_triangular(U[:, :own], X[:own] - U[:, own:] @ X[own:]))
    assert (back[own:] == X[own:]).all()


@pytest.mark.parametrize("inner", [0, 1, SWEEP - 1, SWEEP, SWEEP + 1, 3 * SWEEP + 2])
def test_products_are_subtracted(inner):
    rng = np.random.default_rng(2)
    A, B, C = rng.standard_normal((5, inner)), rng.standard_normal((inner, 11)), rng.standard_normal((5, 11))
    expected = C - A @ B
    take_product(C, A, B)
    assert np.allclose(C, expected, atol=1e-13)
