"""Covariance of the adjusted unknowns: orientations, cameras, shift, lever arm and kept points jointly; other points one by one.

The covariance of the reduced system is the inverse of its normal matrix, in a free network with respect to the inner constraints.
It is stored in the blocks of the normal matrix (photographs that share points, cameras with their photographs), which points and
rays need; any other part of it is computed on request. The uncertainty of parameters that keep their value (considered, Schmidt
1966) is propagated into all others.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag
from scipy.sparse import csc_array, csr_array, vstack

from orthomill.schemas.errors import GeometryError
from orthomill.tasks.adjustment.model.datum import add_prior
from orthomill.tasks.adjustment.model.linearisation import Linear, seen_pattern, structure
from orthomill.tasks.adjustment.model.network import Network, State
from orthomill.tasks.adjustment.solve.minimise import UNDETERMINED
from orthomill.tasks.adjustment.solve.normal_equations import point_covariances, point_precision, reduced_normals
from orthomill.tasks.adjustment.solve.normal_inverse import Inverse, inverse_of
from orthomill.tasks.adjustment.sparse.block_matrix import BlockMatrix, Pattern

# Above this no digit of a float64 solution is left.
WORST_CONDITION = 1e15
"""Condition of the normal matrix with unit diagonal beyond which the unknowns are not determined."""
COLUMNS = 60
"""of a covariance that are made at a time"""


@dataclass(frozen=True, eq=False)
class Motion:
    """How quantities that are many and act on few unknowns each move all of them: the solutions, by `inverse`, for the right-hand
    sides `pulls` (n, k) of one standard error of each. The solutions (n, k) are dense, and never formed. Where something is `known`
    (k, d) of the quantities, their covariance is I - known known'."""

    inverse: Inverse
    pulls: csc_array
    known: np.ndarray | None = None

    def times(self, vectors: np.ndarray) -> np.ndarray:
        """The covariance of the unknowns under these quantities, times `vectors` (n, k)."""
        return self.inverse.times(self.pulls @ self.unknown(self.pulls.T @ self.inverse.times(vectors)))

    def unknown(self, vectors: np.ndarray) -> np.ndarray:
        """The covariance of the quantities times `vectors` (k, m)."""
        return vectors if self.known is None else vectors - self.known @ (self.known.T @ vectors)


@dataclass(frozen=True, eq=False)
class Covariance:
    """Covariance of the n unknowns of the reduced system: its `blocks`, the `inverse` for the rest, `moves` (n, k): the effect
    on the unknowns of one standard error of every considered parameter, and what errors that are `correlated` add."""

    blocks: BlockMatrix
    inverse: Inverse
    moves: np.ndarray
    correlated: Motion | None = None

    def __len__(self) -> int:
        return len(self.blocks)

    @property
    def variances(self) -> np.ndarray:
        """(n,) of the unknowns."""
        return self.blocks.diagonal()

    def times(self, vectors: np.ndarray) -> np.ndarray:
        """The product (n, k) with `vectors` (n, k)."""
        white = self.inverse.times(vectors) + self.moves @ (self.moves.T @ vectors)
        return white if self.correlated is None else white + self.correlated.times(vectors)

    def joint(self, columns: np.ndarray) -> np.ndarray:
        """(m, m) of the unknowns `columns` (m,); 0 for -1."""
        # Most requests are for one photograph or camera, whose block is stored.
        known = self.blocks.pieces(columns)[0]
        if np.isfinite(known).all():
            return known
        there = columns >= 0
        unit = np.zeros((len(self), len(columns)))
        unit[columns[there], np.flatnonzero(there)] = 1.0
        return np.where(there[:, None], self.times(unit)[columns], 0.0)

    def of_pattern(self, pattern: Pattern) -> BlockMatrix:
        """The covariance in the blocks of another pattern of the same groups, computed block by block."""
        out, start = BlockMatrix.zero(pattern), pattern.start
        for block, (g, h) in enumerate(zip(pattern.rows, pattern.partner, strict=True)):
            columns = np.concatenate([np.arange(*start[g : g + 2]), np.arange(*start[h : h + 2])])
            size = start[g + 1] - start[g]
            part = self.joint(columns)[:size, -(start[h + 1] - start[h]) :]
            out.values[pattern.offset[block] : pattern.offset[block + 1]] = part.ravel()
        return out


def covariance_of(network: Network, state: State, linear: Linear) -> Covariance:
    """The inverse of the reduced normal matrix, in a free network with respect to the inner constraints.

    Rows of considered parameters are zero; `with_considered` adds their contribution. Raises GeometryError where the observations
    do not determine the unknowns.
    """
    order = structure(network, state, linear)
    matrix = reduced_normals(linear, order.pattern).matrix
    add_prior(network, state, matrix)
    try:
        inverse = inverse_of(network, state, order, matrix)
        blocks, condition = inverse.blocks()
    except np.linalg.LinAlgError:
        raise GeometryError(UNDETERMINED) from None
    if not np.isfinite(blocks.values).all() or not condition <= WORST_CONDITION:
        raise GeometryError(UNDETERMINED)
    return Covariance(blocks, inverse, np.zeros((len(blocks), 0)))


def with_considered(network: Network, linear: Linear, cofactor: Covariance) -> Covariance:
    """The covariance with the uncertainty of the considered parameters propagated into all others.

    The unknowns change by -Q N_uk per unit of a considered parameter, whose own covariance is the prior one. Source: Schmidt 1966.
    """
    considered = np.flatnonzero(network.considered_columns)
    if not len(considered):
        return cofactor
    unit = np.zeros((len(cofactor), len(considered)))
    unit[considered, np.arange(len(considered))] = 1.0
    normal = reduced_normals(linear, cofactor.blocks.pattern).matrix
    # A root of the prior covariance instead of itself: the sum of its squares is positive semidefinite whatever the rounding.
    values, vectors = np.linalg.eigh(_considered_covariance(network))
    moves = (unit - cofactor.times(normal.times(unit))) @ (vectors * np.sqrt(np.maximum(values, 0.0)))
    blocks = BlockMatrix(cofactor.blocks.pattern, cofactor.blocks.values.copy())
    blocks.add_product(moves, moves)
    return replace(cofactor, blocks=blocks, moves=moves)


def _considered_covariance(network: Network) -> np.ndarray:
    """Prior covariance (k, k) of the considered parameters, camera by camera, in the order of their columns."""
    blocks = []
    for free, considered, weight in zip(network.interior.free, network.interior.considered, network.interior.weight, strict=True):
        chosen = np.flatnonzero(free & (np.diag(weight) > 0))
        inside = np.isin(chosen, np.flatnonzero(considered))
        scale = 1.0 / np.sqrt(np.maximum(np.diag(weight)[chosen], 1e-300))
        covariance = np.linalg.inv(weight[np.ix_(chosen, chosen)] * scale[:, None] * scale) * scale[:, None] * scale
        blocks.append(covariance[np.ix_(inside, inside)])
    return block_diag(*blocks)


def points_and_rays(network: Network, linear: Linear, cofactor: Covariance) -> tuple[np.ndarray, np.ndarray]:
    """Covariance (N, 3, 3) of all points, kept ones too, and variances (M, 2) px^2 of the computed image coordinates."""
    points, adjusted = point_precision(linear, cofactor.blocks)
    return _with_kept(network, cofactor, points), adjusted


def points_alone(network: Network, linear: Linear, cofactor: Covariance) -> np.ndarray:
    """Covariance (N, 3, 3) of all points, kept ones too."""
    return _with_kept(network, cofactor, point_covariances(linear, cofactor.blocks))


def _with_kept(network: Network, cofactor: Covariance, points: np.ndarray) -> np.ndarray:
    # Kept points are unknowns of the reduced system: for them the elimination left only zeros.
    points[network.kept] = cofactor.blocks.pieces(network.kept_columns)
    return points


def points_elsewhere(linear: Linear, cofactor: Covariance) -> np.ndarray:
    """Covariance (N, 3, 3) of points that took no part in the adjustment and may connect photographs without common points."""
    return point_covariances(linear, cofactor.of_pattern(seen_pattern(linear, cofactor.blocks.pattern.start)))


def distances_elsewhere(linear: Linear, cofactor: Covariance, point: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """(d,) m^2 of the distances between points (n, 3) that took no part, by the numbers of their `ends` (d, 2): errors of the
    orientation move neighbouring points alike, which their own covariances do not tell."""
    moved = {i: _movement(linear, i, len(cofactor)) for i in map(int, np.unique(ends))}
    variances = []
    for i, j in ends.tolist():
        towards = (point[j] - point[i]) / np.linalg.norm(point[j] - point[i])
        pull = towards @ (moved[j][0] - moved[i][0])
        own = towards @ (moved[i][1] + moved[j][1]) @ towards
        variances.append(float(own + pull @ cofactor.times(pull[:, None])[:, 0]))
    return np.array(variances)


def joint_elsewhere(linear: Linear, cofactor: Covariance, points: np.ndarray) -> np.ndarray:
    """Covariance (3k, 3k) m^2 of the points (k,) that took no part, all coordinates of a point in a row: errors of the orientation
    move them together, their own rays move each by itself."""
    moved, own = [], []
    for point in map(int, points):
        by_unknowns, alone = _movement(linear, point, len(cofactor))
        moved.append(csr_array(by_unknowns))
        own.append(alone)
    movement = vstack(moved, format="csr")
    # A few columns at a time: all would be as many as unknowns times points.
    shared = [
        movement @ cofactor.times(movement[first : first + COLUMNS].toarray().T) for first in range(0, movement.shape[0], COLUMNS)
    ]
    return np.hstack(shared) + block_diag(*own)


def _movement(linear: Linear, point: int, unknowns: int) -> tuple[np.ndarray, np.ndarray]:
    """(3, unknowns) derivatives of an intersected point by orientation and cameras, and its covariance (3, 3) by its rays alone."""
    own = slice(linear.first[point], linear.first[point + 1])
    jp = linear.jp[own] @ linear.frame[point].T
    weighted = (linear.weight[own, None, None] * jp).swapaxes(1, 2)
    alone = np.linalg.inv((weighted @ jp).sum(axis=0))
    by_unknowns = np.zeros((3, unknowns))
    for columns, normal in zip(linear.columns[linear.row[own]], weighted @ linear.jg[own], strict=True):
        by_unknowns[:, columns[columns >= 0]] += normal[:, columns >= 0]
    return -alone @ by_unknowns, alone
