"""Dense work on one front: elimination of its own unknowns, substitution, products.

Written as sums of rows, eight at a time, each in a fixed order: the compiler makes vectors of them, and no result depends on how
many threads a library finds, as those of LAPACK do.
"""

import numpy as np
from numba import njit

TOGETHER = 8
"""Rows that are subtracted in one sweep; `_less_rows` is written for as many."""


@njit(cache=True)
def _less_eight(target, begin, f0, f1, f2, f3, f4, f5, f6, f7, rows):
    """Takes the products of eight factors with eight `rows` (8, m) off the `target` (m,), from column `begin` on."""
    r0, r1, r2, r3, r4, r5, r6, r7 = rows[0], rows[1], rows[2], rows[3], rows[4], rows[5], rows[6], rows[7]
    for j in range(begin, len(target)):
        target[j] -= (((f0 * r0[j] + f1 * r1[j]) + (f2 * r2[j] + f3 * r3[j])) +
                      ((f4 * r4[j] + f5 * r5[j]) + (f6 * r6[j] + f7 * r7[j])))  # fmt: skip


@njit(cache=True)
def _less_rows(target, begin, f, rows):
    """Takes `f` (k,) times `rows` (k, m) off the `target` (m,), from column `begin` on."""
    whole = len(f) - len(f) % TOGETHER
    for k in range(0, whole, TOGETHER):
        _less_eight(
            target, begin, f[k], f[k + 1], f[k + 2], f[k + 3], f[k + 4], f[k + 5], f[k + 6], f[k + 7], rows[k : k + TOGETHER]
        )
    for k in range(whole, len(f)):
        for j in range(begin, len(target)):
            target[j] -= f[k] * rows[k, j]


@njit(cache=True)
def eliminate(F, own):
    """Cholesky's elimination of the first `own` unknowns of a symmetric F (m, m), in place, upper half: the first rows become U
    with U'U = F there, the rest is what they leave over. False where F is not positive."""
    for k in range(0, own, TOGETHER):
        stop = min(k + TOGETHER, own)
        for p in range(k, stop):
            _less_rows(F[p], p, F[k:p, p], F[k:p])
            if not F[p, p] > 0.0:
                return False
            root = np.sqrt(F[p, p])
            for j in range(p, len(F)):
                F[p, j] /= root
        for i in range(stop, len(F)):
            _less_rows(F[i], i, F[k:stop, i], F[k:stop])
    return True


@njit(cache=True)
def forward(U, X):
    """U'^-1 for the own unknowns, in place; U (s, m), X (m, c). What follows from them is taken off the rows below."""
    for k in range(len(U)):
        for c in range(X.shape[1]):
            X[k, c] /= U[k, k]
        for j in range(k + 1, len(X)):
            for c in range(X.shape[1]):
                X[j, c] -= U[k, j] * X[k, c]


@njit(cache=True)
def backward(U, X):
    """U^-1 for the own unknowns, in place; U (s, m), X (m, c), of which the rows below are known."""
    for k in range(len(U) - 1, -1, -1):
        _less_rows(X[k], 0, U[k, k + 1 :], X[k + 1 :])
        for c in range(X.shape[1]):
            X[k, c] /= U[k, k]


@njit(cache=True)
def take_product(C, A, B):
    """C -= A B."""
    for i in range(len(C)):
        _less_rows(C[i], 0, A[i], B)
