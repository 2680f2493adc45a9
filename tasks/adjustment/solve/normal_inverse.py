"""The inverse of a normal matrix: its products with vectors and its blocks; it is never formed as a whole.

The matrix is scaled to a unit diagonal first, because unknowns differ by many powers of ten. In a free network the inverse is that
with respect to the inner constraints. These are dense (they involve every unknown) and would fill the sparse matrix. The datum is
therefore defined in the last front alone, which is dense anyway, and the result transformed by P = I - H H' (S-transformation) with
an orthonormal basis H of the null space, which makes it independent of the datum.

Source: Baarda 1973, "S-transformations and criterion matrices"; Meissl 1969 for inner constraints.
"""

from dataclasses import dataclass

import numpy as np

from orthomill.tasks.adjustment.model.datum import freedoms
from orthomill.tasks.adjustment.model.network import Network, State
from orthomill.tasks.adjustment.sparse.block_cholesky import BlockCholesky, Structure, factorised
from orthomill.tasks.adjustment.sparse.block_matrix import BlockMatrix, diagonal_places


@dataclass(frozen=True, eq=False)
class Inverse:
    """The inverse of S^-1 A S^-1, where A has a unit diagonal: `scale` S (n,), 0 for unknowns that keep their value; `free`
    (n, 7, 6 or 0) an orthonormal basis of the null space of A; `norm`, the largest row sum of A."""

    cholesky: BlockCholesky
    scale: np.ndarray
    free: np.ndarray
    norm: float

    def times(self, vectors: np.ndarray) -> np.ndarray:
        """The product (n, k) with `vectors` (n, k)."""
        scale = self.scale[:, None]
        return scale * self._inner(self.cholesky.solve(self._inner(scale * vectors)))

    def _inner(self, vectors: np.ndarray) -> np.ndarray:
        """The part of `vectors` that the observations determine: P vectors."""
        return vectors - self.free @ (self.free.T @ vectors)

    def blocks(self) -> tuple[BlockMatrix, float]:
        """The inverse in the blocks of the matrix, and a lower bound of the condition of A, from one row of its inverse."""
        found, H = self.cholesky.selected_inverse(), self.free
        if H.shape[1]:
            # P X P = X - H h' - h H' with h = X H - H (H' X H) / 2: two products of rank seven, instead of a dense matrix.
            across = self.cholesky.solve(H)
            half = across - 0.5 * H @ (H.T @ across)
            found.add_product(np.hstack([-H, -half]), np.hstack([half, H]))
        # The worst determined unknown has the largest diagonal element, and its row the largest sum but for correlations.
        unit = np.zeros((len(found), 1))
        unit[found.diagonal().argmax()] = 1.0
        row = self._inner(self.cholesky.solve(self._inner(unit)))
        return found.scaled(self.scale), self.norm * float(np.abs(row).sum())


def inverse_of(network: Network, state: State, structure: Structure, matrix: BlockMatrix) -> Inverse:
    """The inverse of a normal matrix; considered parameters are excluded. Raises LinAlgError where it does not exist."""
    considered = network.considered_columns
    scale = np.where(considered, 0.0, 1.0 / np.sqrt(np.maximum(matrix.diagonal(), 1e-300)))
    A = matrix.scaled(scale)
    # Rows and columns of considered parameters are 0 by their scale; a unit diagonal keeps the matrix positive definite.
    A.values[diagonal_places(A.pattern)[considered]] = 1.0
    if not network.free:
        return Inverse(factorised(structure, A), scale, np.zeros((len(scale), 0)), A.row_sums().max())
    unit = np.where(considered, 1.0, scale)
    H = np.linalg.qr(freedoms(network, state) / unit[:, None])[0]
    hold = np.linalg.qr(H[structure.last])[0]
    return Inverse(factorised(structure, A, hold @ hold.T), scale, H, A.row_sums().max())
