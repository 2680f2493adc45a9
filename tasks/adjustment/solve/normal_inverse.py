"""The inverse of a normal matrix as something that multiplies and has blocks, but is never formed as a whole.

The matrix gets a unit diagonal first: unknowns differ by many powers of ten. In a free network the inverse is that with respect to
the inner constraints. These are dense (every unknown has a part in them) and would spoil the sparse matrix; so the block is held
by its last front alone, which is dense anyway, and the result carried over by the S-transformation P = I - H H' with the unit
freedoms H, which makes it independent of how the block was held.

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
    (n, 7, 6 or 0) unit freedoms of A; `norm`, the largest row sum of A."""

    cholesky: BlockCholesky
    scale: np.ndarray
    free: np.ndarray
    norm: float

    def times(self, vectors: np.ndarray) -> np.ndarray:
        """The product (n, k) with `vectors` (n, k)."""
        scale = self.scale[:, None]
        return scale * self._inner(self.cholesky.solve(self._inner(scale * vectors)))

    def _inner(self, vectors: np.ndarray) -> np.ndarray:
        return vectors - self.free @ (self.free.T @ vectors)

    def blocks(self) -> tuple[BlockMatrix, float]:
        """The inverse where the matrix has blocks, and the condition of A, by the row of A^-1 with the largest diagonal."""
        found, H = self.cholesky.selected_inverse(), self.free
        if H.shape[1]:
            across = self.cholesky.solve(H)
            half = across - 0.5 * H @ (H.T @ across)
            found.add_product(np.hstack([-H, -half]), np.hstack([half, H]))
        unit = np.zeros((len(found), 1))
        unit[found.diagonal().argmax()] = 1.0
        row = self._inner(self.cholesky.solve(self._inner(unit)))
        return found.scaled(self.scale), self.norm * float(np.abs(row).sum())


def inverse_of(network: Network, state: State, structure: Structure, matrix: BlockMatrix) -> Inverse:
    """The inverse of a normal matrix; considered parameters have no part in it. Raises LinAlgError where there is none."""
    considered = network.considered_columns
    scale = np.where(considered, 0.0, 1.0 / np.sqrt(np.maximum(matrix.diagonal(), 1e-300)))
    A = matrix.scaled(scale)
    A.values[diagonal_places(A.pattern)[considered]] = 1.0
    if not network.free:
        return Inverse(factorised(structure, A), scale, np.zeros((len(scale), 0)), A.row_sums().max())
    unit = np.where(considered, 1.0, scale)
    H = np.linalg.qr(freedoms(network, state) / unit[:, None])[0]
    hold = np.linalg.qr(H[structure.last])[0]
    return Inverse(factorised(structure, A, hold @ hold.T), scale, H, A.row_sums().max())
