"""Symmetric systems of a few unknowns, for kernels: Cholesky, without allocation.

Strategy. `factor` returns the lower triangle with the inverse of its diagonal, so that `solve` needs no division. Pivots below 1e-6
of their diagonal element count as zero: the texture does not determine that unknown.
"""

import numpy as np

from orthomill.kernels.kernel_compilation import njit

_PIVOT = 1e-6


@njit(error_model="numpy")
def factor(matrix, size, lower):
    """Factor the leading `size` rows of a symmetric matrix; False where it is not positive definite.

    lower (>= size, >= size): the Cholesky factor below its diagonal, on the diagonal the inverse of the factor's.
    """
    for i in range(size):
        for j in range(i):
            total = matrix[i, j]
            for k in range(j):
                total -= lower[i, k] * lower[j, k]
            lower[i, j] = total * lower[j, j]
        total = matrix[i, i]
        for k in range(i):
            total -= lower[i, k] * lower[i, k]
        # Stated as "not above", so that NaN counts as singular.
        if not (total > _PIVOT * matrix[i, i] and matrix[i, i] > 0.0):
            return False
        lower[i, i] = 1.0 / np.sqrt(total)
    return True


@njit(error_model="numpy")
def solve(lower, size, x):
    """Overwrite the right side `x` (size,) with the solution."""
    # Forward substitution, then back substitution with the transpose.
    for i in range(size):
        total = x[i]
        for k in range(i):
            total -= lower[i, k] * x[k]
        x[i] = total * lower[i, i]
    for i in range(size - 1, -1, -1):
        total = x[i]
        for k in range(i + 1, size):
            total -= lower[k, i] * x[k]
        x[i] = total * lower[i, i]
