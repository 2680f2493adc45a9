"""Dense operations on one front: elimination of its own unknowns, substitution, products.

They are sums of rows, eight at a time, each in a fixed order: the compiler vectorises them, and no result depends on the number of
threads that a library uses, as LAPACK's do. Runs on different machines therefore agree bit for bit.
"""

import numpy as np

from orthomill.kernels.kernel_compilation import njit

# Eight rows fit the vector registers, and the target is read and written once for all of them: the sweep is bound by memory.
SWEEP = 8
"""Rows that are subtracted in one sweep; `_less_eight` is written for this number."""


@njit()
def _less_eight(target, begin, f, rows):
    """Subtracts the products of eight factors `f` (8,) with eight `rows` (8, m) from the `target` (m,), from column `begin` on."""
    # Scalars of their own: the compiler cannot know that writing the target leaves the factors unchanged.
    f0, f1, f2, f3, f4, f5, f6, f7 = f[0], f[1], f[2], f[3], f[4], f[5], f[6], f[7]
    r0, r1, r2, r3, r4, r5, r6, r7 = rows[0], rows[1], rows[2], rows[3], rows[4], rows[5], rows[6], rows[7]
    for j in range(begin, len(target)):
        # Pairs of pairs: the eight products do not wait for each other.
        low = (f0 * r0[j] + f1 * r1[j]) + (f2 * r2[j] + f3 * r3[j])
        high = (f4 * r4[j] + f5 * r5[j]) + (f6 * r6[j] + f7 * r7[j])
        target[j] -= low + high


@njit()
def _less_rows(target, begin, f, rows):
    """Subtracts `f` (k,) times `rows` (k, m) from the `target` (m,), from column `begin` on."""
    whole = len(f) - len(f) % SWEEP
    for k in range(0, whole, SWEEP):
        _less_eight(target, begin, f[k : k + SWEEP], rows[k : k + SWEEP])
    for k in range(whole, len(f)):
        for j in range(begin, len(target)):
            target[j] -= f[k] * rows[k, j]


@njit()
def eliminate(F, own):
    """Cholesky's elimination of the first `own` unknowns of a symmetric F (m, m), in place, upper half: the first rows become those
    of U, the rest becomes the Schur complement. False where F is not positive definite."""
    for k in range(0, own, SWEEP):
        stop = min(k + SWEEP, own)
        for p in range(k, stop):
            _less_rows(F[p], p, F[k:p, p], F[k:p])
            # Negated, so that NaN fails, too.
            if not F[p, p] > 0.0:
                return False
            root = np.sqrt(F[p, p])
            for j in range(p, len(F)):
                F[p, j] /= root
        for i in range(stop, len(F)):
            _less_rows(F[i], i, F[k:stop, i], F[k:stop])
    return True


@njit()
def forward(U, X):
    """Forward substitution U'^-1 X of the own unknowns, in place; U (s, m), X (m, c). The rows of the boundary are reduced."""
    for k in range(len(U)):
        for c in range(X.shape[1]):
            X[k, c] /= U[k, k]
        for j in range(k + 1, len(X)):
            for c in range(X.shape[1]):
                X[j, c] -= U[k, j] * X[k, c]


@njit()
def backward(U, X):
    """Back substitution U^-1 X of the own unknowns, in place; U (s, m), X (m, c), whose rows of the boundary are known."""
    for k in range(len(U) - 1, -1, -1):
        _less_rows(X[k], 0, U[k, k + 1 :], X[k + 1 :])
        for c in range(X.shape[1]):
            X[k, c] /= U[k, k]


@njit()
def take_product(C, A, B):
    """C -= A B."""
    for i in range(len(C)):
        _less_rows(C[i], 0, A[i], B)
